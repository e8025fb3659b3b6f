"""Reductions: results of a run, such as a peak force, that are updated at every accepted step."""

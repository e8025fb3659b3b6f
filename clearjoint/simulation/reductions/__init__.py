"""Reductions: results, such as a peak force, that are updated at every accepted step of a run."""

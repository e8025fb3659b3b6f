"""Reductions: results that are accumulated during a run, at every accepted step."""

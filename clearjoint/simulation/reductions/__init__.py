"""Reductions: numbers of a run, updated at every accepted step."""

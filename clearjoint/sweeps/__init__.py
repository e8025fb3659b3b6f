"""Sweeps: many runs of one mechanism, their results and where they are computed."""

"""Starts for fits, screened by many runs without derivatives."""

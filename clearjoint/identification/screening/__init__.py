"""Screening: starts for fits by many runs without derivatives."""

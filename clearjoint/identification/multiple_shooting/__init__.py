"""Fits of long records in windows, each with a start of its own."""

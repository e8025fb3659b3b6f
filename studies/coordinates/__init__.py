"""Absolute and joint coordinates side by side."""

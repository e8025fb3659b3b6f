"""Bouncing balls, measured by others."""

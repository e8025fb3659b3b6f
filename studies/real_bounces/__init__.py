"""Measured bouncing balls."""

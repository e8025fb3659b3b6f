"""Measured series of quantities with their noise."""

"""Measured series of quantities with their noise: reading of files, conversion of units, and
residuals of predictions."""

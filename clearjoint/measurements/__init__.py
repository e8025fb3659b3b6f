"""Measured series: units, files and residuals."""

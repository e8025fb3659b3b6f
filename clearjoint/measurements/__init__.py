"""Measured series: units, files, residuals. Nothing here fits anything."""

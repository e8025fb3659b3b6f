"""Estimation of parameters from measurements: least squares, starts, confidence, reports."""

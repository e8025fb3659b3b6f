"""Parameters from measurements: least squares, starts, confidence, reports."""

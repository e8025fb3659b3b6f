"""Estimation of parameters from measurements: fits by least squares, searches for starting points,
posterior distributions, and reports. Other modules minimise a function of a motion, and search for
the largest value of a parameter within limits."""

"""Estimation of parameters from measurements: fits by least squares, searches for starting points,
posterior distributions, and reports. Modules `minimise` and `largest` need no measurements: they
minimise a function of a motion, and search for the largest value of a parameter for which
quantities stay within limits."""

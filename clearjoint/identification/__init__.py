"""Estimation of parameters from measurements: fits by least squares, searches for starting points,
posterior distributions, and reports. Two modules need no measurements: `minimise`
minimises a function of a motion, and `largest` searches for the largest value of a parameter for
which quantities stay within limits."""

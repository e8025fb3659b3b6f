"""Estimation of parameters from measurements: fits by least squares, searches for starting points,
posterior distributions, and reports. `minimise` needs none: it minimises a function of a motion.

In all modules here, the coordinate of a parameter is its value on its scale, such as the logarithm
of the value, a point is the coordinates of all p parameters, and residuals are in standard
deviations of the noise.
"""

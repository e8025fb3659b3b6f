"""Estimation of parameters from measurements: fits by least squares, searches for starting points,
posterior distributions, and reports. One module needs no measurements: `minimise` minimises a
function of a motion."""

"""Arithmetic on scalars, without mechanics: vectors, rotations, smoothing, interpolation, small
linear systems, and groups of bodies or joints of the same structure, computed at once as arrays."""

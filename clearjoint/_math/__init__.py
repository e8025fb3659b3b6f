"""Arithmetic on scalars, without mechanics: vectors, rotations, smoothing, interpolation,
and small linear systems."""

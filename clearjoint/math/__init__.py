"""Arithmetic on scalars, without mechanics: vectors, rotations, smoothing, interpolation, small
linear systems, and groups of elements that are computed as arrays."""

"""Arithmetic on scalars, independent of mechanics: vectors, rotations, smoothing, interpolation,
small linear systems, and groups of alike elements."""

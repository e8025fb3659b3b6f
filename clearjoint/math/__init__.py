"""Scalar arithmetic, independent of mechanisms: vectors, rotations, smoothing, interpolation, small
linear systems, and groups of elements with the same structure."""

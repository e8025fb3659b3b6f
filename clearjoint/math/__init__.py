"""Arithmetic in scalar form: vectors, rotations, smoothing, small linear systems, and several
alike elements in the place of one. Nothing here knows mechanisms."""

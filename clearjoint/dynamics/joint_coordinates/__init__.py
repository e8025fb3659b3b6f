"""Coordinates of a tree of joints, with the mass matrix by composite rigid bodies."""

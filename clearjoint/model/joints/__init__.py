"""Ideal joints between bodies, their constraint rows and motion subspaces.

The interfaces of all elements of a scene are in `base`.
"""

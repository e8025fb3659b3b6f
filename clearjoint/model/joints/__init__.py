"""Ideal joints between bodies, their constraint rows and motion subspaces.

A motion subspace is the set of relative motions that a joint allows. The interfaces of all elements
of a scene are in `base`.
"""

"""Ideal joints between bodies, their constraint rows and motion subspaces.

A constraint row is one scalar constraint equation with its derivatives. A motion subspace is the
set of relative motions that a joint allows. The interfaces of all elements of a scene (joints,
forces and drivers) are in the module `base`.
"""

"""Arithmetic on scalars, without mechanics."""

"""Ideal joints between bodies, their constraint rows and motion subspaces, and interfaces of
elements."""

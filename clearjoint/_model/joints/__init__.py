"""Ideal joints, their constraint rows and motion subspaces, and interfaces of elements."""

"""Ideal joints between bodies, and the constraint rows and motion subspaces of which they consist;
what any element of a scene may do is in `base`."""

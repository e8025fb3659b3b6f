"""Mutation test of the kernels: how many small changes of the code the fast tests catch."""

"""Largest value of a parameter for which quantities stay within their limits."""

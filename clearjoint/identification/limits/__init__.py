"""Search for the largest value of a parameter for which quantities stay within their limits."""

"""The largest value of a parameter with which quantities stay within their limits."""

"""Accuracy that sensors can give, before there are data."""

"""Mechanisms from the literature, each with its initial state."""

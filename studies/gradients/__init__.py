"""Gradients in reverse mode: what they cost, and what they are good for."""

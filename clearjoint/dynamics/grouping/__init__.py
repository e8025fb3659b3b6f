"""Alike elements of a scene put together, and coordinates for what results."""

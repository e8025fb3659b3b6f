"""Numbers of a scene by their paths: list, replace, scale and vary them, and build the family of
scenes that parameters span. This package runs no simulation."""

"""Scenes and states in TOML, JSON and URDF files. The format of TOML and JSON follows from the
arguments of the classes and their units."""

"""Scenes and states in TOML, JSON and URDF files.

A table of a TOML or JSON file contains the arguments of a class by name, and a number may be a text
with a unit. So the classes themselves define the format.
"""

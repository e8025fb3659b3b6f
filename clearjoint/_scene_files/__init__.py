"""Scenes and states in TOML, JSON and URDF files, whose tables contain the arguments of classes."""

"""Scenes and states as files, TOML or JSON, whose form follows from the classes and their units;
and scenes of URDF files."""

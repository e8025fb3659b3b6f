"""Parse MJCF files with MuJoCo."""

from pathlib import Path

from .robots import Content


def read_mjcf(path: Path) -> Content:
    """Return the content of an MJCF file."""
    raise NotImplementedError

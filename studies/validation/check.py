"""A published value, and that of clearjoint."""

from typing import NamedTuple


class Check(NamedTuple):
    """A published value of a source, and that of clearjoint; no unit means dimensionless."""

    source: str
    name: str
    unit: str
    published: float
    ours: float

    @property
    def difference(self) -> float:
        """Difference relative to the published value, or if dimensionless at least to one."""
        scale = abs(self.published) if self.unit else max(abs(self.published), 1.0)
        return abs(self.ours - self.published) / scale

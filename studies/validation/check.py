"""A published value and ours."""

from typing import NamedTuple


class Check(NamedTuple):
    """A value of a source and ours, in the unit named; none has no dimension."""

    source: str
    name: str
    unit: str
    published: float
    ours: float

    @property
    def difference(self) -> float:
        """The difference relative to the published value, or to one where that is smaller."""
        scale = abs(self.published) if self.unit else max(abs(self.published), 1.0)
        return abs(self.ours - self.published) / scale

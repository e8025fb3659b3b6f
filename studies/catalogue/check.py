"""One line of the catalogue: what an entry was compared with, and how far off it is."""

from typing import NamedTuple


class Check(NamedTuple):
    """An entry of the catalogue beside something that nobody here computed.

    `entry`: its name in clearjoint; `source`: where its formula is from; `against`: what it is
    compared with; `error` and `within`: how far off it is, relative unless `against` says
    otherwise, and how far it may be; `figure`: of the family's picture, or another study's.
    """

    entry: str
    source: str
    against: str
    error: float
    within: float
    figure: str

    @property
    def holds(self) -> bool:
        """Whether the entry is as near as it has to be."""
        return self.error <= self.within

    def cells(self) -> list[str]:
        """Its row of a table."""
        error = f"{self.error:.1e} of {self.within:.0e}" + ("" if self.holds else " **fails**")
        return [f"`{self.entry}`", self.source, self.against, error, self.figure]


HEAD = ["entry", "source", "compared with", "off, of what is allowed", "figure"]

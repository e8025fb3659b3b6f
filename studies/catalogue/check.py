"""Row of the catalogue: an entry, its comparison and its error."""

from typing import NamedTuple


class Check(NamedTuple):
    """An entry of the catalogue compared with an independent result.

    - `entry`: name in clearjoint.
    - `source`: source of the formula.
    - `against`: what it is compared with.
    - `error`, `within`: error, relative unless `against` says otherwise, and allowed error.
    - `figure`: Markdown link to a figure.
    """

    entry: str
    source: str
    against: str
    error: float
    within: float
    figure: str

    @property
    def holds(self) -> bool:
        """Whether the error is within the allowed one."""
        return self.error <= self.within

    def cells(self) -> list[str]:
        """Return the row as text."""
        error = f"{self.error:.1e} of {self.within:.0e}" + ("" if self.holds else " **fails**")
        return [f"`{self.entry}`", self.source, self.against, error, self.figure]


HEAD = ["entry", "source", "compared with", "error, of the allowed one", "figure"]

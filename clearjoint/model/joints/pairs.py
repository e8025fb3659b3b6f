"""Elements between two bodies, and the two points that some of them join."""

import equinox as eqx

from ...fields.checks import require
from ...fields.types import Triple
from ..pen import Marker
from .base import AbstractElement, Attachment


def require_distinct(first: str, second: str) -> None:
    """Check that an element connects two different bodies by name."""
    for argument, name in (("first", first), ("second", second)):
        require(isinstance(name, str), argument, name, "the name of a body", "pass the body's name")
    require(first != second, "second", second, "another body than `first`", "name two bodies")


class AbstractPair(AbstractElement):
    """An element between two different bodies."""

    first: eqx.AbstractVar[str]
    second: eqx.AbstractVar[str]

    def __check_init__(self):
        require_distinct(self.first, self.second)

    def body_names(self) -> tuple[str, ...]:
        """Names of the first and the second body."""
        return self.first, self.second


class AbstractPairAtPoints(AbstractPair):
    """An element between two different bodies at a point of each, (3,) m in body axes."""

    point_first: eqx.AbstractVar[Triple]
    point_second: eqx.AbstractVar[Triple]

    def attachments(self) -> tuple[Attachment, ...]:
        """Its point on each body."""
        return (
            ("point_first", self.first, self.point_first),
            ("point_second", self.second, self.point_second),
        )

    def ends(
        self, axis_first: Triple | None = None, axis_second: Triple | None = None
    ) -> tuple[Marker, Marker]:
        """Its points, with an axis there of each body, (3,) in its axes, where there is one."""
        first = Marker(self.first, self.point_first, axis_first)
        return first, Marker(self.second, self.point_second, axis_second)

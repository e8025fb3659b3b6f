"""Base classes of elements between two bodies."""

import equinox as eqx

from ...fields.checks import require, require_point
from ...fields.declarations import quantity
from ...fields.types import Triple
from ..pen import Marker
from .base import AbstractElement, Attachment


def require_distinct(first: str, second: str) -> None:
    """Check that two names of bodies are strings and differ.

    **Raises:** `ValueError` that names the argument `first` or `second`.
    """
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
        """Return the names of the first and the second body."""
        return self.first, self.second


class AbstractPairAtPoints(AbstractPair):
    """An element between a point of one body and a point of another, (3,) m in body axes."""

    first: str = eqx.field(static=True)
    second: str = eqx.field(static=True)
    point_first: Triple = quantity("m", check=require_point)
    point_second: Triple = quantity("m", check=require_point)

    def attachments(self) -> tuple[Attachment, ...]:
        """Return the element's point on the first and on the second body."""
        return (
            ("point_first", self.first, self.point_first),
            ("point_second", self.second, self.point_second),
        )

    def ends(
        self, axis_first: Triple | None = None, axis_second: Triple | None = None
    ) -> tuple[Marker, Marker]:
        """Return markers of the element's points on the first and the second body, for drawing.

        **Arguments:** `axis_first`, `axis_second`: direction of each marker, (3,) in body axes, or
        ``None``, the default, for a marker without direction.
        """
        first = Marker(self.first, self.point_first, axis_first)
        return first, Marker(self.second, self.point_second, axis_second)

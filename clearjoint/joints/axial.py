"""What holds the journal of a clearance joint along the bearing's axis."""

from typing import Any

from ..contact import AbstractContactLaw, AbstractHertzianLaw, Gap, GivenStiffness
from ..fields import quantity, require, require_positive
from ..readable import AbstractReadable
from ..vectors import Scalar


class AbstractAxialPolicy(AbstractReadable):
    """The declared axial behaviour of a clearance joint."""


class FreeAxially(AbstractAxialPolicy):
    """Nothing holds the journal along an endless bearing, as in the paper."""


class FixedAxially(AbstractAxialPolicy):
    """An ideal constraint keeps the journal's centre in the bearing's middle plane."""


class EndPlay(AbstractAxialPolicy):
    """Shoulders at both ends stop the journal after half the play to each side.

    **Arguments:**

    - `play`: m, total axial travel between the shoulders.
    - `law`: the normal law of a shoulder, with a given stiffness (the surfaces are flat).

    The force acts along the bearing's axis at the journal's base. No friction at the shoulders.
    """

    play: Any = quantity("m")
    law: AbstractContactLaw

    def __check_init__(self):
        require_positive("play", self.play, "give the axial travel in m", zero=True)
        if isinstance(self.law, AbstractHertzianLaw):
            require(
                isinstance(self.law.stiffness, GivenStiffness),
                "law",
                type(self.law.stiffness).__name__,
                "a law with a given stiffness",
                "shoulders are flat, so pass a number in N/m^n as the law's stiffness",
            )

    def gap(self, offset: Scalar, rate: Scalar) -> Gap:
        """The gap at one shoulder for an outward offset (m) and rate (m/s) of the journal."""
        return Gap(offset - 0.5 * self.play, rate)

"""What holds the journal of a clearance joint along the bearing's axis."""

from typing import ClassVar

from ...fields.conversion import AbstractConverting
from ...fields.declarations import quantity
from ...fields.types import Single
from ...math.vectors import Scalar
from ..contact.flat_surfaces import require_flat_law
from ..contact.gap import Gap
from ..contact.laws import AbstractContactLaw


class AbstractAxialPolicy(AbstractConverting):
    """The declared axial behaviour of a clearance joint.

    A subclass either sets `holds_centre`, and an ideal constraint keeps the journal's centre in the
    bearing's middle plane, or gives the law of the two shoulders at the bearing's ends:

    ```python
    import clearjoint as cj

    class ThrustWashers(cj.extend.AbstractAxialPolicy):
        lower_play: float  # m, from the journal's end to the washer
        upper_play: float
        stiffness: float  # N/m^1.5

        def shoulder_law(self):
            return cj.laws.Hertz(self.stiffness)

        def shoulder_gap(self, side, offset, rate):
            play = self.lower_play if side < 0 else self.upper_play
            return cj.extend.Gap(offset - play, rate)

    washers = ThrustWashers(lower_play=1e-4, upper_play=3e-4, stiffness=1e9)
    scene, state = cj.mechanisms.double_pendulum(axial=washers)
    ```
    """

    holds_centre: ClassVar[bool] = False

    def shoulder_law(self) -> AbstractContactLaw | None:
        """The normal law of the shoulders; ``None``, the default, where there are none."""
        return None

    def shoulder_gap(self, side: float, offset: Scalar, rate: Scalar) -> Gap:
        """The gap at one shoulder.

        **Arguments:** `side`: -1.0 for the shoulder at the lower end of the bearing's axis, 1.0 for
        the upper one. `offset` (m) and its `rate` (m/s): how far the journal's end is towards the
        shoulder, from where it is with the journal in the middle.
        """
        del side
        return Gap(offset, rate)


class FreeAxially(AbstractAxialPolicy):
    """Nothing holds the journal along an endless bearing, as in the paper.

    For a mechanism whose other joints hold the bodies in a plane, as a slider-crank's do. Where
    they don't, the journal slides out sooner or later; `simulate` then warns with a
    `LeftBearingWarning`. Take `EndPlay` for a real bearing, whose collars stop the journal, or
    `FixedAxially` where the axial motion is of no interest.

    >>> scene, state = cj.mechanisms.double_pendulum(axial=cj.FreeAxially())
    >>> scene.joints["shoulder"].axial
    FreeAxially()
    """


class FixedAxially(AbstractAxialPolicy):
    """An ideal constraint keeps the journal's centre in the bearing's middle plane.

    >>> scene, state = cj.mechanisms.double_pendulum(axial=cj.FixedAxially())
    >>> scene.joints["shoulder"].axial
    FixedAxially()
    """

    holds_centre = True


class EndPlay(AbstractAxialPolicy):
    """Shoulders at both ends stop the journal after half the play to each side.

    **Arguments:**

    - `play`: m, total axial travel between the shoulders.
    - `law`: the normal law of a shoulder, with a given stiffness (the surfaces are flat).

    The force acts along the bearing's axis at the journal's base. No friction at the shoulders.

    >>> collars = cj.EndPlay(play=0.2e-3, law=cj.laws.Hertz(1e9))
    >>> gap = collars.shoulder_gap(1.0, offset=0.15e-3, rate=0.0)
    >>> print(f"{gap.depth:.2e} m")  # beyond half of the play
    5.00e-05 m
    """

    play: Single = quantity("m", positive=True, zero=True, remedy="give the axial travel in m")
    law: AbstractContactLaw  # pyright: ignore[reportGeneralTypeIssues]

    def __check_init__(self):
        require_flat_law(self.law, "shoulders")

    def shoulder_law(self) -> AbstractContactLaw:
        """The law that was given, for both shoulders."""
        return self.law

    def shoulder_gap(self, side: float, offset: Scalar, rate: Scalar) -> Gap:
        """The gap after half the play."""
        del side
        return Gap(offset - 0.5 * self.play, rate)

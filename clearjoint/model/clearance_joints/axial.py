"""Axial behaviour of a clearance joint: free, fixed, or limited by shoulders."""

from typing import ClassVar

from ...fields.checks import require
from ...fields.conversion import AbstractConverting
from ...fields.declarations import optional_quantity, quantity
from ...fields.types import Single
from ...math.vectors import Scalar
from ..contact.friction import AbstractFriction
from ..contact.gap import Gap
from ..contact.laws import AbstractContactLaw, require_flat_law, require_instance


class AbstractAxialPolicy(AbstractConverting):
    """Axial behaviour of a `ClearanceJoint`: a free, held or stopped journal.

    A subclass sets ``holds_centre = True``, so that an ideal constraint keeps the journal's centre
    in the bearing's middle plane. Or it defines two shoulders at the ends of the bearing, as in
    this example of washers at different distances:

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
    """Whether an ideal constraint holds the journal's centre in the bearing's middle plane."""

    def shoulder_law(self) -> AbstractContactLaw | None:
        """Return the normal law of the shoulders; ``None``, the default, for no shoulders."""
        return None

    def shoulder_friction(self) -> tuple[AbstractFriction, Scalar] | None:
        """Return the friction law of the shoulders and their mean radius, m; ``None``, the default,
        for shoulders without friction.
        """
        return None

    def shoulder_gap(self, side: float, offset: Scalar, rate: Scalar) -> Gap:
        """Return the penetration of the journal into one shoulder, m, and its rate, m/s.

        **Arguments:**

        - `side`: -1.0 for the shoulder at the lower end of the bearing's axis, 1.0 for the upper
          end.
        - `offset`: m, displacement of the journal's end towards the shoulder, zero for a centred
          journal.
        - `rate`: rate of `offset`, m/s.
        """
        return Gap(offset, rate)


class FreeAxially(AbstractAxialPolicy):
    """No axial support: the journal slides freely along a bearing of unlimited length.

    Use it in a mechanism whose other joints hold the bodies in a plane, such as a slider-crank.
    Elsewhere the journal eventually slides out and `simulate` warns with a `LeftBearingWarning`;
    use `EndPlay` for a bearing with shoulders, or `FixedAxially` if the axial motion is not of
    interest.

    >>> scene, state = cj.mechanisms.double_pendulum(axial=cj.FreeAxially())
    >>> scene.joints["shoulder"].axial
    FreeAxially()
    """


class FixedAxially(AbstractAxialPolicy):
    """An ideal constraint that keeps the journal's centre in the bearing's middle plane.

    >>> scene, state = cj.mechanisms.double_pendulum(axial=cj.FixedAxially())
    >>> scene.joints["shoulder"].axial
    FixedAxially()
    """

    holds_centre = True


class EndPlay(AbstractAxialPolicy):
    """Shoulders at both ends of the bearing that stop the journal after half the play to each side.

    Each shoulder's force acts along the bearing's axis, at the centre of the base that touches the
    shoulder.

    A shoulder with friction is a thrust face. It resists sliding across the axis and rotation about
    it: for the sliding velocity v of the base's centre and the relative spin w about the axis, the
    slip speed is sqrt(v^2 + (r w)^2) with the mean radius r of the face. If the face only rotates,
    the moment of friction is r times the law's friction force. A face does not resist tilting.

    **Arguments:**

    - `play`: m, total axial travel between the shoulders.
    - `law`: normal law of a shoulder; it needs an explicit stiffness, because the surfaces are
      flat.
    - `friction`: an `AbstractFriction`, or ``None``, the default, for no friction.
    - `radius`: mean radius of the faces, m, if and only if they have friction. For a face between
      the radii a and b, (2/3) (b^3 - a^3)/(b^2 - a^2) gives the moment of a uniform pressure.

    **Raises:** `ValueError` if only one of `friction` and `radius` is given, the law takes its
    stiffness from radii, or a value is of the wrong class or outside its range.

    >>> collars = cj.EndPlay(play=0.2e-3, law=cj.laws.Hertz(1e9))
    >>> gap = collars.shoulder_gap(1.0, offset=0.15e-3, rate=0.0)
    >>> print(f"{gap.depth:.2e} m")  # beyond half the play
    5.00e-05 m
    """

    play: Single = quantity("m", positive=True, zero=True, remedy="give the axial travel in m")
    law: AbstractContactLaw  # pyright: ignore[reportGeneralTypeIssues]
    friction: AbstractFriction | None = None
    radius: Single | None = optional_quantity("m", positive=True, remedy="give the radius in m")

    def __check_init__(self):
        require_flat_law(self.law, "shoulders")
        if self.friction is not None:
            require_instance("friction", self.friction, AbstractFriction)
        both = (self.friction is None) == (self.radius is None)
        expected = "given if and only if `friction` is"
        require(both, "radius", self.radius, expected, "pass both, or none of the two")

    def shoulder_law(self) -> AbstractContactLaw:
        """Return the law of both shoulders."""
        return self.law

    def shoulder_friction(self) -> tuple[AbstractFriction, Scalar] | None:
        """Return the friction law and the mean radius of both shoulders, m; ``None`` without
        friction.
        """
        if self.friction is None or self.radius is None:
            return None
        return self.friction, self.radius

    def shoulder_gap(self, side: float, offset: Scalar, rate: Scalar) -> Gap:
        """Return the penetration into a shoulder: the offset beyond half the play, m, and its rate,
        m/s.
        """
        return Gap(offset - 0.5 * self.play, rate)

"""Friction of ideal joints: of hinges, sliders and balls that other joints hold."""

import equinox as eqx
from typing_extensions import override

from ..._fields.checks import require, require_axis, require_point
from ..._fields.leaves import with_fields
from ..._fields.objects import optional_quantity, quantity
from ..._fields.types import Single, Triple
from ..._math.rotations import unit
from ..._math.vectors import ZERO, Scalar, Vector
from ..bodies import Motion, Wrench
from ..contact.friction import AbstractBristleFriction, AbstractFriction, FrictionLaw
from ..contact.laws import AbstractContactLaw, Gap, require_instance
from .base import AbstractContactJoint, AbstractNamedPair, Contact, Motions

LABEL = "surface"
"""Label of the only contact of a `JointFriction`."""
PRESSED = 1e-9
"""Depth, m, of the contact, which stays closed. The load does not depend on it."""


class Preload(AbstractContactLaw):
    """A constant normal force between surfaces that never part: the `load`, N."""

    load: Single = quantity("N", positive=True, zero=True)
    uses_entry_speed = False
    force_jumps = False

    @override
    def force(self, gap: Gap, entry_speed: Scalar | None) -> Scalar:
        return self.load

    @override
    def elastic_force(self, gap: Gap) -> Scalar:
        return self.load

    @override
    def stored_energy(self, gap: Gap) -> Scalar:
        return 0.0

    @override
    def slope_jumps(self) -> bool:
        return False


class JointFriction(AbstractNamedPair, AbstractContactJoint):
    """Friction in an ideal joint, by any of the laws in `clearjoint.frictions`.

    Two surfaces, pressed together by a constant load, slip as the second body moves relative to the
    first. In a hinge or ball, they have a radius r: the slip is r times the relative angular
    velocity, and the friction F acts as a couple with the moment F r. In a slider the slip is the
    velocity along the axis, and F acts along it. Choose a law with bristles, such as `LuGre`, if
    the joint must hold below the breakaway load.

    The ideal joint's reactions exclude the load. `simulate_nonsmooth` does not support the element.

    **Arguments:**

    - `first`, `second`: names of the bodies that the ideal joint connects.
    - `friction`: law that gives the ratio of friction to load. Its speeds are the surfaces', m/s.
    - `load`: N, by which the surfaces are pressed together.
    - `axis`: (3,) in the first body's axes, any length: of a hinge, or direction of a slider;
      ``None`` for a ball, where friction resists every relative rotation.
    - `radius`: m, of the surfaces of a hinge or ball; ``None`` for a slider, which needs an `axis`.
      For a law in N m and rad/s, take ``radius=1``: the moment is the ratio times `load` in N m.
    - `point_second`: a point of the second body on the slider's surface, (3,) m from its centre of
      mass in its axes; this centre by default. The point matters only if the first body rotates.
    - `viscosity`: coefficient of a viscous part, N s/m at the surfaces (N m s/rad with
      ``radius=1``); none by default.
    - `pressed_by`, `load_ratio`: name of another element of the scene, and a ratio: the load is
      increased by the ratio times the force of this element, for example to model the losses of a
      gear. The force of a contact joint such as a `Backlash` is the elastic part of its normal
      forces, N; that of a `TorsionalSpring` is the magnitude of its elastic torque, N m.

    This hinge holds 0.6 N m at rest, and resists with 0.5 N m when it turns:

    >>> law = cj.frictions.LuGre(breakaway=1.2, kinetic=1.0, stribeck_speed=0.05, stiffness=1e4)
    >>> friction = cj.JointFriction("ground", "arm", law, load=0.5, axis=(0, 0, 1), radius=1.0)
    >>> friction.pair()
    ('ground', 'arm')
    """

    friction: FrictionLaw  # pyright: ignore[reportGeneralTypeIssues]
    load: Single = quantity("N", positive=True, zero=True, remedy="give the load in N")
    axis: Triple | None = optional_quantity("1", shape=(3,), check=require_axis)
    radius: Single | None = optional_quantity("m", positive=True, remedy="give the radius in m")
    point_second: Triple = quantity("m", check=require_point, default=(0.0, 0.0, 0.0))
    viscosity: Single | None = optional_quantity("N s/m", positive=True, zero=True)
    pressed_by: str | None = eqx.field(static=True, default=None)
    load_ratio: Single | None = optional_quantity("1", positive=True, zero=True)

    @override
    def __check_init__(self):
        require_instance("friction", self.friction, AbstractFriction, AbstractBristleFriction)

    @override
    def _check_together(self) -> None:
        expected = "given for a slider, or else a `radius` for a hinge or ball"
        remedy = "give the direction of the slider, (3,) in the first body's axes"
        require(not (self.axis is None and self.radius is None), "axis", None, expected, remedy)
        agree = (self.pressed_by is None) == (self.load_ratio is None)
        expected = "given if and only if `load_ratio` is"
        remedy = "name the element that presses, and give the load over its force"
        require(agree, "pressed_by", self.pressed_by, expected, remedy)

    def pressed_with(self, force: Scalar) -> "JointFriction":
        """Return this friction with its load increased by `load_ratio` times the `force`, N, of the
        element that presses."""
        assert self.load_ratio is not None
        load = self.load + self.load_ratio * force
        # A constructor would convert vectors to arrays.
        return with_fields(self, {"load": load, "pressed_by": None, "load_ratio": None})

    @override
    def laws(self) -> dict[str, AbstractContactLaw]:
        return {LABEL: Preload(self.load)}

    @override
    def contacts(self, motions: Motions) -> dict[str, Contact]:
        first, second = motions[self.first], motions[self.second]
        on_first = first.components(second.point(self.point_second) - first.position)
        slip = self._slip(first, second, on_first)
        gap = Gap(PRESSED, 0.0)
        # Without a normal, the load acts on neither body.
        return {LABEL: Contact(gap, ZERO, on_first, self.point_second, slip, lever=self.radius)}

    def _slip(self, first: Motion, second: Motion, on_first: Vector) -> Vector:
        # Only a slider has no radius.
        if self.radius is None:
            slip = second.velocity_at(self.point_second) - first.velocity_at(on_first)
        else:
            spin = second.direction(second.spin) - first.direction(first.spin)
            slip = spin * self.radius
        # In a ball, the surfaces slip about any axis; otherwise only about or along the given one.
        if self.axis is None:
            return slip
        axis = first.direction(unit(self.axis))
        return axis * slip.dot(axis)

    @override
    def friction_force(self, name: str, contact: Contact, normal_force: Scalar) -> Vector | None:
        assert contact.slip is not None
        return self.friction.force(normal_force, contact.slip)

    @override
    def bristle_laws(self) -> dict[str, AbstractBristleFriction]:
        return {LABEL: self.friction} if isinstance(self.friction, AbstractBristleFriction) else {}

    @override
    def film_wrenches(self, motions: Motions) -> dict[str, Wrench]:
        if self.viscosity is None:
            return {}
        (contact,) = self.contacts(motions).values()
        assert contact.slip is not None
        drag = contact.slip * -self.viscosity
        first, second = motions[self.first], motions[self.second]
        # In a hinge or ball, the drag acts as a couple.
        if self.radius is not None:
            moment = drag * self.radius
            return {self.second: second.torque(moment), self.first: first.torque(-moment)}
        return {
            self.second: second.wrench(drag, contact.arm_second),
            self.first: first.wrench(-drag, contact.arm_first),
        }

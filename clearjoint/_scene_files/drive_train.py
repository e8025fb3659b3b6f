"""Drive trains of a robot's joints: rotor, gear with play or compliance, and friction."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import PyTree

from .._fields.cautions import quiet
from .._fields.checks import as_number, require, require_positive, require_type
from .._math.vectors import Scalar
from .._model.bodies import Body
from .._model.clearance_joints.backlash import DEFAULT_RADIUS
from .._model.contact.dashpots import SpringDashpot
from .._model.contact.friction import FrictionLaw
from .._model.contact.hunt_crossley import ExactRestitution
from .._model.contact.laws import AbstractContactLaw
from .._model.joints.base import AbstractContactJoint
from .._model.joints.ideal import HingeOrSlider, PrismaticJoint, RevoluteJoint
from .._model.joints.joint_friction import JointFriction
from .documents import FileLocation
from .reading import number_of_text
from .robot_elements import (
    BACKLASH,
    FRICTION,
    Element,
    backlash_of,
    ends_of_travel,
    friction_of,
    spring_of,
)
from .robots import NEGLIGIBLE

COMPLIANCE = "compliance"


@dataclass(frozen=True)
class Drive:
    """The drive train of a hinge or slider: rotor - play or compliance - link; see
    `Robot.with_drive`.

    With neither play nor stiffness, the rotor turns with the joint and only adds its inertia. With
    a stiffness, the drive train is a spring, whose oscillations the steps of a run must resolve;
    play adds impacts of the flanks.

    Numbers may be texts with units, such as "0.5 deg". The units of a slider's numbers have m in
    place of rad, N in place of N m, and kg in place of kg m^2.

    - `armature`: kg m^2, moment of inertia of the rotor about the motor's axis. ``None`` keeps the
      armature of the file, which is not multiplied by the squared ratio.
    - `ratio`: turns of the motor per turn of the joint, whose square multiplies the armature. All
      other numbers are those at the joint: give the motor's friction times the ratio.
    - `play`: rad, total angle from flank to flank; ``None`` for none.
    - `stiffness`: N m/rad, between rotor and link; with play, of a pressed flank. ``None`` is
      rigid, and not possible with play.
    - `damping`: N m s/rad, parallel to the stiffness; with play, of a pressed flank
      (`SpringDashpot`).
    - `restitution`: of the flanks, in place of a damping; 0.5 by default (see `Backlash`).
    - `friction`, `viscosity`: dry friction, N m, and viscous friction, N m s/rad, between the rotor
      and the joint's first body.
    - `loss`: further dry friction of the rotor, divided by the torque between rotor and link: 0.1
      for a gear that loses a tenth of this torque. A slider can have a loss only with play.
    - `link_friction`: dry friction of the link, N m, beside that of the file.
    - `law`: law of both dry frictions, with speeds in rad/s; the default law includes sticking.

    >>> geared = cj.Drive(armature=2e-5, ratio=100.0, play="0.5 deg", stiffness=800.0, friction=0.3)
    >>> geared.play
    '0.5 deg'
    """

    armature: Scalar | str | None = None
    ratio: Scalar | str = 1.0
    play: Scalar | str | None = None
    stiffness: Scalar | str | None = None
    damping: Scalar | str | None = None
    restitution: Scalar | str | None = None
    friction: Scalar | str | None = None
    viscosity: Scalar | str | None = None
    loss: Scalar | str | None = None
    link_friction: Scalar | str | None = None
    law: FrictionLaw = FRICTION


UNITS = {
    "armature": ("kg m^2", "kg"),
    "ratio": ("1", "1"),
    "play": ("rad", "m"),
    "stiffness": ("N m/rad", "N/m"),
    "damping": ("N m s/rad", "N s/m"),
    "restitution": ("1", "1"),
    "friction": ("N m", "N"),
    "viscosity": ("N m s/rad", "N s/m"),
    "loss": ("1", "1"),
    "link_friction": ("N m", "N"),
}
"""Units of the numbers of a `Drive` by name, first for a hinge, then for a slider."""


class Train(NamedTuple):
    """What a drive adds to a robot's scene: the driven `joint`; `elements` by name; and the body of
    the `rotor`, ``None`` if the rotor turns with the link, as an armature of `joint`."""

    joint: HingeOrSlider
    elements: dict[str, Element]
    rotor: Body | None = None


def rotor_name(joint: str) -> str:
    return f"{joint} rotor"


def motor_name(joint: str) -> str:
    return f"{joint} motor"


def train_of(name: str, joint: HingeOrSlider, drive: Drive) -> Train:
    require_type("drive", drive, Drive, "a Drive", 'pass cj.Drive(play="0.5 deg", ...)')
    is_slider = isinstance(joint, PrismaticJoint)
    numbers = _numbers(drive, is_slider)
    armature = joint.armature
    if "armature" in numbers:
        armature = numbers["armature"] * numbers["ratio"] ** 2
    is_elastic = "play" in numbers or "stiffness" in numbers
    _require_together(name, numbers, armature, is_elastic, is_slider)

    # The frictions of the drive by name, in the joints `motor` and `link` that hold rotor and link.
    def frictions(motor: HingeOrSlider, link: HingeOrSlider) -> dict[str, JointFriction]:
        named = {}
        if {"friction", "viscosity", "loss"} & numbers.keys():
            load, viscosity, loss = numbers.get("friction", 0.0), numbers.get("viscosity"), {}
            if "loss" in numbers:
                # The loss is a fraction of a torque. But the flanks of a hinge with play report
                # their force, which acts at this radius; springs and sliders need no factor.
                radius = DEFAULT_RADIUS if "play" in numbers and not is_slider else 1.0
                pressed_by = f"{name} {BACKLASH if 'play' in numbers else COMPLIANCE}"
                loss = {"pressed_by": pressed_by, "load_ratio": numbers["loss"] * radius}
            friction = friction_of(motor, drive.law, load, viscosity=viscosity, **loss)
            named[f"{motor_name(name)} friction"] = friction
        if "link_friction" in numbers:
            named[f"{name} link friction"] = friction_of(link, drive.law, numbers["link_friction"])
        return named

    if not is_elastic:  # the rotor turns with the link: it is an armature, not a body
        driven = replace(joint, armature=armature)
        return Train(driven, {**frictions(driven, driven)})
    # A body must have mass. The rotor has a negligible one, since the file counts the rotor's mass
    # as that of a link, and the joint `motor` has its moment of inertia about the axis.
    rotor = rotor_name(name)
    assert armature is not None
    inertia = NEGLIGIBLE * armature
    body = Body(inertia, inertia * np.ones(3), is_massless=True)
    link = replace(joint, armature=None)
    # The joint's first body carries rotor and link side by side; the rotor carries no body. So the
    # massless rotor acts on the first body only by the force or torque of its bearing along or
    # about the axis, and the coordinates of no other body refer to it.
    motor = replace(joint, second=rotor, point_second=np.zeros(3), armature=armature)
    if isinstance(motor, RevoluteJoint):
        # The rotor's axes are parallel to those of the first body while the motor is at zero.
        motor = replace(motor, axis_second=motor.axis_first)
    # Not in the scene: an ideal joint of rotor and link, for the ends and axis of play or spring.
    between = replace(link, first=rotor, point_first=np.zeros(3))
    elements: dict[str, Element] = {motor_name(name): motor, **frictions(motor, link)}
    if "play" in numbers:
        elements[f"{name} {BACKLASH}"] = _flanks(between, numbers)
    else:
        spring = spring_of(between, numbers["stiffness"], numbers.get("damping", 0.0), 0.0)
        elements[f"{name} {COMPLIANCE}"] = spring
    return Train(link, elements, body)


def _numbers(drive: Drive, is_slider: bool) -> dict[str, np.ndarray]:
    numbers = {}
    for field in fields(drive):
        value = getattr(drive, field.name)
        if field.name not in UNITS or value is None:  # the law, or an omitted number
            continue
        unit = UNITS[field.name][is_slider]  # False and True are the indices 0 and 1
        if isinstance(value, str):
            value = number_of_text(value, unit, FileLocation("drive").at(field.name))
        number = as_number(value, f"drive.{field.name}", unit)
        may_vanish = field.name not in ("armature", "ratio", "play", "stiffness")
        remedy = f"give it in {unit}, or leave it out for none"
        require_positive(f"drive.{field.name}", number, remedy, zero=may_vanish)
        numbers[field.name] = number
    return numbers


def _require_together(
    name: str, numbers: Mapping[str, PyTree], armature: PyTree, is_elastic: bool, is_slider: bool
) -> None:
    # Raise the error about one argument of the drive unless it is valid beside the others.
    def check(argument: str, is_valid: bool, expected: str, remedy: str) -> None:
        require(is_valid, f"drive.{argument}", numbers.get(argument), expected, remedy)

    has = {argument: argument in numbers for argument in UNITS}
    expected = f"given, since joint {name!r} has none in the file"
    remedy = "give the moment of inertia of the rotor, or leave play and stiffness out"
    check("armature", not is_elastic or armature is not None, expected, remedy)
    is_valid = not has["play"] or has["stiffness"]
    check("stiffness", is_valid, "given with a play", "give that of a pressed flank")
    is_valid = has["play"] or not has["restitution"]
    check("restitution", is_valid, "omitted without a play", "leave it out, or give a play")
    is_valid = not (has["restitution"] and has["damping"])
    check("restitution", is_valid, "omitted with a damping", "leave one of the two out")
    is_valid, expected = has["stiffness"] or not has["damping"], "omitted without a stiffness"
    check("damping", is_valid, expected, "give a stiffness, or a viscosity in place of the damping")
    is_valid = not has["loss"] or has["play"] or (is_elastic and not is_slider)
    expected = "omitted without a play or, of a hinge, a stiffness"
    check("loss", is_valid, expected, "leave it out, or give one of them")


def _flanks(between: HingeOrSlider, numbers: Mapping[str, PyTree]) -> AbstractContactJoint:
    """Return the play between rotor and link. `between`: the ideal joint of these two bodies;
    `numbers`: those of the `Drive`, in SI units, without those that are ``None``."""
    # The flanks of a hinge touch at a radius. Stiffness and damping of the force there are those of
    # the torque over the square of the radius.
    square = DEFAULT_RADIUS**2 if isinstance(between, RevoluteJoint) else 1.0
    stiffness, damping = numbers["stiffness"] / square, numbers.get("damping")
    with quiet():  # the stiffness for the arbitrary radius may be unusual
        if damping is not None:
            law: AbstractContactLaw = SpringDashpot(stiffness, damping / square)
        else:
            restitution = numbers.get("restitution", 0.5)
            law = ExactRestitution(restitution=restitution, stiffness=stiffness, exponent=1.0)
    if isinstance(between, RevoluteJoint):
        return backlash_of(between, play=numbers["play"], radius=DEFAULT_RADIUS, law=law)
    return ends_of_travel(between, numbers["play"], 0.0, {"law": law})

"""Joints and forces of the scene of a robot: those of its file, and those that the user adds."""

import math
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import replace
from typing import TypeAlias

import numpy as np
from jaxtyping import PyTree

from .._fields.cautions import quiet
from .._fields.checks import as_number, nearest, require_positive
from .._fields.types import TripleLike
from .._math.rotations import transverse_axes
from .._math.vectors import Vector, pack
from .._model.bodies import State, body_state
from .._model.clearance_joints.backlash import Backlash
from .._model.clearance_joints.between_walls import PinInSlot
from .._model.clearance_joints.clearance import ClearanceJoint, FixedAxially
from .._model.contact.friction import ElastoPlastic, FrictionLaw
from .._model.drives.drivers import PrescribedAngle, PrescribedTranslation
from .._model.drives.functions_of_time import FunctionOfTime, Polynomial
from .._model.forces import Bushing, TorsionalSpring
from .._model.joints.base import AbstractConstraint, AbstractContactJoint, AbstractForce
from .._model.joints.couplings import JointCoupling
from .._model.joints.ideal import (
    FixedJoint,
    HingeOrSlider,
    PlanarJoint,
    PrismaticJoint,
    RevoluteJoint,
    SphericalJoint,
)
from .._model.joints.joint_friction import JointFriction
from .._model.scene import Scene
from . import robots
from .classes import REQUIRED, Expectation, arguments
from .documents import FileLocation, listed
from .reading import Reader

Play: TypeAlias = Mapping[str, PyTree]
"""Arguments of a `ClearanceJoint`, a `Backlash` or a stop, by name, as the user passes them."""
Joint: TypeAlias = AbstractConstraint | AbstractContactJoint
Element: TypeAlias = Joint | AbstractForce
IDEAL = {
    **dict.fromkeys(robots.HINGES, (RevoluteJoint, 2)),
    robots.SLIDER: (PrismaticJoint, 1),
    "planar": (PlanarJoint, 2),
    robots.BALL: (SphericalJoint, 0),
    robots.FIXED: (FixedJoint, 0),
}
"""Class of the ideal joint, and how many of its arguments are the axis, by type in the file."""
TYPES = *IDEAL, robots.FLOATING
BACKLASH = "backlash"
"""Key of a backlash's angle, rad, in the user's arguments; the class `Backlash` calls it `play`."""
GIVEN_BY_THE_FILE = {
    *("bearing_body", "bearing_point", "bearing_axis"),
    *("journal_body", "journal_point", "journal_axis"),
    *("first", "second", "axis_first", "axis_second", "play", "play_length"),
}
"""Arguments of `ClearanceJoint` and `Backlash` that the user can't pass."""
OF_STOPS = ("torsional_stiffness", "restitution", "law", "radius"), ("law",)
"""Arguments of the stops of hinges, and of those of sliders."""
FAR = 1e3
"""Distance of the walls that a slider with stops never touches, as a multiple of its travel."""


FRICTION = ElastoPlastic(
    breakaway=1.0, kinetic=1.0, stribeck_speed=0.1, elastic_deflection=0.7e-4, stiffness=1e4
)
"""Law of the dry friction of joints: at up to 0.7 of the friction, joints stick without drift;
before they slip, they deflect elastically by 1e-4 rad or m."""


class Elements:
    """The `joints` and `forces` of a robot's scene, by name.

    - `ideal`: ideal joint for each joint of the file, except floating joints and those between
      links that are fixed to each other, in one body or on the ground.
    - `mimics`: the `Mimic` of each joint that follows another, leaders before their followers.
    - `omitted`: contents of the file that the scene lacks, in the form of `Content.omitted`.
    """

    def __init__(self, tree: robots.LinkTree):
        self.tree = tree
        self.joints: dict[str, Joint] = {}
        self.forces: dict[str, AbstractForce] = {}
        pairs = {name: ideal_joint(joint, tree) for name, joint in tree.joints.items()}
        self.ideal = {name: joint for name, joint in pairs.items() if joint is not None}
        self.omitted: dict[str, list[str]] = defaultdict(list)
        self.mimics = self._mimics()

    def _mimics(self) -> dict[str, robots.Mimic]:
        mimics = {name: j.mimic for name, j in self.tree.joints.items() if j.mimic is not None}
        for name, mimic in [*mimics.items()]:
            if self.scalar(name) is None or self.scalar(mimic.leader or name) is None:
                self.omitted["mimics, between other joints than hinges and sliders,"].append(name)
                del mimics[name]
        leaders = {n: {mimic.leader} & mimics.keys() for n, mimic in mimics.items()}
        return {n: mimics[n] for n in robots.leaders_first(leaders, self.tree.location)}

    def add(self, element: Joint | AbstractForce, joint: str, what: str) -> None:
        # The new name must be none of the file's joints, whose names are kept.
        name = f"{joint} {what}"
        if name in self.tree.joints or name in self.joints or name in self.forces:
            expected = f"no joint {name!r}, which is the name of the {what}"
            self.tree.location.at(joint).refuse(name, expected, "rename that joint")
        if isinstance(element, AbstractForce):
            self.forces[name] = element
        else:
            self.joints[name] = element

    def scalar(self, name: str) -> HingeOrSlider | None:
        joint = self.ideal.get(name)
        return joint if isinstance(joint, HingeOrSlider) else None


def scene_of(
    tree: robots.LinkTree,
    loops: tuple[robots.LoopJoint, ...],
    play: Mapping[str, Play],
    stops: Mapping[str, Play],
    friction: FrictionLaw | None,
    gravity: TripleLike | None,
) -> tuple[Scene, State, Elements]:
    """Return the scene of a robot, its state at rest with all joints at zero, and its elements.
    `play`, `stops`, `friction`, `gravity`: as in `load_robot`."""
    location = tree.location
    hinges = [joint.name for joint in tree.joints.values() if joint.kind in robots.HINGES]
    play = {
        name: _checked(name, settings, "play", hinges, _arguments_of_play(settings), location)
        for name, settings in play.items()
    }
    carriers = tree.moving()  # the bodies
    if not carriers:
        remedy = "pass free_root=True, which makes the root a body, or correct the joints"
        if not tree.massive(tree.carriers[tree.root]):
            remedy = "add a joint that moves"
        location.refuse(f"no link that moves relative to {tree.root!r}", "some", remedy)
    bodies, elements = robots.bodies_of(tree, carriers), Elements(tree)
    for name, ideal in elements.ideal.items():
        settings, at = play.get(name), location.at(name)
        # A clearance replaces the ideal joint, a backlash is added to it.
        armature = tree.joints[name].armature
        if settings is not None and BACKLASH not in settings:
            elements.joints[name] = _clearance(ideal, settings, at)
            if armature:  # a joint with clearance has none
                elements.omitted["armatures"].append(name)
            continue
        elements.joints[name] = ideal
        if armature and isinstance(ideal, HingeOrSlider):
            with at.in_errors():
                elements.joints[name] = replace(ideal, armature=armature)
        if settings is not None:
            elements.add(_backlash(tree.joints[name], ideal, settings, at), name, BACKLASH)
    _add_loops(elements, loops)
    _add_couplings(elements)
    _add_resistances(elements, friction)
    _add_stops(elements, stops)
    centres = {
        carrier.body: tuple(robots.moved(carrier.pose, carrier.centre)) for carrier in carriers
    }
    with location.in_errors():
        scene = Scene(bodies, elements.joints, elements.forces, gravity)
        return scene, State({name: body_state(at) for name, at in centres.items()}), elements


def ideal_joint(joint: robots.RobotJoint, tree: robots.LinkTree) -> AbstractConstraint | None:
    """Return the ideal joint of the scene for a joint of the file; ``None`` if its child is free,
    or if both its links belong to one carrier, that is, to one body or the ground."""
    parent, child = tree.carriers[joint.parent], tree.carriers[joint.child]
    location = tree.location.at(joint.name)
    if joint.kind not in TYPES:
        kinds = f"one of the types {listed(TYPES)}"
        location.refuse(joint.kind, kinds, "correct it, or fix the link and add the joint yourself")
    if parent is child or joint.kind == robots.FLOATING:
        return None
    # `in_body` converts from the frame of a carrier's first link. This is the child link in the
    # child's carrier. The parent link may be a later one, from whose frame `poses` converts.
    in_parent = robots.moved(tree.poses[joint.parent] @ joint.pose, joint.point)
    points = tree.in_body(parent, in_parent), tree.in_body(child, joint.point)
    # All bodies are parallel at zero, so that the axis has the same components in both. `rounded`
    # restores exact zeros, first of the rotation matrix, then of the axis.
    axis = robots.rounded(robots.rounded(child.pose[:3, :3]) @ joint.axis)
    make, axis_count = IDEAL[joint.kind]
    with location.in_errors():
        return make(parent.body, child.body, *points, *[axis] * axis_count)


def _clearance(hinge: AbstractConstraint, play: Play, location: FileLocation) -> ClearanceJoint:
    assert isinstance(hinge, RevoluteJoint)  # only hinges may have play
    with location.in_errors():
        return ClearanceJoint(
            hinge.first,
            hinge.second,
            bearing_point=hinge.point_first,
            journal_point=hinge.point_second,
            bearing_axis=hinge.axis_first,
            journal_axis=hinge.axis_second,
            **{"axial": FixedAxially(), **play},
        )


def _backlash(
    joint: robots.RobotJoint, hinge: AbstractConstraint, settings: Play, location: FileLocation
) -> Backlash:
    assert isinstance(hinge, RevoluteJoint)
    options = {key: value for key, value in settings.items() if key != BACKLASH}
    if "law" not in options and "torsional_stiffness" not in options:
        effort = math.inf if joint.limits is None else joint.limits.effort
        if not 0.0 < effort < math.inf:
            expected = "a `torsional_stiffness`, since the joint has no effort limit"
            location.refuse(value=None, expected=expected, remedy="give it in N m/rad")
        with location.in_errors():  # `Backlash` would check the angle after the division by it
            angle = as_number(settings[BACKLASH], BACKLASH, "rad")
            require_positive(BACKLASH, angle, "give an angle in rad")
        # With this stiffness, the largest torque deflects the surfaces in contact (flanks) by a
        # tenth of the play, which is small compared with the play.
        options["torsional_stiffness"] = effort / (0.1 * float(angle))
    with location.in_errors():
        return backlash_of(hinge, play=settings[BACKLASH], **options)


def backlash_of(hinge: RevoluteJoint, **options: PyTree) -> Backlash:
    return Backlash(
        hinge.first,
        hinge.second,
        axis_first=hinge.axis_first,
        axis_second=hinge.axis_second,
        **options,
    )


def _arguments_of_play(settings: Play) -> dict[str, Expectation]:
    kind = Backlash if isinstance(settings, Mapping) and BACKLASH in settings else ClearanceJoint
    expected = arguments(kind)
    allowed = {key: value for key, value in expected.items() if key not in GIVEN_BY_THE_FILE}
    # Errors about unknown keys of a clearance also list "backlash", which may have been meant.
    return allowed | {BACKLASH: expected["play"] if kind is Backlash else Expectation(default=None)}


def _checked(
    name: str,
    settings: Play,
    what: str,
    joints: list[str],
    allowed: dict[str, Expectation],
    location: FileLocation,
) -> Play:
    if name not in joints:  # `what` is "play" or "stops", the argument of `load_robot`
        kind = "one of the hinges" if what == "play" else "one of the joints with two limits,"
        remedy = nearest(name, joints, "leave it out")
        location.refuse(name, f"{what} in {kind} {listed(joints)}", remedy)
    if not isinstance(settings, Mapping):
        remedy = f"pass values of {listed(allowed)}"
        if what == "play":
            remedy = 'pass {"backlash": "0.1 deg"}, or the arguments of a ClearanceJoint'
        location.at(name).refuse(settings, "arguments by name", remedy)
    for argument in settings:
        if argument not in allowed:
            remedy = nearest(argument, allowed, "leave it out")
            location.at(name).refuse(argument, f"one of the arguments {listed(allowed)}", remedy)
    # Where stops are made, missing arguments are refused with a remedy of their own.
    missing = [key for key, e in allowed.items() if e.default is REQUIRED and key not in settings]
    if missing and what == "play":
        location.at(name).refuse([*settings], f"also {listed(missing)}", "add the missing ones")
    # Only texts are converted here. The constructors check all other values.
    reader, at = Reader(classes=()), location.at(name)
    texts = {key: value for key, value in settings.items() if isinstance(value, str)}
    return {**settings, **{k: reader.value(v, allowed[k], at.at(k)) for k, v in texts.items()}}


def _add_loops(elements: Elements, loops: tuple[robots.LoopJoint, ...]) -> None:
    tree = elements.tree
    for loop in loops:
        carrier, point, rotation = tree.placed(loop.first, loop.in_first)
        other_carrier, other_point, other_rotation = tree.placed(loop.second, loop.in_second)
        if carrier is other_carrier:  # both links belong to one body, which needs no joint
            continue
        ends = carrier.body, other_carrier.body, point, other_point
        if loop.kind == robots.BALL:
            joint: Joint = SphericalJoint(*ends)
        else:
            # The two frames coincide. Components in the second body's axes are transformed to the
            # common frame, and then to the first body's axes.
            relative = robots.rounded(rotation @ other_rotation.T)
            joint = FixedJoint(*ends, robots.euler_parameters(relative))
        if loop.name in tree.joints or loop.name in elements.joints:
            expected = "a name that no other joint has"
            tree.location.at(loop.name).refuse(loop.name, expected, "rename one of the two")
        elements.joints[loop.name] = joint


def _add_couplings(elements: Elements) -> None:
    for name, mimic in elements.mimics.items():
        follower, at = elements.scalar(name), elements.tree.location.at(name)
        assert follower is not None
        leader = elements.scalar(mimic.leader or "")
        with at.in_errors():
            if leader is None:  # the joint stays at a constant position
                coupling = prescribed(follower, mimic.coefficients[0])
            else:
                coupling = JointCoupling(leader, follower, Polynomial(mimic.coefficients))
        elements.add(coupling, name, "coupling")


def prescribed(joint: HingeOrSlider, position: FunctionOfTime) -> AbstractConstraint:
    """Return the driver that makes the position of a joint, rad or m, a function of time."""
    if isinstance(joint, RevoluteJoint):
        return PrescribedAngle(joint.first, joint.second, joint.axis_first, position)
    ends = joint.first, joint.second, joint.point_first, joint.point_second
    return PrescribedTranslation(*ends, joint.axis, position)


def _add_resistances(elements: Elements, friction: FrictionLaw | None) -> None:
    for name, joint in elements.tree.joints.items():
        if (ideal := elements.scalar(name)) is None:
            continue
        with elements.tree.location.at(name).in_errors():
            if joint.damping or joint.stiffness:
                spring = spring_of(ideal, joint.stiffness, joint.damping, joint.rest)
                elements.add(spring, name, "spring" if joint.stiffness else "damping")
            if joint.friction and friction is not None:
                elements.add(friction_of(ideal, friction, joint.friction), name, "friction")


def friction_of(
    joint: HingeOrSlider, law: FrictionLaw, load: PyTree, **options: PyTree
) -> JointFriction:
    """Return friction in a joint: `load`, N m (hinge) or N (slider), times the ratio by `law`.
    `options`: further arguments of `JointFriction`."""
    ends = joint.first, joint.second
    if isinstance(joint, RevoluteJoint):
        return JointFriction(*ends, law, load, joint.axis_first, 1.0, **options)
    return JointFriction(*ends, law, load, joint.axis, None, joint.point_second, **options)


def spring_of(
    joint: HingeOrSlider, stiffness: PyTree, damping: PyTree, rest: PyTree
) -> AbstractForce:
    """Return the spring and damper of a hinge or slider, relaxed at the position `rest`, rad or m;
    `stiffness` in N m/rad or N/m, `damping` in N m s/rad or N s/m."""
    ends = joint.first, joint.second
    if isinstance(joint, RevoluteJoint):
        return TorsionalSpring(*ends, joint.axis_first, stiffness, damping, rest)
    axis = np.asarray(joint.axis) / np.linalg.norm(joint.axis)
    # A bushing has a stiffness along each of its own axes. The first of these is the slider's axis;
    # the others get no stiffness. A relaxed bushing's two points coincide, and the first point is
    # where the second one is at the position `rest`.
    across = [pack(vector) for vector in transverse_axes(Vector(*axis.tolist()))]
    along = robots.euler_parameters(np.column_stack([axis, *across]))
    return Bushing(
        *ends,
        point_first=joint.point_first + rest * axis,
        point_second=joint.point_second,
        stiffness=(stiffness, 0.0, 0.0),
        damping=(damping, 0.0, 0.0),
        orientation_first=along,
        orientation_second=along,
    )


def _add_stops(elements: Elements, stops: Mapping[str, Play]) -> None:
    """Add stops at the limits of joints: a `Backlash` or, for a slider, a `PinInSlot` with ends,
    whose play is the range of the joint. `stops[joint]`: other arguments of this element."""
    tree = elements.tree
    # Only joints of one degree of freedom with a finite range can have stops.
    limits_of = {n: j.limits for n, j in tree.joints.items() if j.limits and elements.scalar(n)}
    ranges = {n: r for n, r in limits_of.items() if -math.inf < r.lower < r.upper < math.inf}
    for name, settings in stops.items():
        joint = elements.scalar(name)  # ``None`` for a wrong name, which `_checked` refuses
        kind = Backlash if isinstance(joint, RevoluteJoint) else PinInSlot
        of_hinge, of_slider = OF_STOPS
        names = of_hinge if kind is Backlash else of_slider
        allowed = {key: value for key, value in arguments(kind).items() if key in names}
        settings = _checked(name, settings, "stops", [*ranges], allowed, tree.location)
        limits, at = ranges[name], tree.location.at(name)
        room, middle = limits.upper - limits.lower, 0.5 * (limits.upper + limits.lower)
        # Constructors warn of a large play, but here it is the range of the joint.
        with at.in_errors(), quiet():
            if isinstance(joint, RevoluteJoint):
                stop = backlash_of(joint, play=room, middle=middle, **settings)
            else:
                assert isinstance(joint, PrismaticJoint)
                if "law" not in settings:
                    remedy = "pass a law whose stiffness is a number, N/m"
                    at.refuse([*settings], "a `law` of the ends", remedy)
                stop = ends_of_travel(joint, room, middle, settings)
        elements.add(stop, name, "stop")


def ends_of_travel(
    joint: PrismaticJoint, room: PyTree, middle: PyTree, settings: Play
) -> PinInSlot:
    """Return the two stops of a slider, at the positions `middle` - `room` / 2 and `middle` +
    `room` / 2, m. `settings`: further arguments of the `PinInSlot`, such as its `law`."""
    axis = np.asarray(joint.axis) / np.linalg.norm(joint.axis)
    normal, _ = transverse_axes(Vector(*axis.tolist()))
    # The stops are the ends of the slot. The walls beside the pin are never touched: they are much
    # farther away than the ends. The pin's radius, which moves no end, only bounds penetrations and
    # appears in drawings.
    return PinInSlot(
        joint.first,
        joint.second,
        play=FAR * room,
        pin_radius=room,
        travel=room,
        slot_point=joint.point_first + middle * axis,
        slot_axis=axis,
        slot_normal=pack(normal),
        pin_point=joint.point_second,
        **settings,
    )

"""Robots as trees of links and joints, whatever the format of their files, and their scenes.

A joint gives the frame of its child link relative to the frame of its parent link while the joint
is at zero. Links that are fixed to each other form one body, named after the first of them, the
carrier.

The frames of all bodies are parallel to the root link's frame while all joints are at zero. The
components of a joint's axis are then the same in both bodies, and the angle of a joint, of a
backlash and of a drive without `orientation` is zero where the file's is. With body frames parallel
to those of the links, a joint's frame that is turned about its axis would shift the zero.
"""

import math
from collections import Counter
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from graphlib import TopologicalSorter
from typing import NamedTuple, TypeAlias

import numpy as np
from jaxtyping import PyTree

from .._fields.cautions import NotCarriedOverWarning, caution
from .._fields.checks import as_number, nearest, require_positive
from .._fields.types import TripleLike
from .._model.bodies import GROUND, Body, State, body_state
from .._model.clearance_joints.backlash import Backlash
from .._model.clearance_joints.clearance import ClearanceJoint, FixedAxially
from .._model.joints.base import AbstractConstraint, AbstractContactJoint
from .._model.joints.ideal import (
    FixedJoint,
    PlanarJoint,
    PrismaticJoint,
    RevoluteJoint,
    SphericalJoint,
)
from .._model.scene import Scene
from .classes import Expectation, arguments
from .documents import FileLocation, listed
from .reading import Reader

Play: TypeAlias = Mapping[str, PyTree]
"""Arguments of a `ClearanceJoint`, or of a `Backlash`, by name, as the user passes them."""
HINGES = "revolute", "continuous"
"""Types of joints that rotate about one axis. Only these may have play."""
FLOATING = "floating"
"""Type of joints that leave the child free; the scene has no joint for them."""
FIXED = "fixed"
IDEAL = {
    **dict.fromkeys(HINGES, (RevoluteJoint, 2)),
    "prismatic": (PrismaticJoint, 1),
    "planar": (PlanarJoint, 2),
    "spherical": (SphericalJoint, 0),
    FIXED: (FixedJoint, 0),
}
"""Class of the ideal joint, and how often it takes the axis, by the type of the joint."""
TYPES = *IDEAL, FLOATING
BACKLASH = "backlash"
"""Key of the angle of a backlash, rad, which the class `Backlash` calls `play`."""
GIVEN_BY_THE_FILE = {
    *("bearing_body", "bearing_point", "bearing_axis"),
    *("journal_body", "journal_point", "journal_axis"),
    *("first", "second", "axis_first", "axis_second", "play", "play_length"),
}
"""Arguments of `ClearanceJoint` and `Backlash` that the user can't pass."""
ROUNDING = 0.5e-9
"""Relative error of moments of inertia that is allowed for rounding, less than `Body` allows."""
ZERO = 1e-14
"""Ratio of a moment or product of inertia to the largest moment below which it counts as zero."""


@dataclass(frozen=True)
class JointLimits:
    """Limits of a joint in a URDF file. Those that the file omits are infinite.

    - `lower`, `upper`: smallest and largest position of the joint, rad or m.
    - `effort`: largest torque or force, N m or N.
    - `velocity`: largest speed, rad/s or m/s.

    >>> cj.results.JointLimits(effort=10.0).velocity
    inf
    """

    lower: float = -math.inf
    upper: float = math.inf
    effort: float = math.inf
    velocity: float = math.inf


@dataclass(frozen=True)
class LinkPose:
    """Where the frame of a robot's link is in a scene.

    - `body`: name of the body to which the link belongs; "ground" if it doesn't move.
    - `point`: (3,) m in body axes, from the body's centre of mass to the origin of the frame.
    - `orientation`: (4,) Euler parameters, scalar first, that transform components in the link's
      frame to the body's frame.

    >>> cj.results.LinkPose("arm", (0.5, 0.0, 0.0)).orientation
    (1.0, 0.0, 0.0, 0.0)
    """

    body: str
    point: tuple[float, float, float]
    orientation: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)


class Inertial(NamedTuple):
    """Mass of a link, kg, its centre (3,), m, in the link's frame, and the inertia tensor (3, 3),
    kg m^2, about the centre in the link's axes; None if unknown."""

    mass: float
    centre: np.ndarray
    tensor: np.ndarray | None


class RobotLink(NamedTuple):
    """A link: its name, and its inertia unless the file gives none."""

    name: str
    inertial: Inertial | None = None


class RobotJoint(NamedTuple):
    """A joint of the tree.

    - `pose`: (4, 4) homogeneous matrix, m, from the child's to the parent's frame at zero.
    - `axis`: (3,) in the child's axes, any length.
    """

    name: str
    kind: str
    parent: str
    child: str
    pose: np.ndarray
    axis: np.ndarray
    limits: JointLimits | None = None


@dataclass(frozen=True)
class Options:
    """Choices of the user for the bodies of a robot, see `load_urdf`."""

    merge_fixed: bool = True
    free_root: bool = False
    balance_inertia: bool = False
    bound_mass: float = 0.0
    bound_inertia: float = 0.0


@dataclass
class Carrier:
    """Links that form one body, or belong to the ground.

    - `pose`: (4, 4) m, from the frame of the first link to that of the root at zero.
    - `centre`: (3,) m, the body's centre of mass in the frame of the first link.
    """

    body: str
    pose: np.ndarray
    links: list[str]
    centre: np.ndarray = field(default_factory=lambda: np.zeros(3))


class Robot:
    """A tree of links, with the body to which each link belongs.

    - `root`: the only link that is no joint's child.
    - `carriers`: the body of each link; links of one body share the object.
    - `poses`: (4, 4) m, from the frame of each link to that of its carrier's first link.
    """

    def __init__(
        self,
        links: Iterable[RobotLink],
        joints: Iterable[RobotJoint],
        location: FileLocation,
        options: Options,
    ):
        self.location, self.options = location, options
        self.links = _by_name(links, "link", location)
        self.joints = _by_name(joints, "joint", location)
        of_child = self._joints_by_child()
        (self.root,) = self.links.keys() - of_child.keys()
        is_free = options.free_root
        base = Carrier(self._body_name(self.root) if is_free else GROUND, np.eye(4), [self.root])
        self.carriers, self.poses = {self.root: base}, {self.root: np.eye(4)}
        parents = {child: [joint.parent] for child, joint in of_child.items()}
        with location.in_errors():  # an error for a cycle of joints
            parents_first = [*TopologicalSorter(parents).static_order()]
        for name in parents_first:
            if name == self.root:
                continue
            joint = of_child[name]
            carrier, pose = self.carriers[joint.parent], self.poses[joint.parent] @ joint.pose
            if self._is_part(joint):
                carrier.links.append(name)
            else:
                carrier = Carrier(self._body_name(name), carrier.pose @ pose, [name])
                pose = np.eye(4)
            self.carriers[name], self.poses[name] = carrier, pose
        for carrier in self.moving():
            carrier.centre = self._centre(carrier)

    def _joints_by_child(self) -> dict[str, RobotJoint]:
        """Return the joints by their child links, to each of which they must lead once from one
        root."""
        of_child: dict[str, RobotJoint] = {}
        for joint in self.joints.values():
            at = self.location.at(joint.name)
            for end, link in (("parent", joint.parent), ("child", joint.child)):
                if link not in self.links:
                    remedy = nearest(link, self.links, "add the <link>")
                    at.at(end).refuse(link, "the name of a link of the file", remedy)
            other = of_child.setdefault(joint.child, joint)
            if other is not joint:
                expected = f"a link that is not yet the child of joint {other.name!r}"
                remedy = "robots are trees: leave one of the joints out, and add it to the scene"
                at.at("child").refuse(joint.child, expected, remedy)
        roots = [name for name in self.links if name not in of_child]
        if len(roots) != 1:
            expected = "one root link that is no joint's child"
            remedy = "join the others to it" if roots else "open the loop, or add links"
            self.location.refuse(roots, expected, remedy)
        return of_child

    def _is_part(self, joint: RobotJoint) -> bool:
        inertial = self.links[joint.child].inertial
        has_mass = inertial is not None and inertial.mass > 0.0
        return joint.kind == FIXED and (self.options.merge_fixed or not has_mass)

    def _body_name(self, link: str) -> str:
        name = f"{GROUND} link" if link == GROUND else link
        if link == GROUND and name in self.links:
            remedy = "rename one of the links"
            self.location.at(link).refuse(link, f"no other link {name!r} beside it", remedy)
        return name

    def moving(self) -> list[Carrier]:
        """Return the carriers that are bodies, in the order of the file."""
        carriers = {id(carrier): carrier for carrier in map(self.carriers.__getitem__, self.links)}
        return [carrier for carrier in carriers.values() if carrier.body != GROUND]

    def massive(self, carrier: Carrier) -> dict[str, Inertial]:
        """Return the inertias of the links of a carrier that have any, by the links' names."""
        inertials = {name: self.links[name].inertial for name in carrier.links}
        return {name: inertial for name, inertial in inertials.items() if inertial is not None}

    def _centre(self, carrier: Carrier) -> np.ndarray:
        """Return the centre of mass of a carrier in the frame of its first link; without mass that
        of its first link that has an <inertial>, or the origin."""
        inertials = self.massive(carrier)
        centres = [_moved(self.poses[name], part.centre) for name, part in inertials.items()]
        masses = np.array([part.mass for part in inertials.values()])
        if not centres:
            return np.zeros(3)
        # Relative to the first centre, so that a single link's centre is not rounded.
        shifts = np.array(centres) - centres[0]
        return centres[0] + (masses @ shifts / masses.sum() if masses.sum() > 0.0 else 0.0)

    def frame(self, link: str) -> LinkPose:
        """Return the place of a link's frame in its body."""
        carrier, pose = self.carriers[link], self.poses[link]
        rotation = _rounded(carrier.pose[:3, :3] @ pose[:3, :3])
        point = self.in_body(carrier, pose[:3, 3])
        return LinkPose(carrier.body, point, euler_parameters(rotation))

    def in_body(self, carrier: Carrier, point: np.ndarray) -> tuple[float, float, float]:
        """Convert a point, (3,) m, from the frame of the carrier's first link to body axes, whose
        origin is the centre of mass."""
        x, y, z = _rounded(carrier.pose[:3, :3]) @ (point - carrier.centre)
        return float(x), float(y), float(z)


def scene_of(
    robot: Robot, play: Mapping[str, Play], gravity: TripleLike | None
) -> tuple[Scene, State]:
    """Return the scene of a robot, and its state at rest with all joints at zero."""
    location = robot.location
    hinges = [joint.name for joint in robot.joints.values() if joint.kind in HINGES]
    play = {name: _checked(name, settings, hinges, location) for name, settings in play.items()}
    carriers = robot.moving()
    if not carriers:
        remedy = "pass free_root=True, which makes the root a body, or correct the joints"
        location.refuse(f"no link that moves relative to {robot.root!r}", "some", remedy)
    bodies = _bodies(robot, carriers)
    joints = {}
    for joint in robot.joints.values():
        settings = play.get(joint.name)
        # A clearance replaces the ideal joint, a backlash is added to it.
        has_backlash = settings is not None and BACKLASH in settings
        scene_joint = _joint(joint, robot, None if has_backlash else settings)
        if scene_joint is not None:  # floating joints and joints within a body have none
            joints[joint.name] = scene_joint
        # Only hinges pass `_checked`, and without a clearance they are always revolute joints.
        if settings is not None and has_backlash and isinstance(scene_joint, RevoluteJoint):
            name, at = f"{joint.name} {BACKLASH}", location.at(joint.name)
            if name in robot.joints:
                expected = f"no joint {name!r}, which is the name of the backlash"
                at.refuse(name, expected, "rename that joint")
            joints[name] = _backlash(joint, scene_joint, settings, at)
    state = {
        carrier.body: body_state(tuple(_moved(carrier.pose, carrier.centre)))
        for carrier in carriers
    }
    with location.in_errors():
        return Scene(bodies, joints, gravity=gravity), State(state)


def _bodies(robot: Robot, carriers: Iterable[Carrier]) -> dict[str, Body]:
    options, bodies = robot.options, {}
    balanced: list[str] = []
    bounded: list[str] = []
    for carrier in carriers:
        location = robot.location.at(carrier.links[0])
        inertials = robot.massive(carrier)
        if options.balance_inertia:
            possible = {name: _balanced(part) for name, part in inertials.items()}
            balanced += [name for name, part in possible.items() if part is not inertials[name]]
            inertials = possible
        mass = sum(part.mass for part in inertials.values())
        tensor = _tensor(robot, carrier, inertials)
        if mass < options.bound_mass or np.linalg.eigvalsh(tensor)[0] < options.bound_inertia:
            bounded.append(carrier.body)
            mass = max(mass, options.bound_mass)
            tensor = _bounded(tensor, options.bound_inertia)
        if not mass > 0.0:
            remedy = (
                "give it an <inertial>, fix it to its parent, or pass for example bound_mass=1e-3 "
                "and bound_inertia=1e-6, least values for bodies in kg and kg m^2"
            )
            location.refuse("no mass", "the mass of a moving link", remedy)
        _require_possible(tensor, carrier, inertials, robot.location)
        rotation = _rounded(carrier.pose[:3, :3])
        tensor = rotation @ tensor @ rotation.T
        # Three moments make a smaller program than a tensor. Rounding makes a rotated tensor
        # slightly unsymmetric, and that of a ball not quite diagonal.
        products = tensor - np.diag(tensor.diagonal())
        is_principal = np.abs(products).max() <= ZERO * np.abs(tensor).max()
        inertia = tensor.diagonal() if is_principal else 0.5 * (tensor + tensor.T)
        with location.in_errors():
            bodies[carrier.body] = Body(mass, inertia)
    changes = {
        "impossible inertias, replaced by their mean moment, of links": balanced,
        "masses or moments of inertia below the least ones, increased, of bodies": bounded,
    }
    replaced = [f"{title} {', '.join(names)}" for title, names in changes.items() if names]
    if replaced:
        caution(f"{robot.location}: {'; '.join(replaced)}.", NotCarriedOverWarning)
    return bodies


def _tensor(robot: Robot, carrier: Carrier, inertials: Mapping[str, Inertial]) -> np.ndarray:
    """Return the inertia of a carrier about its centre of mass, in the axes of its first link, by
    the parallel-axis theorem."""
    total = np.zeros((3, 3))
    for name, inertial in inertials.items():
        if inertial.tensor is None:
            remedy = "give the moments of inertia in kg m^2"
            robot.location.at(name).refuse(None, "an <inertia>", remedy)
        rotation = robot.poses[name][:3, :3]
        x, y, z = _moved(robot.poses[name], inertial.centre) - carrier.centre
        across = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        total += rotation @ inertial.tensor @ rotation.T + inertial.mass * across @ across.T
    return total


def _is_possible(tensor: np.ndarray) -> bool:
    least, middle, largest = np.linalg.eigvalsh(tensor)
    excess = largest - least - middle
    return least >= -ROUNDING * abs(largest) and excess <= ROUNDING * largest


def _balanced(inertial: Inertial) -> Inertial:
    """Return the inertia that MuJoCo's `balanceinertia` makes: the principal moments are their mean
    if no rigid body has them; otherwise it is the same object."""
    tensor = inertial.tensor
    if tensor is None or _is_possible(tensor):
        return inertial
    return inertial._replace(tensor=np.eye(3) * (np.trace(tensor) / 3.0))


def _bounded(tensor: np.ndarray, least: float) -> np.ndarray:
    moments, axes = np.linalg.eigh(tensor)
    return axes @ np.diag(np.maximum(moments, least)) @ axes.T


def _require_possible(
    tensor: np.ndarray, carrier: Carrier, names: Collection[str], location: FileLocation
) -> None:
    """Check the inertia of a body so that the message names the links with mass and the options."""
    moments = np.linalg.eigvalsh(tensor)
    at = location.at(carrier.links[0])
    whole = f" of links {', '.join(names)} together" if len(names) > 1 else ""
    actual = f"principal moments {', '.join(f'{x:.4g}' for x in moments)} kg m^2"
    if not _is_possible(tensor):
        expected = f"an inertia{whole} such that no principal moment exceeds the sum of the others"
        remedy = "correct it, or pass balance_inertia=True to replace impossible inertias"
        at.refuse(actual, expected, remedy)
    if not moments[0] > ZERO * moments[-1]:
        expected = f"an inertia{whole} with positive moments about all axes"
        at.refuse(actual, expected, "correct it, or pass for example bound_inertia=1e-6, in kg m^2")


def _by_name(elements: Iterable, kind: str, location: FileLocation) -> dict:
    elements = list(elements)
    for name, number in Counter(element.name for element in elements).items():
        if number > 1:
            location.refuse(name, f"the name of one {kind} only", "rename the others")
    return {element.name: element for element in elements}


def _checked(name: str, settings: Play, hinges: list[str], location: FileLocation) -> Play:
    if name not in hinges:
        remedy = nearest(name, hinges, "leave it out")
        location.refuse(name, f"play in one of the hinges {listed(hinges)}", remedy)
    if not isinstance(settings, Mapping):
        remedy = 'pass {"backlash": "0.1 deg"}, or the arguments of a ClearanceJoint'
        location.at(name).refuse(settings, "arguments by name", remedy)
    kind = Backlash if BACKLASH in settings else ClearanceJoint
    expected = arguments(kind)
    allowed = {key: value for key, value in expected.items() if key not in GIVEN_BY_THE_FILE}
    if kind is Backlash:
        allowed[BACKLASH] = expected["play"]
    for argument in settings:
        if argument not in allowed:
            # The message lists the backlash too, because it may have been meant.
            allowed |= {BACKLASH: Expectation()}
            remedy = nearest(argument, allowed, "leave it out")
            location.at(name).refuse(argument, f"one of the arguments {listed(allowed)}", remedy)
    # Only texts are converted here. The constructors check all other values.
    reader, at = Reader(()), location.at(name)
    return {
        key: reader.value(value, allowed[key], at.at(key)) if isinstance(value, str) else value
        for key, value in settings.items()
    }


def _backlash(
    joint: RobotJoint, hinge: RevoluteJoint, settings: Play, location: FileLocation
) -> Backlash:
    options = {key: value for key, value in settings.items() if key != BACKLASH}
    axes = {"axis_first": hinge.axis_first, "axis_second": hinge.axis_second}
    if "law" not in options and "torsional_stiffness" not in options:
        effort = math.inf if joint.limits is None else joint.limits.effort
        if not 0.0 < effort < math.inf:
            needed = "a `torsional_stiffness`, since the joint has no effort limit"
            location.refuse(None, needed, "give it in N m/rad")
        with location.in_errors():  # before the division by the angle
            angle = as_number(settings[BACKLASH], BACKLASH, "rad")
            require_positive(BACKLASH, angle, "give an angle in rad")
        # The limit turns the joint past the end of the play by a tenth of it: the elastic
        # deflection of the surfaces in contact (flanks) is small compared with the play.
        options["torsional_stiffness"] = effort / (0.1 * float(angle))
    with location.in_errors():
        return Backlash(hinge.first, hinge.second, play=settings[BACKLASH], **axes, **options)


def _joint(
    joint: RobotJoint, robot: Robot, play: Play | None
) -> AbstractConstraint | AbstractContactJoint | None:
    parent, child = robot.carriers[joint.parent], robot.carriers[joint.child]
    location = robot.location.at(joint.name)
    if joint.kind not in TYPES:
        kinds = f"one of the types {listed(TYPES)}"
        location.refuse(joint.kind, kinds, "correct it, or fix the link and add the joint yourself")
    if parent is child or joint.kind == FLOATING:
        return None
    # The frame of the joint is that of the child link, which begins its carrier.
    in_parent = robot.poses[joint.parent] @ joint.pose
    points = robot.in_body(parent, in_parent[:3, 3]), robot.in_body(child, np.zeros(3))
    bodies = parent.body, child.body
    # All bodies are parallel at zero, so that the axis has the same components in both.
    axis = _rounded(_rounded(child.pose[:3, :3]) @ joint.axis)
    with location.in_errors():
        if play is not None:
            return ClearanceJoint(
                *bodies,
                bearing_point=points[0],
                journal_point=points[1],
                bearing_axis=axis,
                journal_axis=axis,
                **{"axial": FixedAxially(), **play},
            )
        make, axes = IDEAL[joint.kind]
        return make(*bodies, *points, *[axis] * axes)


def _moved(pose: np.ndarray, point: np.ndarray) -> np.ndarray:
    return _rounded(pose[:3, :3]) @ point + pose[:3, 3]


def _rounded(numbers: np.ndarray) -> np.ndarray:
    """Restore the exact zeros of a quarter turn, which make the compiled program smaller."""
    return np.round(numbers, 15) + 0.0  # no negative zeros


def euler_parameters(rotation: np.ndarray) -> tuple[float, float, float, float]:
    """Return the Euler parameters (4,), scalar first, of a rotation matrix (3, 3)."""
    from scipy.spatial.transform import Rotation

    w, x, y, z = Rotation.from_matrix(rotation).as_quat(scalar_first=True).tolist()
    return w, x, y, z

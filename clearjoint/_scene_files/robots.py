"""Robots as trees of links and joints, whatever the format of their files, and their bodies.

The pose of a joint is that of the child link relative to the parent link while the joint is at
zero, as the file defines it. A carrier is a group of links that are fixed to each other: a body,
which has the name of the first of them, or the ground.

The frames of all bodies are parallel to the root link's frame while all joints are at zero. The
components of a joint's axis are then the same in both bodies, and the angle of a joint, of a
backlash and of a drive without `orientation` is zero where the file's is. With body frames parallel
to those of the links, a joint's frame that is turned about its axis would shift the zero.
"""

import math
from collections import Counter
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from graphlib import CycleError, TopologicalSorter
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from .._fields.cautions import NotCarriedOverWarning, caution
from .._fields.checks import nearest
from .._model.bodies import GROUND, Body
from .documents import FileLocation

HINGES = "revolute", "continuous"
"""Types of joints that rotate about one axis. Only these may have play."""
SLIDER = "prismatic"
BALL = "spherical"
FLOATING = "floating"
"""Type of joints that leave the child free; the scene has no joint for them."""
FIXED = "fixed"
ROUNDING = 0.5e-9
"""Relative rounding error that moments of inertia may have, less than `Body` allows."""
NEGLIGIBLE = 1e-11
"""Mass and inertia of a body that has none in the file, as a fraction of those of the bodies that
it carries, or of its joint's armature. The acceleration of such a body in absolute coordinates, as
in `observe`, is a difference of numbers that are larger by the inverse of this fraction;
`ConstraintEquations.corrected` corrects the rounding error."""
ZERO = 1e-14
"""Moments and products of inertia below this fraction of the largest moment count as zero."""


@dataclass(frozen=True)
class JointLimits:
    """Limits of a joint in a robot's file. Those that the file omits are infinite.

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
    """Mass of a link, kg; its centre of mass, (3,) m in the link's frame; and the inertia tensor
    (3, 3), kg m^2, about this centre in the link's axes, ``None`` if unknown."""

    mass: float
    centre: np.ndarray
    tensor: np.ndarray | None


class RobotLink(NamedTuple):
    name: str
    inertial: Inertial | None = None


class Mimic(NamedTuple):
    """Position of a joint, rad or m, as a polynomial of the position of the joint `leader`, with
    the constant first in `coefficients`; a constant if `leader` is ``None``."""

    leader: str | None
    coefficients: tuple[float, ...]


class RobotJoint(NamedTuple):
    """A joint of the tree.

    - `kind`: type in the file, such as `FIXED`. `parent`, `child`: names of the joint's links.
    - `pose`: (4, 4) homogeneous matrix, m, from child's to parent's frame with the joint at zero.
    - `axis`: (3,) in the child's axes, any length.
    - `limits`, `mimic`: ``None`` for a joint without limits, and for one that follows no other.
    - `point`: (3,) m, of the joint in the child's frame, the origin by default.
    - `friction`: N m or N, dry. `damping`: N m s/rad or N s/m. `stiffness`: N m/rad or N/m, of a
      spring that is relaxed at `rest`, rad or m. `armature`: kg m^2 or kg, zero for none.
    """

    name: str
    kind: str
    parent: str
    child: str
    pose: np.ndarray
    axis: np.ndarray
    limits: JointLimits | None = None
    mimic: Mimic | None = None
    friction: float = 0.0
    damping: float = 0.0
    stiffness: float = 0.0
    rest: float = 0.0
    armature: float = 0.0
    point: np.ndarray = np.zeros(3)


class LoopJoint(NamedTuple):
    """A joint that closes a loop between the links `first` and `second`. The `kind` `FIXED` makes a
    frame in each of the two links coincide, `BALL` only the origins of these frames. `in_first`,
    `in_second`: pose of each frame in its link, (4, 4) m."""

    name: str
    kind: str
    first: str
    second: str
    in_first: np.ndarray
    in_second: np.ndarray


@dataclass(frozen=True)
class Actuator:
    """An actuator of a robot's file, from which to make a `Motor` or `DriveTorque`.

    The actuator's moment (N m) or force (N) on the joint is gear * f, with
    f = gain * u + bias[0] + bias[1] * gear * q + bias[2] * gear * q'; u is the control, q the
    joint's position, q' its rate.

    - `joint`: name of the joint.
    - `gear`: ratio of the actuator's motion to the joint's.
    - `gain`, `bias`: coefficients of f, (3,) for the bias.
    - `control`: smallest and largest u.
    - `force`: smallest and largest f.

    >>> servo = cj.results.Actuator("elbow", gain=50.0, bias=(0.0, -50.0, -2.0))
    >>> servo.gear
    1.0
    """

    joint: str
    gear: float = 1.0
    gain: float = 1.0
    bias: tuple[float, float, float] = (0.0, 0.0, 0.0)
    control: tuple[float, float] = (-math.inf, math.inf)
    force: tuple[float, float] = (-math.inf, math.inf)


class Content(NamedTuple):
    """Content of a robot's file. `omitted`: for each kind of content that scenes can't represent,
    by its title in messages, the names of the links, joints or other elements that have it; an
    empty list for content of the robot as a whole. `gravity`: m/s^2."""

    links: list[RobotLink]
    joints: list[RobotJoint]
    omitted: dict[str, list[str]]
    loops: tuple[LoopJoint, ...] = ()
    actuators: Mapping[str, Actuator] = MappingProxyType({})
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81)


@dataclass(frozen=True)
class Options:
    """The arguments of `load_robot` that determine bodies, with the same names."""

    merge_fixed: bool = True
    free_root: bool = False
    balance_inertia: bool = False
    bound_mass: float = 0.0
    bound_inertia: float = 0.0


@dataclass
class Carrier:
    """Links that form one body, or belong to the ground; see the docstring of this module.

    - `pose`: (4, 4) m, from the first link's frame to the root's frame with all joints at zero.
    - `centre`: (3,) m, the body's centre of mass in the frame of the first link.
    """

    body: str
    pose: np.ndarray
    links: list[str]
    centre: np.ndarray = field(default_factory=lambda: np.zeros(3))


class LinkTree:
    """The links and joints of a robot's file as a tree, and the links in groups that form bodies.

    - `root`: name of the only link that is no joint's child.
    - `carriers`: the `Carrier` of each link, by the link's name.
    - `poses`: (4, 4) m, by name, from each link's frame to the frame of its carrier's first link.
    """

    def __init__(self, content: Content, location: FileLocation, options: Options):
        self.location, self.options = location, options
        self.links = _by_name(content.links, "link", location)
        self.joints = _by_name(content.joints, "joint", location)
        of_child = self._joints_by_child()
        # Exactly one link is no child: another number has been refused.
        (self.root,) = self.links.keys() - of_child.keys()
        is_free = options.free_root
        base = Carrier(self._body_name(self.root) if is_free else GROUND, np.eye(4), [self.root])
        self.carriers, self.poses = {self.root: base}, {self.root: np.eye(4)}
        parents = {child: [joint.parent] for child, joint in of_child.items()}
        for name in leaders_first(parents, location)[1:]:  # without the root
            joint = of_child[name]
            carrier, pose = self.carriers[joint.parent], self.poses[joint.parent] @ joint.pose
            inertial = self.links[name].inertial
            has_mass = inertial is not None and inertial.mass > 0.0
            # A fixed link becomes a part of its parent's body if it has no mass, or links shall be
            # merged. Every other link begins a new body.
            if joint.kind == FIXED and (options.merge_fixed or not has_mass):
                carrier.links.append(name)
            else:
                carrier = Carrier(self._body_name(name), carrier.pose @ pose, [name])
                pose = np.eye(4)
            self.carriers[name], self.poses[name] = carrier, pose
        for carrier in self.moving():
            carrier.centre = self._centre(carrier)

    def _joints_by_child(self) -> dict[str, RobotJoint]:
        """Return the joints by their child links; refuse a file that has not exactly one root."""
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

    def carried(self, carrier: Carrier) -> list[Carrier]:
        """Return the carriers that a carrier's joints carry, directly or by way of others."""
        ends = [self.carriers[j.child] for j in self.joints.values() if j.parent in carrier.links]
        ends = [end for end in ends if end is not carrier]
        return ends + [further for end in ends for further in self.carried(end)]

    def massive(self, carrier: Carrier) -> dict[str, Inertial]:
        """Return the inertias of those links of a carrier that have one in the file, by name."""
        inertials = {name: self.links[name].inertial for name in carrier.links}
        return {name: inertial for name, inertial in inertials.items() if inertial is not None}

    def _centre(self, carrier: Carrier) -> np.ndarray:
        """Return a carrier's centre of mass, (3,) m, in the frame of its first link. For a carrier
        without mass, return the centre of the first link that has an `Inertial`, or else zeros."""
        inertials = self.massive(carrier)
        centres = [moved(self.poses[name], part.centre) for name, part in inertials.items()]
        masses = np.array([part.mass for part in inertials.values()])
        if not centres:
            return np.zeros(3)
        # Relative to the first centre, so that a single link's centre is not rounded.
        shifts = np.array(centres) - centres[0]
        return centres[0] + (masses @ shifts / masses.sum() if masses.sum() > 0.0 else 0.0)

    def placed(
        self, link: str, frame: np.ndarray
    ) -> tuple[Carrier, tuple[float, float, float], np.ndarray]:
        """Return where a frame in a link, (4, 4) m, is: the link's carrier; the origin relative to
        the centre of mass of the carrier's body, (3,) m in body axes; and the rotation matrix from
        the frame to these axes, (3, 3)."""
        carrier, pose = self.carriers[link], self.poses[link] @ frame
        rotation = rounded(carrier.pose[:3, :3] @ pose[:3, :3])
        return carrier, self.in_body(carrier, pose[:3, 3]), rotation

    def frame(self, link: str) -> LinkPose:
        carrier, point, rotation = self.placed(link, np.eye(4))
        return LinkPose(carrier.body, point, euler_parameters(rotation))

    def in_body(self, carrier: Carrier, point: np.ndarray) -> tuple[float, float, float]:
        """Return a point's position relative to the centre of mass of the carrier's body, (3,) m in
        body axes. `point`: (3,) m in the frame of the carrier's first link."""
        x, y, z = rounded(carrier.pose[:3, :3]) @ (point - carrier.centre)
        return float(x), float(y), float(z)


def bodies_of(tree: LinkTree, carriers: Iterable[Carrier]) -> dict[str, Body]:
    options, bodies = tree.options, {}
    balanced: list[str] = []
    bounded: list[str] = []
    for carrier in carriers:
        location = tree.location.at(carrier.links[0])
        inertials = tree.massive(carrier)
        if options.balance_inertia:
            # `_balanced` returns the same object if it changes nothing.
            possible = {name: _balanced(part) for name, part in inertials.items()}
            balanced += [name for name, part in possible.items() if part is not inertials[name]]
            inertials = possible
        mass = sum(part.mass for part in inertials.values())
        tensor = _tensor(tree, carrier, inertials)
        if mass < options.bound_mass or np.linalg.eigvalsh(tensor)[0] < options.bound_inertia:
            bounded.append(carrier.body)
            mass = max(mass, options.bound_mass)
            # The principal axes stay; moments about them are increased to the bound.
            moments, axes = np.linalg.eigh(tensor)
            tensor = axes @ np.diag(np.maximum(moments, options.bound_inertia)) @ axes.T
        has_mass = mass > 0.0
        if not has_mass:
            mass, tensor = _negligible(tree, carrier)
        _require_possible(tensor, carrier, inertials, tree.location)
        rotation = rounded(carrier.pose[:3, :3])
        tensor = rotation @ tensor @ rotation.T
        # Three moments make a smaller program than a tensor. Rounding makes a rotated tensor
        # slightly unsymmetric, and that of a ball not quite diagonal.
        products = tensor - np.diag(tensor.diagonal())
        is_principal = np.abs(products).max() <= ZERO * np.abs(tensor).max()
        inertia = tensor.diagonal() if is_principal else 0.5 * (tensor + tensor.T)
        with location.in_errors():
            bodies[carrier.body] = Body(mass, inertia, is_massless=not has_mass)
    changes = {
        "impossible inertias, replaced by their mean moment, of links": balanced,
        "masses or moments of inertia below the least ones, increased, of bodies": bounded,
    }
    replaced = [f"{title} {', '.join(names)}" for title, names in changes.items() if names]
    if replaced:
        caution(f"{tree.location}: {'; '.join(replaced)}.", NotCarriedOverWarning)
    return bodies


def _negligible(tree: LinkTree, carrier: Carrier) -> tuple[float, np.ndarray]:
    """Return the mass, kg, and the inertia tensor, (3, 3) kg m^2, of a body that has no mass in the
    file, such as one between two joints of a body of MJCF: a small fraction of the masses and
    moments of inertia of the bodies that it carries."""
    # The joint that moves the body; a free root has none.
    (joint,) = [j for j in tree.joints.values() if j.child == carrier.links[0]] or [None]
    inertias = [(part, tree.massive(part)) for part in tree.carried(carrier)]
    masses = [part.mass for _, inertials in inertias for part in inertials.values()]
    moments = [np.trace(_tensor(tree, part, inertials)) for part, inertials in inertias]
    has_axis = joint is not None and joint.kind in (*HINGES, SLIDER)
    expected = "the mass of a moving link, unless a hinge or slider moves it and it carries mass"
    if not (has_axis and min(sum(masses), sum(moments)) > 0.0):
        remedy = (
            "give it an <inertial>, fix it to its parent, or pass for example bound_mass=1e-3 "
            "and bound_inertia=1e-6, least values for bodies in kg and kg m^2"
        )
        tree.location.at(carrier.links[0]).refuse("no mass", expected, remedy)
    return NEGLIGIBLE * sum(masses), NEGLIGIBLE * sum(moments) * np.eye(3)


def _tensor(tree: LinkTree, carrier: Carrier, inertials: Mapping[str, Inertial]) -> np.ndarray:
    """Return the inertia tensor of a carrier's body, (3, 3) kg m^2, about the body's centre of mass
    in the axes of the first link. `inertials`: of the carrier's links, by name."""
    total = np.zeros((3, 3))
    for name, inertial in inertials.items():
        if inertial.tensor is None:
            remedy = "give the moments of inertia in kg m^2"
            tree.location.at(name).refuse(None, "an <inertia>", remedy)
        rotation = tree.poses[name][:3, :3]
        x, y, z = moved(tree.poses[name], inertial.centre) - carrier.centre
        # Parallel-axis theorem, with the matrix of the cross product by the link's offset.
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        total += rotation @ inertial.tensor @ rotation.T + inertial.mass * cross @ cross.T
    return total


def _is_possible(tensor: np.ndarray) -> bool:
    least, middle, largest = np.linalg.eigvalsh(tensor)
    excess = largest - least - middle
    return least >= -ROUNDING * abs(largest) and excess <= ROUNDING * largest


def _balanced(inertial: Inertial) -> Inertial:
    """Return the inertia as changed by MuJoCo's `balanceinertia`: if no rigid body can have the
    principal moments, each is replaced by their mean; otherwise return the same object."""
    tensor = inertial.tensor
    if tensor is None or _is_possible(tensor):
        return inertial
    return inertial._replace(tensor=np.eye(3) * (np.trace(tensor) / 3.0))


def _require_possible(
    tensor: np.ndarray, carrier: Carrier, names: Collection[str], location: FileLocation
) -> None:
    """Refuse a carrier's inertia `tensor`, kg m^2, if no body can have it. The message lists
    `names`, those of the carrier's links that have an inertia, if there are several."""
    moments = np.linalg.eigvalsh(tensor)
    at = location.at(carrier.links[0])
    links = f" of links {', '.join(names)} together" if len(names) > 1 else ""
    actual = f"principal moments {', '.join(f'{x:.4g}' for x in moments)} kg m^2"
    if not _is_possible(tensor):
        expected = f"an inertia{links} such that no principal moment exceeds the sum of the others"
        remedy = "correct it, or pass balance_inertia=True to replace impossible inertias"
        at.refuse(actual, expected, remedy)
    if not moments[0] > ZERO * moments[-1]:
        expected = f"an inertia{links} with positive moments about all axes"
        at.refuse(actual, expected, "correct it, or pass for example bound_inertia=1e-6, in kg m^2")


def leaders_first(leaders: Mapping[str, Iterable[str]], location: FileLocation) -> list[str]:
    """Return all names such that each comes after its `leaders`; refuse a cycle."""
    try:
        return [*TopologicalSorter(leaders).static_order()]
    except CycleError as error:
        location.refuse(error.args[1], "no cycle of parents or leaders", "break it at one of these")


def warn_of_omitted(file: object, omitted: Mapping[str, list[str]]) -> None:
    """Warn that what is `omitted`, see `Content`, is not carried over from or to a `file`."""
    parts = [f"{title} of {', '.join(names)}" for title, names in omitted.items() if names]
    parts += sorted(title for title, names in omitted.items() if not names)
    if parts:
        caution(f"{file}: not carried over: {'; '.join(parts)}.", NotCarriedOverWarning)


def _by_name(elements: Iterable, kind: str, location: FileLocation) -> dict:
    for name, number in Counter(element.name for element in elements).items():
        if number > 1:
            location.refuse(name, f"the name of one {kind} only", "rename the others")
    return {element.name: element for element in elements}


def pose_of(rotation: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Return the homogeneous matrix (4, 4) of a rotation matrix and a translation, m."""
    return np.block([[rotation, point[:, None]], [np.eye(4)[3:]]])


def moved(pose: np.ndarray, point: np.ndarray) -> np.ndarray:
    return rounded(pose[:3, :3]) @ point + pose[:3, 3]


def rounded(numbers: np.ndarray) -> np.ndarray:
    """Return numbers rounded to 15 decimals, which restores the exact zeros in the matrix of a
    quarter turn; zeros make compiled programs smaller."""
    return np.round(numbers, 15) + 0.0  # no negative zeros


def euler_parameters(rotation: np.ndarray) -> tuple[float, float, float, float]:
    """Return the Euler parameters (4,), scalar first, of a rotation matrix (3, 3)."""
    from scipy.spatial.transform import Rotation

    w, x, y, z = Rotation.from_matrix(rotation).as_quat(scalar_first=True).tolist()
    return w, x, y, z

"""Load robots from URDF files, with play in given joints. The package yourdfpy parses the files.

Play is either a radial clearance of a joint or a backlash, a free angle of rotation.
A link of URDF has a frame, and a joint of URDF gives the frame of its child link relative to the
frame of its parent link. The frame of a body is parallel to the frame of its link, and its origin
is the centre of mass.
"""

import math
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from graphlib import TopologicalSorter
from io import BytesIO
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple, TypeAlias
from xml.etree import ElementTree

import numpy as np
from jaxtyping import PyTree

from ..fields.cautions import NotCarriedOverWarning, caution
from ..fields.checks import as_number, nearest, require_positive
from ..fields.types import TripleLike
from ..model.bodies import GROUND, Body, State, body_state
from ..model.clearance_joints.backlash import Backlash
from ..model.clearance_joints.clearance import ClearanceJoint, FixedAxially
from ..model.joints.base import AbstractConstraint, AbstractContactJoint
from ..model.joints.ideal import FixedJoint, PrismaticJoint, RevoluteJoint
from ..model.scene import Scene
from .classes import Expectation, arguments
from .documents import FileLocation, listed, read_bytes
from .files import FilePath
from .reading import Reader

if TYPE_CHECKING:
    import yourdfpy

Play: TypeAlias = Mapping[str, PyTree]
"""Arguments of a `ClearanceJoint`, or of a `Backlash`, by name, as the user passes them."""
OF_JOINTS = {
    "limit": "limits",
    "dynamics": "damping and friction",
    "mimic": "mimics",
    "calibration": "calibrations",
    "safety_controller": "safety controllers",
}
OF_LINKS = {"visuals": "visual shapes", "collisions": "collision shapes"}
"""Contents of URDF joints (`OF_JOINTS`) and links (`OF_LINKS`) that a scene lacks. Keys are the
names of attributes in yourdfpy, values the names in messages."""
HINGES = "revolute", "continuous"
"""Types of URDF joints that rotate about one axis. Only these may have play."""
BACKLASH = "backlash"
"""Key of the angle of a backlash, rad, in the arguments of a joint's play. The class `Backlash` has
the name `play` for this angle."""
GIVEN_BY_THE_FILE = {
    *("bearing_body", "bearing_point", "bearing_axis"),
    *("journal_body", "journal_point", "journal_axis"),
    *("first", "second", "axis_first", "axis_second", "play", "play_length"),
}
"""Arguments of `ClearanceJoint` and `Backlash` that the user can't pass, since they follow from the
file or, for the angle of a backlash, have the name `BACKLASH`."""


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


def urdf_limits(path: FilePath) -> dict[str, JointLimits]:
    """Return the limits of the joints of a URDF file, by the joints' names. Joints without limits
    are left out.

    A scene has no joint limits. Use them for the torque of a `Motor`, or to check a computed
    motion. The function needs ``pip install "clearjoint[urdf]"``.

    ```python
    import clearjoint as cj

    limits = cj.urdf_limits("arm.urdf")
    print(limits["elbow"].effort, limits["elbow"].velocity)  # N m, rad/s
    ```

    **Raises:** `ValueError` for a file that can't be parsed, or of more than 50 MB; `OSError` for a
    file that does not exist; `ImportError` without the extra.
    """
    robot, _ = _robot(Path(path))
    return {joint.name: _limits(joint.limit) for joint in robot.joints if joint.limit is not None}


def _limits(limit: "yourdfpy.Limit") -> JointLimits:
    return JointLimits(**{name: float(x) for name, x in vars(limit).items() if x is not None})


def load_urdf(
    path: FilePath,
    play: Mapping[str, Play] = MappingProxyType({}),
    gravity: TripleLike | None = (0.0, 0.0, -9.81),
) -> tuple[Scene, State]:
    """Read a robot from a URDF file, with play in some of its joints.

    It needs ``pip install "clearjoint[urdf]"``.

    ```python
    import clearjoint as cj

    elbow = {
        "bearing_radius": 10e-3,
        "clearance": 0.05e-3,
        "journal_length": 20e-3,
        "law": cj.laws.LankaraniNikravesh(0.9, cj.laws.RavnStiffness(207e9, 0.3)),
    }
    wrist = {"backlash": "0.1 deg", "torsional_stiffness": "2e4 N m/rad"}
    scene, state = cj.load_urdf("arm.urdf", play={"elbow": elbow, "wrist": wrist})
    ```

    The root link is the ground. Other links with mass become bodies, whose frames are parallel to
    the frames of the links, with the origin at the centre of mass. Other links without mass must be
    fixed to their parents and are parts of them. Revolute, continuous, prismatic and fixed joints
    keep their names; the child of a floating joint is free.

    **Arguments:**

    - `path`: path of the file.
    - `play`: a dictionary of arguments for each revolute or continuous joint with play, by the
      joint's name. Numbers may be texts with units. There are two kinds:
        - Arguments of a `ClearanceJoint`, which replaces the joint. Bodies, points and axes are
          those of the file: the parent has the bearing, the child the journal. `axial` is
          `FixedAxially()` by default.
        - ``"backlash"``, an angle in rad, and arguments of a `Backlash`, which is added to the
          scene with a name such as "elbow backlash"; the joint stays. By default its
          `torsional_stiffness` is such that the joint's effort limit in the file deflects the
          surfaces in contact (flanks) by a tenth of the backlash. Without an effort limit, a
          `torsional_stiffness` or a `law` must be given.
    - `gravity`: (3,) m/s^2, or ``None``.

    **Returns:** the scene, and its state at rest with all joints at zero.

    **Raises:** `ValueError`, with the file and the element, for a file that can't be read, a robot
    that a scene can't represent, and invalid `play`. `OSError` for a file that does not exist.
    `ImportError` without the extra.

    **Warns:** `NotCarriedOverWarning` lists the contents of the file that the scene lacks: limits
    (see `urdf_limits`), damping and friction, mimics, shapes and others.
    """
    robot, tags = _robot(Path(path))
    location = FileLocation(str(path))
    hinges = [joint.name for joint in robot.joints if joint.type in HINGES]
    play = {name: _checked(name, given, hinges, location) for name, given in play.items()}
    frames = _frames(robot, location)
    children = {joint.child for joint in robot.joints}
    # The root, which may be named "ground", is no child, and not a body.
    bodies = {
        link.name: _body(link, location.at(link.name))
        for link in robot.links
        if frames[link.name].body == link.name and link.name in children
    }
    joints = {}
    for joint in robot.joints:
        given, joint_location = play.get(joint.name), location.at(joint.name)
        has_backlash = given is not None and BACKLASH in given
        # A clearance replaces the ideal joint, a backlash is added to it.
        clearance = None if has_backlash else given
        scene_joint = _joint(joint, frames, clearance, joint_location)
        if scene_joint is not None:  # floating joints and joints within a body have none
            joints[joint.name] = scene_joint
        # Only hinges pass `_checked`, and without a clearance they are always revolute joints.
        if given is not None and has_backlash and isinstance(scene_joint, RevoluteJoint):
            backlash_name = f"{joint.name} {BACKLASH}"
            if any(other.name == backlash_name for other in robot.joints):
                expected = f"no joint {backlash_name!r}, which is the name of the backlash"
                joint_location.refuse(backlash_name, expected, "rename that joint")
            joints[backlash_name] = _backlash(joint, scene_joint, given, joint_location)
    omitted = _not_carried_over(robot, frames, tags)
    if omitted:
        caution(f"{path}: not carried over: {omitted}.", NotCarriedOverWarning)
    state = {}
    for name in bodies:
        # A pose is that of the link's frame. A body's frame is parallel to it and lies in the
        # centre of mass, from which `origin` leads to the origin of the link's frame.
        rotation, origin = frames[name].pose[:3, :3], frames[name].pose[:3, 3]
        centre = origin - rotation @ frames[name].origin
        state[name] = body_state(centre, _euler_parameters(rotation))
    with location.in_errors():
        return Scene(bodies, joints, gravity=gravity), State(state)


def _not_carried_over(
    robot: "yourdfpy.Robot", frames: Mapping[str, "Frame"], tags: Iterable[str]
) -> str:
    """Return a text that lists the contents of the file that the scene lacks; empty if none.

    **Arguments:** `frames`: frames of the links, by name; `tags`: tags of the XML elements of the
    robot, except of those inside of links and joints.
    """
    omitted = {
        title: [element.name for element in elements if getattr(element, attribute)]
        for elements, titles in ((robot.joints, OF_JOINTS), (robot.links, OF_LINKS))
        for attribute, title in titles.items()
    }
    roots = [link for link in robot.links if frames[link.name].body == GROUND]
    omitted["inertia of the root"] = [link.name for link in roots if not _is_massless(link)]
    named = [f"{title} of {', '.join(names)}" for title, names in omitted.items() if names]
    # Materials belong to the visual shapes.
    others = sorted({*tags} - {"link", "joint", "material"})
    return "; ".join([*named, *(f"<{tag}>" for tag in others)])


def _robot(path: Path) -> tuple["yourdfpy.Robot", list[str]]:
    """Return the parsed robot, without meshes, and the tags of its XML elements, except of those
    inside of links and joints.

    **Raises:** `ImportError` without yourdfpy; `ValueError` for a file that can't be parsed, or of
    more than 50 MB; `OSError` for a file that does not exist.
    """
    try:
        import yourdfpy
    except ImportError as error:
        raise ImportError('URDF files need pip install "clearjoint[urdf]"') from error
    # The limit, in bytes, refuses files that would exhaust the memory: parsed they are far larger.
    content = read_bytes(path, 50_000_000)
    try:
        # yourdfpy silently skips elements that it does not know; their tags are needed to warn.
        tags = [entry.tag for entry in ElementTree.fromstring(content)]
        parsed = yourdfpy.URDF.load(BytesIO(content), build_scene_graph=False, load_meshes=False)
    except (ElementTree.ParseError, KeyError, AttributeError, ValueError, TypeError) as error:
        raise ValueError(f"{path}: {error!r}: check the file, with `check_urdf` say.") from error
    return parsed.robot, tags


def _checked(name: str, given: Play, hinges: list[str], location: FileLocation) -> Play:
    """Return the arguments of a joint's play, with texts such as "0.1 deg" converted to numbers in
    SI units.

    **Arguments:** `name`: name of the joint; `given`: its play, as the user passes it to
    `load_urdf`; `hinges`: names of the joints that can have play; `location`: the file.

    **Raises:** `ValueError` for a joint that can't have play, for arguments that are no dictionary,
    for an unknown argument, and for a text that is no number with a suitable unit.
    """
    if name not in hinges:
        remedy = nearest(name, hinges, "leave it out")
        location.refuse(name, f"play in one of the hinges {listed(hinges)}", remedy)
    if not isinstance(given, Mapping):
        remedy = 'pass {"backlash": "0.1 deg"}, or the arguments of a ClearanceJoint'
        location.at(name).refuse(given, "arguments by name", remedy)
    kind = Backlash if BACKLASH in given else ClearanceJoint
    expected = arguments(kind)
    known = {key: value for key, value in expected.items() if key not in GIVEN_BY_THE_FILE}
    if kind is Backlash:
        known[BACKLASH] = expected["play"]
    for argument in given:
        if argument not in known:
            # The message lists the backlash too, because it may have been meant.
            known |= {BACKLASH: Expectation()}
            remedy = nearest(argument, known, "leave it out")
            location.at(name).refuse(argument, f"one of the arguments {listed(known)}", remedy)
    # Only texts are converted here. The constructors check all other values.
    reader, at = Reader(()), location.at(name)
    return {
        key: reader.value(value, known[key], at.at(key)) if isinstance(value, str) else value
        for key, value in given.items()
    }


def _backlash(
    joint: "yourdfpy.Joint", hinge: RevoluteJoint, given: Play, location: FileLocation
) -> Backlash:
    """Return a `Backlash` between the bodies of a hinge, about the hinge's axis.

    If neither a law nor a stiffness is given, the stiffness follows from the joint's effort limit,
    as `load_urdf` describes.

    **Arguments:** `joint`, `hinge`: the joint of URDF, and the joint of the scene made from it;
    `given`: arguments of the backlash, checked by `_checked`.

    **Raises:** `ValueError` if neither a law nor a stiffness is given and the joint has no effort
    limit, and for invalid arguments.
    """
    options = {key: value for key, value in given.items() if key != BACKLASH}
    axes = {"axis_first": hinge.axis_first, "axis_second": hinge.axis_second}
    if "law" not in options and "torsional_stiffness" not in options:
        effort = math.inf if joint.limit is None else _limits(joint.limit).effort
        if not 0.0 < effort < math.inf:
            needed = "a `torsional_stiffness`, since the joint has no effort limit"
            location.refuse(None, needed, "give it in N m/rad")
        with location.in_errors():  # before the division by the angle
            angle = as_number(given[BACKLASH], BACKLASH, "rad")
            require_positive(BACKLASH, angle, "give an angle in rad")
        # The limit turns the joint past the end of the play by a tenth of it: the elastic
        # deflection of the surfaces in contact (flanks) is small compared with the play.
        options["torsional_stiffness"] = effort / (0.1 * float(angle))
    with location.in_errors():
        return Backlash(hinge.first, hinge.second, play=given[BACKLASH], **axes, **options)


class Frame(NamedTuple):
    """The frame of a link, relative to its body and to the ground.

    - `body`: name of the body to which the link belongs. A link without mass belongs to the body of
      its parent, the root link to the ground; every other link is a body of the same name.
    - `origin`: (3,) m in body axes, from the body's centre of mass to the origin of the frame.
    - `rotation`: (3, 3), rotation matrix from the link's to the body's axes.
    - `pose`: (4, 4), homogeneous matrix from the link's to global axes, m, if all joints are at
      zero.
    """

    body: str
    origin: np.ndarray
    rotation: np.ndarray
    pose: np.ndarray


def _frames(robot: "yourdfpy.Robot", location: FileLocation) -> dict[str, Frame]:
    """Return the frame of each link by name, found by following the joints from the root.

    The root is the only link that is no joint's child; it is the ground.

    **Raises:** `ValueError` for repeated names, joints that don't form a tree, and links without
    mass that move relative to their parent.
    """
    for kind, elements in (("link", robot.links), ("joint", robot.joints)):
        counts = Counter(element.name for element in elements)
        repeated = [name for name, count in counts.items() if count > 1]
        if repeated:
            location.refuse(repeated[0], f"the name of one {kind} only", "rename the others")
    links = {link.name: link for link in robot.links}
    joints = {joint.child: joint for joint in robot.joints}
    roots = [name for name in links if name not in joints]
    if len(roots) != 1:
        location.refuse(roots, "one root link that is no joint's child", "join the others to it")
    # Joints of unknown links, and joints whose child is also the child of another joint.
    wrong = [j.name for j in robot.joints if not {j.parent, j.child} <= links.keys()]
    wrong += [joint.name for joint in robot.joints if joints[joint.child] is not joint]
    if wrong:
        location.refuse(wrong, "joints of a tree between known links", "correct their links")
    frames = {roots[0]: Frame(GROUND, np.zeros(3), np.eye(3), np.eye(4))}
    parents = {child: [joint.parent] for child, joint in joints.items()}
    with location.in_errors():  # an error for a cycle of joints
        parents_first = [*TopologicalSorter(parents).static_order()]
    for name in parents_first:
        if name in frames:
            continue
        joint, link = joints[name], links[name]
        parent, moved = frames[joint.parent], _transform(joint.origin)
        pose = parent.pose @ moved
        if not _is_massless(link):  # the link is a body of its own
            centre = _transform(link.inertial.origin)[:3, 3]  # pyright: ignore
            frames[name] = Frame(name, -centre, np.eye(3), pose)
            continue
        if joint.type != "fixed":
            remedy = "give it an <inertial>, or fix it to its parent"
            location.at(name).refuse("no mass", "the mass of a moving link", remedy)
        origin = parent.origin + parent.rotation @ moved[:3, 3]
        frames[name] = Frame(parent.body, origin, parent.rotation @ moved[:3, :3], pose)
    return frames


def _is_massless(link: "yourdfpy.Link") -> bool:
    return link.inertial is None or not link.inertial.mass


def _body(link: "yourdfpy.Link", location: FileLocation) -> Body:
    """Return the body for a link with mass; body axes are parallel to the link's frame.

    **Raises:** `ValueError` for a missing or invalid inertia.
    """
    inertial = link.inertial
    assert inertial is not None
    if inertial.inertia is None:
        location.refuse(None, "an <inertia>", "give the moments of inertia in kg m^2")
    rotation = _transform(inertial.origin)[:3, :3]
    tensor = rotation @ inertial.inertia @ rotation.T
    # Three moments make a smaller program than a tensor. Rounding makes a rotated tensor slightly
    # unsymmetric.
    is_principal = not np.any(tensor - np.diag(tensor.diagonal()))
    with location.in_errors():
        return Body(inertial.mass, tensor.diagonal() if is_principal else 0.5 * (tensor + tensor.T))


def _joint(
    joint: "yourdfpy.Joint", frames: Mapping[str, Frame], play: Play | None, location: FileLocation
) -> AbstractConstraint | AbstractContactJoint | None:
    """Return the joint of the scene for a joint of URDF.

    **Arguments:** `frames`: frames of the links by name; `play`: arguments of a `ClearanceJoint`
    that replaces the joint, None for an ideal joint.

    **Returns:** the joint; ``None`` for a floating joint, and if both links belong to one body.

    **Raises:** `ValueError` for a type of joint that a scene doesn't have, and for an invalid
    origin, axis or argument of `play`.
    """
    parent, child = frames[joint.parent], frames[joint.child]
    if parent.body == child.body or joint.type == "floating":
        return None
    # The frame of the joint, which is that of the child link, in the axes of the parent's body. The
    # axis of the joint is given in this frame, so that it needs no rotation for the child.
    frame = _transform(joint.origin)
    rotation = parent.rotation @ frame[:3, :3]
    points = parent.origin + parent.rotation @ frame[:3, 3], child.origin
    bodies = parent.body, child.body
    axis = np.asarray(joint.axis, dtype=float)
    numbers = np.array([*np.ravel(frame), *np.ravel(axis)])
    wrong = numbers[~np.isfinite(numbers)].tolist()
    if axis.shape != (3,) or wrong:
        remedy = "correct the <origin> and the <axis>"
        location.refuse(wrong or axis.tolist(), "finite origin and axis (3,)", remedy)
    with location.in_errors():
        if play is not None:
            return ClearanceJoint(
                *bodies,
                bearing_point=points[0],
                journal_point=points[1],
                bearing_axis=rotation @ axis,
                journal_axis=axis,
                **{"axial": FixedAxially(), **play},
            )
        if joint.type in HINGES:
            return RevoluteJoint(*bodies, *points, rotation @ axis, axis)
        if joint.type == "prismatic":
            return PrismaticJoint(*bodies, *points, rotation @ axis, _euler_parameters(rotation))
        if joint.type == "fixed":
            return FixedJoint(*bodies, *points, _euler_parameters(rotation))
    kinds = listed([*HINGES, "prismatic", "fixed", "floating"])
    return location.refuse(joint.type, f"one of the types {kinds}", "add the joint to the scene")


def _transform(origin: np.ndarray | None) -> np.ndarray:
    """Return the homogeneous matrix (4, 4), m, of an <origin> element; the identity for None."""
    matrix = np.eye(4) if origin is None else np.array(origin, dtype=float)
    # Rounding restores the exact zeros of a quarter turn, which make the compiled program smaller.
    matrix[:3, :3] = np.round(matrix[:3, :3], 15)
    return matrix


def _euler_parameters(rotation: np.ndarray) -> np.ndarray:
    """Return the Euler parameters (4,), scalar first, of a rotation matrix (3, 3)."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_matrix(rotation).as_quat(scalar_first=True)

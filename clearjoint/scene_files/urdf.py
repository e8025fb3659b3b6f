"""Robots of URDF files, whose joints get play by name. yourdfpy parses."""

import math
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING
from xml.etree import ElementTree

from ..fields.cautions import NotCarriedOverWarning, caution
from ..fields.suggestions import nearest
from ..fields.types import TripleLike
from ..model.bodies import GROUND, BodyState, State, body_state
from ..model.clearance_joints.backlash import Backlash
from ..model.clearance_joints.clearance import ClearanceJoint
from ..model.joints.ideal import RevoluteJoint
from ..model.scene import Scene
from .complaints import FilePlace, listed
from .expectations import Expectation, arguments
from .files import FilePath
from .reading import Reader
from .urdf_frames import (
    Frame,
    body_of,
    child_frame,
    euler_parameters,
    is_massless,
    root_frame,
)
from .urdf_joints import HINGES, Play, joint_of

if TYPE_CHECKING:
    import yourdfpy

OF_JOINTS = {
    "limit": "limits",
    "dynamics": "damping and friction",
    "mimic": "mimics",
    "calibration": "calibrations",
    "safety_controller": "safety controllers",
}
READ = {"link", "joint", "material"}
"""Tags of which the materials belong to the looks."""
OF_LINKS = {"visuals": "looks", "collisions": "shapes of collisions"}


def not_carried_over(
    robot: "yourdfpy.Robot", frames: Mapping[str, Frame], tags: Iterable[str]
) -> str:
    """Text that lists what was not read from a file, by link and joint; empty if all was.

    **Arguments:** `tags`: of all that the file says of the robot.
    """
    left = {}
    for attribute, what in OF_JOINTS.items():
        left[what] = [joint.name for joint in robot.joints if getattr(joint, attribute)]
    for attribute, what in OF_LINKS.items():
        left[what] = [link.name for link in robot.links if getattr(link, attribute)]
    left["inertia of the root"] = [
        link.name
        for link in robot.links
        if frames[link.name].body == GROUND and not is_massless(link)
    ]
    named = [f"{what} of {', '.join(names)}" for what, names in left.items() if names]
    others = sorted(set(tags) - READ)
    return "; ".join([*named, *(f"<{tag}>" for tag in others)])


BACKLASH = "backlash"
"""The argument of a play that is an angle, in the place of `Backlash`'s own name for it."""
WIND_UP = 0.1
"""Share of the backlash by which a flank gives way under the joint's effort limit, where no
stiffness is given."""
GIVEN_BY_THE_FILE = {
    *("bearing_body", "bearing_point", "bearing_axis"),
    *("journal_body", "journal_point", "journal_axis"),
    *("first", "second", "axis_first", "axis_second", "play", "play_length"),
}
LARGEST_FILE = 50_000_000
"""Bytes of a URDF file, at most."""


@dataclass(frozen=True)
class JointLimits:
    """What a URDF file allows a joint: `lower` and `upper`, rad or m; `effort`, N m or N; and
    `velocity`, rad/s or m/s. What the file does not say is infinite.

    >>> cj.results.JointLimits(effort=10.0).velocity
    inf
    """

    lower: float = -math.inf
    upper: float = math.inf
    effort: float = math.inf
    velocity: float = math.inf


def urdf_limits(path: FilePath) -> dict[str, JointLimits]:
    """The limits of the joints of a URDF file, by their names: for the torque of a `Motor`, say, or
    to check a computed motion. A scene has no place for them. Needs
    ``pip install "clearjoint[urdf]"``.

    ```python
    import clearjoint as cj

    limits = cj.urdf_limits("arm.urdf")
    print(limits["elbow"].effort, limits["elbow"].velocity)  # N m, rad/s
    ```

    **Raises:** `ValueError` and `ImportError` as `load_urdf`.
    """
    robot, _ = _robot(Path(path))
    return {joint.name: _limits(joint) for joint in robot.joints if joint.limit is not None}


def _limits(joint: "yourdfpy.Joint") -> JointLimits:
    names = ("lower", "upper", "effort", "velocity")
    found = {name: getattr(joint.limit, name, None) for name in names}
    return JointLimits(**{name: float(x) for name, x in found.items() if x is not None})


def load_urdf(
    path: FilePath,
    play: Mapping[str, Play] = MappingProxyType({}),
    gravity: TripleLike | None = (0.0, 0.0, -9.81),
) -> tuple[Scene, State]:
    """A robot of a URDF file as a scene, with play in some of its joints, and its state at rest
    where all joints are at zero. Needs ``pip install "clearjoint[urdf]"``.

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

    The link that no joint carries is the ground. Links with mass become bodies, whose frames are
    parallel to the links' and lie in the centres of mass; links without mass that are fixed to
    another are part of it. Joints keep their names: revolute and continuous, prismatic, fixed; what
    a floating joint carries is free.

    **Arguments:**

    - `play`: for names of revolute or continuous joints, the arguments of a `ClearanceJoint` but
      for bodies, points and axes: the parent has the bearing, and `axial` is `FixedAxially()`
      unless given. Or ``{"backlash": angle}`` with those of a `Backlash`, which is put beside the
      joint under the name "elbow backlash": its `torsional_stiffness` is the one by which the
      file's effort limit deflects a flank by a tenth of the backlash, unless given. Numbers may
      be texts with units.
    - `gravity`: (3,) m/s^2, or ``None``.

    **Raises:** `ValueError` that names file and place. `ImportError` without the extra.

    **Warns:** with a `NotCarriedOverWarning` that names what the file says and the scene lacks:
    limits (see `urdf_limits`), damping and friction, mimics, shapes and the like.
    """
    robot, tags = _robot(Path(path))
    place = FilePlace(str(path))
    play = _checked_play(play, robot, place)
    frames = _frames(robot, place)
    bodies = {
        link.name: body_of(link, place.at(link.name))
        for link in robot.links
        if frames[link.name].body == link.name
    }
    joints = {}
    for joint in robot.joints:
        given = play.get(joint.name)
        beside = given is not None and BACKLASH in given
        made = joint_of(joint, frames, None if beside else given, place.at(joint.name))
        if made is not None:
            joints[joint.name] = made
        if beside and isinstance(made, RevoluteJoint):
            assert given is not None
            found = _backlash(joint, made, given, place.at(joint.name))
            joints[f"{joint.name} {BACKLASH}"] = found
    left = not_carried_over(robot, frames, tags)
    if left:
        caution(f"{path}: not carried over: {left}.", NotCarriedOverWarning)
    state = {name: _at_rest(frames[name]) for name in bodies}
    try:
        return Scene(bodies, joints, gravity=gravity), State(state)
    except ValueError as error:
        raise ValueError(f"{place}: {error}") from error


def _at_rest(frame: Frame) -> BodyState:
    """Where a link's body is with all joints at zero."""
    centre = frame.pose[:3, 3] - frame.pose[:3, :3] @ frame.origin
    return body_state(centre, euler_parameters(frame.pose[:3, :3]))


def _robot(path: Path) -> tuple["yourdfpy.Robot", list[str]]:
    """What the parser finds in a file that is XML, and all tags in it; shapes are not loaded."""
    try:
        import yourdfpy
    except ImportError as error:
        raise ImportError('URDF files need pip install "clearjoint[urdf]"') from error
    size = path.stat().st_size
    if size > LARGEST_FILE:
        FilePlace(str(path)).refuse(f"{size} bytes", f"at most {LARGEST_FILE}", "shorten the file")
    content = path.read_bytes()
    try:
        tags = [entry.tag for entry in ElementTree.fromstring(content)]
        parsed = yourdfpy.URDF.load(BytesIO(content), build_scene_graph=False, load_meshes=False)
    except (ElementTree.ParseError, KeyError, AttributeError, ValueError, TypeError) as error:
        raise ValueError(f"{path}: {error!r}: check the file, by `check_urdf` say.") from error
    return parsed.robot, tags


def _checked_play(
    play: Mapping[str, Play], robot: "yourdfpy.Robot", place: FilePlace
) -> dict[str, Play]:
    """The arguments of each play, in which numbers with units are read."""
    hinges = [joint.name for joint in robot.joints if joint.type in HINGES]
    return {name: _checked(name, given, hinges, place) for name, given in play.items()}


def _checked(name: str, given: Play, hinges: list[str], place: FilePlace) -> Play:
    """The arguments of a joint's play, of the names that it may have."""
    if name not in hinges:
        remedy = nearest(name, hinges, "leave it out")
        place.refuse(name, f"play in one of the hinges {listed(hinges)}", remedy)
    if not isinstance(given, Mapping):
        remedy = 'pass {"backlash": "0.1 deg"}, or the arguments of a ClearanceJoint'
        place.at(name).refuse(given, "arguments by name", remedy)
    kind = Backlash if BACKLASH in given else ClearanceJoint
    expected = {key: argument.expected for key, argument in arguments(kind).items()}
    known = {key: one for key, one in expected.items() if key not in GIVEN_BY_THE_FILE}
    if kind is Backlash:
        known[BACKLASH] = expected["play"]
    for argument in given:
        if argument not in known:
            known |= {BACKLASH: Expectation()}
            remedy = nearest(argument, known, "leave it out")
            place.at(name).refuse(argument, f"one of the arguments {listed(known)}", remedy)
    reader, at = Reader(()), place.at(name)
    return {
        key: reader.value(value, known[key], at.at(key)) if isinstance(value, str) else value
        for key, value in given.items()
    }


def _backlash(
    joint: "yourdfpy.Joint", hinge: RevoluteJoint, given: Play, place: FilePlace
) -> Backlash:
    """The backlash beside a hinge."""
    own = {key: value for key, value in given.items() if key != BACKLASH}
    axes = {"axis_first": hinge.axis_first, "axis_second": hinge.axis_second}
    if "law" not in own and "torsional_stiffness" not in own:
        effort = math.inf if joint.limit is None else _limits(joint).effort
        if not 0.0 < effort < math.inf:
            needed = "a `torsional_stiffness`, since the joint has no effort limit"
            place.refuse(None, needed, "give it in N m/rad")
        own["torsional_stiffness"] = effort / (WIND_UP * float(given[BACKLASH]))
    try:
        return Backlash(hinge.first, hinge.second, play=given[BACKLASH], **axes, **own)
    except ValueError as error:
        raise ValueError(f"{place}: {error}") from error


def _frames(robot: "yourdfpy.Robot", place: FilePlace) -> dict[str, Frame]:
    """The frame of each link, following the joints from the root."""
    for kind, elements in (("link", robot.links), ("joint", robot.joints)):
        counts = Counter(element.name for element in elements)
        twice = [name for name, count in counts.items() if count > 1]
        if twice:
            place.refuse(twice[0], f"the name of one {kind} only", "rename the others")
    links = {link.name: link for link in robot.links}
    carried = {joint.child for joint in robot.joints}
    roots = [name for name in links if name not in carried]
    if len(roots) != 1:
        place.refuse(roots, "one link that no joint carries", "join the others to it")
    frames = {roots[0]: root_frame()}
    leaving: dict[str, list[yourdfpy.Joint]] = {}
    for joint in robot.joints:
        leaving.setdefault(joint.parent, []).append(joint)
    waiting = list(leaving.pop(roots[0], ()))
    while waiting:
        joint = waiting.pop()
        if joint.child not in links or joint.child in frames:
            leaving = {joint.parent: [joint], **leaving}
            break
        link = links[joint.child]
        if is_massless(link) and joint.type != "fixed":
            remedy = "give it an <inertial>, or fix it to its parent"
            place.at(link.name).refuse("no mass", "mass of a link that moves", remedy)
        frames[link.name] = child_frame(joint, frames[joint.parent], link)
        waiting += leaving.pop(link.name, ())
    if leaving:
        names = [joint.name for joints in leaving.values() for joint in joints]
        place.refuse(names, "joints of a tree between known links", "correct their links")
    return frames

"""Load robots from URDF files, with play in given joints.

This module parses the XML; `robots` makes the scene. Every message names the file and the element.
"""

import math
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

import numpy as np

from .._fields.cautions import NotCarriedOverWarning, caution
from .._fields.checks import require_positive
from .._fields.types import TripleLike
from .._model.bodies import GROUND, State
from .._model.scene import Scene
from .documents import FileLocation, read_bytes
from .files import FilePath
from .robots import (
    Inertial,
    JointLimits,
    LinkPose,
    Options,
    Play,
    Robot,
    RobotJoint,
    RobotLink,
    scene_of,
)

LARGEST_FILE = 50_000_000
"""Size in bytes above which files are refused, since parsed they are far larger."""
READ = {"link": {"inertial"}, "joint": {"origin", "parent", "child", "axis"}}
"""Tags of the elements of links and of joints that a scene carries over."""
TITLES = {
    "limit": "limits",
    "dynamics": "damping and friction",
    "mimic": "mimics",
    "calibration": "calibrations",
    "safety_controller": "safety controllers",
    "visual": "visual shapes",
    "collision": "collision shapes",
}
"""Names, in messages, of elements of links and joints that a scene lacks, by their tags."""
XACRO = "if the file is a xacro file, expand it with `xacro FILE > robot.urdf` and load that"


def urdf_limits(path: FilePath) -> dict[str, JointLimits]:
    """Return the limits of those joints of a URDF file that have any, by name.

    A scene has no joint limits. Use them for the torque of a `Motor`, or to check a computed
    motion.

    ```python
    import clearjoint as cj

    limits = cj.urdf_limits("arm.urdf")
    print(limits["elbow"].effort, limits["elbow"].velocity)  # N m, rad/s
    ```

    **Raises:** `ValueError` and `OSError` as `load_urdf`.
    """
    joints = _parsed(Path(path)).joints
    return {joint.name: joint.limits for joint in joints if joint.limits is not None}


def urdf_links(
    path: FilePath, *, merge_fixed: bool = True, free_root: bool = False
) -> dict[str, LinkPose]:
    """Return where the frames of the links of a URDF file are in the scene of `load_urdf`, by name.

    Use it for points of links that are parts of other bodies, such as a tool or a sensor.

    ```python
    import clearjoint as cj

    tool = cj.urdf_links("arm.urdf")["hand"]
    print(tool.body, tool.point, tool.orientation)
    ```

    **Arguments:**, **Raises:** see `load_urdf`.
    """
    content, location = _parsed(Path(path)), FileLocation(str(path))
    options = Options(merge_fixed=merge_fixed, free_root=free_root)
    robot = Robot(content.links, content.joints, location, options)
    return {name: robot.frame(name) for name in robot.links}


def load_urdf(
    path: FilePath,
    play: Mapping[str, Play] = MappingProxyType({}),
    gravity: TripleLike | None = (0.0, 0.0, -9.81),
    *,
    merge_fixed: bool = True,
    free_root: bool = False,
    balance_inertia: bool = False,
    bound_mass: float = 0.0,
    bound_inertia: float = 0.0,
) -> tuple[Scene, State]:
    """Read a robot from a URDF file, with play in some of its joints. Return the scene, and its
    state at rest with all joints at zero.

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

    The root link is the ground. Links that move relative to their parents become bodies; links that
    are fixed to their parents are parts of them (`urdf_links` tells where). Joints keep their
    names; the child of a floating joint is free. A moving link named "ground" is the body "ground
    link".

    The frames of all bodies are parallel to the root's frame while all joints are at zero, so that
    a joint's angle (`quantities.JointAngle`), the middle of a backlash, and the angle of a drive
    about the joint's axis are those of the file. The axis of a joint has the same components in
    both bodies: ``scene.joints["wrist"].axis_first`` is the axis of a drive.

    **Arguments:**

    - `play`: a dictionary of arguments for each revolute or continuous joint with play, by the
      joint's name. Numbers may be texts with units. There are two kinds:
        - Arguments of a `ClearanceJoint`, which replaces the joint. Bodies, points and axes are
          those of the file: the parent has the bearing, the child the journal. `axial` is
          `FixedAxially()` by default.
        - ``"backlash"``, an angle in rad, and arguments of a `Backlash`, which is added to the
          scene with a name such as "elbow backlash"; the joint stays. By default its
          `torsional_stiffness` is such that the joint's effort limit in the file deflects the
          surfaces in contact (flanks) by a tenth of the backlash.
    - `gravity`: (3,) m/s^2, or ``None``.
    - `merge_fixed`: False makes fixed links with mass bodies of their own, held by a `FixedJoint`,
      whose reaction can then be observed. Merged links make runs faster.
    - `free_root`: True makes the root a free body, as for a robot that walks or a single object.
    - `balance_inertia`: True replaces the principal moments of a link by their mean if no rigid
      body can have them, as MuJoCo's compiler does with `balanceinertia`.
    - `bound_mass`, `bound_inertia`: least mass, kg, and least principal moment of inertia, kg m^2,
      of a body, as for MuJoCo's compiler. Smaller ones are increased, also those of moving links
      without mass.

    **Raises:** `ValueError`, with the file and the element, for a file of more than 50 MB or that
    can't be read, a robot that a scene can't represent, and invalid `play`. `OSError` for a file
    that does not exist.

    **Warns:** `NotCarriedOverWarning` lists the contents of the file that the scene lacks: limits
    (see `urdf_limits`), damping and friction, mimics, shapes and others; and the links and bodies
    whose masses and inertias were replaced.
    """
    for name, bound in (("bound_mass", bound_mass), ("bound_inertia", bound_inertia)):
        require_positive(name, bound, "give zero for no bound", zero=True)
    content, location = _parsed(Path(path)), FileLocation(str(path))
    options = Options(merge_fixed, free_root, balance_inertia, bound_mass, bound_inertia)
    robot = Robot(content.links, content.joints, location, options)
    made = scene_of(robot, play, gravity)
    omitted = _not_carried_over(robot, content.omitted)
    if omitted:
        caution(f"{path}: not carried over: {omitted}.", NotCarriedOverWarning)
    return made


def _not_carried_over(robot: Robot, omitted: Mapping[str, list[str]]) -> str:
    grounded = [name for name, carrier in robot.carriers.items() if carrier.body == GROUND]
    inertials = {name: robot.links[name].inertial for name in grounded}
    massive = [name for name, inertial in inertials.items() if inertial and inertial.mass > 0.0]
    listed_parts = {**omitted} | ({"inertia of the fixed links": massive} if massive else {})
    named = [f"{title} of {', '.join(names)}" for title, names in listed_parts.items() if names]
    return "; ".join([*named, *sorted(title for title, names in listed_parts.items() if not names)])


class Content(NamedTuple):
    """Content of a URDF file: links and joints in its order, and the names of those with an element
    that a scene lacks, by the element's title in messages; no names for elements of the robot
    itself."""

    links: list[RobotLink]
    joints: list[RobotJoint]
    omitted: dict[str, list[str]]


def _parsed(path: Path) -> Content:
    location = FileLocation(str(path))
    robot = _root(read_bytes(path, LARGEST_FILE), location)
    links: list[RobotLink] = []
    joints: list[RobotJoint] = []
    omitted: dict[str, list[str]] = {}
    for entry in robot:
        if entry.tag not in READ:
            # Materials belong to the visual shapes.
            omitted |= {} if entry.tag == "material" else {f"<{entry.tag}>": []}
            continue
        number = len(links) if entry.tag == "link" else len(joints)
        at = location.at(entry.tag, number)
        name = _attribute(entry, "name", at)
        at = location.at(name)
        if entry.tag == "link":
            links.append(RobotLink(name, _inertial(entry, at)))
        else:
            joints.append(_joint(entry, name, at))
        for tag in dict.fromkeys(child.tag for child in entry):
            if tag not in READ[entry.tag]:
                omitted.setdefault(TITLES.get(tag, f"<{tag}>"), []).append(name)
    if not links:
        location.refuse("no <link>", "links and joints in <robot>", f"add them, or {XACRO}")
    return Content(links, joints, omitted)


def _root(content: bytes, location: FileLocation) -> Element:
    """Return the element <robot> of a URDF file. Namespaces are ignored, as by other readers of
    URDF: tags and attributes keep their prefixes, and a default namespace has no effect."""
    parser, builder = expat.ParserCreate(), TreeBuilder()
    parser.StartElementHandler = builder.start
    parser.EndElementHandler = builder.end
    try:
        # Other readers skip empty lines before the declaration, and a zero byte at the end.
        parser.Parse(content.strip(b"\0\t\n\r "), True)
    except expat.ExpatError as error:
        location.refuse("no XML", f"the XML of a URDF file ({error})", "correct that line")
    root = builder.close()
    if root.tag != "robot":
        location.refuse(f"<{root.tag}>", "<robot>", "convert the file to URDF")
    return root


def _attribute(element: Element, name: str, location: FileLocation) -> str:
    value = element.get(name, "")
    if not value:
        expected = f"an attribute `{name}` of <{element.tag}>"
        location.refuse(dict(element.attrib) or None, expected, "add it")
    if "${" in value or "$(" in value:
        location.refuse(value, f"`{name}` without macros", XACRO)
    return value


def _numbers(
    element: Element | None, name: str, default: str | None, count: int, location: FileLocation
) -> np.ndarray:
    """Return the (count,) numbers of an attribute, or of `default`, None if it must exist."""
    text = default if element is None else element.get(name, default)
    if element is not None:
        location = location.at(element.tag, name)
        if text is None or "$" in text:
            text = _attribute(element, name, location)
    try:
        numbers = np.array([float(word) for word in (text or "").split()])
    except ValueError:
        numbers = np.array([math.nan])
    if numbers.shape != (count,) or not np.isfinite(numbers).all():
        expected = "a finite number" if count == 1 else f"{count} finite numbers between spaces"
        location.refuse(text, expected, "correct it")
    return numbers


def _number(
    element: Element | None, name: str, default: str | None, location: FileLocation
) -> float:
    return float(_numbers(element, name, default, 1, location)[0])


def _pose(origin: Element | None, location: FileLocation) -> np.ndarray:
    from scipy.spatial.transform import Rotation

    rpy = _numbers(origin, "rpy", "0 0 0", 3, location)
    pose = np.eye(4)
    # Rounding restores the exact zeros of a quarter turn, which make the compiled program smaller.
    pose[:3, :3] = np.round(Rotation.from_euler("xyz", rpy).as_matrix(), 15)
    pose[:3, 3] = _numbers(origin, "xyz", "0 0 0", 3, location)
    return pose


def _inertial(link: Element, location: FileLocation) -> Inertial | None:
    inertial = link.find("inertial")
    if inertial is None:
        return None
    location = location.at("inertial")
    mass = _number(inertial.find("mass"), "value", "0", location)
    if mass < 0.0:
        location.at("mass").refuse(mass, "a mass in kg that is not negative", "correct it")
    pose = _pose(inertial.find("origin"), location)
    inertia = inertial.find("inertia")
    if inertia is None:
        return Inertial(mass, pose[:3, 3], None)

    def entry(name: str) -> float:
        # Products of inertia are often omitted if they are zero.
        return _number(inertia, name, None if name[1] == name[2] else "0", location)

    tensor = np.array([[entry("i" + "".join(sorted(row + c))) for c in "xyz"] for row in "xyz"])
    return Inertial(mass, pose[:3, 3], pose[:3, :3] @ tensor @ pose[:3, :3].T)


def _joint(joint: Element, name: str, location: FileLocation) -> RobotJoint:
    links = {}
    for tag in ("parent", "child"):
        element = joint.find(tag)
        if element is None:
            location.refuse(None, f'an element <{tag} link="...">', "add it")
        links[tag] = _attribute(element, "link", location.at(tag))
    limit = joint.find("limit")
    return RobotJoint(
        name,
        _attribute(joint, "type", location),
        parent=links["parent"],
        child=links["child"],
        pose=_pose(joint.find("origin"), location),
        axis=_numbers(joint.find("axis"), "xyz", "1 0 0", 3, location),
        limits=None if limit is None else _limits(limit, location),
    )


def _limits(limit: Element, location: FileLocation) -> JointLimits:
    names = [name for name in ("lower", "upper", "effort", "velocity") if name in limit.attrib]
    return JointLimits(**{name: _number(limit, name, None, location) for name in names})

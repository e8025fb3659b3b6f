"""Parse the XML of URDF files."""

import math
from contextlib import suppress
from pathlib import Path
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

import numpy as np

from .documents import FileLocation, read_bytes
from .robots import Content, Inertial, JointLimits, Mimic, RobotJoint, RobotLink, pose_of, rounded

LARGEST_FILE = 50_000_000
"""Size in bytes above which files are refused, since their content takes far more memory."""
READ = {
    "link": {"inertial"},
    "joint": {"origin", "parent", "child", "axis", "limit", "dynamics", "mimic"},
}
"""Tags of the elements of links and of joints that a robot carries over."""
TITLES = {
    "calibration": "calibrations",
    "safety_controller": "safety controllers",
    "visual": "visual shapes",
    "collision": "collision shapes",
}
"""Titles in messages of elements that a scene lacks, by their tags."""
XACRO = "if the file is a xacro file, expand it with `xacro FILE > robot.urdf` and load that"


def read_urdf(path: Path) -> Content:
    location = FileLocation(str(path))
    robot = _root(read_bytes(path, LARGEST_FILE), location)
    links: list[RobotLink] = []
    joints: list[RobotJoint] = []
    omitted: dict[str, list[str]] = {}
    for entry in robot:
        if entry.tag not in READ:
            # Materials belong to the visual shapes, which messages list already.
            if entry.tag != "material":
                omitted.setdefault(f"<{entry.tag}>", [])
            continue
        at = location.at(entry.tag, len(links) if entry.tag == "link" else len(joints))
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


def root_tag(content: bytes) -> str:
    """Return the tag of the first element of an XML text, "" if there is none."""
    parser, tags = expat.ParserCreate(), [""]
    parser.StartElementHandler = lambda tag, _: tags.append(tag)
    with suppress(expat.ExpatError):
        parser.Parse(content.strip(b"\0\t\n\r "), True)
    return tags[min(len(tags), 2) - 1]


def _root(content: bytes, location: FileLocation) -> Element:
    """Return the element <robot>. As in other readers of URDF, tags and attributes keep the
    prefixes of namespaces, and a default namespace has no effect."""
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
    """Return the numbers, (count,), of the attribute `name` of an element. If the element or the
    attribute is missing, return those of the text `default`; with ``None``, raise an error."""
    text = default if element is None else element.get(name, default)
    if element is not None:
        location = location.at(element.tag, name)
        if text is None or "$" in text:  # missing, or perhaps a macro: this raises the errors
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
    rotation = rounded(Rotation.from_euler("xyz", rpy).as_matrix())
    return pose_of(rotation, _numbers(origin, "xyz", "0 0 0", 3, location))


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
        # Products of inertia, such as "ixy", are often omitted if they are zero.
        return _number(inertia, name, None if name[1] == name[2] else "0", location)

    # Files have only one of two equal products: the letters of their names are sorted.
    tensor = np.array([[entry("i" + "".join(sorted(row + c))) for c in "xyz"] for row in "xyz"])
    return Inertial(mass, pose[:3, 3], pose[:3, :3] @ tensor @ pose[:3, :3].T)


def _joint(joint: Element, name: str, location: FileLocation) -> RobotJoint:
    links = {}
    for tag in ("parent", "child"):
        element = joint.find(tag)
        if element is None:
            location.refuse(None, f'an element <{tag} link="...">', "add it")
        links[tag] = _attribute(element, "link", location.at(tag))
    limit, mimic, dynamics = (joint.find(tag) for tag in ("limit", "mimic", "dynamics"))
    return RobotJoint(
        name,
        _attribute(joint, "type", location),
        parent=links["parent"],
        child=links["child"],
        pose=_pose(joint.find("origin"), location),
        axis=_numbers(joint.find("axis"), "xyz", "1 0 0", 3, location),
        limits=None if limit is None else _limits(limit, location),
        mimic=None if mimic is None else _mimic(mimic, location),
        friction=_number(dynamics, "friction", "0", location),
        damping=_number(dynamics, "damping", "0", location),
    )


def _limits(limit: Element, location: FileLocation) -> JointLimits:
    names = [name for name in ("lower", "upper", "effort", "velocity") if name in limit.attrib]
    return JointLimits(**{name: _number(limit, name, None, location) for name in names})


def _mimic(mimic: Element, location: FileLocation) -> Mimic:
    leader = _attribute(mimic, "joint", location.at("mimic"))
    offset = _number(mimic, "offset", "0", location)
    return Mimic(leader, (offset, _number(mimic, "multiplier", "1", location)))

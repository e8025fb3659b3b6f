"""Robots of URDF files, whose joints get play by name. yourdfpy parses."""

from collections.abc import Mapping
from io import BytesIO
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING
from xml.etree import ElementTree

from ..fields.cautions import NotCarriedOverWarning, caution
from ..fields.suggestions import nearest
from ..fields.types import TripleLike
from ..model.bodies import BodyState, State, body_state
from ..model.plays.clearance import ClearanceJoint
from ..model.scene import Scene
from .complaints import FilePlace, listed
from .expectations import arguments
from .files import FilePath
from .urdf_frames import (
    Frame,
    body_of,
    child_frame,
    euler_parameters,
    is_massless,
    root_frame,
)
from .urdf_joints import HINGES, Play, joint_of
from .urdf_rest import not_carried_over

if TYPE_CHECKING:
    import yourdfpy

GIVEN_BY_THE_FILE = {
    *("bearing_body", "bearing_point", "bearing_axis"),
    *("journal_body", "journal_point", "journal_axis"),
}


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
        "law": cj.LankaraniNikravesh(0.9, cj.RavnStiffness(207e9, 0.3)),
    }
    scene, state = cj.load_urdf("arm.urdf", play={"elbow": elbow})
    ```

    The link that no joint carries is the ground. Links with mass become bodies, whose frames are
    parallel to the links' and lie in the centres of mass; links without mass that are fixed to
    another are part of it. Joints keep their names: revolute and continuous, prismatic, fixed; what
    a floating joint carries is free.

    **Arguments:**

    - `play`: for names of revolute or continuous joints, the arguments of a `ClearanceJoint` but
      for bodies, points and axes. The parent has the bearing. `axial` is `FixedAxially()` unless
      given.
    - `gravity`: (3,) m/s^2, or ``None``.

    **Raises:** `ValueError` that names file and place. `ImportError` without the extra.

    **Warns:** with a `NotCarriedOverWarning` that names what the file says and the scene lacks:
    limits, damping and friction, mimics, shapes and the like.
    """
    robot, tags = _robot(Path(path))
    place = FilePlace(str(path))
    _check_play(play, robot, place)
    frames = _frames(robot, place)
    bodies = {
        link.name: body_of(link, place.at(link.name))
        for link in robot.links
        if frames[link.name].body == link.name
    }
    joints = {}
    for joint in robot.joints:
        made = joint_of(joint, frames, play.get(joint.name), place.at(joint.name))
        if made is not None:
            joints[joint.name] = made
    left = not_carried_over(robot, frames, tags)
    if left:
        caution(f"{path}: not carried over: {left}.", NotCarriedOverWarning)
    state = {name: _at_rest(frames[name]) for name in bodies}
    return Scene(bodies, joints, gravity=gravity), State(state)


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
    content = path.read_bytes()
    try:
        tags = [entry.tag for entry in ElementTree.fromstring(content)]
        parsed = yourdfpy.URDF.load(BytesIO(content), build_scene_graph=False, load_meshes=False)
    except (ElementTree.ParseError, KeyError, AttributeError, ValueError, TypeError) as error:
        raise ValueError(f"{path}: {error!r}: check the file, by `check_urdf` say.") from error
    return parsed.robot, tags


def _check_play(play: Mapping[str, Play], robot: "yourdfpy.Robot", place: FilePlace) -> None:
    hinges = [joint.name for joint in robot.joints if joint.type in HINGES]
    known = [name for name in arguments(ClearanceJoint) if name not in GIVEN_BY_THE_FILE]
    for name, given in play.items():
        if name not in hinges:
            remedy = nearest(name, hinges, "leave it out")
            place.refuse(name, f"play in one of the hinges {listed(hinges)}", remedy)
        for argument in given:
            if argument not in known:
                remedy = nearest(argument, known, "leave it out")
                place.at(name).refuse(argument, f"one of the arguments {listed(known)}", remedy)


def _frames(robot: "yourdfpy.Robot", place: FilePlace) -> dict[str, Frame]:
    """The frame of each link, following the joints from the root."""
    links = {link.name: link for link in robot.links}
    carried = {joint.child for joint in robot.joints}
    roots = [name for name in links if name not in carried]
    if len(roots) != 1:
        place.refuse(roots, "one link that no joint carries", "join the others to it")
    frames = {roots[0]: root_frame()}
    waiting = list(robot.joints)
    while waiting:
        ready = [joint for joint in waiting if joint.parent in frames and joint.child in links]
        if not ready:
            names = [joint.name for joint in waiting]
            place.refuse(names, "joints of a tree between known links", "correct their links")
        for joint in ready:
            link = links[joint.child]
            if is_massless(link) and joint.type != "fixed":
                remedy = "give it an <inertial>, or fix it to its parent"
                place.at(link.name).refuse("no mass", "mass of a link that moves", remedy)
            frames[link.name] = child_frame(joint, frames[joint.parent], link)
            waiting.remove(joint)
    return frames

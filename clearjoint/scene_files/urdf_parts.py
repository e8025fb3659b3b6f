"""Convert the links and joints of a URDF file to bodies and joints of a scene.

A link of URDF has a frame, and a joint of URDF gives the frame of its child link relative to the
frame of its parent link. The frame of a body is parallel to the frame of its link, and its origin
is the centre of mass.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from jaxtyping import PyTree

from ..model.bodies import Body
from ..model.clearance_joints.axial import FixedAxially
from ..model.clearance_joints.clearance import ClearanceJoint
from ..model.joints.base import AbstractConstraint, AbstractContactJoint
from ..model.joints.ideal import FixedJoint, PrismaticJoint, RevoluteJoint
from .locations import FileLocation, listed

if TYPE_CHECKING:
    import yourdfpy

Play: TypeAlias = Mapping[str, PyTree]
"""Arguments of a `ClearanceJoint`, or of a `Backlash`, by name."""
HINGES = "revolute", "continuous"
DIGITS = 15
"""Number of decimals to which rotation matrices are rounded. Rounding restores the exact zeros of a
quarter turn, which make the compiled program smaller."""


@dataclass(frozen=True)
class Frame:
    """The frame of a link, relative to its body and to the ground.

    - `body`: name of the body to which the link belongs.
    - `origin`: (3,) m in body axes, from the body's centre of mass to the origin of the frame.
    - `rotation`: (3, 3), rotation matrix from the link's to the body's axes.
    - `pose`: (4, 4), homogeneous matrix from the link's to global axes, m, if all joints are at
      zero.
    """

    body: str
    origin: np.ndarray
    rotation: np.ndarray
    pose: np.ndarray


def child_frame(joint: "yourdfpy.Joint", parent: Frame, link: "yourdfpy.Link") -> Frame:
    """Return the frame of the child `link` of a joint, given the frame of the parent link. A link
    without mass belongs to the parent's body."""
    moved = transform(joint.origin)
    pose = parent.pose @ moved
    if is_massless(link):
        origin = parent.origin + parent.rotation @ moved[:3, 3]
        return Frame(parent.body, origin, parent.rotation @ moved[:3, :3], pose)
    assert link.inertial is not None
    centre = transform(link.inertial.origin)[:3, 3]
    return Frame(link.name, -centre, np.eye(3), pose)


def is_massless(link: "yourdfpy.Link") -> bool:
    """Return whether a link has no mass."""
    return link.inertial is None or not link.inertial.mass


def body_of(link: "yourdfpy.Link", location: FileLocation) -> Body:
    """Return the body for a link with mass; body axes are parallel to the link's frame.

    **Raises:** `ValueError` for a missing or invalid inertia.
    """
    inertial = link.inertial
    assert inertial is not None
    if inertial.inertia is None:
        location.refuse(None, "an <inertia>", "give the moments of inertia in kg m^2")
    rotation = transform(inertial.origin)[:3, :3]
    tensor = rotation @ inertial.inertia @ rotation.T
    is_principal = not np.any(tensor - np.diag(tensor.diagonal()))
    with location.in_errors():
        return Body(inertial.mass, tensor.diagonal() if is_principal else 0.5 * (tensor + tensor.T))


def transform(origin: np.ndarray | None) -> np.ndarray:
    """Return the homogeneous matrix (4, 4), m, of an <origin> element; the identity for None."""
    if origin is None:
        return np.eye(4)
    matrix = np.array(origin, dtype=float)
    matrix[:3, :3] = np.round(matrix[:3, :3], DIGITS)
    return matrix


def euler_parameters(rotation: np.ndarray) -> np.ndarray:
    """Return the Euler parameters (4,), scalar first, of a rotation matrix (3, 3)."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_matrix(rotation).as_quat(scalar_first=True)


def joint_of(
    joint: "yourdfpy.Joint", frames: Mapping[str, Frame], play: Play | None, location: FileLocation
) -> AbstractConstraint | AbstractContactJoint | None:
    """Return the joint of the scene for a joint of URDF.

    **Arguments:** `frames`: frames of the links by name; `play`: arguments of a `ClearanceJoint`
    that replaces the joint, None for an ideal joint.

    **Returns:** the joint; ``None`` for a floating joint, and if both links belong to one body.

    **Raises:** `ValueError` for a type without counterpart, and for invalid numbers.
    """
    parent, child = frames[joint.parent], frames[joint.child]
    if parent.body == child.body or joint.type == "floating":
        return None
    frame = transform(joint.origin)
    rotation = parent.rotation @ frame[:3, :3]
    points = parent.origin + parent.rotation @ frame[:3, 3], child.origin
    bodies = parent.body, child.body
    axis = np.asarray(joint.axis, dtype=float)
    numbers = np.array([*np.ravel(frame), *np.ravel(axis)])
    if axis.shape != (3,) or not np.isfinite(numbers).all():
        remedy = "correct the <origin> and the <axis>"
        location.refuse(
            numbers[~np.isfinite(numbers)].tolist(), "finite origin and axis (3,)", remedy
        )
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
            return PrismaticJoint(*bodies, *points, rotation @ axis, euler_parameters(rotation))
        if joint.type == "fixed":
            return FixedJoint(*bodies, *points, euler_parameters(rotation))
    kinds = listed([*HINGES, "prismatic", "fixed", "floating"])
    return location.refuse(joint.type, f"one of the types {kinds}", "add the joint to the scene")

"""Bodies, frames and joints of a scene from the links and joints of a URDF file.

URDF gives a joint's frame, which is that of its child link, in the frame of the parent link. The
frame of a body is parallel to its link's and lies in the centre of mass.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from jaxtyping import PyTree

from ..model.bodies import GROUND, Body
from ..model.clearance_joints.axial import FixedAxially
from ..model.clearance_joints.clearance import ClearanceJoint
from ..model.joints.base import AbstractConstraint, AbstractContactJoint
from ..model.joints.ideal import FixedJoint, PrismaticJoint, RevoluteJoint
from .locations import FileLocation, listed

if TYPE_CHECKING:
    import yourdfpy

Play: TypeAlias = Mapping[str, PyTree]
"""Arguments of a `ClearanceJoint` by name."""
HINGES = "revolute", "continuous"
DIGITS = 15
"""Decimals of rotation matrices: rounding restores the exact zeros of a quarter turn, which make
the compiled program smaller."""


@dataclass(frozen=True)
class Frame:
    """The frame of a link, relative to its body and to the ground.

    - `body`: name of the body that the link belongs to.
    - `origin`: (3,) m, from the body's centre of mass, in the body's axes.
    - `rotation`: (3, 3), link to body.
    - `pose`: (4, 4), link to ground, with all joints at zero.
    """

    body: str
    origin: np.ndarray
    rotation: np.ndarray
    pose: np.ndarray


def child_frame(joint: "yourdfpy.Joint", parent: Frame, link: "yourdfpy.Link") -> Frame:
    """The frame of a joint's child link; a link without mass belongs to the parent's body."""
    moved = transform(joint.origin)
    pose = parent.pose @ moved
    if is_massless(link):
        origin = parent.origin + parent.rotation @ moved[:3, 3]
        return Frame(parent.body, origin, parent.rotation @ moved[:3, :3], pose)
    assert link.inertial is not None
    centre = transform(link.inertial.origin)[:3, 3]
    return Frame(link.name, -centre, np.eye(3), pose)


def root_frame() -> Frame:
    """The frame of the root link, which is the ground."""
    return Frame(GROUND, np.zeros(3), np.eye(3), np.eye(4))


def is_massless(link: "yourdfpy.Link") -> bool:
    """Whether a link has no mass."""
    return link.inertial is None or not link.inertial.mass


def body_of(link: "yourdfpy.Link", location: FileLocation) -> Body:
    """The body of a link with mass, in axes parallel to the link's frame."""
    inertial = link.inertial
    assert inertial is not None
    if inertial.inertia is None:
        location.refuse(None, "an <inertia>", "give the moments of inertia in kg m^2")
    rotation = transform(inertial.origin)[:3, :3]
    tensor = rotation @ inertial.inertia @ rotation.T
    is_principal = not np.any(tensor - np.diag(tensor.diagonal()))
    try:
        return Body(inertial.mass, tensor.diagonal() if is_principal else 0.5 * (tensor + tensor.T))
    except ValueError as error:
        raise ValueError(f"{location}: {error}") from error


def transform(origin: np.ndarray | None) -> np.ndarray:
    """The (4, 4) matrix of an <origin>; without one, the identity."""
    if origin is None:
        return np.eye(4)
    matrix = np.array(origin, dtype=float)
    matrix[:3, :3] = np.round(matrix[:3, :3], DIGITS)
    return matrix


def euler_parameters(rotation: np.ndarray) -> np.ndarray:
    """(4,), scalar first, of a (3, 3) rotation."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_matrix(rotation).as_quat(scalar_first=True)


def joint_of(
    joint: "yourdfpy.Joint", frames: Mapping[str, Frame], play: Play | None, location: FileLocation
) -> AbstractConstraint | AbstractContactJoint | None:
    """The joint between two bodies; ``None`` for a floating joint, and if both links belong to the
    same body."""
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
    try:
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
    except ValueError as error:
        raise ValueError(f"{location}: {error}") from error
    kinds = listed([*HINGES, "prismatic", "fixed", "floating"])
    return location.refuse(joint.type, f"one of the types {kinds}", "add the joint to the scene")

"""Links of a robot as bodies, and where their frames are. URDF puts a joint's frame, which is its
child's, in that of its parent; a body's frame is parallel to its link's, in the centre of mass."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..model.bodies import GROUND, Body
from .complaints import FilePlace

if TYPE_CHECKING:
    import yourdfpy

DIGITS = 15
"""Decimals of rotations: the zeros of a quarter turn are zeros again, which cost nothing."""


@dataclass(frozen=True)
class Frame:
    """A link's frame, as the body that it belongs to has it, and the ground.

    - `origin`: (3,) m, in the body's axes, from its centre of mass.
    - `rotation`: (3, 3), link to body.
    - `pose`: (4, 4), link to ground, where all joints are at zero.
    """

    body: str
    origin: np.ndarray
    rotation: np.ndarray
    pose: np.ndarray


def child_frame(joint: "yourdfpy.Joint", parent: Frame, link: "yourdfpy.Link") -> Frame:
    """The frame of a joint's child; one without mass is part of the parent's body."""
    moved = transform(joint.origin)
    pose = parent.pose @ moved
    if is_massless(link):
        origin = parent.origin + parent.rotation @ moved[:3, 3]
        return Frame(parent.body, origin, parent.rotation @ moved[:3, :3], pose)
    assert link.inertial is not None
    centre = transform(link.inertial.origin)[:3, 3]
    return Frame(link.name, -centre, np.eye(3), pose)


def root_frame() -> Frame:
    """The frame of the link that no joint carries: the ground's."""
    return Frame(GROUND, np.zeros(3), np.eye(3), np.eye(4))


def is_massless(link: "yourdfpy.Link") -> bool:
    """Whether a link says nothing of its inertia, or that it has none."""
    return link.inertial is None or not link.inertial.mass


def body_of(link: "yourdfpy.Link", place: FilePlace) -> Body:
    """The body of a link with mass, in axes parallel to the link's frame."""
    inertial = link.inertial
    assert inertial is not None
    if inertial.inertia is None:
        place.refuse(None, "an <inertia>", "give the moments of inertia in kg m^2")
    rotation = transform(inertial.origin)[:3, :3]
    turned = rotation @ inertial.inertia @ rotation.T
    is_principal = not np.any(turned - np.diag(turned.diagonal()))
    try:
        return Body(inertial.mass, turned.diagonal() if is_principal else 0.5 * (turned + turned.T))
    except ValueError as error:
        raise ValueError(f"{place}: {error}") from error


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

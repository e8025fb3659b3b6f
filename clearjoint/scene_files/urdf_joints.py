"""Joints of URDF as those of a scene, ideal or with play."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from jaxtyping import PyTree

from ..model.clearance_joints.axial import FixedAxially
from ..model.clearance_joints.clearance import ClearanceJoint
from ..model.joints.base import AbstractConstraint, AbstractContactJoint
from ..model.joints.ideal import FixedJoint, PrismaticJoint, RevoluteJoint
from .complaints import FilePlace, listed
from .urdf_frames import Frame, euler_parameters, transform

if TYPE_CHECKING:
    import yourdfpy

Play: TypeAlias = Mapping[str, PyTree]
"""Arguments of a `ClearanceJoint` by name."""
HINGES = "revolute", "continuous"


def joint_of(
    joint: "yourdfpy.Joint", frames: Mapping[str, Frame], play: Play | None, place: FilePlace
) -> AbstractConstraint | AbstractContactJoint | None:
    """The joint between two bodies; ``None`` where nothing holds the child, or it is no body."""
    parent, child = frames[joint.parent], frames[joint.child]
    if parent.body == child.body or joint.type == "floating":
        return None
    here = transform(joint.origin)
    turn = parent.rotation @ here[:3, :3]
    points = parent.origin + parent.rotation @ here[:3, 3], child.origin
    bodies = parent.body, child.body
    axis = np.asarray(joint.axis, dtype=float)
    numbers = np.array([*np.ravel(here), *np.ravel(axis)])
    if axis.shape != (3,) or not np.isfinite(numbers).all():
        remedy = "correct the <origin> and the <axis>"
        place.refuse(numbers[~np.isfinite(numbers)].tolist(), "finite origin and axis (3,)", remedy)
    try:
        if play is not None:
            return _with_play(bodies, points, (turn @ axis, axis), play)
        if joint.type in HINGES:
            return RevoluteJoint(*bodies, *points, turn @ axis, axis)
        if joint.type == "prismatic":
            return PrismaticJoint(*bodies, *points, turn @ axis, euler_parameters(turn))
        if joint.type == "fixed":
            return FixedJoint(*bodies, *points, euler_parameters(turn))
    except ValueError as error:
        raise ValueError(f"{place}: {error}") from error
    kinds = listed([*HINGES, "prismatic", "fixed", "floating"])
    return place.refuse(joint.type, f"one of the types {kinds}", "add the joint to the scene")


def _with_play(
    bodies: tuple[str, str],
    points: tuple[np.ndarray, np.ndarray],
    axes: tuple[np.ndarray, np.ndarray],
    play: Play,
) -> ClearanceJoint:
    """The joint whose bearing belongs to the first body."""
    return ClearanceJoint(
        *bodies,
        bearing_point=points[0],
        journal_point=points[1],
        bearing_axis=axes[0],
        journal_axis=axes[1],
        **{"axial": FixedAxially(), **play},
    )

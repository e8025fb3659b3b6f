"""What a URDF file says that a scene has no place for."""

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

from ..model.bodies import GROUND
from .urdf_frames import Frame, is_massless

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
    """What is left out, and of which links and joints; empty if nothing is.

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

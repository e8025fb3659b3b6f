"""Arrows of forces, and colours of journals by their contact."""

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..simulation.results.observe import MotionMode, Observation
from . import meshes
from .parts import FORCE, LOAD, DrawnPart, between
from .sketching import SketchingPen

LONGEST = 0.3
"""Length of the longest arrow relative to the size of the mechanism."""
USUAL, FAR = 0.5, 5.0
"""Quantile that defines the usual force, and the largest ratio of the greatest force to it with
lengths proportional to forces."""
WIDTH = 1.1
"""Radius of an arrow's head relative to that of a bar."""
MODE_NAMES = {
    MotionMode.FREE_FLIGHT: "free flight",
    MotionMode.ONE_BASE: "contact at one end",
    MotionMode.LINE_CONTACT: "contact along a line",
    MotionMode.OPPOSITE_SIDES: "contact at opposite sides",
}


class Arrows(NamedTuple):
    """Arrows of a view.

    - `parts`: the solids.
    - `scale`: length of the arrow of the `largest` force divided by that force, m/N.
    - `cut`: force, N, above which arrows have the same length; ``None`` if no force is as large.
    - `root`: whether lengths are proportional to the square root of forces.
    """

    parts: list[DrawnPart]
    scale: float
    cut: float | None
    largest: float
    root: bool


def arrows(
    pen: SketchingPen,
    observation: Observation | None,
    size: float,
    bar: float,
    scale: float | None,
) -> Arrows:
    """Return arrows of the contact forces on second bodies, with tips at the contact points, and of
    constant loads, which start at the point of application.

    By default the largest force has the longest arrow. If it is far above the usual forces, such as
    an impact in a motion that follows the wall, lengths are proportional to the square root of
    forces, so that both are visible.
    """
    contact_forces = {} if observation is None else _contact_forces(pen, observation)
    all_forces = [force for _, force in (*contact_forces.values(), *pen.loads.values())]
    sizes = np.concatenate([np.linalg.norm(f, axis=1) for f in all_forces] or [np.zeros(1)])
    acting = sizes[sizes > 0.0]
    largest, longest = float(sizes.max()), LONGEST * size
    root = False
    if scale is None:
        root = len(acting) > 0 and largest > FAR * float(np.quantile(acting, USUAL))
        scale = longest / largest if len(acting) else 1.0
    longest *= 1.0 + 1e-9
    cut = longest / scale if bool((sizes * scale > longest).any()) else None
    parts = []
    for family, colour, at_tip in ((contact_forces, FORCE, True), (pen.loads, LOAD, False)):
        for name, (points, forces) in family.items():
            if np.any(forces):
                if root:
                    shares = np.linalg.norm(forces, axis=1, keepdims=True) / largest
                    forces = forces / np.sqrt(np.maximum(shares, 1e-30))
                vectors = _shortened(forces * scale, longest)
                starts = points - vectors if at_tip else points
                poses = between(starts, starts + vectors, WIDTH * bar)
                # Arrows without length shrink to a point.
                hidden = np.linalg.norm(poses[:, :3, 2], axis=1) < 1e-9
                poses = poses.copy()
                poses[hidden, :3, :3] = 1e-9 * np.eye(3)
                parts.append(DrawnPart(name, meshes.arrow(), poses, colour))
    return Arrows(parts, scale, cut, largest, root)


def _contact_forces(
    pen: SketchingPen, observation: Observation
) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Points (N, 3) m and forces (N, 3) N of each contact with a point; contacts of flanks, which
    transmit a couple, have none."""
    result = {}
    for joint, family in observation.contacts.items():
        if joint not in pen.drawn:
            continue
        for label, contact in family.items():
            normal = np.asarray(contact.normal)
            force = -normal * np.asarray(contact.normal_force)[:, None]
            if contact.friction_force is not None:
                force = force + np.asarray(contact.friction_force)
            point = np.asarray(contact.point_on_journal)
            if joint in pen.journals:
                touching = pen.journals[joint].touching_point(label, normal)
                point = point if touching is None else touching
            result[f"{joint} {label}"] = point, np.nan_to_num(force)
    return result


def coloured_by_mode(
    parts: list[DrawnPart], observation: Observation
) -> tuple[list[DrawnPart], list[MotionMode]]:
    """Return the parts, with journals and balls coloured by modes, and the occurring modes."""
    modes = _modes(observation)
    occurring: set[int] = set()
    coloured = []
    for part in parts:
        if part.name in modes and part.is_journal:
            occurring |= set(np.unique(modes[part.name]).tolist())
            part = replace(part, modes=modes[part.name])
        coloured.append(part)
    return coloured, [MotionMode(number) for number in sorted(occurring)]


def _modes(observation: Observation) -> Mapping[str, np.ndarray]:
    """Observed modes of journals; for other joints, 1 if one of their contacts touches, else 0."""
    modes = {name: np.asarray(numbers) for name, numbers in observation.modes.items()}
    for name, family in observation.contacts.items():
        if name not in modes and family:
            touching = [np.asarray(contact.penetration) > 0.0 for contact in family.values()]
            modes[name] = np.any(touching, axis=0).astype(int)
    return modes


def _shortened(vectors: np.ndarray, longest: float) -> np.ndarray:
    sizes = np.linalg.norm(vectors, axis=1, keepdims=True)
    return vectors * np.minimum(1.0, longest / np.maximum(sizes, 1e-300))

"""Draw arrows of forces, and colour journals by their contact."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..simulation.results.observation import MotionMode, Observation
from . import meshes
from .parts import FORCE, LOAD, DrawnPart, between
from .sketching import SketchingPen

LONGEST = 0.3
"""Length of the longest arrow, as a fraction of the size of the mechanism."""
USUAL, FAR = 0.5, 5.0
"""The usual force is the quantile `USUAL` of all forces that are not zero. Lengths of arrows are
proportional to the square root of forces if the largest force exceeds `FAR` times the usual force,
otherwise to forces."""
WIDTH = 1.1
"""Radius of an arrow's head in radii of a bar."""
MODE_NAMES = {
    MotionMode.FREE_FLIGHT: "free flight",
    MotionMode.ONE_BASE: "contact at one end",
    MotionMode.LINE_CONTACT: "contact along a line",
    MotionMode.OPPOSITE_SIDES: "contact at opposite sides",
}


class Arrows(NamedTuple):
    """Arrows of a view.

    - `parts`: solids of the arrows.
    - `scale`: length of the arrow of the largest force divided by that force, m/N.
    - `cut`: force, N, above which all arrows have the same length; ``None`` if no force is larger.
    - `largest`: largest force, N.
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
    """Return arrows of the contact forces on the second body of each contact, with tips at the
    contact points, and of constant loads, which start at the point of application.

    If the largest force is far above the usual forces, as in an impact during a motion along the
    wall, lengths are proportional to the square root of forces, so that all are visible.

    **Arguments:**

    - `pen`: the pen by which the scene has drawn itself.
    - `observation`: observation at the times of the frames, None without contact forces.
    - `size`: size of the mechanism, m. `bar`: radius of the bar by which a body is drawn, m.
    - `scale`: length of an arrow divided by its force, m/N; None to choose it.
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
                norms = np.linalg.norm(forces, axis=1, keepdims=True)
                lengths = scale * (np.sqrt(norms * largest) if root else norms)
                directions = forces / np.maximum(norms, 1e-300)
                vectors = directions * np.minimum(lengths, longest)
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
    """Return the contact point (N, 3), m, and the force on the second body (N, 3), N, in global
    axes for each contact, by "joint label". Flanks, which transmit a couple, are left out."""
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
    """Return the parts, in which journals and balls have the colours of their motion modes, and the
    motion modes that occur, sorted by number.

    A joint without observed motion modes has the mode 1 if one of its contacts touches, else 0.
    """
    modes = {name: np.asarray(numbers) for name, numbers in observation.modes.items()}
    for name, family in observation.contacts.items():
        if name not in modes and family:
            touching = [np.asarray(contact.penetration) > 0.0 for contact in family.values()]
            modes[name] = np.any(touching, axis=0).astype(int)
    coloured = [
        replace(part, modes=modes[part.name]) if part.is_journal and part.name in modes else part
        for part in parts
    ]
    occurring = {int(mode) for part in coloured if part.modes is not None for mode in part.modes}
    return coloured, [MotionMode(number) for number in sorted(occurring)]

"""Forces as arrows, and the modes of journals as colours."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from ..simulation.results.observe import MotionMode, Observation
from . import meshes
from .meshes import pose_at
from .parts import FORCE, LOAD, DrawnPart, between, recoloured
from .sketching import SketchingPen

LONGEST = 0.3
"""Length of the longest arrow over the size of the mechanism."""
USUAL, FAR = 0.5, 5.0
"""Share of the forces that are no greater than the usual one; and how many times as great the
greatest may be for lengths to be proportional to forces."""
WIDTH = 1.1
"""Radius of an arrow's head over that of a bar."""
MODE_NAMES = {
    MotionMode.FREE_FLIGHT: "free flight",
    MotionMode.ONE_BASE: "contact at one end",
    MotionMode.LINE_CONTACT: "contact along a line",
    MotionMode.OPPOSITE_SIDES: "contact at opposite sides",
}


class Arrows(NamedTuple):
    """`parts`, the `scale` that makes a length of the `largest` force, m/N, and the force, N, from
    which on arrows grow no longer, or ``None`` if no force is as great. Lengths grow as the square
    `root` of forces, or as the forces."""

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
    """Arrows of all contact forces on the second bodies, their tips where these are touched, and of
    constant loads, their ends where these act.

    Unless a scale is given, the longest arrow is that of the greatest force. Where this is far
    above the usual one, such as an impact in a motion that follows the wall, lengths grow as the
    square root of forces, so that both are seen.
    """
    pushes = {} if observation is None else _contact_forces(pen, observation)
    everything = [force for _, force in (*pushes.values(), *pen.loads.values())]
    sizes = np.concatenate([np.linalg.norm(f, axis=1) for f in everything] or [np.zeros(1)])
    acting = sizes[sizes > 0.0]
    largest, longest = float(sizes.max()), LONGEST * size
    root = False
    if scale is None:
        root = len(acting) > 0 and largest > FAR * float(np.quantile(acting, USUAL))
        scale = longest / largest if len(acting) else 1.0
    longest *= 1.0 + 1e-9
    cut = longest / scale if bool((sizes * scale > longest).any()) else None
    parts = []
    for family, colour, at_tip in ((pushes, FORCE, True), (pen.loads, LOAD, False)):
        for name, (points, forces) in family.items():
            if np.any(forces):
                if root:
                    shares = np.linalg.norm(forces, axis=1, keepdims=True) / largest
                    forces = forces / np.sqrt(np.maximum(shares, 1e-30))
                vectors = _shortened(forces * scale, longest)
                starts = points - vectors if at_tip else points
                spanned = between(starts, starts + vectors, WIDTH * bar)
                parts.append(DrawnPart(name, meshes.arrow(), _hidden_where_none(spanned), colour))
    return Arrows(parts, scale, cut, largest, root)


def _contact_forces(
    pen: SketchingPen, observation: Observation
) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Points (N, 3) m and forces (N, 3) N of each contact that is anywhere: the couples of flanks,
    which have no place, are left out."""
    found = {}
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
            found[f"{joint} {label}"] = point, np.nan_to_num(force)
    return found


def coloured_by_mode(
    parts: list[DrawnPart], observation: Observation
) -> tuple[list[DrawnPart], list[MotionMode]]:
    """The parts, those of journals and balls with play in the colours of their modes; and which
    modes there are."""
    modes = _modes(observation)
    found: set[int] = set()
    shown = []
    for part in parts:
        if part.name in modes and part.is_journal:
            found |= set(np.unique(modes[part.name]).tolist())
            part = recoloured(part, modes[part.name])
        shown.append(part)
    return shown, [MotionMode(number) for number in sorted(found)]


def _modes(observation: Observation) -> Mapping[str, np.ndarray]:
    """Of the journals as observed; of other contacts, whether one of the joint's touches."""
    modes = {name: np.asarray(numbers) for name, numbers in observation.modes.items()}
    for name, family in observation.contacts.items():
        if name not in modes and family:
            touching = [np.asarray(contact.penetration) > 0.0 for contact in family.values()]
            modes[name] = np.any(touching, axis=0).astype(int)
    return modes


def _shortened(vectors: np.ndarray, longest: float) -> np.ndarray:
    sizes = np.linalg.norm(vectors, axis=1, keepdims=True)
    return vectors * np.minimum(1.0, longest / np.maximum(sizes, 1e-300))


def _hidden_where_none(poses: np.ndarray) -> np.ndarray:
    """The poses, shrunk to a point where they have no length."""
    length = np.linalg.norm(poses[:, :3, 2], axis=1)
    small = pose_at((0.0, 0.0, 0.0))[:3, :3] * 1e-9
    hidden = poses.copy()
    hidden[length < 1e-9, :3, :3] = small
    return hidden

"""Make the arrows of forces in a view, and colour journals by their contact."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from .._model.clearance_joints.journal_bases import axial_positions
from .._simulation.results.observe import MotionMode, Observation
from . import meshes
from .meshes import FORCE, LOAD, DrawnPart, between
from .proportions import Proportions
from .sketching import SketchingPen

LONGEST = 0.3
"""Length of the longest arrow, as a fraction of the size of the mechanism."""
MODE_NAMES = {
    MotionMode.FREE_FLIGHT: "free flight",
    MotionMode.ONE_BASE: "contact at one end",
    MotionMode.LINE_CONTACT: "contact along a line",
    MotionMode.OPPOSITE_SIDES: "contact at opposite sides",
}


class Arrows(NamedTuple):
    """Arrows of forces. `parts`: their solids; `note`: the legend's text on the scale; `scale`:
    length over force, m/N, before arrows are cut to the length `LONGEST`. If lengths grow with the
    square root of forces, `scale` is that of the largest force."""

    parts: list[DrawnPart]
    scale: float
    note: str


def arrows(
    pen: SketchingPen, observation: Observation | None, sizes: Proportions, scale: float | None
) -> Arrows:
    """Return arrows of an observation's contact forces on the second body of each joint, which end
    at the contact points, and of the loads in `pen`, which start at the points of application.

    Lengths are forces times `scale`, m/N, at most `LONGEST` times the mechanism's size. Without a
    `scale`, the largest force has this length; and if it exceeds five times the median of all
    forces that are not zero, as in an impact during a motion along the wall, lengths are
    proportional to the square root of forces, so that small forces are visible.
    """
    contact_forces = [] if observation is None else [*_contact_forces(pen, observation).items()]
    all_forces = [force for _, (_, force) in (*contact_forces, *pen.loads)]
    magnitudes = np.concatenate([np.linalg.norm(f, axis=1) for f in all_forces] or [np.zeros(1)])
    acting = magnitudes[magnitudes > 0.0]
    largest, longest = float(magnitudes.max()), LONGEST * sizes.size
    by_root = False  # whether lengths are proportional to the square root of forces
    if scale is None:
        by_root = len(acting) > 0 and largest > 5.0 * float(np.median(acting))
        scale = longest / largest if len(acting) else 1.0
    longest *= 1.0 + 1e-9  # a longest arrow is not cut because of rounding errors
    parts = []
    for family, colour, at_tip in ((contact_forces, FORCE, True), (pen.loads, LOAD, False)):
        for name, (points, forces) in family:
            if not np.any(forces):
                continue
            norms = np.linalg.norm(forces, axis=1, keepdims=True)
            # The arrow of the largest force has the same length by either formula.
            lengths = np.minimum(scale * (np.sqrt(norms * largest) if by_root else norms), longest)
            vectors = forces / np.maximum(norms, 1e-300) * lengths  # zero for no force, not NaN
            starts = points - vectors if at_tip else points
            poses = between(starts, starts + vectors, 1.1 * sizes.bar).copy()
            # Arrows shorter than 1e-9 m, as in frames without force, shrink to a point in all
            # directions: a disc would be seen otherwise.
            poses[np.linalg.norm(poses[:, :3, 2], axis=1) < 1e-9, :3, :3] = 1e-9 * np.eye(3)
            parts.append(DrawnPart(name, meshes.arrow(), poses, colour))
    if not parts:
        return Arrows(parts, scale, "")
    # The legend states the force of an arrow as long as a tenth of the mechanism or, if lengths are
    # not proportional to forces, the largest force.
    length, force, suffix = 0.1 * sizes.size, 0.1 * sizes.size / scale, ""
    if by_root:
        length, force, suffix = scale * largest, largest, ", lengths ∝ square root of forces"
    elif largest * scale > longest:
        suffix = f", cut at {newtons(longest / scale)}"
    return Arrows(parts, scale, f"arrows: {length:.2g} m for {newtons(force)}{suffix}")


def newtons(force: float) -> str:  # such as "12.3 kN"
    from matplotlib.ticker import EngFormatter

    return EngFormatter("N")(float(f"{force:.3g}"))


def _contact_forces(
    pen: SketchingPen, observation: Observation
) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return the points, (N, 3) m, at which contact forces act, and the forces on the joints'
    second bodies, (N, 3) N, by names such as "pin V" for the contact "V" of the joint "pin". Joints
    that draw nothing, such as `Backlash`, whose contacts transmit a couple, are left out."""
    result = {}
    for joint, family in observation.contacts.items():
        if joint not in pen.drawn:
            continue
        on_axis = axial_positions(family)
        for label, contact in family.items():
            normal = np.asarray(contact.normal)
            # The normal points outwards from the bearing's axis; the wall pushes the journal, which
            # is on the second body, inwards.
            force = -normal * np.asarray(contact.normal_force)[:, None]
            if contact.friction_force is not None:
                force = force + np.asarray(contact.friction_force)
            point = np.asarray(contact.point_on_journal)
            # Journals are drawn with enlarged eccentricities, so their points are elsewhere. Other
            # contacts, such as those of shoulders, have no position on the journal's axis: their
            # true points are kept.
            if joint in pen.journals and label in on_axis:
                point = pen.journals[joint].touching_point(on_axis[label], normal)
            # Without contact, the direction of the force may be undefined (NaN).
            result[f"{joint} {label}"] = point, np.nan_to_num(force)
    return result


def coloured_by_mode(
    parts: list[DrawnPart], observation: Observation
) -> tuple[list[DrawnPart], list[MotionMode]]:
    """Give journals and balls the colours of their motion modes; return all parts, and the modes
    that occur, sorted. Without observed modes, as for a ball in a socket, the mode is 1 (contact at
    one end) if a contact touches, else 0 (free flight)."""
    modes = {name: np.asarray(numbers) for name, numbers in observation.modes.items()}
    # Only joints with a journal have observed modes.
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

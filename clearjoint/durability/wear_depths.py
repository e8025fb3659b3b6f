"""Depths that the contacts of a run remove around a bearing and its journal."""

import numpy as np
from jaxtyping import Float

from ..math.rotations import rotation_matrix, transverse_axes, unit
from ..math.vectors import EulerParameters, Vector, pack
from ..model.bodies import GROUND, BodyState
from ..model.clearance_joints.clearance import ClearanceJoint
from ..model.clearance_joints.journal_bases import BASES
from ..model.profiles import PlanarAxes, overlaps
from ..model.scene import Scene
from ..simulation.results.observe import ContactObservation, observe
from ..simulation.results.solution import Solution, Trajectory


def wear_depths(
    scene: Scene,
    solution: Solution,
    joint: str,
    rates: tuple[float, float],
    start: float,
    end: float,
    samples: int,
) -> tuple[Float[np.ndarray, "2 samples"], float]:
    """Return the depths that wear off the wall and off the journal of a joint in a part of a run.

    The volume that wears off in a time dt is k F v dt, with the specific wear rate k of a part, the
    normal force F of a base and the sliding speed v (J. F. Archard 1953). It is distributed in
    proportion to the overlap of the two profiles, as if the wall were an elastic foundation, over
    the whole length of the journal. Both bases count together.

    **Arguments:**

    - `solution`: of `simulate`, with all steps saved.
    - `joint`: name of a `ClearanceJoint`.
    - `rates`: k of the bearing and of the journal, m^2/N.
    - `start`, `end`: s.
    - `samples`: number of evenly spaced angles from the x axis of each part's frame.

    **Returns:** the depths, (2, samples) m, and the largest penetration, m.
    """
    assert solution.steps is not None, "`wear` saves all steps"
    ends = np.asarray(solution.steps.times)
    ends = np.unique([start, *ends[(ends > start) & (ends < end)], end])
    middles = 0.5 * (ends[1:] + ends[:-1])
    times = np.sort(np.concatenate([ends, middles]))
    path = solution.steps.between(times)
    observed = observe(scene, solution, path).contacts[joint]
    element = scene.joints[joint]
    assert isinstance(element, ClearanceJoint)
    axes = _planar_axes(element, path)
    depths = np.zeros((2, samples))
    for base in BASES:
        power = observed[base].normal_force * _sliding_speeds(element, path, observed[base])
        radii = element.bearing_radius, element.journal_radius
        for k, angles in enumerate(_wall_angles(axes, samples)):
            if rates[k] == 0.0:
                continue
            area = float(radii[k]) * 2.0 * np.pi / samples * float(element.journal_length)
            shares = _shares(element, observed[base].offset, angles, axes)
            depths[k] += rates[k] / area * _integral(times, power[:, None] * shares)
    return depths, max(float(observed[base].penetration.max()) for base in BASES)


def _integral(
    times: Float[np.ndarray, " T"], values: Float[np.ndarray, "T n"]
) -> Float[np.ndarray, " n"]:
    """Return integrals over time by Simpson's rule in each step; every second time is a middle."""
    lengths = times[2::2] - times[:-2:2]
    sixths = lengths[:, None] / 6.0
    return (sixths * (values[:-2:2] + 4.0 * values[1:-1:2] + values[2::2])).sum(axis=0)


def _sliding_speeds(
    joint: ClearanceJoint, path: Trajectory, contact: ContactObservation
) -> Float[np.ndarray, " T"]:
    """Return the sliding speed at the contact of a base, m/s, with or without friction."""
    bearing = _velocities(joint.bearing_body, path, contact.point_on_bearing)
    journal = _velocities(joint.journal_body, path, contact.point_on_journal)
    sliding = journal - bearing
    along = (sliding * contact.normal).sum(axis=1, keepdims=True)
    return np.linalg.norm(sliding - along * contact.normal, axis=1)


def _velocities(
    name: str, path: Trajectory, points: Float[np.ndarray, "T 3"]
) -> Float[np.ndarray, "T 3"]:
    """Return the velocity of the points of a body at given global positions, m/s."""
    if name == GROUND:
        return np.zeros_like(points)
    body = path.states.bodies[name]
    spin = _to_global(body, np.asarray(body.spin))
    return np.asarray(body.velocity) + np.cross(spin, points - np.asarray(body.position))


def _to_global(body: BodyState, components: Float[np.ndarray, "#T 3"]) -> Float[np.ndarray, "T 3"]:
    """Return global components of vectors that are given in the axes of a body."""
    rotation = rotation_matrix(EulerParameters(*np.asarray(body.orientation).T))
    return np.asarray(pack(rotation @ Vector(*components.T)))


def _planar_axes(joint: ClearanceJoint, path: Trajectory) -> PlanarAxes:
    """Return the components of the journal's axes in the bearing's cross-section, (T, 1) each."""
    own, bearing = (
        [
            np.broadcast_to(axis, (len(path.times), 3))
            if name == GROUND
            else _to_global(path.states.bodies[name], axis[None])
            for axis in map(pack, transverse_axes(unit(Vector(*np.asarray(along)))))
        ]
        for name, along in (
            (joint.journal_body, joint.journal_axis),
            (joint.bearing_body, joint.bearing_axis),
        )
    )
    return PlanarAxes(*((mine * axis).sum(1, keepdims=True) for mine in own for axis in bearing))


def _wall_angles(axes: PlanarAxes, samples: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the angles in the bearing's cross-section of evenly spaced angles of both parts.

    The first array is (samples,), the second (T, samples), since the journal rotates.
    """
    angles = np.arange(samples) * 2.0 * np.pi / samples
    along_x = axes.x_along_x * np.cos(angles) + axes.y_along_x * np.sin(angles)
    along_y = axes.x_along_y * np.cos(angles) + axes.y_along_y * np.sin(angles)
    return angles, np.arctan2(along_y, along_x)


def _shares(
    joint: ClearanceJoint,
    offset: Float[np.ndarray, "T 3"] | None,
    angles: Float[np.ndarray, "... samples"],
    axes: PlanarAxes,
) -> Float[np.ndarray, "T samples"]:
    """Return the share of the wear at each angle in the bearing's cross-section.

    The sagitta of one spacing is added to the overlap, so that two angles at least share the wear
    of a contact that is narrower than their distance.
    """
    assert offset is not None
    spacing = 2.0 * np.pi / angles.shape[-1]
    excess = 0.5 * float(joint.clearance) * spacing**2 - float(joint.clearance)
    profiles = joint.bearing_profile, joint.journal_profile
    overlap = overlaps(offset[:, :1], offset[:, 1:2], angles, *profiles, axes)
    part = np.maximum(np.asarray(overlap) + excess, 0.0)
    total = part.sum(axis=1, keepdims=True)
    return part / np.where(total > 0.0, total, 1.0)

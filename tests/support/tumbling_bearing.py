"""A bearing that tumbles, and a journal that runs round in it: states made by hand."""

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

import clearjoint as cj
from clearjoint.extend import Formulation

COUNT, CLEARANCE = 60, 0.5e-3
TIMES = np.linspace(0.0, 0.06, COUNT)
POINT, AXIS = np.array([0.2, -0.1, 0.3]), np.array([1.0, 2.0, 2.0]) / 3.0


class Tumbling(NamedTuple):
    """A scene, a solution with its states, and the bearing's rotations, (N, 3, 3) from body to
    global axes."""

    scene: cj.Scene
    solution: cj.results.Solution
    rotations: np.ndarray


def tumbling_bearing() -> Tumbling:
    """The journal is a micrometre in the wall for half of the time."""
    first = np.cross(AXIS, (0.0, 0.0, 1.0)) / np.linalg.norm(np.cross(AXIS, (0.0, 0.0, 1.0)))
    second = np.cross(AXIS, first)
    round_it = 2.0 * np.pi * np.arange(COUNT) / COUNT
    size = CLEARANCE + 1e-6 * np.sign(np.sin(round_it))
    place = np.cos(round_it)[:, None] * first + np.sin(round_it)[:, None] * second
    tumbling = Rotation.from_rotvec(np.outer(5.0 * TIMES, (3.0, -1.0, 2.0)))
    euler = np.roll(tumbling.as_quat(), 1, axis=1)
    still = np.zeros((COUNT, 3))
    bearing = cj.BodyState(np.outer(TIMES, (1.0, 2.0, 3.0)), euler, still, still)
    centre = bearing.position + tumbling.apply(POINT + size[:, None] * place)
    states = cj.State({"bearing": bearing, "journal": cj.BodyState(centre, euler, still, still)})
    joint = cj.ClearanceJoint(
        "bearing",
        "journal",
        bearing_point=POINT,
        bearing_axis=AXIS,
        journal_axis=AXIS,
        bearing_radius=10e-3,
        clearance=CLEARANCE,
        journal_length=20e-3,
        law=cj.laws.Hertz(cj.laws.RavnStiffness(207e9, 0.3)),
    )
    body = cj.Body(1.0, (1.0, 1.0, 1.0))
    scene = cj.Scene({"bearing": body, "journal": body}, {"pin": joint})
    return Tumbling(scene, solution_of(cj.results.Trajectory(TIMES, states)), tumbling.as_matrix())


def solution_of(
    saved: cj.results.Trajectory, impacts: cj.results.Impacts | None = None
) -> cj.results.Solution:
    """A solution with given states, in absolute coordinates."""
    return cj.results.Solution(
        time=np.asarray(saved.times)[-1],
        final=saved.states,
        result=cj.RESULTS.successful,
        attempts=np.asarray(70),
        accepted=np.asarray(60),
        saved=saved,
        saved_count=None,
        steps=None,
        impacts=impacts,
        formulation=Formulation(cj.AbsoluteCoordinates()),
        redundant_constraints=(),
    )

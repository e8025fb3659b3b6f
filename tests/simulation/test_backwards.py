"""Motions of every element without losses return to their start, through impacts too, if all
velocities are reversed at their end."""

from typing import Any

import numpy as np
import pytest

import clearjoint as cj
from tests.simulation.test_symmetries import backwards
from tests.support import symmetry_transformations as symmetries
from tests.support.elements import Case, elements
from tests.support.many_states import TIME, states

CLOSE = 1e-6
"""Largest difference to the start, m, m/s, rad/s, and of rotation matrices. Impacts amplify the
errors of the runs, whose `rtol` is 1e-10, some hundred times."""
QUICK = ("spring",)
"""One force and one drive. An ideal joint and one with clearance are in `test_symmetries.py`."""
pytestmark = pytest.mark.filterwarnings("ignore::UserWarning")


def without_dampers(element: Any) -> Any:
    """The element with all coefficients of damping zero."""
    changes = {
        name: np.zeros_like(getattr(element, name))
        for name in symmetries.ODD_IN_TIME
        if hasattr(element, name) and name != "speed"
    }
    return symmetries.with_fields(element, **changes)


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=() if name in QUICK else pytest.mark.slow)
        for name in elements(lossless=True)
    ],
)
def test_element_backwards(name):
    case = elements(lossless=True)[name]
    scene = symmetries.scene_with(case.scene, without_dampers)
    start, duration = single_state(case), 4e-3 if scene.contact_joints() else 0.03
    forwards = run(scene, start, TIME, duration)
    back = run(
        symmetries.scene_with(scene, symmetries.backwards),
        backwards(forwards.final),
        -(TIME + duration),
        duration,
    )
    assert differences(backwards(back.final), start) < CLOSE
    assert differences(forwards.final, start) > 1e3 * CLOSE
    if scene.contact_joints():
        assert forwards.impacts is not None and len(forwards.impacts) > 0


def single_state(case: Case) -> cj.State:
    """A state at random in which contacts are open, or only just closed."""
    within = case._replace(rotation=0.3 * case.rotation, shift=0.3 * case.shift)
    many = states(within, np.random.default_rng(1))
    return cj.State(
        {
            name: cj.body_state(*(part[0] for part in vars(body).values()))
            for name, body in many.bodies.items()
        }
    )


def run(scene: cj.Scene, state: cj.State, start: float, duration: float) -> cj.results.Solution:
    return cj.simulate(
        scene,
        state,
        start + duration,
        cj.Settings(rtol=1e-10),
        save=cj.Saving(impacts=True),
        start_time=start,
        progress=False,
    )


def differences(found: cj.State, expected: cj.State) -> float:
    """The largest difference, m, m/s, rad/s, and of rotation matrices."""
    worst = 0.0
    for name, body in expected.bodies.items():
        there = found.bodies[name]
        turned = symmetries.matrix(there.orientation) - symmetries.matrix(body.orientation)
        parts = [getattr(there, k) - getattr(body, k) for k in ("position", "velocity", "spin")]
        worst = max(worst, *(float(np.abs(part).max()) for part in (turned, *parts)))
    return worst

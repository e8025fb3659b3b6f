"""What a user prints reads like what was given."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import clearjoint as cj
from clearjoint.results import RESULTS


def test_a_scene_shows_its_numbers():
    scene, state = cj.double_pendulum()
    text = repr(scene)
    for part in ("mass=7.02", "inertia=[0.001, 0.5855, 0.5855]", "clearance=0.0005", "gravity="):
        assert part in text
    assert "numpy" not in text and "f64" not in text
    assert "position=[0.5, 0.0, 0.0]" in repr(state)


@pytest.mark.parametrize(
    ("element", "text"),
    [
        (cj.Body(1.5, (1, 2, 3)), "Body(mass=1.5, inertia=[1.0, 2.0, 3.0])"),
        (cj.Hertz(1e8), "Hertz(stiffness=GivenStiffness(stiffness=100000000.0))"),
        (cj.RegularisedCoulomb(0.1), "RegularisedCoulomb(coefficient=0.1"),
        (cj.Baumgarte(3.0, 4.0), "Baumgarte(alpha=3.0, beta=4.0)"),
        (cj.SphericalJoint("a", "b", (0, 1, 2), (3, 4, 5)), "point_first=[0.0, 1.0, 2.0]"),
        (cj.Body(jnp.asarray(2.0), np.eye(3)), "mass=2.0"),
    ],
)
def test_elements_show_their_numbers(element, text):
    assert text in repr(element).replace("\n  ", " ")


def test_long_arrays_and_traced_numbers_show_their_kind():
    long = cj.Trajectory(np.zeros(1000), cj.State({"arm": cj.body_state((0, 0, 0))}))
    assert "times=f64[1000](numpy)" in repr(long)
    seen = []
    jax.jit(lambda mass: seen.append(repr(cj.Body(mass, (1, 1, 1)))))(1.0)
    assert seen[0].startswith("Body(mass=") and "inertia=[1.0, 1.0, 1.0]" in seen[0]


def test_every_result_says_something():
    for code in RESULTS._name_to_item.values():
        assert RESULTS[code] != ""
        assert RESULTS[code] in str(code)
    assert "reached its end" in str(RESULTS.successful)

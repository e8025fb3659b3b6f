"""Equations of motion in joint coordinates: of mechanisms with loops, and without constraints."""

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import clearjoint as cj
from clearjoint._dynamics import system as dynamics
from clearjoint._math.vectors import fold_constants
from clearjoint.extend import Formulation, System, pack, rotation_matrix, unpack
from clearjoint.mechanisms import bricard, double_four_bar
from tests.dynamics.test_joint_coordinates import ABSOLUTE, JOINT
from tests.internals.dynamics.test_large_trees import random_scene, random_variables


def close(found, expected, tolerance=1e-12):
    scale = max(np.abs(leaf).max() for leaf in jax.tree.leaves(expected))
    jax.tree.map(
        partial(np.testing.assert_allclose, rtol=0, atol=tolerance * scale), found, expected
    )


def arrays(tree):
    return jax.tree.map(jnp.asarray, pack(tree))


@pytest.mark.parametrize(
    ("mechanism", "redundant", "left"),
    [
        (cj.mechanisms.double_pendulum, False, 0),
        pytest.param(lambda: cj.mechanisms.double_pendulum(None), False, 0, marks=pytest.mark.slow),
        pytest.param(double_four_bar, True, 10, marks=pytest.mark.slow),
        pytest.param(bricard, True, 5, marks=pytest.mark.slow),
    ],
    ids=["pendulum with clearance", "ideal pendulum", "double four-bar", "Bricard"],
)
def test_mechanisms_accelerate_as_in_absolute_coordinates(mechanism, redundant, left):
    scene, state = mechanism()
    form = fold_constants(scene)
    entry_speeds = {name: dict.fromkeys(family, 0.1) for name, family in scene.laws().items()}

    def accelerations(coordinates):
        def at(form, state):
            scene = unpack(form)
            variables = coordinates.encode(scene, unpack(state.bodies))
            formulation = Formulation(coordinates, redundant=redundant)
            found = System(scene, formulation).dynamics(variables, entry_speeds, 0.0)
            return arrays(found.accelerations), sum(map(len, found.rows.values()))

        return eqx.filter_jit(at)(form, state)

    expected, _ = accelerations(ABSOLUTE)
    found, rows = accelerations(JOINT)
    close(found, expected)
    assert rows == left


@pytest.mark.slow
def test_flying_tree_keeps_energy_and_momentum():
    random = np.random.default_rng(11)
    scene = random_scene(random, [4], ("revolute", "spherical"), on_ground=0.0)
    scene = cj.Scene(scene.bodies, scene.joints)
    bodies = JOINT.decode(unpack(scene), random_variables(random, unpack(scene)))
    solution = cj.simulate(
        scene, cj.State(pack(bodies)), 2.0, cj.Settings(rtol=1e-11), save=cj.Saving([0.0, 2.0])
    )

    def momenta(bodies):
        linear, angular = 0.0, 0.0
        for name, part in unpack(bodies).items():
            mass, turn = scene.bodies[name].mass, rotation_matrix(part.orientation)
            own = turn @ unpack(scene).bodies[name].angular_momentum(part.spin)
            linear = linear + pack(part.velocity * mass)
            angular = angular + pack(own + (part.position * mass).cross(part.velocity))
        return linear, angular

    start, end = (
        momenta(jax.tree.map(lambda leaf, k=k: leaf[k], solution.states.bodies)) for k in (0, 1)
    )
    np.testing.assert_allclose(end, start, rtol=0.0, atol=1e-9)
    observed = cj.observe(scene, solution)
    assert np.ptp(observed.energies["kinetic"]) < 1e-9 * observed.energies["kinetic"][0]


def test_a_tree_solves_no_constraints(monkeypatch):
    """Neither stabilisation nor projection nor multipliers are traced."""
    monkeypatch.setattr(dynamics, "ConstraintEquations", None)
    scene, state = cj.mechanisms.double_pendulum()
    scene, bodies = unpack(fold_constants(scene)), unpack(state.bodies)
    variables, entry_speeds = JOINT.encode(scene, bodies), {"shoulder": {"V": 0.1, "W": 0.1}}
    system = System(scene, Formulation(JOINT, cj.Projection()))
    assert system.dynamics(variables, entry_speeds, 0.0).multipliers == {}
    assert not system.is_constrained(0.0)
    absolute = System(scene, Formulation(ABSOLUTE))
    assert absolute.is_constrained(0.0)
    assert system.project(variables, 0.0) is variables

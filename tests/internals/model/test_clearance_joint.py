"""Sums of contact forces on a body at rest and on the ground."""

import jax
import numpy as np

import clearjoint as cj
from clearjoint._dynamics.contact_forces import contact_forces
from clearjoint.extend import EulerParameters
from tests.model.test_clearance_joint import (
    COORDINATES,
    FRICTION,
    MEMORY,
    PLAY,
    N,
    random_scene,
    random_states,
    vector,
)


def test_bearing_on_the_ground_is_a_bearing_on_a_body_at_rest():
    """Pruning what the ground makes zero changes nothing for the journal's body."""
    scene = random_scene(friction=FRICTION, axial=cj.EndPlay(PLAY, cj.laws.Hertz(30.0)))
    states = random_states()
    zero = vector(np.zeros((N, 3)))
    still = cj.BodyState(zero, EulerParameters(np.ones(N), zero.x, zero.y, zero.z), zero, zero)
    pinned = random_scene(cj.GROUND, friction=FRICTION, axial=cj.EndPlay(PLAY, cj.laws.Hertz(30.0)))
    variables = COORDINATES.encode(pinned, states)
    on_ground = contact_forces(pinned, COORDINATES.motions(pinned, variables), MEMORY)
    on_body = contact_forces(scene, COORDINATES.motions(scene, {**states, "a": still}), MEMORY)
    jax.tree.map(
        lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-11, atol=1e-11), on_ground, on_body
    )

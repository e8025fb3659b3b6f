"""Derivatives of forces where contact begins, and what reverse mode of `simulate` says."""

import equinox as eqx
import jax
import jax.numpy as jnp
import pytest

import clearjoint as cj
from clearjoint._model.contact.laws import Gap, contact_normal_force
from tests.support.one_body import one_body


def test_grad_raises_with_the_remedy():
    scene, state = one_body("rod")

    def flown(speed):
        thrown = eqx.tree_at(lambda s: s.bodies["rod"].velocity, state, jnp.zeros(3) + speed)
        return cj.simulate(scene, thrown, 1.0).final.bodies["rod"].position[0]

    with pytest.raises(RuntimeError, match=r"clearjoint\.predictor"):
        jax.jit(jax.grad(flown)).lower(1.0)


def test_force_at_zero_depth_is_that_of_the_flight():
    """Hertz: the slope is zero on both sides. Linear: that of the flight."""
    for law in (
        cj.laws.Hertz(1e9),
        cj.laws.Hertz(1e9, exponent=1.0),
        cj.laws.LankaraniNikravesh(restitution=0.5, stiffness=1e9),
    ):
        slopes = jax.grad(lambda d, law=law: contact_normal_force(law, Gap(d, 0.1), 0.1))(0.0)
        assert slopes == 0.0

"""Derivatives of the computed steps under `jax.jvp` against closed forms and differences; and
derivatives of forces at points with a kink or a vanishing length."""

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import clearjoint as cj
from clearjoint._math.vectors import Vector
from clearjoint._model.contact.laws import Gap, contact_normal_force
from clearjoint.mechanisms import STEEL
from tests.support.difference_quotients import central
from tests.support.one_body import bearing, one_body


def height(numbers):
    """Where a rod is after an impact by clearance m, restitution, gravity m/s^2 and height at the
    start m. Its journal falls along -Y from near the centre of the bearing."""
    clearance, restitution, gravity, start = numbers
    law = cj.laws.LankaraniNikravesh(0.9, STEEL, entry_speed_floor=1e-2)
    pin = bearing(law, "rod", journal_point=(-0.1, 0.0, 0.0))
    place = {"inertia": (1e-5, 3e-3, 3e-3), "position": (0.1, 0.0, 0.0)}
    scene, state = one_body("rod", {"pin": pin}, gravity=(0, -1, 0), **place)
    scene = eqx.tree_at(
        lambda s: (s.joints["pin"].clearance, s.joints["pin"].law.restitution, s.gravity),
        scene,
        (clearance, restitution, gravity * jnp.array([0.0, -1.0, 0.0])),
    )
    position = jnp.stack([jnp.asarray(0.1), start, jnp.zeros(())])
    state = eqx.tree_at(lambda s: s.bodies["rod"].position, state, position)
    settings = cj.Settings(solver=diffrax.Bosh3(), rtol=1e-7, landing_tolerance=1e-13)
    return cj.simulate(scene, state, 0.012, settings).final.bodies["rod"].position[1]


@pytest.mark.slow
def test_derivatives_after_an_impact_agree_with_differences():
    """From the centre, where the journal's direction vanishes, and from beside it."""
    run, slopes = jax.jit(height), jax.jit(jax.jacfwd(height))
    for start in (np.array([5e-4, 0.9, 9.81, 0.0]), np.array([4e-4, 0.5, 9.81, 1e-5])):
        expected = [
            central(lambda by, k=k, start=start: run(start + by * np.eye(4)[k]), step)
            for k, step in enumerate((1e-8, 1e-3, 1e-3, 1e-8))
        ]
        np.testing.assert_allclose(slopes(start), expected, rtol=2e-3)


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


def test_damping_at_zero_entry_speed_is_that_of_the_floor():
    """F = K delta^1.5 (1 + chi rate/floor) for either sign of a rate below the floor."""
    law = cj.laws.LankaraniNikravesh(restitution=0.5, stiffness=1e9, entry_speed_floor=1e-3)
    slope = jax.grad(lambda rate: contact_normal_force(law, Gap(1e-6, rate), 0.0))(0.0)
    assert slope == pytest.approx(1e9 * 1e-9 * 0.75 * 0.75 / 1e-3, rel=1e-12)


@pytest.mark.parametrize(
    "law",
    [cj.frictions.RegularisedCoulomb(0.2, 1e-2), cj.frictions.Ambrosio(0.2, 0.0, 1e-2)],
    ids=["Coulomb", "Ambrosio from rest"],
)
def test_friction_at_zero_slip_has_the_slope_of_either_side(law):
    def force(speed):
        return law.force(3.0, Vector(speed, 0.0, 0.0)).x

    np.testing.assert_allclose(jax.jvp(force, (0.0,), (1.0,))[1], -60.0, rtol=1e-12)
    np.testing.assert_allclose(jax.grad(force)(0.0), -60.0, rtol=1e-12)

"""Derivatives of the computed steps under `jax.jvp` against closed forms and differences; and
derivatives of forces at points with a kink or a vanishing length."""

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import clearjoint as cj
from clearjoint._dynamics.formulation import Formulation
from clearjoint._dynamics.system import System
from clearjoint._math.vectors import Vector, fold_constants, unpack
from clearjoint._model.contact.laws import Gap, contact_normal_force
from clearjoint.mechanisms import STEEL
from tests.support.difference_quotients import central
from tests.support.one_body import bearing, one_body

GRAVITY, CLEARANCE, RESTITUTION = 9.81, 5e-4, 0.9
END, BEFORE = 0.012, 0.0099
"""s: after the first impact, and before it."""
TIMES = jnp.asarray([0.0, BEFORE, END])
ENTRY_SPEEDS = {"shoulder": {"V": 0.0, "W": 0.0}}


def rod(height=0.0):
    """A rod whose journal is at a height in the bearing, falling along -Y."""
    law = cj.laws.LankaraniNikravesh(RESTITUTION, STEEL, entry_speed_floor=1e-2)
    pin = bearing(law, "rod", journal_point=(-0.1, 0.0, 0.0), clearance=CLEARANCE)
    place = {"inertia": (1e-5, 3e-3, 3e-3), "position": (0.1, height, 0.0)}
    return one_body("rod", {"pin": pin}, gravity=(0, -1, 0), **place)


def heights(parameters):
    """Heights at `TIMES` by clearance m, restitution, gravity m/s^2 and height at the start m."""
    scene, state = rod()
    clearance, restitution, gravity, start = parameters
    down = jnp.asarray([0.0, -1.0, 0.0])
    settings = cj.Settings(solver=diffrax.Bosh3(), rtol=1e-7, landing_tolerance=1e-13)
    scene = eqx.tree_at(
        lambda s: (s.joints["pin"].clearance, s.joints["pin"].law.restitution, s.gravity),
        scene,
        (clearance, restitution, gravity * down),
    )
    position = state.bodies["rod"].position - start * down
    state = eqx.tree_at(lambda s: s.bodies["rod"].position, state, position)
    solution = cj.simulate(scene, state, END, settings, cj.Saving(TIMES))
    return solution.states.bodies["rod"].position[:, 1]


LANES = np.array(
    [
        [CLEARANCE, RESTITUTION, GRAVITY, 0.0],
        [4e-4, 0.5, GRAVITY, 1e-5],
        [CLEARANCE, RESTITUTION, GRAVITY, -CLEARANCE],
    ]
)
"""Starts at the centre, off the centre, and at the wall: no depth, no slip, no entry speed."""


@pytest.fixture(scope="module")
def forward():
    """Return derivatives of heights, (lanes, times, parameters)."""
    return np.asarray(jax.jit(jax.vmap(jax.jacfwd(heights)))(LANES))


@pytest.mark.slow
def test_derivatives_of_a_free_fall_are_exact(forward):
    """From the centre, where the journal's direction vanishes: start - g t^2 / 2."""
    expected = [[0, 0, 0, 1], [0, 0, -0.5 * BEFORE**2, 1]]
    np.testing.assert_allclose(forward[0, :2], expected, rtol=1e-12, atol=1e-15)


@pytest.mark.slow
def test_derivatives_after_an_impact_agree_with_differences(forward):
    run = jax.jit(heights)
    for lane in (0, 1):
        for k, step in enumerate((1e-8, 1e-3, 1e-3, 1e-8)):
            expected = central(
                lambda by, k=k, lane=lane: run(LANES[lane] + by * np.eye(4)[k])[-1], step
            )
            assert forward[lane, -1, k] == pytest.approx(float(expected), rel=2e-3)


def test_grad_raises_with_the_remedy():
    scene, state = one_body("rod")

    def flown(speed):
        thrown = eqx.tree_at(lambda s: s.bodies["rod"].velocity, state, jnp.zeros(3) + speed)
        return cj.simulate(scene, thrown, 1.0).final.bodies["rod"].position[0]

    with pytest.raises(RuntimeError, match=r"clearjoint\.predictor"):
        jax.jit(jax.grad(flown)).lower(1.0)


POSITIONS = {"centred": 0.0, "touching": CLEARANCE, "deep": 1.02 * CLEARANCE}


@pytest.fixture(scope="module")
def kernel():
    """Return tangents and cotangents of the equations of motion at a height of the journal, at
    rest, along all numbers of the scene, the state and the entry speeds."""
    law = cj.laws.LankaraniNikravesh(restitution=RESTITUTION, stiffness=STEEL)
    scene, state = cj.mechanisms.double_pendulum(
        friction=cj.frictions.Ambrosio(0.1, lower_speed=0.0),
        axial=cj.EndPlay(1e-3, cj.laws.Hertz(1e9)),
        law=law,
    )
    form = fold_constants(scene)
    numbers, shape = jax.tree.flatten((form.tree, state.bodies, ENTRY_SPEEDS))

    def rates(numbers, height):
        tree, bodies, entry_speeds = jax.tree.unflatten(shape, numbers)
        system = System(unpack(tree), Formulation())
        up = height * jnp.asarray([0.0, 1.0, 0.0])
        lifted = {
            name: eqx.tree_at(lambda b: b.position, body, body.position + up)
            for name, body in bodies.items()
        }
        y = system.encode(unpack(lifted))
        found = system.contact_gaps(y)
        results = (system.rates(y, entry_speeds, 0.0), found)
        return [jnp.asarray(x, dtype=float) for x in jax.tree.leaves(results)]

    random = np.random.default_rng(4)
    change = [random.normal(size=np.shape(n)) * (np.abs(n) + 1e-3) for n in numbers]

    @jax.jit
    def both(height):
        numbers_ = [jnp.asarray(n, dtype=float) for n in numbers]
        out, pushed = jax.jvp(lambda n: rates(n, height), (numbers_,), (change,))
        _, pull = jax.vjp(lambda n: rates(n, height), numbers_)
        weights = [1.0 + 0.1 * k for k in range(len(out))]
        (pulled,) = pull([jnp.asarray(w) for w in weights])
        return pushed, pulled, sum(w * p for w, p in zip(weights, pushed, strict=True))

    return both, change


@pytest.mark.slow
@pytest.mark.parametrize("position", POSITIONS)
def test_equations_of_motion_have_finite_derivatives(kernel, position):
    both, change = kernel
    pushed, pulled, expected = both(POSITIONS[position])
    assert all(np.isfinite(leaf).all() for leaf in (*pushed, *pulled))
    parts = [np.sum(a * b) for a, b in zip(pulled, change, strict=True)]
    assert sum(parts) == pytest.approx(expected, abs=1e-10 * np.abs(parts).max())


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

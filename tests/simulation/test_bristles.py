"""Runs with bristles: against closed forms and SciPy's integrator, stick, ledger, derivatives."""

from dataclasses import replace

import equinox as eqx
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import clearjoint as cj
from tests.support.difference_quotients import central
from tests.support.sliding_block import DEPTH, MASS, WEIGHT, along, block, deflections

Q = cj.quantities
LUGRE = cj.frictions.LuGre(
    0.25, 0.15, stribeck_speed=0.02, stiffness=1e4, damping=20.0, viscosity=0.05
)
SPRING, BELT_SPEED = 200.0, 0.1
"""N/m, and m/s."""


def by_displacement(friction, slid):
    """Dahl's force over the normal force: exponential in the distance slid, at any speed."""
    mu, stiffness = float(friction.coefficient), float(friction.stiffness)
    return mu * -np.expm1(-stiffness / mu * slid)


def test_dahls_force_over_displacement_is_exponential_and_is_booked():
    """The belt drags the block along, with a slip that changes throughout."""
    friction, times = cj.frictions.Dahl(0.3, 1e4), np.linspace(5e-4, 0.01, 20)
    scene, state = block(friction, BELT_SPEED)
    settings = cj.Settings(ledger=True)
    solution = cj.simulate(scene, state, 0.01, settings, save=cj.Saving(times))
    positions, speeds = along(solution)
    ratio = by_displacement(friction, BELT_SPEED * times - positions)
    error = -deflections(solution)[:, 0] * 1e4 - ratio
    assert np.abs(error).max() < 1e-5 * 0.3
    work = np.asarray(solution.saved.states.work["friction"])
    supplied = BELT_SPEED * MASS * speeds
    np.testing.assert_allclose(work, supplied - 0.5 * MASS * speeds**2, rtol=1e-6, atol=1e-10)
    observed = cj.observe(scene, solution)
    force = observed.contacts["floor"]["belt"].friction_force[:, 0]
    np.testing.assert_allclose(force, WEIGHT * ratio, rtol=2e-5)
    slid, stored = BELT_SPEED * times - positions, WEIGHT * ratio**2 / 2e4
    np.testing.assert_allclose(observed.energies["bristles"], stored, rtol=4e-5)
    taken = WEIGHT * (0.3 * slid - 0.3 * ratio / 1e4)
    np.testing.assert_allclose(observed.energies["friction"], taken - stored, rtol=1e-4, atol=1e-9)


@pytest.mark.slow
def test_energy_stored_in_bristles_is_returned_and_not_dissipated():
    """A block oscillates on bristles that dissipate little.

    A run that continues without a ledger starts it at their stored energy.
    """
    scene, state = block(cj.frictions.Dahl(0.3, 1e3), velocity=(2e-3, 0.0, 0.0))
    times, settings = np.linspace(0.0, 0.05, 26), cj.Settings(rtol=1e-9, ledger=True)
    solution = cj.simulate(scene, state, 0.05, settings, save=cj.Saving(times))
    observed, whole = cj.observe(scene, solution), 0.5 * MASS * 2e-3**2
    assert np.abs(observed.ledger_residual()).max() < 1e-6 * whole
    assert observed.energies["bristles"].max() > 0.9 * whole
    assert (np.diff(observed.energies["friction"]) > -1e-9 * whole).all()
    assert observed.energies["friction"][-1] < 0.2 * whole
    stopped = cj.simulate(scene, state, 0.016, settings).final
    stored = observed.energies["bristles"][8]
    assert stored > 0.5 * whole
    bare = eqx.tree_at(lambda s: s.work, stopped, {}, is_leaf=lambda node: node is stopped.work)
    on = cj.simulate(scene, bare, 0.05, settings, start_time=0.016, save=cj.Saving([0.016, 0.05]))
    after = cj.observe(scene, on).energies
    assert abs(after["friction"][0]) < 1e-9 * whole
    assert after["bristles"][0] == pytest.approx(stored)
    lost = observed.energies["friction"][-1] - observed.energies["friction"][8]
    assert after["friction"][1] == pytest.approx(lost, rel=1e-3)


def on_a_spring():
    spring = cj.SpringDamper(
        "ground", "block", (-1.0, 0.0, -DEPTH), (0.0,) * 3, stiffness=SPRING, free_length=1.0
    )
    return block(LUGRE, BELT_SPEED, {"spring": spring})


def independent(times):
    """Return positions, velocities and deflections of the block on the spring, by SciPy."""

    def rates(_, y):
        x, v, z = y
        slip = v - BELT_SPEED
        g = 0.15 + 0.1 * np.exp(-((slip / 0.02) ** 2))
        rate = slip - 1e4 * abs(slip) / g * z
        friction = 1e4 * z + 20.0 * rate + 0.05 * slip
        return v, (-SPRING * x - WEIGHT * friction) / MASS, rate

    found = solve_ivp(rates, (0.0, times[-1]), np.zeros(3), "Radau", times, rtol=1e-10, atol=1e-14)
    return found.y


def test_stick_slip_is_that_of_an_independent_integration():
    """The block sticks and slips repeatedly; a run from a saved state continues exactly."""
    scene, state = on_a_spring()
    times = np.linspace(0.02, 0.8, 40)
    expected = independent(times)
    solution = cj.simulate(scene, state, 0.8, save=cj.Saving(times))
    positions, speeds = along(solution)
    np.testing.assert_allclose(positions, expected[0], atol=2e-6)
    np.testing.assert_allclose(speeds, expected[1], atol=1e-4)
    np.testing.assert_allclose(
        deflections(solution)[:, 0], expected[2], rtol=0.0, atol=2e-4 * 0.15e-4
    )
    sticks = np.abs(speeds - BELT_SPEED) < 1e-3
    assert sticks.sum() > 5 and (~sticks).sum() > 5
    half = cj.simulate(scene, state, 0.4, save=cj.Saving(times[times < 0.4]))
    rest = cj.simulate(scene, half.final, 0.8, start_time=0.4, save=cj.Saving(times[times > 0.4]))
    np.testing.assert_allclose(along(rest)[0], expected[0][times > 0.4], atol=2e-6)
    forgotten = eqx.tree_at(lambda s: s.bristles["floor"]["belt"], half.final, np.zeros(3))
    other = cj.simulate(scene, forgotten, 0.8, start_time=0.4, save=cj.Saving(times[times > 0.4]))
    assert np.abs(along(other)[0] - along(rest)[0]).max() > 1e-4


@pytest.mark.parametrize(
    "friction",
    [LUGRE, pytest.param(cj.frictions.RegularisedCoulomb(0.25), marks=pytest.mark.slow)],
    ids=["LuGre", "Coulomb"],
)
def test_bristles_hold_a_load_that_lets_other_friction_creep(friction):
    """Half the breakaway load: tanh friction creeps at the speed that balances it."""
    pull = {"pull": cj.AppliedLoad("block", (0.5 * 0.25 * WEIGHT, 0.0, 0.0))}
    scene, state = block(friction, forces=pull)
    times = np.array([0.3, 0.5])
    solution = cj.simulate(scene, state, 0.5, save=cj.Saving(times))
    positions, _ = along(solution)
    moved = positions[1] - positions[0]
    if isinstance(friction, cj.extend.AbstractBristleFriction):
        assert abs(moved) < 1e-9
    else:
        assert moved == pytest.approx(0.2 * 1e-3 * np.arctanh(0.5), rel=1e-4)


FALLING = replace(cj.presets.derivatives, rtol=1e-10)


def falling(**changes):
    """The block above the belt, sliding and falling: bristles deflect from the onset on."""
    numbers = {"velocity": (0.05, 0.02, -0.05), "height": 1e-5} | changes
    return block(LUGRE, 0.01, **numbers)


@pytest.mark.slow
def test_derivatives_are_right_across_an_onset():
    """The onset depends on the initial height, and the bristles' rate jumps there."""
    times = np.array([3e-4, 6e-4, 1e-3])
    parameters = {
        "height": cj.Parameter.initial(lambda s: s.bodies["block"].position[2]),
        "stiffness": cj.Parameter(lambda s: s.joints["floor"].friction.stiffness, cj.Log()),
    }
    outputs = {"x": Q.Position("block", "x"), "z": Q.BristleDeflection("floor", "belt")}
    found = cj.sensitivities(*falling(), 1.1e-3, parameters, outputs, times, FALLING)

    def values(scene, state):
        tight = replace(FALLING, rtol=1e-13, landing_tolerance=1e-15)
        solution = cj.simulate(scene, state, 1.1e-3, tight, save=cj.Saving(times))
        return np.stack([along(solution)[0], np.linalg.norm(deflections(solution), axis=1)])

    def stiffer(step):
        scene, state = falling()
        where = lambda s: s.joints["floor"].friction.stiffness  # noqa: E731
        return eqx.tree_at(where, scene, np.asarray(1e4 * np.exp(step))), state

    changes = (lambda h: falling(height=1e-5 + h), 1e-8), (stiffer, 1e-4)
    for column, (make, step) in enumerate(changes):
        differences = central(lambda by, make=make: values(*make(by)), step)
        for name, expected in zip(outputs, differences, strict=True):
            error = np.abs(found.derivatives[name][:, column] - expected).max()
            assert error < 2e-5 * np.abs(expected).max(), (name, column)


@pytest.mark.slow
def test_deflections_are_zero_in_flight_and_at_each_onset():
    scene, state = falling()
    times = np.linspace(5e-5, 6e-3, 60)
    solution = cj.simulate(scene, state, 6e-3, FALLING, save=cj.Saving(times))
    heights, _ = along(solution, 2)
    sizes = np.linalg.norm(deflections(solution), axis=1)
    assert (sizes[heights > 1e-9] == 0.0).all() and (heights > 1e-9).any()
    assert (sizes[heights < -1e-9] > 0.0).all() and (heights < -1e-9).any()
    assert np.abs(deflections(solution)[:, 2]).max() == 0.0


@pytest.mark.slow
def test_rigid_contacts_take_the_friction_of_long_slip():
    """The block slows down at mu_C g, as it slides far above the Stribeck speed; observations of
    rigid runs have bristles at rest."""
    scene, state = block(LUGRE, velocity=(1.0, 0.0, 0.0), height=0.0)
    times = np.array([0.1, 0.2])
    save = cj.Saving(times)
    run = cj.simulate_nonsmooth(scene, state, 0.21, save, step=1e-3, restitution=0.0)
    np.testing.assert_allclose(along(run)[1], 1.0 - 0.15 * 10.0 * times, rtol=1e-6)
    assert cj.observe(scene, run).contacts["floor"]["belt"].friction_force is not None


@pytest.mark.slow
def test_two_joints_equal_single_ones():
    """Two blocks in one scene against single runs."""
    one, start = falling()
    floor = one.joints["floor"]
    stiffer = eqx.tree_at(lambda j: j.friction.stiffness, floor, np.asarray(2e4))
    bodies = dict.fromkeys(("block", "other"), one.bodies["block"])
    scene = replace(
        one, bodies=bodies, joints={"floor": floor, "second": replace(stiffer, body="other")}
    )
    state = cj.State(dict.fromkeys(bodies, start.bodies["block"]))
    save = cj.Saving(np.array([3e-4, 1e-3]))
    both = cj.simulate(scene, state, 1.1e-3, FALLING, save)
    alone = cj.simulate(one, start, 1.1e-3, FALLING, save)
    stored = np.asarray(both.saved.states.bristles["floor"]["belt"])
    np.testing.assert_allclose(stored, deflections(alone), rtol=1e-7, atol=1e-15)
    assert not np.allclose(both.saved.states.bristles["second"]["belt"], stored, rtol=0.1, atol=0.0)

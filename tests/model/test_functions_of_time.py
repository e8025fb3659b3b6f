"""Torques and loads over time: tables, functions, their breakpoints, and runs by closed forms."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import clearjoint as cj
from clearjoint._dynamics.breakpoints import (
    next_breakpoint,
    one_sided_time,
    since_breakpoints,
)
from clearjoint._math.vectors import fold_constants
from clearjoint._simulation.step.discontinuities import require_declared
from clearjoint.extend import UNIT_X, ZERO, unpack
from tests.support.motions import AT_REST

Z = (0.0, 0.0, 1.0)
ORIGIN = (0.0, 0.0, 0.0)
INERTIA = 0.02
TIMES, LEVELS = [0.0, 0.2, 0.3], [2.0, -1.0, 0.5]


def test_a_piecewise_constant_table_holds_each_value_up_to_the_next_time():
    steps = unpack(cj.PiecewiseConstant(TIMES, LEVELS))
    found = [float(steps(t)) for t in (-1.0, 0.0, 0.199, 0.2, 0.299, 0.3, 9.0)]
    assert found == [2.0, 2.0, 2.0, -1.0, -1.0, 0.5, 0.5]
    np.testing.assert_array_equal(steps.breakpoints(), [0.2, 0.3])


def test_a_piecewise_linear_table_is_that_of_numpy_and_exact_at_its_points():
    lines = unpack(cj.PiecewiseLinear(TIMES, LEVELS))
    times = np.linspace(-0.1, 0.5, 61)
    found = jax.vmap(lines)(times)
    np.testing.assert_allclose(found, np.interp(times, TIMES, LEVELS), rtol=1e-14)
    assert [float(lines(t)) for t in TIMES] == LEVELS
    np.testing.assert_array_equal(lines.breakpoints(), TIMES)


def load_at(load: cj.AppliedLoad, t: float) -> np.ndarray:
    """Force and moment on a body at rest in the origin, (6,) N and N m."""
    element = unpack(fold_constants(load))
    wrench = element.wrenches({"rod": AT_REST}, t)["rod"]
    return np.array([float(part) for part in jax.tree.leaves(wrench)])


def test_a_load_takes_functions_for_one_component_or_for_all():
    rows = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 7.0], [0.0, 0.0, 0.0]])
    ramp, table = cj.PiecewiseLinear(TIMES, LEVELS), cj.PiecewiseConstant(TIMES, rows)
    alone = cj.AppliedLoad("rod", (0.0, ramp, 5.0), torque=(0.0, 0.0, lambda t: 3.0 * t))
    np.testing.assert_allclose(load_at(alone, 0.1), [0, 0.5, 5, 0, 0, 0.3], atol=1e-15)
    np.testing.assert_array_equal(load_at(cj.AppliedLoad("rod", table), 0.25)[:3], rows[1])
    turning = cj.AppliedLoad("rod", lambda t: (jnp.cos(t), jnp.sin(t), 0.0), point=(0, 0, 2.0))
    expected = [np.cos(0.5), np.sin(0.5), 0.0, -2.0 * np.sin(0.5), 2.0 * np.cos(0.5), 0.0]
    np.testing.assert_allclose(load_at(turning, 0.5), expected, rtol=1e-14)
    along = cj.AppliedLoad("rod", lambda t: UNIT_X * t)
    np.testing.assert_array_equal(load_at(along, 0.5), [0.5, 0, 0, 0, 0, 0])
    spline = cj.Spline.through(TIMES, rows)
    mid = [float(cj.Spline.through(TIMES, rows[:, k])(0.13)) for k in range(3)]
    np.testing.assert_allclose(load_at(cj.AppliedLoad("rod", spline), 0.13)[:3], mid, rtol=1e-14)


def test_elements_have_the_breakpoints_of_their_tables():
    steps, lines = cj.PiecewiseConstant(TIMES, LEVELS), cj.PiecewiseLinear([0.5, 0.6], [0, 1])
    load = cj.AppliedLoad("rod", (steps, 0.0, lines), torque=(0.0, 0.0, lambda t: t))
    found = np.concatenate(jax.tree.leaves(load.breakpoints()))
    np.testing.assert_array_equal(found, [0.2, 0.3, 0.5, 0.6])
    np.testing.assert_array_equal(
        *jax.tree.leaves(cj.DriveTorque("a", "b", Z, steps).breakpoints()), [0.2, 0.3]
    )
    assert jax.tree.leaves(cj.DriveTorque("a", "b", Z, 2.0).breakpoints()) == []
    assert jax.tree.leaves(cj.AppliedLoad("rod", (1.0, 0.0, 0.0)).breakpoints()) == []


@pytest.mark.parametrize("table", [[[0.1, 0.3], [0.2, 0.4]], [0.1, 0.3, 0.2, 0.4]])
def test_breakpoints_are_found_in_arrays_of_any_shape(table):
    class Switched(cj.AppliedLoad):
        def breakpoints(self):
            return np.array(table), np.zeros((0, 2))

    bodies, load = {"rod": cj.Body(1.0, (0.1, 0.1, 0.1))}, Switched("rod", (1.0, 0.0, 0.0))
    system = cj.extend.System(cj.Scene(bodies, forces={"load": load}), cj.extend.Formulation())
    assert [float(next_breakpoint(system, t)) for t in (0.0, 0.15, 0.3, 0.4)] == [
        0.1,
        0.2,
        0.4,
        np.inf,
    ]
    assert 0.2 < float(one_sided_time(system, 0.2, 0.2)) < 0.2 + 1e-12
    assert 0.3 - 1e-12 < float(one_sided_time(system, 0.2, 0.3)) < 0.3


class Switch(cj.extend.AbstractForce):
    """A force of 1 N along X after the time `at`, s; `how` decides whether at this time itself."""

    at: float
    how: Callable = eqx.field(static=True)

    def body_names(self):
        return ("rod",)

    def breakpoints(self):
        return self.at

    def wrenches(self, motions, t):
        force = UNIT_X * jnp.where(self.how(t, self.at), 1.0, 0.0)
        return {"rod": motions["rod"].wrench(force, ZERO)}


def switched(at, how=jnp.greater) -> cj.Scene:
    return cj.Scene({"rod": cj.Body(1.0, (0.1, 0.1, 0.1))}, forces={"switch": Switch(at, how)})


@pytest.mark.parametrize(
    ("at", "origin"), [(0.0, None), (0.0, 0.0), (0.0, -1.0), (1e-20, -0.7), (1e-3, -1000.1)]
)
def test_breakpoints_near_time_zero_have_two_sides(at, origin):
    system = cj.extend.System(switched(at), cj.extend.Formulation(), origin)
    start, here = system.own_time(-0.5), system.own_time(at)
    assert next_breakpoint(system, start) == here
    assert next_breakpoint(system, here) == np.inf
    assert system.clock(one_sided_time(system, start, here)) < at
    assert system.clock(one_sided_time(system, here, here)) > at


@pytest.mark.parametrize("at", [[np.inf], [-np.inf], [-np.inf, 0.2, np.inf]])
def test_infinite_breakpoints_never_occur(at):
    system = cj.extend.System(switched(np.array(at)), cj.extend.Formulation())
    finite = 0.2 if 0.2 in at else np.inf
    assert next_breakpoint(system, 0.1) == finite
    assert one_sided_time(system, 0.1, 0.15) == 0.15
    (occurs, since), *_ = since_breakpoints(system, 0.1, 0.15).values()
    assert not occurs and since == 0.0


@pytest.mark.slow
@pytest.mark.parametrize("at", [np.inf, -np.inf])
def test_runs_with_infinite_breakpoints(at):
    scene, state = switched(at), cj.State({"rod": cj.body_state((0.0, 0.0, 0.0))})
    way = 0.0 if at > 0.0 else 0.5
    found = cj.simulate(scene, state, 1.0)
    np.testing.assert_allclose(found.final.bodies["rod"].position[0], way, rtol=1e-9)
    stepped = cj.simulate_nonsmooth(scene, state, 1.0, step=1e-3)
    np.testing.assert_allclose(stepped.final.bodies["rod"].position[0], way, rtol=1e-2)
    outputs = {"x": cj.quantities.Position("rod", "x")}
    mass = {"mass": cj.Parameter(lambda s: s.bodies["rod"].mass)}
    result = cj.sensitivities(scene, state, 1.0, mass, outputs, [1.0])
    np.testing.assert_allclose(result.derivatives["x"], [[-way]], rtol=1e-9)


@pytest.mark.parametrize("how", [jnp.greater, jnp.greater_equal])
def test_a_load_that_is_switched_at_time_zero(how):
    state = cj.State({"rod": cj.body_state((0.0, 0.0, 0.0))})
    found = cj.simulate(switched(0.0, how), state, 1.0, start_time=-1.0)
    np.testing.assert_allclose(found.final.bodies["rod"].position[0], 0.5, rtol=1e-9)
    assert found.attempts < 12


def test_a_function_that_decides_by_time_without_saying_so_has_no_derivatives():
    scene, _ = cj.mechanisms.slider_crank()

    def driven(torque) -> cj.Scene:
        motor = cj.DriveTorque("ground", "crank", Z, torque)
        return cj.Scene(scene.bodies, forces={"motor": motor})

    for smooth in (lambda t: jnp.sin(t), cj.PiecewiseConstant(TIMES, LEVELS), 3.0):
        require_declared(driven(smooth))
    spline = cj.PrescribedAngle("ground", "crank", Z, cj.Spline.through(TIMES, LEVELS))
    require_declared(cj.Scene(scene.bodies, {"motor": spline}))
    silent = [driven(lambda t: jnp.where(t < 0.1, 1.0, 0.0))]
    angle = cj.PrescribedAngle("ground", "crank", Z, lambda t: jnp.maximum(t - 0.1, 0.0))
    silent.append(cj.Scene(scene.bodies, {"motor": angle}))
    load = cj.AppliedLoad("crank", lambda t: (jnp.where(t < 0.1, 1.0, 0.0), 0.0, 0.0))
    silent.append(cj.Scene(scene.bodies, forces={"push": load}))
    for bad in silent:
        with pytest.raises(ValueError, match="PiecewiseConstant"):
            require_declared(bad)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: cj.PiecewiseConstant([0.0, 0.0], [1, 2]), "`times`.*increasing"),
        (lambda: cj.PiecewiseLinear([0.0], [1]), "`times`.*two or more times"),
        (lambda: cj.PiecewiseLinear([0.0, 1.0], [1, 2, 3]), r"`values`.*\(2,\) of `times`"),
        (lambda: cj.PiecewiseConstant([0.0, 1.0], [1, np.inf]), "`values`.*finite"),
        (lambda: cj.Spline([0.0, 1.0], [0.0, 1.0], np.zeros((2, 3))), "`rates`.*`values`"),
        (
            lambda: cj.PrescribedAngle("a", "b", Z, cj.PiecewiseConstant([0, 1], [1, 2])),
            "`function` must be continuous.*PiecewiseLinear",
        ),
        (
            lambda: cj.PrescribedTranslation(
                "a", "b", ORIGIN, ORIGIN, Z, cj.PiecewiseConstant([0, 1], [1, 2])
            ),
            "`function` must be continuous",
        ),
        (lambda: cj.DriveTorque("a", "b", Z, (1.0, 2.0)), r"`torque`.*shape \(\).*PiecewiseC"),
        (lambda: cj.AppliedLoad("a", (1.0, lambda t: t)), "`force` must be three components"),
        (lambda: cj.AppliedLoad("a", 5.0), r"`force`.*shape \(3,\).*function of time"),
        (lambda: load_at(cj.AppliedLoad("rod", lambda t: t), 0.0), "`function`.*three numbers"),
        (
            lambda: load_at(cj.AppliedLoad("rod", lambda t: None), 0.0),
            "`function`.*three numbers, but is None",
        ),
        (
            lambda: load_at(cj.AppliedLoad("rod", (0.0, lambda t: None, 0.0)), 0.0),
            "`function`.*one number, but is None",
        ),
        (
            lambda: load_at(cj.AppliedLoad("rod", (0.0, lambda t: (t, t), 0.0)), 0.0),
            "`function`.*one number",
        ),
        (
            lambda: unpack(
                cj.PrescribedAngle(
                    "ground", "a", Z, cj.Spline([0.0, 1.0], np.zeros((2, 3)), np.zeros((2, 3)))
                )
            ).rows({"ground": AT_REST, "a": AT_REST}, 0.0),
            "`function`.*one number",
        ),
        (
            lambda: unpack(
                cj.PrescribedTranslation("ground", "a", ORIGIN, ORIGIN, Z, lambda t: (t, t, t))
            ).rows({"ground": AT_REST, "a": AT_REST}, 0.0),
            "`function`.*one number",
        ),
    ],
)
def test_invalid_functions_of_time_are_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def shaft(torque) -> tuple[cj.Scene, cj.State]:
    """A shaft in a bearing about Z, driven by a torque."""
    bearing = cj.RevoluteJoint("ground", "shaft", ORIGIN, ORIGIN, Z, Z)
    motor = cj.DriveTorque("ground", "shaft", Z, torque)
    body = cj.Body(1.0, (0.03, 0.03, INERTIA))
    scene = cj.Scene({"shaft": body}, {"bearing": bearing}, {"motor": motor})
    return scene, cj.State({"shaft": cj.body_state(ORIGIN)})


@pytest.mark.slow
def test_a_switched_torque_is_that_of_its_impulses_to_rounding():
    """Steps end at the switches, so that what is integrated is constant in each."""
    scene, state = shaft(cj.PiecewiseConstant(TIMES, LEVELS))
    times = np.linspace(0.0, 0.5, 51)
    solution = cj.simulate(scene, state, 0.5, cj.Settings(ledger=True), save=cj.Saving(times))
    edges = np.array([0.0, 0.2, 0.3, 0.5])
    impulse = np.interp(times, edges, np.cumsum([0.0, *np.diff(edges) * LEVELS]))
    spin = solution.states.bodies["shaft"].spin[:, 2]
    np.testing.assert_allclose(spin, impulse / INERTIA, atol=1e-12)
    supplied = cj.observe(scene, solution).energies["supplied"]
    np.testing.assert_allclose(supplied, 0.5 * INERTIA * spin**2, atol=1e-9)


@pytest.mark.slow
def test_a_switch_is_a_parameter():
    """Of the times and of the levels: the speed changes by the torque's jump over the inertia."""
    scene, state = shaft(cj.PiecewiseConstant(TIMES, LEVELS))
    found = cj.sensitivities(
        scene,
        state,
        0.5,
        {
            "time": cj.Parameter(lambda s: s.forces["motor"].torque.times[1]),
            "level": cj.Parameter(lambda s: s.forces["motor"].torque.values[1]),
        },
        {"speed": cj.quantities.AngularVelocity("shaft", "z")},
        [0.5],
    )
    np.testing.assert_allclose(found.derivatives["speed"][0], [150.0, 5.0], rtol=1e-9)


@pytest.mark.slow
def test_a_rotating_load_drives_a_free_body_round():
    """The unbalance of a rotor on a free body: x = F (1 - cos w t) / (m w^2)."""
    force, w, mass = 40.0, 60.0, 2.0
    load = cj.AppliedLoad("b", lambda t: (force * jnp.cos(w * t), force * jnp.sin(w * t), 0.0))
    scene = cj.Scene({"b": cj.Body(mass, (0.1, 0.1, 0.1))}, forces={"unbalance": load})
    times = np.linspace(0.0, 0.3, 31)
    state = cj.State({"b": cj.body_state(ORIGIN)})
    solution = cj.simulate(scene, state, 0.3, cj.Settings(rtol=1e-10), save=cj.Saving(times))
    place, size = solution.states.bodies["b"].position, force / (mass * w**2)
    np.testing.assert_allclose(place[:, 0], size * (1 - np.cos(w * times)), atol=1e-10)
    np.testing.assert_allclose(place[:, 1], size * (w * times - np.sin(w * times)), atol=1e-10)

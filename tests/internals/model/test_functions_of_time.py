"""Breakpoints of functions of time, and functions that hide one."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import clearjoint as cj
from clearjoint._dynamics.breakpoints import next_breakpoint, one_sided_time, since_breakpoints
from clearjoint._math.vectors import fold_constants
from clearjoint._simulation.step.discontinuities import require_declared
from clearjoint.extend import UNIT_X, unpack
from tests.model.test_functions_of_time import LEVELS, TIMES
from tests.support.motions import AT_REST
from tests.support.one_body import one_body
from tests.support.push import Push
from tests.support.shaft import ORIGIN, Z


def load_at(load: cj.AppliedLoad, t: float) -> np.ndarray:
    """Force and moment on a body at rest in the origin, (6,) N and N m."""
    element = unpack(fold_constants(load))
    wrench = element.wrenches({"rod": AT_REST}, t)["rod"]
    return np.array([float(part) for part in jax.tree.leaves(wrench)])


def test_a_load_takes_functions_for_one_component_or_for_all():
    rows = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 7.0], [0.0, 0.0, 0.0]])
    ramp, table = cj.PiecewiseLinear(TIMES, LEVELS), cj.PiecewiseConstant(TIMES, rows)
    alone = cj.AppliedLoad("rod", (0.0, ramp, 5.0), torque=(0.0, 0.0, lambda t: 3.0 * t))
    np.testing.assert_allclose(load_at(alone, 0.1), [0, 0.5, 5, 0, 0, 0.3], rtol=0.0, atol=1e-15)
    np.testing.assert_array_equal(load_at(cj.AppliedLoad("rod", table), 0.25)[:3], rows[1])
    turning = cj.AppliedLoad("rod", lambda t: (jnp.cos(t), jnp.sin(t), 0.0), point=(0, 0, 2.0))
    expected = [np.cos(0.5), np.sin(0.5), 0.0, -2.0 * np.sin(0.5), 2.0 * np.cos(0.5), 0.0]
    np.testing.assert_allclose(load_at(turning, 0.5), expected, rtol=1e-14)
    along = cj.AppliedLoad("rod", lambda t: UNIT_X * t)
    np.testing.assert_array_equal(load_at(along, 0.5), [0.5, 0, 0, 0, 0, 0])
    spline = cj.Spline.through(TIMES, rows)
    mid = [float(cj.Spline.through(TIMES, rows[:, k])(0.13)) for k in range(3)]
    np.testing.assert_allclose(load_at(cj.AppliedLoad("rod", spline), 0.13)[:3], mid, rtol=1e-14)


@pytest.mark.parametrize("table", [[[0.1, 0.3], [0.2, 0.4]], [0.1, 0.3, 0.2, 0.4]])
def test_breakpoints_are_found_in_arrays_of_any_shape(table):
    class Switched(cj.AppliedLoad):
        def breakpoints(self):
            return np.array(table), np.zeros((0, 2))

    bodies, load = {"rod": cj.Body(1.0, (0.1, 0.1, 0.1))}, Switched("rod", (1.0, 0.0, 0.0))
    system = cj.extend.System(cj.Scene(bodies, forces={"load": load}), cj.extend.Formulation())
    following = [float(next_breakpoint(system, t)) for t in (0.0, 0.15, 0.3, 0.4)]
    assert following == [0.1, 0.2, 0.4, np.inf]
    assert 0.2 < float(one_sided_time(system, 0.2, 0.2)) < 0.2 + 1e-12
    assert 0.3 - 1e-12 < float(one_sided_time(system, 0.2, 0.3)) < 0.3


def switched(at) -> cj.Scene:
    return one_body("rod", forces={"switch": Push("rod", 1.0, at)})[0]


@pytest.mark.parametrize(
    ("at", "origin"), [(0.0, None), (0.0, 0.0), (0.0, -1.0), (1e-20, -0.7), (1e-3, -1000.1)]
)
def test_breakpoints_near_time_zero_have_two_sides(at, origin):
    system = cj.extend.System(switched(at), cj.extend.Formulation(), origin)
    start, here = system.own_time(-0.5), system.own_time(at)
    assert next_breakpoint(system, start) == here
    assert next_breakpoint(system, here) == np.inf
    assert system.scene_time(one_sided_time(system, start, here)) < at
    assert system.scene_time(one_sided_time(system, here, here)) > at


@pytest.mark.parametrize("at", [[np.inf], [-np.inf], [-np.inf, 0.2, np.inf]])
def test_infinite_breakpoints_never_occur(at):
    system = cj.extend.System(switched(np.array(at)), cj.extend.Formulation())
    finite = 0.2 if 0.2 in at else np.inf
    assert next_breakpoint(system, 0.1) == finite
    assert one_sided_time(system, 0.1, 0.15) == 0.15
    (occurs, since), *_ = since_breakpoints(system, 0.1, 0.15).values()
    assert not occurs and since == 0.0


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


STEPS, ROWS = cj.PiecewiseConstant([0, 1], [1, 2]), np.zeros((2, 3))
RAIL = "ground", "a", ORIGIN, ORIGIN, Z


SPATIAL = cj.PrescribedAngle("ground", "a", Z, cj.Spline([0.0, 1.0], ROWS, ROWS))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: cj.PiecewiseConstant([0.0, 0.0], [1, 2]), "`times`.*increasing"),
        (lambda: cj.PiecewiseLinear([0.0], [1]), "`times`.*two or more times"),
        (lambda: cj.PiecewiseLinear([0.0, 1.0], [1, 2, 3]), r"`values`.*\(2,\) of `times`"),
        (lambda: cj.PiecewiseConstant([0.0, 1.0], [1, np.inf]), "`values`.*finite"),
        (lambda: cj.Spline([0.0, 1.0], [0.0, 1.0], ROWS), "`rates`.*`values`"),
        (lambda: cj.PrescribedAngle("a", "b", Z, STEPS), "`function` must be continuous.*Piecew"),
        (lambda: cj.PrescribedTranslation(*RAIL, STEPS), "`function` must be continuous"),
        (lambda: cj.DriveTorque("a", "b", Z, (1.0, 2.0)), r"`torque`.*shape \(\).*PiecewiseC"),
        (lambda: cj.AppliedLoad("a", (1.0, lambda t: t)), "`force` must be three components"),
        (lambda: cj.AppliedLoad("a", 5.0), r"`force`.*shape \(3,\).*function of time"),
        *(
            (lambda force=force: load_at(cj.AppliedLoad("rod", force), 0.0), f"`function`.*{said}")
            for force, said in (
                (lambda t: t, "three numbers"),
                (lambda t: None, "three numbers, but is None"),
                ((0.0, lambda t: None, 0.0), "one number, but is None"),
                ((0.0, lambda t: (t, t), 0.0), "one number"),
            )
        ),
        (lambda: unpack(SPATIAL).rows({"ground": AT_REST, "a": AT_REST}, 0.0), "`function`.*one n"),
    ],
)
def test_invalid_functions_of_time_are_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()

"""One dictionary of outputs for every call: a ball on a spring, x = 0.1 cos(10 t)."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import clearjoint as cj
from tests.support.dropped_rod import dropped_rod
from tests.support.oscillator import on_spring

TIMES = np.linspace(0.0, 0.5, 11)
X = cj.quantities.Position("ball", "x")


def elapsed(now):
    """A function without a unit."""
    return now.time


def clock(now):
    """A function with a unit."""
    return now.time


clock.unit = "s"
OUTPUTS = {
    "x": X,
    "time": elapsed,
    "clock": clock,
    "speed": cj.Peak(cj.quantities.Velocity("ball"), "m/s"),
    "early": cj.Statistics(cj.quantities.Velocity("ball", "x"), "m/s", until=0.3),
    "turns": cj.Section(X, {"v": cj.quantities.Velocity("ball", "x")}, count=3),
}
EXACT = cj.Settings(rtol=1e-9)
STIFFNESS = cj.Parameter(lambda scene: scene.forces["spring"].stiffness, cj.Log())


def test_a_run_and_a_lane_keep_the_outputs_of_one_dictionary():
    save = cj.Saving(TIMES, states=False)
    run = cj.simulate(*on_spring(), 0.5, EXACT, save, outputs=OUTPUTS, progress=False)
    axes = {"k": cj.Axis(STIFFNESS.variation, [100.0])}
    lane = cj.sweep(*on_spring(), 0.5, axes, OUTPUTS, EXACT, save, progress=False).isel(k=0)
    assert run.saved is None and "saved_position" not in lane
    np.testing.assert_allclose(run.outputs["x"], 0.1 * np.cos(10.0 * TIMES), rtol=0.0, atol=1e-9)
    for name in ("time", "clock"):
        np.testing.assert_array_equal(run.outputs[name], TIMES)
        np.testing.assert_array_equal(lane[name], TIMES)
    np.testing.assert_allclose(lane["x"], run.outputs["x"], rtol=1e-12, atol=1e-12)
    assert lane["x"].attrs["units"] == "m" and lane["clock"].attrs["units"] == "s"
    assert "units" not in lane["time"].attrs
    assert run.outputs["speed"] == pytest.approx(1.0, rel=1e-6)
    assert run.outputs["speed_time"] == pytest.approx(0.05 * np.pi, rel=1e-4)
    assert run.outputs["early_mean"] == pytest.approx(0.1 * (np.cos(3.0) - 1.0) / 0.3, rel=1e-6)
    assert float(lane["speed"]) == run.outputs["speed"]
    crossings = run.outputs["turns"]
    np.testing.assert_allclose(crossings.times, 0.15 * np.pi, rtol=1e-7)
    assert crossings.units == {"v": "m/s"} and lane["turns_v"].attrs["units"] == "m/s"


def test_a_run_with_derivatives_keeps_them_too_but_refuses_reductions():
    message = r"outputs\['speed'\].*a quantity, a Section or an ImpactTable.*sweep\(\) for it"
    with pytest.raises(ValueError, match=message):
        cj.sensitivities(*on_spring(), 0.5, {"k": STIFFNESS}, OUTPUTS, TIMES)
    with pytest.raises(ValueError, match=r"outputs\['turns'\].*a quantity in a fit"):
        parameters, wanted = {"k": STIFFNESS}, {"turns": OUTPUTS["turns"]}
        cj.minimise(*on_spring(), lambda outputs: outputs["x"][0], parameters, wanted, TIMES)
    wanted = {name: OUTPUTS[name] for name in ("x", "turns")}
    seldom = np.array([0.05, 0.31])
    found = cj.sensitivities(
        *on_spring(), 0.5, {"k": STIFFNESS}, wanted, TIMES, EXACT, cj.Saving(seldom), progress=False
    )
    assert found.saved is not None
    saved = found.saved.states.bodies["ball"].position
    np.testing.assert_allclose(saved[:, 0], 0.1 * np.cos(10.0 * seldom), rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(found.outputs["x"], 0.1 * np.cos(10.0 * TIMES), rtol=0.0, atol=1e-9)
    exact = -0.5 * TIMES * np.sin(10.0 * TIMES)  # d x/d log k
    np.testing.assert_allclose(found.derivatives["x"][:, 0], exact, rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(found.outputs["turns"].times, 0.15 * np.pi, rtol=1e-7)
    assert set(found.derivatives) == {"x"} and "turns" not in found.to_xarray()


@pytest.mark.slow
@pytest.mark.parametrize("transformed", [jax.jacfwd, jax.jit], ids=["jacfwd", "jit"])
def test_quantities_are_evaluated_under_transformations(transformed):
    scene, state = on_spring()

    def reached(stiffness):
        changed = cj.set_value(scene, STIFFNESS.variation.path, stiffness)
        save = cj.Saving(TIMES, states=False)
        run = cj.simulate(changed, state, 0.5, EXACT, save, outputs={"x": X})
        assert run.saved is None
        return run.outputs["x"]

    value, slope = 0.1 * np.cos(10.0 * TIMES), -0.005 * TIMES * np.sin(10.0 * TIMES)
    expected = value if transformed is jax.jit else slope
    np.testing.assert_allclose(transformed(reached)(100.0), expected, rtol=0.0, atol=1e-7)


@pytest.mark.slow
def test_a_table_has_the_first_impacts_of_the_run():
    scene, state = dropped_rod()
    outputs = {"first": cj.ImpactTable(1), "late": cj.ImpactTable(9, after=0.02)}
    save = cj.Saving(impacts=True)
    run = cj.simulate(scene, state, 0.05, save=save, outputs=outputs, progress=False)
    every = run.impacts
    first = [every.of("pin", label).onset[:1] for label in "VW"]
    np.testing.assert_array_equal(np.sort(run.outputs["first"].onset), np.sort(np.ravel(first)))
    late = every.within(after=0.02)
    assert len(every) > len(late) > 1
    np.testing.assert_array_equal(run.outputs["late"].peak_force, late.peak_force)
    parameters = {"clearance": cj.Parameter(lambda scene: scene.joints["pin"].clearance)}
    wanted = {"y": cj.quantities.Position("rod", "y"), **outputs}
    found = cj.sensitivities(scene, state, 0.05, parameters, wanted, [0.05], progress=False)
    np.testing.assert_allclose(found.outputs["late"].onset, late.onset, rtol=1e-4)
    assert len(found.outputs["first"]) == len(run.outputs["first"])


@pytest.mark.parametrize(
    ("output", "message"),
    [
        (cj.ImpactCount("pin"), r"Output 'x'.*pin"),
        (cj.MeanPowerLost(), r"outputs\['x'\]"),
        (X, r"`times`.*outputs\['x'\].*save=cj.Saving\(times\)"),
    ],
    ids=["of no joint", "without the ledger", "without times"],
)
def test_outputs_that_a_run_cannot_have_are_refused(output, message):
    with pytest.raises(ValueError, match=message):
        cj.simulate(*on_spring(), 0.5, outputs={"x": output})


@pytest.mark.slow
def test_reductions_are_refused_under_a_transformation():
    scene, state = on_spring()
    speed = {"speed": OUTPUTS["speed"]}
    with pytest.raises(ValueError, match=r"outputs\['speed'\].*a quantity under a transformation"):
        jax.jit(lambda t: cj.simulate(scene, state, t, outputs=speed).time)(0.5)


def test_sample_times_may_follow_the_scene():
    save = cj.Saving(lambda scene: [0.0, 1.0 / float(scene.forces["spring"].stiffness)])
    run = cj.simulate(*on_spring(), 0.5, EXACT, save, outputs={"x": X}, progress=False)
    np.testing.assert_array_equal(run.times, [0.0, 0.01])
    np.testing.assert_allclose(run.outputs["x"], 0.1 * np.cos([0.0, 0.1]), rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("rises", [True, False])
def test_a_section_finds_a_height_that_a_step_of_a_throw_crosses_twice(rises):
    height, speed, g = 0.4, 3.0, 9.81
    scene = cj.Scene({"ball": cj.Body(1.0, (0.01, 0.01, 0.01))}, {}, gravity=(0, 0, -g))
    state = cj.State({"ball": cj.body_state((0, 0, 0), velocity=(0, 0, speed))})
    place, sign = cj.quantities.Position("ball", "z"), 1.0 if rises else -1.0
    section = cj.Section(lambda now: sign * (place(now) - height), {"z": (place, "m")}, 3)
    solution = cj.simulate(scene, state, 0.6, outputs={"height": section}, progress=False)
    (time,) = solution.outputs["height"].times
    expected = (speed - sign * np.sqrt(speed**2 - 2.0 * g * height)) / g
    assert time == pytest.approx(expected, rel=1e-9)


def as_outputs(function):
    reductions = cj.Peak(function, "m"), cj.Quantiles(function, "m", [0.0, 1.0, 2.0])
    sections = cj.Section(function, {"x": X}), cj.Section(X, {"function": (function, "m")})
    return (function, *reductions, cj.Integral(function, "m s"), *sections)


@pytest.mark.parametrize(
    "function",
    [lambda now: now.motions["ball"].position, lambda now: jnp.ones(3), lambda now: 1j * now.time],
    ids=["Vector", "array", "complex"],
)
def test_functions_that_return_no_real_number_are_named(function):
    save, axes = cj.Saving([0.0, 0.1]), {"k": cj.Axis(STIFFNESS.variation, [100.0])}
    for output in as_outputs(function):
        with pytest.raises(ValueError, match="returns one real number, but is .*lambda.*returns"):
            cj.simulate(*on_spring(), 0.1, save=save, outputs={"a": output}, progress=False)
    for output in (function, cj.Peak(function, "m")):
        with pytest.raises(ValueError, match="returns one real number"):
            cj.sweep(*on_spring(), 0.1, axes, {"a": output}, save=save, progress=False)
    parameters = {"k": STIFFNESS}
    with pytest.raises(ValueError, match="returns one real number"):
        cj.sensitivities(*on_spring(), 0.1, parameters, {"a": function}, [0.0, 0.1])
    total = {"a": cj.Integral(function, "m s")}
    with pytest.raises(ValueError, match="returns one real number"):
        cj.predictor(*on_spring(), 0.1, parameters, total)({"k": 100.0})

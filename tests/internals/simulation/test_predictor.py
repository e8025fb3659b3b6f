"""Reverse mode across impacts: gradients of `predictor` against forward mode and closed forms."""

import contextlib
from dataclasses import replace
from types import SimpleNamespace
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import clearjoint as cj
from clearjoint._identification import minimise
from clearjoint._native import NativeFallbackWarning, UnsupportedPrimitiveError
from clearjoint._parametrisation.parts import parts_of
from clearjoint._result_codes import RESULTS
from clearjoint._simulation.run import adjoint, recorded_runs
from tests.internals.simulation.test_sensitivity import PARAMETERS
from tests.internals.simulation.test_sensitivity import POSITION as REFERENCE
from tests.internals.simulation.test_sensitivity import TIMES as REFERENCE_TIMES
from tests.support.catalogue_scenes import catalogue_scenes
from tests.support.difference_quotients import central
from tests.support.oscillator import on_spring

SCENES = catalogue_scenes()
SETTINGS = replace(cj.presets.derivatives, rtol=1e-9)


def parameters(scene: cj.Scene, body: str) -> dict[str, cj.Parameter]:
    """Numbers of the scene and of the state that the motion of a body depends on."""
    place = (2, 2) if np.ndim(scene.bodies[body].inertia) == 2 else 2
    found = {
        "mass": cj.Parameter(lambda s: s.bodies[body].mass, cj.Log()),
        "inertia": cj.Parameter(lambda s: s.bodies[body].inertia[place], cj.Log()),
        "speed": cj.Parameter.initial(lambda s: s.bodies[body].velocity[0]),
    }
    if scene.gravity is not None:
        found["gravity"] = cj.Parameter(lambda s: s.gravity[1])
    for name, joint in scene.contact_joints().items():
        if getattr(joint, "clearance", None) is not None:
            found[f"clearance of {name}"] = cj.Parameter(
                lambda s, name=name: s.joints[name].clearance, cj.Log()
            )
    return found


def slopes_of(predict, chosen: dict[str, cj.Parameter]) -> dict[str, float]:
    """Derivatives of the values of parameters by their coordinates."""
    return {
        name: float(p.scale.slope(p.scale.coordinate(predict.values[name])))
        for name, p in chosen.items()
    }


def difference_from_forward_mode(
    made: cj.Scene,
    state: cj.State,
    end: float,
    body: str,
    chosen: dict[str, cj.Parameter],
    settings: cj.Settings = SETTINGS,
) -> float:
    """Return the largest error of gradients of a body's motion, relative to the largest derivative
    of the same output at any of the times up to the end; errors below those of forward mode at the
    same tolerance don't count."""
    outputs = {
        "x": cj.quantities.Position(body, "x"),
        "v": cj.quantities.Velocity(body, "y"),
        "w": cj.quantities.AngularVelocity(body, "z"),
    }
    times = np.linspace(0.0, end, 9)
    # At the same tolerance, forward mode is off by 1e-6 to 7e-6 in some scenes.
    finer = replace(settings, rtol=0.1 * settings.rtol)
    same, forward = (
        cj.sensitivities(made, state, end, chosen, outputs, times, each, progress=False)
        for each in (settings, finer)
    )
    predict = cj.predictor(made, state, end, chosen, outputs, times, settings)
    slopes = slopes_of(predict, chosen)
    values, pull = jax.vjp(predict, predict.values)
    worst = 0.0
    for output, expected in forward.derivatives.items():
        np.testing.assert_allclose(values[output], forward.outputs[output], rtol=1e-6, atol=1e-9)
        for k in (3, 8):
            seeds = {name: np.zeros(len(times)) for name in outputs}
            seeds[output][k] = 1.0
            (gradient,) = pull(seeds)
            reverse = np.array([gradient[name] * slopes[name] for name in chosen])
            # Derivatives far below the output itself are rounding errors, of which forward mode has
            # others.
            size = max(np.abs(expected).max(), 0.1 * np.abs(values[output]).max(), 1e-9)
            error = np.abs(reverse - expected[k]).max() / size
            if error > np.abs(same.derivatives[output] - expected).max() / size:
                worst = max(worst, error)
    return worst


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_gradients_are_those_of_forward_mode(name):
    """Half a minute each; among them are bristles, closed loops and breakpoints."""
    made, state = SCENES[name].make()
    body = SCENES[name].body or list(made.bodies)[-1]
    chosen = parameters(made, body)
    assert difference_from_forward_mode(made, state, SCENES[name].end, body, chosen) < 1e-6


def test_gradients_are_those_of_the_event_exact_solver():
    """The table of derivatives in quadruple precision (see `test_sensitivity`)."""
    outputs = {"y": cj.quantities.Position("arm 2", "y")}
    scene, state = cj.mechanisms.double_pendulum()
    predict = cj.predictor(scene, state, 0.1, PARAMETERS, outputs, REFERENCE_TIMES, SETTINGS)
    by = jax.jacrev(predict)(predict.values)["y"]
    values = predict.values
    found = [by["clearance"] * values["clearance"], by["stiffness"] * values["stiffness"]]
    found = np.stack([*found, by["restitution"]], axis=1)
    np.testing.assert_allclose(found, REFERENCE, rtol=3e-6)


@pytest.mark.slow
@pytest.mark.parametrize("end", [0.0102, 0.02])
def test_gradients_of_a_run_that_continues(end):
    """From within the first impact, with entry speeds, and from the flight after it."""
    scene, state = cj.mechanisms.double_pendulum()
    first = cj.simulate(scene, state, end, SETTINGS, progress=False)
    assert any(v > 0 for v in first.final.entry_speeds["shoulder"].values()) == (end < 0.011)
    chosen = parameters(scene, "arm 2")
    outputs = {axis: cj.quantities.Position("arm 2", axis) for axis in "xy"}
    start = {"start_time": float(first.time)}
    arguments = scene, first.final, 0.06, chosen, outputs, [0.03, 0.06], SETTINGS
    forward = cj.sensitivities(*arguments, **start, progress=False)
    predict = cj.predictor(*arguments, **start)
    jacobian, slopes = jax.jacrev(predict)(predict.values), slopes_of(predict, chosen)
    for output, expected in forward.derivatives.items():
        found = np.stack([jacobian[output][name] * slopes[name] for name in chosen], axis=1)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6 * np.abs(expected).max())


TIMES = np.array([0.0, 0.1, 0.1, 0.25, 0.3])
POSITION = {"x": cj.quantities.Position("ball", "x"), "v": cj.quantities.Velocity("ball", "x")}


def stiffness(scene):
    return scene.forces["spring"].stiffness


STIFFNESS = {"k": stiffness}
PATHS = {
    "stiffness": stiffness,
    "start": cj.Parameter.initial(lambda state: state.bodies["ball"].position[0]),
}


@pytest.fixture(scope="module")
def predict():
    """In segments of 16 steps, of which only the first are kept."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(adjoint, "ROWS", 16)
        patch.setattr(recorded_runs, "KEPT_BYTES", 8000)
        yield cj.predictor(*on_spring(), 0.3, PATHS, POSITION, TIMES, SETTINGS)


def test_closed_form_of_an_oscillator(predict):
    values = predict.values
    assert float(values["stiffness"]) == 100.0 and float(values["start"]) == 0.1
    jacobian = jax.jit(jax.jacrev(predict))(values)
    c, s = np.cos(10.0 * TIMES), np.sin(10.0 * TIMES)
    # The frequency is w = sqrt(k/m), so that dw/dk = 0.05 at k = 100 N/m.
    expected = {
        ("x", "stiffness"): -0.1 * 0.05 * TIMES * s,
        ("x", "start"): c,
        ("v", "stiffness"): -0.1 * 0.05 * (s + 10.0 * TIMES * c),
        ("v", "start"): -10.0 * s,
    }
    for (output, name), derivative in expected.items():
        np.testing.assert_allclose(jacobian[output][name], derivative, rtol=1e-7, atol=1e-8)
    numbers = {name: float(value) for name, value in values.items()}
    gradient = jax.grad(lambda numbers: predict(numbers)["x"].sum())(numbers)
    assert float(gradient["start"]) == pytest.approx(c.sum(), rel=1e-7)


def test_more_times_than_are_computed_at_once(predict):
    """The fixture computes 16 at once. The force depends on the stiffness also directly."""

    def force(now):
        return now.scene.forces["spring"].stiffness * POSITION["x"](now)

    times = np.linspace(0.0, 0.3, 37)
    made = cj.predictor(*on_spring(), 0.3, PATHS, {"force": force}, times, SETTINGS)
    weights = np.random.default_rng(2).standard_normal(37)
    total, gradient = jax.value_and_grad(lambda v: jnp.dot(weights, made(v)["force"]))(made.values)
    c, s = np.cos(10.0 * times), np.sin(10.0 * times)
    np.testing.assert_allclose(made(made.values)["force"], 10.0 * c, rtol=0, atol=1e-6)
    assert float(total) == pytest.approx(10.0 * weights @ c, abs=1e-6)
    assert float(gradient["start"]) == pytest.approx(100.0 * weights @ c, abs=1e-5)
    expected = weights @ (0.1 * c - 0.5 * times * s)
    assert float(gradient["stiffness"]) == pytest.approx(expected, abs=1e-6)


REDUCTIONS = {
    "top": cj.Peak(lambda now: -POSITION["x"](now), "m", after=0.2),
    "late": cj.Statistics(POSITION["x"], "m", after=0.1, until=0.25),
    "cost": cj.Integral(lambda now: POSITION["x"](now) ** 2, "m^2 s"),
}


def reduced(stiffness: float, start: float) -> dict[str, float]:
    """The results of `REDUCTIONS` of x = start cos(w t), w = sqrt(stiffness / 1 kg)."""
    w = np.sqrt(stiffness)
    mean = start * (np.sin(0.25 * w) - np.sin(0.1 * w)) / (0.15 * w)
    square = lambda t: start**2 * (0.5 * t + np.sin(2.0 * w * t) / (4.0 * w))  # noqa: E731
    rms = np.sqrt((square(0.25) - square(0.1)) / 0.15)
    top = start if w * 0.3 > np.pi else -start * np.cos(0.3 * w)
    return {"top": top, "late_mean": mean, "late_rms": rms, "cost": square(0.3)}


def test_closed_forms_of_reductions():
    predict = cj.predictor(*on_spring(), 0.3, PATHS, REDUCTIONS, settings=SETTINGS)
    values, jacobian = predict(predict.values), jax.jacrev(predict)(predict.values)
    plain = cj.simulate(*on_spring(), 0.3, SETTINGS, outputs=REDUCTIONS, progress=False)
    at, steps = np.array([100.0, 0.1]), {"stiffness": 1e-3, "start": 1e-6}
    assert list(values) == sorted(reduced(*at))
    for name, expected in reduced(*at).items():
        assert float(values[name]) == pytest.approx(expected, rel=1e-8)
        assert float(values[name]) == pytest.approx(plain.outputs[name], rel=1e-6)
    for k, (parameter, step) in enumerate(steps.items()):

        def moved(by, k=k):
            return np.array([*reduced(*(at + by * np.eye(2)[k])).values()])

        for name, slope in zip(reduced(*at), central(moved, step), strict=True):
            assert float(jacobian[name][parameter]) == pytest.approx(slope, rel=2e-6, abs=1e-9)


@pytest.mark.slow
def test_reductions_across_impacts_agree_with_differences():
    """Of runs at a far smaller tolerance."""
    settings = replace(SETTINGS, ledger=True)
    scene, state = cj.mechanisms.double_pendulum(0.5e-3, 0.9)
    force = cj.quantities.ContactForce("shoulder", "V")
    outputs = {
        "peak": cj.Peak(force, "N"),
        "lost": cj.DissipatedEnergy(after=0.005),
        "power": cj.MeanPowerLost(),
        "impulse": cj.Integral(force, "N s", after=0.01),
    }
    paths = {
        "clearance": lambda scene: scene.joints["shoulder"].clearance,
        "restitution": lambda scene: scene.joints["shoulder"].law.restitution,
        "mass": lambda scene: scene.bodies["arm 2"].mass,
    }
    predict, tight = (
        cj.predictor(scene, state, 0.06, paths, outputs, settings=each)
        for each in (settings, replace(settings, rtol=1e-12))
    )
    jacobian = jax.jacrev(predict)(predict.values)
    for name, value in predict.values.items():
        step = 1e-6 * float(value)
        above, below = (tight({**predict.values, name: value + s}) for s in (step, -step))
        for output, derivatives in jacobian.items():
            difference = float(above[output] - below[output]) / (2.0 * step)
            assert float(derivatives[name]) == pytest.approx(difference, rel=5e-5), (output, name)


def loss(predict, values):
    return jnp.sum(jnp.square(predict(values)["x"] - 0.1 * jnp.cos(11.0 * TIMES)))


def floats(tree, index=()):
    return jax.tree.map(lambda leaf: float(leaf[index]), tree)


@pytest.mark.parametrize("kept", [1e9, 20_000])
def test_a_batch_has_the_bits_of_its_elements(predict, monkeypatch, kept):
    """More runs than lanes, of different lengths, each of several segments; with the smaller bound,
    the longer runs do not fit in memory and are made one by one."""
    monkeypatch.setattr(recorded_runs, "LANE_ROWS", 12)
    monkeypatch.setattr(recorded_runs, "KEPT_BYTES", kept)
    springs, starts = jnp.linspace(50.0, 400.0, 6), jnp.array([0.1, 0.2])
    gradient = jax.value_and_grad(lambda values: loss(predict, values))
    both = lambda k, x: gradient({"stiffness": k, "start": x})  # noqa: E731
    together = jax.jit(jax.vmap(jax.vmap(both, (0, None)), (None, 0)))(springs, starts)
    for index in np.ndindex(2, 6):
        assert floats(together, index) == floats(both(springs[index[1]], starts[index[0]]))


@pytest.mark.parametrize(
    ("kept", "has_lanes", "expected"),
    [
        ([True, True], True, "in lanes"),
        ([True], True, "alone"),
        ([True, False], True, "alone"),
        ([True, True], False, "alone"),
        ([True, True], None, "alone"),  # refused by the native compiler
    ],
)
def test_gradients_are_computed_side_by_side_if_all_steps_of_several_runs_are_kept(
    kept, has_lanes, expected, monkeypatch
):
    def in_lanes(recorder, runs, seeds_of):
        if has_lanes is None:
            raise UnsupportedPrimitiveError("a function of the test")
        return ["in lanes"] * len(runs)

    monkeypatch.setattr(recorded_runs, "_gradients_in_lanes", in_lanes)
    recorder = object.__new__(recorded_runs.Recorder)
    recorder.has_lanes = has_lanes is not False
    runs = [
        SimpleNamespace(
            is_kept=lambda all_kept=all_kept: all_kept,
            pulled_outputs=lambda seeds: seeds,
            gradient=lambda seeds: seeds["x"],
        )
        for all_kept in kept
    ]
    with contextlib.nullcontext() if has_lanes is not None else pytest.warns(NativeFallbackWarning):
        found = recorder.gradients(runs, [{"x": np.asarray("alone")} for _ in runs])
    assert [str(gradient) for gradient in found] == [expected] * len(runs)
    assert recorder.has_lanes is bool(has_lanes)


def test_a_run_that_fails_in_a_batch_is_nan():
    few = replace(SETTINGS, max_steps=40)
    made = cj.predictor(*on_spring(), 0.3, STIFFNESS, POSITION, TIMES, few)
    numbers = jnp.array([1.0, 1e6, -1e400, 4.0])
    outputs = jax.vmap(made.or_nan)({"k": numbers})
    assert np.isnan(outputs["x"][1:3]).all()
    for k in (0, 3):
        assert np.array_equal(outputs["x"][k], made({"k": numbers[k]})["x"])
    with pytest.raises(Exception, match="step limit was reached"):
        jax.vmap(made)({"k": numbers[:2]})


@pytest.mark.slow
def test_segments_across_impacts_give_the_same_bits(monkeypatch):
    scene, state = cj.mechanisms.double_pendulum(0.5e-3, 0.9)
    outputs = {"x": cj.quantities.Position("arm 3", "x")}
    path = {"number": lambda scene: scene.joints["shoulder"].clearance}

    def gradient(kept: float, rows: int) -> float:
        monkeypatch.setattr(recorded_runs, "KEPT_BYTES", kept)
        monkeypatch.setattr(adjoint, "ROWS", rows)
        for program in (adjoint.segment, adjoint.backward):
            program.native._programs.clear()
        made = cj.predictor(scene, state, 0.05, path, outputs, np.linspace(0.0, 0.05, 7), SETTINGS)
        return float(jax.grad(lambda values: jnp.sum(made(values)["x"]))(made.values)["number"])

    whole = gradient(1e9, 1024)
    assert whole != 0.0
    assert gradient(0, 1024) == gradient(0, 50) == gradient(2e4, 50) == whole


class Network(cj.extend.AbstractForce):
    """A force along X on a ball, from its position and velocity by a network."""

    network: eqx.nn.MLP

    def body_names(self):
        return ("ball",)

    def wrenches(self, motions, t):
        motion = motions["ball"]
        inputs = jnp.stack([10.0 * motion.position.x, motion.velocity.x])
        force = self.network(inputs)
        zero = cj.extend.ZERO
        return {"ball": cj.extend.Wrench(cj.extend.Vector(force, 0.0, 0.0), zero)}


def with_network(seed: int) -> tuple[cj.Scene, cj.State]:
    scene, state = on_spring()
    network = eqx.nn.MLP(2, "scalar", 4, 1, jax.nn.tanh, key=jax.random.key(seed))
    return replace(scene, forces={**scene.forces, "network": Network(network)}), state


def network_of(scene: cj.Scene) -> eqx.nn.MLP:
    return scene.forces["network"].network


def test_numbers_of_a_network_are_its_arrays():
    scene, state = with_network(0)
    numbers, changes = parts_of(scene, state, {"all": lambda scene: scene.forces["network"]})
    shapes = sorted(leaf.shape for leaf in jax.tree.leaves(numbers["all"]))
    assert shapes == [(1,), (1, 4), (4,), (4, 2)]
    doubled = jax.tree.map(lambda leaf: 2.0 * leaf, numbers["all"])
    changed, _ = changes[0][1](scene, state, doubled)
    before, after = map(network_of, (scene, changed))
    np.testing.assert_array_equal(after.layers[0].weight, 2.0 * before.layers[0].weight)
    assert after.activation is before.activation


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (3.0, r"values.*dictionary with .*'start', 'stiffness'"),
        ({"stiffness": 100.0}, r"values.*dictionary with .*'start', 'stiffness'"),
        ({"stiffness": 100.0, "start": np.zeros(3)}, r"values\['start'\].*shapes"),
        ({"stiffness": np.nan, "start": 0.1}, "stiffness"),
    ],
)
def test_wrong_values_are_refused(predict, values, message):
    """But numbers that a scene refuses are those of a failed run for line searches."""
    for call in (predict,) if message == "stiffness" else (predict, predict.or_nan):
        with pytest.raises(ValueError, match=message):
            call(values)


@pytest.mark.parametrize(
    ("paths", "outputs", "times", "message"),
    [
        ({}, POSITION, TIMES, r"paths.*not empty"),
        ({"k": 3.0}, POSITION, TIMES, r"paths\['k'\].*a function"),
        ({"k": lambda s: s.forces["spring"].stiffnes}, POSITION, TIMES, "stiffnes"),
        (STIFFNESS, POSITION, None, r"times.*\['x', 'v'\]"),
        (STIFFNESS, {"lost": cj.DissipatedEnergy()}, None, "ledger"),
        (
            STIFFNESS,
            {"x_mean": POSITION["x"], "x": cj.Statistics(POSITION["x"], "m")},
            TIMES,
            r"outputs.*part of a reduction.*\['x_mean'\]",
        ),
        (
            STIFFNESS,
            {"x": cj.Quantiles(POSITION["x"], "m", [-1.0, 1.0])},
            None,
            r"outputs\['x'\].*with derivatives in reverse mode",
        ),
    ],
)
def test_wrong_paths_and_outputs_are_refused(paths, outputs, times, message):
    with pytest.raises(ValueError, match=message):
        cj.predictor(*on_spring(), 0.3, paths, outputs, times)


@pytest.fixture(scope="module")
def short():
    """A predictor whose runs reach their limit of steps."""
    few = replace(SETTINGS, max_steps=5)
    return cj.predictor(*on_spring(), 0.3, STIFFNESS, POSITION, TIMES, few)


def test_a_run_that_fails_raises_what_simulate_raises(short):
    """Or has outputs of NaN, for line searches."""
    with pytest.raises(cj.SimulationError, match="step limit was reached"):
        jax.grad(lambda values: jnp.sum(short(values)["x"]))(short.values)
    with pytest.raises(RuntimeError, match="step limit was reached"):
        jax.jit(short)(short.values)
    assert np.isnan([*jax.jit(short.or_nan)(short.values).values()]).all()
    with pytest.raises(cj.SimulationError, match="step limit was reached") as failed:
        short(short.values)
    # The state that it reached.
    reached = failed.value.solution
    assert 0.0 < reached.time < 0.3 and int(reached.attempts) == 5
    expected = 0.1 * np.cos(10.0 * reached.time)
    assert reached.final.bodies["ball"].position[0] == pytest.approx(expected, rel=1e-6)


def misfit(outputs):
    return jnp.sum(jnp.square((outputs["x"] - 0.1 * np.cos(12.0 * TIMES)) / 1e-2))


class Paraboloid:
    """An objective whose first step is 200 times too long, and which JAX can't trace: a run inside
    of a program of XLA waits for ever on a machine with one core."""

    scales: ClassVar[dict[str, object]] = {}
    curvature = 1e3 * np.linspace(1.0, 4.0, 20)

    def start(self):
        return {"x": jnp.full(20, 1e-3)}

    def value(self, at):
        return jnp.asarray(0.5 * np.sum(self.curvature * np.asarray(at["x"]) ** 2))

    def values(self, at):
        return at

    def evaluated(self, at):
        return self.value(at), {"x": self.curvature * at["x"]}, RESULTS.successful


def test_a_short_first_step_does_not_shorten_those_after_it():
    history = minimise._descended(Paraboloid(), minimise.quasi_newton(), 10).history
    assert history[-1] < 1e-7 * history[0]


@pytest.mark.slow
def test_minimise_trains_a_network():
    scene, state = with_network(0)
    paths = {"network": network_of}
    found = cj.minimise(scene, state, misfit, paths, POSITION, TIMES, SETTINGS, iterations=20)
    assert found.coordinates.shape == (17,)
    assert found.objective < 0.05 * found.history[0]
    assert found.estimates["network"].layers[0].weight.shape == (4, 2)

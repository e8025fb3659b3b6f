"""Sensitivities against an event-exact solver in quadruple precision, and closed forms."""

from dataclasses import replace
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import clearjoint as cj
from clearjoint._parametrisation.parameter import coordinates_of
from clearjoint._parametrisation.parametrised_scene import parametrised
from clearjoint._simulation.run import sampling
from clearjoint._simulation.run.recorders import TangentPeakRecorder
from clearjoint._simulation.run.run_checks import derivative_scheme
from clearjoint._simulation.run.sampling import TangentRun, _amplification, sampled
from clearjoint._simulation.run.sensitivities import _growth_of_derivatives
from tests.support.oscillator import on_spring
from tests.support.programs import body_of, primitives
from tests.support.reference import Case

JOINT, Q = "shoulder", cj.quantities
PARAMETERS = {
    "clearance": cj.Parameter(lambda s: s.joints[JOINT].clearance, cj.Log()),
    "stiffness": cj.Parameter(lambda s: s.joints[JOINT].law.stiffness.young_modulus, cj.Log()),
    "restitution": cj.Parameter(lambda s: s.joints[JOINT].law.restitution),
}
OUTPUTS = {
    "y": Q.Position("arm 2", "y"),
    "V": Q.EntrySpeed(JOINT, "V"),
    "W": Q.EntrySpeed(JOINT, "W"),
}
TIMES = np.array([0.012, 0.025, 0.040, 0.060, 0.065, 0.080, 0.100])
POSITION = np.array(
    [
        [2.861031385e-4, -2.626347866e-6, -4.567781795e-5],
        [-1.552556927e-4, 1.519316328e-6, -3.972620347e-4],
        [-1.152930568e-4, 1.179629503e-6, -6.871866829e-4],
        [-5.195528888e-4, 4.865243798e-6, -1.928408968e-3],
        [4.881763503e-4, 2.261749622e-6, 6.566882160e-4],
        [-2.179315892e-4, -8.075284706e-6, -1.652051576e-3],
        [-3.040991498e-4, 5.228820326e-5, -2.617509723e-3],
    ]
)
ENTRIES = {
    ("V", 4): [3.395300981e-2, 1.676431639e-4, 1.724020207e-1],
    ("W", 4): [2.293936506e-2, -3.880555868e-3, 1.430823149e-1],
    ("V", 5): [8.310691660e-2, 2.668511166e-2, 3.099094667e-1],
    ("W", 5): [-9.181802553e-3, -1.168291211e-2, 8.115270544e-2],
}
"""To log clearance, log stiffness and restitution, by the reference's README."""
SPRING = on_spring("mass", 50.0, 2.0, 0.3)
BY_STIFFNESS = {"k": cj.Parameter(lambda s: s.forces["spring"].stiffness, cj.Log())}
X = {"x": Q.Position("mass", "x")}


def _during(folder, base, number):
    """The middle of a base's contact, s, by the reference."""
    table = Case(5e-4, 0.9, 0.15).impacts(folder, base)
    return 0.5 * (table["t_on"][number - 1] + table["t_off"][number - 1])


@pytest.mark.parametrize(
    ("settings", "accuracy", "entry_accuracy"),
    [
        (cj.presets.derivatives, 1e-6, 5e-6),
        (replace(cj.presets.derivatives, rtol=1e-11), 5e-8, 5e-7),
        (cj.presets.identification, 1e-4, 1e-3),
    ],
    ids=["default", "close", "for fits"],
)
def test_sensitivities_are_those_of_the_event_exact_solver(
    settings, accuracy, entry_accuracy, reference_folder
):
    middles = {contact: _during(reference_folder, *contact) for contact in ENTRIES}
    times = np.union1d(TIMES, list(middles.values()))
    pendulum = cj.mechanisms.double_pendulum()
    found = cj.sensitivities(*pendulum, 0.1, PARAMETERS, OUTPUTS, times, settings)
    position = found.derivatives["y"][np.searchsorted(times, TIMES)]
    np.testing.assert_allclose(position, POSITION, rtol=accuracy)
    for contact, expected in ENTRIES.items():
        at = np.searchsorted(times, middles[contact])
        np.testing.assert_allclose(found.derivatives[contact[0]][at], expected, rtol=entry_accuracy)


def test_derivatives_take_few_more_steps_than_the_motion_alone():
    """Their forces begin and end as roots of time; steps that don't know are twice as many."""
    pendulum = cj.mechanisms.double_pendulum()
    plain = cj.simulate(*pendulum, 0.1, cj.presets.derivatives)
    for settings, more in ((cj.presets.derivatives, 1.45), (cj.presets.identification, 1.1)):
        found = cj.sensitivities(*pendulum, 0.1, PARAMETERS, OUTPUTS, TIMES, settings)
        assert found.attempts < more * plain.attempts


def sampling_loop(scene, state, parameters, outputs, times):
    """The loop of a program of derivatives that looks at the outputs at each of the times."""
    values = jnp.asarray(coordinates_of(scene, state, parameters))
    family = parametrised(scene, state, parameters, values)
    scheme = derivative_scheme(scene, state, cj.presets.derivatives)

    def program(times, *span):
        return sampled(TangentRun(scheme, family, outputs, times, *span, 1000)).derivatives

    return body_of(jax.make_jaxpr(program)(jnp.zeros(times), 0.0, 0.1, 1e-7), "scan")


@pytest.mark.slow
@pytest.mark.parametrize("count", [1, 2])
def test_what_outputs_read_is_arithmetic_without_loops(count):
    """XLA's emitter forgets at each loop what it has written before, and writes it again at every
    use: a single one among the variables made an acceleration's program five times as large."""
    scene, state = cj.mechanisms.double_pendulum()
    parameters = dict(list(PARAMETERS.items())[:count])
    outputs = {
        "acceleration": Q.PointAcceleration("arm 2", (0.3, 0.0, 0.0), "y"),
        "reaction": Q.Reaction("elbow", "arm 3"),
        "contact": Q.ContactForce(JOINT),
        **OUTPUTS,
    }
    sampling = sampling_loop(scene, state, parameters, outputs, 3)
    found = primitives(sampling, beside=("while",))
    assert found["mul"] > 1000
    loops = ("reduce", "arg", "cum", "concatenate", "pad", "dot_general", "scatter", "sort")
    assert [name for name in found if name.startswith(loops)] == []


def test_closed_forms_of_an_oscillator():
    """x = x0 cos(w t) + v0/w sin(w t), w = sqrt(k/m), on all scales and by all ways of varying."""

    def kick(scene, state, value):
        return scene, cj.set_value(state, lambda s: s.bodies["mass"].velocity[0], value)

    found = cj.sensitivities(
        *SPRING,
        1.5,
        {
            **BY_STIFFNESS,
            "m": cj.Parameter(lambda s: s.bodies["mass"].mass, cj.Bounded(1.0, 5.0)),
            "x0": cj.Parameter.initial(lambda s: s.bodies["mass"].position[0], cj.Linear(0.1)),
            "v0": cj.Parameter.change(kick, 0.0),
        },
        X,
        [0.0, 0.4, 1.5],
        replace(cj.presets.derivatives, rtol=1e-10),
    )
    t, angle = found.times, 5.0 * found.times
    to_log_k = -0.15 * 5.0 * t * np.sin(angle)
    slope = (2.0 - 1.0) * (5.0 - 2.0) / (5.0 - 1.0)
    expected = np.stack(
        [to_log_k, -to_log_k / 2.0 * slope, 0.1 * np.cos(angle), np.sin(angle) / 5.0], axis=-1
    )
    np.testing.assert_allclose(found.outputs["x"], 0.3 * np.cos(angle), rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(found.derivatives["x"], expected, rtol=0.0, atol=1e-8)


def test_many_times_are_looked_at_in_blocks():
    """A loop copies at every turn what it has written so far, so that 4096 rows of one loop took
    ten times as long as their run. What is seen is the same."""
    times = np.linspace(0.0, 1.5, 301)
    many, few = (
        cj.sensitivities(*SPRING, 1.5, BY_STIFFNESS, X, times[::every]) for every in (1, 10)
    )
    for name in ("outputs", "derivatives"):
        all_rows, some = getattr(many, name)["x"], getattr(few, name)["x"]
        np.testing.assert_allclose(all_rows[::10], some, rtol=1e-12, atol=1e-15)
    blocks = sampling_loop(*SPRING, BY_STIFFNESS, X, 512)
    lengths = [eqn.params["length"] for eqn in blocks.eqns if eqn.primitive.name == "scan"]
    assert lengths == [64]


def test_amplification_is_the_peak_times_the_time_since_over_the_positions_since():
    """By x0, the speed -x0 w sin(w t) has its largest derivative, w, after a quarter period. Until
    half a period, the largest derivative of the position cos(w t) since then is 1. The second
    parameter has no effect."""

    def with_speeds(positions, speeds):
        return {"x": positions["x"], "v": speeds["v"]}

    def at(angle):
        motion = {"x": np.array([np.cos(angle), 0.0]), "v": np.array([-5.0 * np.sin(angle), 0.0])}
        tangents = SimpleNamespace(y=SimpleNamespace(motion=motion))
        return SimpleNamespace(t=angle / 5.0, tangents=tangents)

    recorder, system = TangentPeakRecorder(), SimpleNamespace(with_speeds=with_speeds)
    first, *steps = (at(k * np.pi / 8.0) for k in range(9))
    peak = recorder.start(SimpleNamespace(loop=SimpleNamespace(system=system), step=first))
    for step in steps:
        peak = recorder.after(peak, SimpleNamespace(system=system, after=step))
    np.testing.assert_allclose(peak.time, [0.1 * np.pi, 0.0], rtol=1e-12)
    np.testing.assert_allclose(_amplification(steps[-1], peak), [0.5 * np.pi, 0.0], rtol=1e-12)


def test_a_run_that_fails_keeps_what_it_reached():
    settings = replace(cj.presets.derivatives, max_steps=40)
    with pytest.raises(cj.SimulationError, match="step limit") as raised:
        cj.sensitivities(*SPRING, 1.5, BY_STIFFNESS, X, [0.001, 1.5], settings)
    found = raised.value.solution
    assert found.result == cj.RESULTS.max_steps_reached
    assert found.times.tolist() == [0.001]
    assert found.outputs["x"].shape == (1,)
    assert found.derivatives["x"].shape == (1, 1)
    assert 0.001 <= found.time < 1.5


@pytest.mark.parametrize(
    ("scale", "value", "message"),
    [
        (cj.Log(), -1.0, "`value` must be positive"),
        (cj.Bounded(0.0, 1.0), 1.0, "`value` must be between 0.0 and 1.0"),
    ],
)
def test_values_outside_their_scale_are_refused(scale, value, message):
    with pytest.raises(ValueError, match=message):
        scale.coordinate(value)


def grown(rate, result=cj.RESULTS.max_steps_reached):
    """A run whose derivatives grow exponentially at a rate from 1 s on, where they begin."""
    times = np.linspace(0.0, 2.0, 101)
    slopes = np.where(times > 1.0, np.exp(rate * (times - 1.0)), 0.0)[:, None]
    return cj.results.Sensitivities(("k",), times, {"x": times}, {"x": slopes}, 2.0, result, 10, 10)


def test_a_run_that_fails_by_the_growth_of_derivatives_says_so():
    assert "grown by a factor of 2e+07" in _growth_of_derivatives(grown(18.5))
    assert "cj.statistics_derivatives" in _growth_of_derivatives(grown(18.5))
    assert _growth_of_derivatives(grown(5.0)) is None
    assert _growth_of_derivatives(grown(18.5, cj.RESULTS.solver_failed)) is None


@pytest.mark.slow
def test_derivatives_past_the_horizon_are_not_to_be_had_by_more_steps():
    scene, state = cj.mechanisms.double_pendulum()
    clearance = PARAMETERS["clearance"]
    x = {"x": cj.quantities.JournalOffset("shoulder", "x")}
    few = replace(cj.presets.derivatives, max_steps=20000)
    with pytest.raises(cj.SimulationError, match="derivatives have grown by a factor") as failed:
        cj.sensitivities(scene, state, 1.0, {"c": clearance}, x, np.linspace(0.01, 1, 100), few)
    assert "Raise `max_steps`" not in str(failed.value)


@pytest.mark.parametrize(
    ("bodies", "largest"), [(1, 2), pytest.param(6, 16, marks=pytest.mark.slow)]
)
def test_derivatives_by_many_parameters_are_those_by_some_of_them(bodies, largest, monkeypatch):
    """By 3 and by 18 parameters, in two runs."""
    monkeypatch.setattr(sampling, "LONGEST_PACKED", largest)
    names = [f"mass {k}" for k in range(bodies)]
    spring = lambda name: cj.SpringDamper("ground", name, (0, 0, 0), (0, 0, 0), 50.0)  # noqa: E731
    scene = cj.Scene(
        {name: cj.Body(1.0 + k, (1.0, 1.0, 1.0)) for k, name in enumerate(names)},
        forces={name: spring(name) for name in names},
    )
    state = cj.State({name: cj.body_state((0.1 + k, 0.0, 0.0)) for k, name in enumerate(names)})
    numbers = {}
    for name in names:
        numbers[f"{name}, m"] = cj.Parameter(lambda s, name=name: s.bodies[name].mass)
        numbers[f"{name}, k"] = cj.Parameter(lambda s, name=name: s.forces[name].stiffness)
        numbers[f"{name}, x"] = cj.Parameter.initial(lambda s, n=name: s.bodies[n].position[0])
    outputs = {name: Q.Position(name, "x") for name in names}
    times = np.array([0.0, 0.2, 0.5])
    found = cj.sensitivities(scene, state, 0.5, numbers, outputs, times)
    for k, name in enumerate(names):
        m, w = 1.0 + k, np.sqrt(50.0 / (1.0 + k))
        slope = -(0.1 + k) * times * np.sin(w * times)  # dx/dw
        expected = np.zeros((3, 3 * bodies))
        own = [slope * -0.5 * w / m, slope * 0.5 * w / 50.0, np.cos(w * times)]
        expected[:, 3 * k : 3 * k + 3] = np.stack(own, axis=1)
        np.testing.assert_allclose(found.derivatives[name], expected, rtol=0, atol=1e-7)
    assert found.parameters == tuple(numbers)

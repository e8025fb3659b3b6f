"""Errors for wrong names, values that are no numbers and wrong containers: each names the argument
and is raised before compilation."""

import math

import numpy as np
import pytest

import clearjoint as cj
from clearjoint import Section
from clearjoint import quantities as q
from clearjoint._simulation.step.settings import checked_times
from clearjoint._sweeps.outputs import Layout, Variable

SCENE, STATE = cj.mechanisms.double_pendulum()
PLACE = cj.Axis(lambda scene: scene.joints["shoulder"].clearance, [4e-4, 5e-4])
CLEARANCE = cj.Parameter(lambda scene: scene.joints["shoulder"].clearance)
HEIGHT = q.Position("arm 2", "y")
LOST = q.ContactForce("sholder", "V")
KNOWN = r"`joint` must be one of the scene's \['shoulder'\], but is 'sholder'"
DATA = cj.Measurements({"height": cj.Series(HEIGHT, [1e-3, 2e-3], [0.0, 0.0], 1e-6)})


AXES = {"clearance": PLACE}


def sweep(outputs=None, axes=AXES, **options):
    cj.sweep(SCENE, STATE, 1e-3, axes, outputs, **options)


PARAMETERS, OUTPUTS = {"clearance": CLEARANCE}, {"height": HEIGHT}


def sensitivities(parameters=PARAMETERS, outputs=OUTPUTS):
    cj.sensitivities(SCENE, STATE, 2e-3, parameters, outputs, [1e-3])


def identify(data=DATA, parameters=PARAMETERS, **options):
    cj.identify(SCENE, STATE, data, parameters, **options)


def minimise(outputs):
    cj.minimise(SCENE, STATE, lambda found: 0.0, PARAMETERS, outputs, [1e-3])


def lost_series():
    return cj.Measurements({"force": cj.Series(LOST, [1e-3], [0.0], 1e-6)})


def horizon():
    cj.fit_horizon(SCENE, STATE, PARAMETERS, lost_series(), uncertainty={"clearance": 0.1})


BODY = cj.Body(1.0, (1, 1, 1))

WRONG = {
    "a joint of a peak": (lambda: sweep({"peak": cj.Peak(LOST, "N")}), f"Output 'peak': .*{KNOWN}"),
    "a joint of impacts": (lambda: sweep({"hits": cj.ImpactCount("sholder")}), KNOWN),
    "a joint saved": (
        lambda: sweep({"force": LOST}, save=cj.Saving([1e-3])),
        f"Output 'force': .*{KNOWN}",
    ),
    "a joint of a section": (lambda: sweep({"hit": Section(LOST, {"y": (HEIGHT, "m")}, 3)}), KNOWN),
    "a joint differentiated": (
        lambda: sensitivities(outputs={"F": LOST}),
        f"Output 'F': .*{KNOWN}",
    ),
    "a joint minimised": (lambda: minimise({"force": LOST}), f"Output 'force': .*{KNOWN}"),
    "a joint measured": (lambda: identify(lost_series()), f"Series 'force': .*{KNOWN}"),
    "a joint planned": (horizon, f"Sensor 'force': .*{KNOWN}"),
    "joints in a list": (
        lambda: cj.Scene({"a": BODY}, []),
        "`joints` must be a dictionary by name",
    ),
    "bodies in a list": (
        lambda: cj.Scene([BODY]),
        "`bodies` must be a dictionary by name, but is 'l",
    ),
    "names of two kinds": (
        lambda: cj.Scene({1: BODY, "a": BODY}),
        "`bodies` must be named by non-em",
    ),
    "states in a list": (
        lambda: cj.simulate(SCENE, cj.State([cj.body_state((0, 0, 0))]), 1.0),
        "`bodies` must be a dictionary by name",
    ),
    "states of two kinds": (
        lambda: cj.simulate(SCENE, cj.State({**STATE.bodies, 1: cj.body_state((0, 0, 0))}), 1.0),
        "`bodies` must be named by non-empty strings, but is 1",
    ),
    "outputs in a list": (lambda: sweep([cj.ImpactCount("shoulder")]), "`outputs` must be a dict"),
    "axes in a list": (lambda: sweep(axes=[PLACE]), "`axes` must be a dictionary by name"),
    "values for an axis": (
        lambda: sweep(axes={"a": [1.0]}),
        r"`axes\['a'\]` must be an Axis, but is '",
    ),
    "parameters in a list": (
        lambda: sensitivities([CLEARANCE]),
        "`parameters` must be a dictionary",
    ),
    "a function as parameter": (
        lambda: identify(parameters={"c": lambda scene: scene.gravity}),
        r"`parameters\['c'\]` must be a Parameter, but is 'function'",
    ),
    "outputs of two kinds": (
        lambda: sensitivities(outputs={1: HEIGHT, "a": HEIGHT}),
        "`outputs` must",
    ),
    "no parameters": (lambda: sensitivities({}), "`parameters` must be at least one Parameter"),
    "no parameters of sensors": (
        lambda: cj.identifiability(SCENE, STATE, {}, DATA.series),
        "`parameters` must be at least one Parameter",
    ),
    "no outputs": (lambda: sensitivities(outputs={}), "`outputs` must be not empty"),
    "series of two kinds": (
        lambda: cj.Measurements({**DATA.series, 1: DATA["height"]}),
        "`series` mu",
    ),
    "a section without a function": (
        lambda: cj.Section("height", {"x": (HEIGHT, "m")}, 1),
        "`crossing` must be a",
    ),
    "channels in a list": (
        lambda: Section(HEIGHT, [HEIGHT], 1),
        "`channels` must be a dictionary by name",
    ),
    "an output with a slash": (
        lambda: sweep({"a/b": cj.ImpactCount("shoulder")}),
        r"`outputs\['a/b'\]` must be named without a slash.*: rename it",
    ),
    "a channel with a slash": (
        lambda: Section(HEIGHT, {"m/s": (HEIGHT, "m")}, 1),
        r"`channels\['m/s'\]` must be named without a slash",
    ),
    "an axis with a slash": (lambda: sweep(axes={"a/b": PLACE}), r"`axes\['a/b'\]` must be named"),
    "a result with a slash": (
        lambda: Layout((), 1, {"a/b": Variable()}),
        r"`variables\['a/b'\]` must be named without a slash",
    ),
    "a hidden output": (lambda: sweep({".a": cj.ImpactCount("shoulder")}), "neither"),
    "an output without a name": (
        lambda: sweep({"": cj.ImpactCount("shoulder")}),
        "`outputs` must be named by non-empty strings, but is ''",
    ),
    "half a lane": (
        lambda: sweep(chunk=2.5),
        "`chunk` must be a whole number, positive, but is 2.5",
    ),
    "lanes as a text": (
        lambda: sweep(chunk="4"),
        "`chunk` must be a whole number, positive, but is '4'",
    ),
    "half a round": (lambda: cj.Screening(rounds=1.5), "`rounds` must be a whole number"),
    "half a crossing": (
        lambda: Section(HEIGHT, {"y": (HEIGHT, "m")}, 1.5),
        "`count` must be a whole number",
    ),
    "a start after the samples": (
        lambda: identify(start_time=1.5e-3),
        r"`start_time` must be no later than the first sample, at 0.001 s, but is 0.0015: start",
    ),
    "a guess that is no number": (
        lambda: identify(guess={"clearance": math.nan}),
        "Parameter 'clearance': Argument `value` must be finite, but is nan",
    ),
    "a guess that is infinite": (
        lambda: identify(
            parameters={"clearance": cj.Parameter(CLEARANCE.variation, cj.Log())},
            guess={"clearance": math.inf},
        ),
        "Parameter 'clearance': Argument `value` must be finite, but is inf",
    ),
    "guesses for one": (
        lambda: identify(guess={"clearance": [1e-4, 2e-4]}),
        "Parameter 'clearance': Argument `value` must be an array of shape",
    ),
    "a guess without a name": (lambda: identify(guess=math.nan), "`guess` must be values by name"),
    "an infinite bound": (lambda: cj.Bounded(0.0, math.inf), "`high` must be finite, but is inf"),
    "a unit of nothing": (lambda: cj.Linear(0.0), "`unit` must be positive, but is 0.0"),
}


@pytest.mark.parametrize("case", WRONG)
def test_the_error_names_the_argument(case):
    call, message = WRONG[case]
    with pytest.raises(ValueError, match=message):
        call()


def test_mappings_are_accepted_as_dictionaries():
    bodies = {"a": BODY}
    scene = cj.Scene(bodies)
    bodies[""] = BODY
    assert list(scene.bodies) == ["a"]
    assert isinstance(cj.Scene(type(SCENE.__dict__)({"a": BODY})).bodies, dict)


@pytest.mark.parametrize(
    ("start", "end", "times"),
    [
        (0.0, 0.012, np.linspace(0.0, 0.012, 5, dtype=np.float32)),
        (0.0, 0.3, np.arange(4) * 0.1),
        (0.0, 3e5, np.arange(4) * 0.1 * 1e6),
        (0.0, 1e-12, [0.0, 1e-12]),
        (0.0, np.float32(0.7), [0.0, 0.7]),
        (0.1, 1.0, np.float32([0.1, 1.0])),
    ],
)
def test_times_outside_by_rounding_are_those_of_the_span(start, end, times):
    found = checked_times(start, end, times)
    assert found.dtype == np.float64
    assert float(start) <= found[0] and found[-1] == float(end)
    np.testing.assert_allclose(found, np.asarray(times, float), rtol=1e-6)
    with pytest.raises(ValueError, match="`times` must be between start_time"):
        checked_times(start, end, [0.0, 1.00001 * float(end)])

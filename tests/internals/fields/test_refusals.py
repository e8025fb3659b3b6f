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


BODY, FREE = cj.Body(1.0, (1, 1, 1)), cj.body_state((0, 0, 0))
LOG = cj.Parameter(CLEARANCE.variation, cj.Log())

BY_NAME, NAMED = "must be a dictionary by name", "must be named by non-empty strings, but is"
SLASH, WHOLE = "must be named without a slash.*: rename it", "must be a whole number, positive, but"
OF_TWO_KINDS = {1: HEIGHT, "a": HEIGHT}
VALUE = "Parameter 'clearance': Argument `value` must be"
WRONG = [
    (lambda: sweep({"peak": cj.Peak(LOST, "N")}), f"Output 'peak': .*{KNOWN}"),
    (lambda: sweep({"hits": cj.ImpactCount("sholder")}), f"Output 'hits': .*{KNOWN}"),
    (lambda: sweep({"F": LOST}, save=cj.Saving([1e-3])), f"Output 'F': .*{KNOWN}"),
    (lambda: sweep({"hit": Section(LOST, {"y": (HEIGHT, "m")}, 3)}), f"Output 'hit': .*{KNOWN}"),
    (lambda: sensitivities(outputs={"G": LOST}), f"Output 'G': .*{KNOWN}"),
    (lambda: minimise({"H": LOST}), f"Output 'H': .*{KNOWN}"),
    (lambda: identify(lost_series()), f"Series 'force': .*{KNOWN}"),
    (horizon, f"Sensor 'force': .*{KNOWN}"),
    (lambda: cj.Scene({"a": BODY}, []), f"`joints` {BY_NAME}"),
    (lambda: cj.Scene({1: BODY, "a": BODY}), f"`bodies` {NAMED} 1"),
    (lambda: cj.simulate(SCENE, cj.State([FREE]), 1.0), f"`bodies` {BY_NAME}"),
    (lambda: cj.simulate(SCENE, cj.State({**STATE.bodies, 2: FREE}), 1.0), f"`bodies` {NAMED} 2"),
    (lambda: sweep([cj.ImpactCount("shoulder")]), f"`outputs` {BY_NAME}"),
    (lambda: sweep(axes=[PLACE]), f"`axes` {BY_NAME}"),
    (lambda: sweep(axes={"a": [1.0]}), r"`axes\['a'\]` must be an Axis, but is '"),
    (lambda: sensitivities([CLEARANCE]), f"`parameters` {BY_NAME}"),
    (lambda: sensitivities(outputs=OF_TWO_KINDS), f"`outputs` {NAMED} 1"),
    (lambda: sensitivities({}), "`parameters` must be at least one Parameter"),
    (lambda: cj.Bounded("0 mm", 1.0), "`low` must be a number or an array of numbers, but is '0 m"),
    (lambda: cj.Linear().coordinate(None), "`value` must be a number or an array of numbers, but"),
    (lambda: cj.function_from_csv("a", "x", "N", cj.Spline), "`kind` must be PiecewiseLinear or P"),
    (lambda: cj.Starts(2, seed=-1), "`seed` must be a whole number, zero or positive, but is -1"),
    (lambda: cj.Screening(seed=0.5), "`seed` must be a whole number, zero or positive, but is 0.5"),
    (lambda: cj.Series(HEIGHT, [0.1], [0.1], 1.0, 3), "`unit` must be a text of at .*, but is 3:"),
    (lambda: cj.identify_many(SCENE, STATE, DATA, {}), "`measurements` must be a list of Measure"),
    (lambda: cj.posterior(SCENE, STATE, DATA, PARAMETERS, spread="1 m"), "`spread` must be a numb"),
    (
        lambda: cj.posterior(SCENE, STATE, DATA, PARAMETERS, guess=[{}, {}]),
        r"`guess` must be one guess, the centre of the box, but is \[{}, {}\]: widen",
    ),
    (
        lambda: cj.identifiability(SCENE, STATE, {}, DATA.series),
        "`parameters` must be at least one",
    ),
    (lambda: sensitivities(outputs={}), "`outputs` must be not empty"),
    (lambda: cj.Measurements({**DATA.series, 1: DATA["height"]}), f"`series` {NAMED} 1"),
    (lambda: Section("height", {"x": (HEIGHT, "m")}, 1), "`crossing` must be a"),
    (lambda: Section(HEIGHT, [HEIGHT], 1), f"`channels` {BY_NAME}"),
    (lambda: sweep({"a/b": cj.ImpactCount("shoulder")}), rf"`outputs\['a/b'\]` {SLASH}"),
    (lambda: Section(HEIGHT, {"m/s": (HEIGHT, "m")}, 1), rf"`channels\['m/s'\]` {SLASH}"),
    (lambda: sweep(axes={"a/b": PLACE}), rf"`axes\['a/b'\]` {SLASH}"),
    (lambda: Layout((), 1, {"a/b": Variable()}), rf"`variables\['a/b'\]` {SLASH}"),
    (lambda: sweep({".a": cj.ImpactCount("shoulder")}), "neither"),
    (lambda: sweep({"": cj.ImpactCount("shoulder")}), f"`outputs` {NAMED} ''"),
    (lambda: sweep(chunk=2.5), f"`chunk` {WHOLE} is 2.5"),
    (lambda: sweep(chunk="4"), f"`chunk` {WHOLE} is '4'"),
    (lambda: cj.Screening(rounds=1.5), f"`rounds` {WHOLE}"),
    (lambda: Section(HEIGHT, {"y": (HEIGHT, "m")}, 1.5), f"`count` {WHOLE}"),
    (
        lambda: identify(start_time=1.5e-3),
        "no later than the first sample, at 0.001 s, but is 0.0015",
    ),
    (lambda: identify(guess={"clearance": math.nan}), f"{VALUE} finite, but is nan"),
    (
        lambda: identify(parameters={"clearance": LOG}, guess={"clearance": math.inf}),
        f"{VALUE} finite, but is inf",
    ),
    (lambda: identify(guess={"clearance": [1e-4, 2e-4]}), f"{VALUE} an array of shape"),
    (lambda: identify(guess=math.nan), "`guess` must be values by name"),
    (lambda: cj.Bounded(0.0, math.inf), "`high` must be finite, but is inf"),
    (lambda: cj.Linear(0.0), "`unit` must be positive, but is 0.0"),
]


@pytest.mark.parametrize(("call", "message"), WRONG, ids=[message for _, message in WRONG])
def test_the_error_names_the_argument(call, message):
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

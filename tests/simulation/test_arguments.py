"""What all functions that make runs refuse: other things than a scene, a state and times."""

import pytest

import clearjoint as cj
from tests.support.oscillator import on_spring

SCENE, STATE = on_spring()
X, STIFFNESS = cj.quantities.Position("ball", "x"), lambda scene: scene.forces["spring"].stiffness
DATA = cj.Measurements({"x": cj.Series(X, [0.1, 0.2], [0.05, -0.04], noise=1e-3)})
AXES, PEAK = {"k": cj.Axis(STIFFNESS, [100.0, 200.0])}, {"p": cj.Peak(X, "m")}
LIMIT = (cj.Parameter(STIFFNESS), cj.quantities.Velocity("ball"), 2.0)
TOLERANCE = {"k": cj.Uncertain(STIFFNESS, half_width=5.0)}
MASS = cj.Uncertain(lambda scene: scene.bodies["ball"].mass, deviation=0.01)
TOLERANCES = TOLERANCE | {"m": MASS}
CALLS = {
    "simulate": lambda *scene_and_state, end=0.5, **rest: cj.simulate(
        *scene_and_state, end, **rest
    ),
    "sensitivities": lambda *scene_and_state, end=0.5, **rest: cj.sensitivities(
        *scene_and_state, end, {"k": LIMIT[0]}, {"x": X}, [0.1], **rest
    ),
    "sweep": lambda *scene_and_state, end=0.5, **rest: cj.sweep(
        *scene_and_state, end, AXES, PEAK, **rest
    ),
    "ensemble": lambda *scene_and_state, end=0.5, **rest: cj.ensemble(
        *scene_and_state, end, AXES, PEAK, **rest
    ),
    "statistics_derivatives": lambda *scene_and_state, end=0.5, **rest: cj.statistics_derivatives(
        *scene_and_state, end, TOLERANCE, PEAK, draws=40, **rest
    ),
    "largest_feasible": lambda *scene_and_state, end=0.5, **rest: cj.largest_feasible(
        *scene_and_state, end, *LIMIT, between=(1.0, 200.0), **rest
    ),
    "settle": lambda *scene_and_state, end=0.5, **rest: cj.settle(
        *scene_and_state, period=0.6, **rest
    ),
    "identify": lambda *scene_and_state, end=0.5, **rest: cj.identify(
        *scene_and_state, DATA, {"k": LIMIT[0]}, **rest
    ),
    "simulate_nonsmooth": lambda *scene_and_state, end=0.5, **rest: cj.simulate_nonsmooth(
        *scene_and_state, end, step=0.1, **rest
    ),
    "predictor": lambda *scene_and_state, end=0.5, **rest: cj.predictor(
        *scene_and_state, end, {"k": LIMIT[0]}, {"x": X}, [0.1], **rest
    ),
    "sobol_indices": lambda *scene_and_state, end=0.5, **rest: cj.sobol_indices(
        *scene_and_state, end, TOLERANCES, PEAK, draws=4, **rest
    ),
}
OTHERS = {
    "design": lambda *scene_and_state: cj.design(*scene_and_state, TOLERANCES, 4),
    "constraint_report": cj.constraint_report,
    "accelerometer": lambda *scene_and_state: cj.accelerometer(
        *scene_and_state, "ball", axis=(1, 0, 0), frequency=1e3
    ),
}


@pytest.mark.parametrize("call", CALLS)
@pytest.mark.parametrize("time", ["now", None, [0.0, 0.1]])
def test_times_that_are_no_single_numbers_are_named(call, time):
    with pytest.raises(ValueError, match="Argument `start_time` must be"):
        CALLS[call](SCENE, STATE, start_time=time)
    if call not in ("settle", "identify"):
        with pytest.raises(ValueError, match="Argument `end_time` must be"):
            CALLS[call](SCENE, STATE, end=time)
    if call in ("sweep", "ensemble", "statistics_derivatives", "sobol_indices"):
        with pytest.raises(ValueError, match="Argument `end_time` must be"):
            CALLS[call](SCENE, STATE, end=lambda scene: time)


@pytest.mark.parametrize("call", [*CALLS, *OTHERS])
def test_what_is_no_scene_or_no_state_is_named(call):
    """A common mistake is to pass the pair that a function of `cj.mechanisms` returns."""
    function = (CALLS | OTHERS)[call]
    for scene in ((SCENE, STATE), None):
        with pytest.raises(ValueError, match="Argument `scene` must be a Scene"):
            function(scene, STATE)
    with pytest.raises(ValueError, match="Argument `state` must be a State"):
        function(SCENE, None)
    with pytest.raises(ValueError, match="Argument `state` must be of the scene's bodies"):
        function(SCENE, cj.State({"cube": cj.body_state((0, 0, 0))}))


def test_what_is_no_scene_of_a_finished_run_is_named():
    solution = cj.simulate(SCENE, STATE, 0.1, save=cj.Saving([0.1]), progress=False)
    impacts = cj.results.Impacts.of_rows([])
    other, _ = cj.mechanisms.double_pendulum()
    with pytest.raises(ValueError, match="`solution` must be of the scene's bodies.*'arm 2'"):
        cj.observe(other, solution)
    with pytest.raises(ValueError, match="`trajectory` must be a Trajectory, but is 'Solution'"):
        cj.observe(SCENE, solution, solution)
    with pytest.raises(ValueError, match="`impacts` must be a table of impacts"):
        cj.beyond_law_ranges(SCENE, solution)
    for function, result in ((cj.observe, solution), (cj.beyond_law_ranges, impacts)):
        with pytest.raises(ValueError, match="Argument `scene` must be a Scene"):
            function((SCENE, STATE), result)
    with pytest.raises(ValueError, match="Argument `scene` must be a Scene"):
        cj.view((SCENE, STATE))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: cj.configure(cache=3), "`cache` must be a path, but is 'int'"),
        (lambda: cj.view(SCENE, STATE, meshes=[]), "`meshes` must be a dictionary by name"),
        (lambda: cj.view(SCENE, STATE, height="tall"), "`height` must be a whole number"),
        (lambda: cj.constraint_report(SCENE, STATE, 0.0, "joint"), "`coordinates` must be"),
        (
            lambda: cj.simulate_nonsmooth(SCENE, STATE, 1.0, step=0.1, coordinates="joint"),
            r"`coordinates` must be .*JointCoordinates\(\), but is 'joint'",
        ),
        (
            lambda: cj.simulate_nonsmooth(SCENE, STATE, 1.0, step=0.1, redundant="no"),
            "`redundant` must be True or False",
        ),
        (
            lambda: cj.accelerometer(SCENE, STATE, "ball", axis=(1, 0, 0), frequency=1e3, name=3),
            "`name` must be a text, but is 3",
        ),
        (lambda: CALLS["sobol_indices"](SCENE, STATE, seed="a"), "`seed` must be a whole number"),
        (
            lambda: CALLS["statistics_derivatives"](SCENE, STATE, seed=1.5),
            "`seed` must be a whole number",
        ),
        (lambda: cj.design(SCENE, STATE, TOLERANCES, 4, seed=-1), "`seed` must be a whole number"),
        (
            lambda: CALLS["sobol_indices"](SCENE, STATE, confidence="95 %"),
            "`confidence` must be a number",
        ),
        (lambda: cj.Uncertain(STIFFNESS, between="ab"), "`between` must be a number"),
        (
            lambda: CALLS["largest_feasible"](SCENE, STATE, draws=[1.0]),
            "`draws` must be a dictionary by name",
        ),
    ],
)
def test_arguments_of_other_types_are_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()

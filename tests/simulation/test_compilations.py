"""How many programs are compiled: one for each structure, none for other numbers of anything."""

from dataclasses import replace
from functools import partial

import jax
import numpy as np
import pytest

import clearjoint as cj
from tests.support.one_body import bearing, one_body
from tests.support.oscillator import on_spring

COMPILED = "/jax/core/compile/backend_compile_duration"
END = 0.3
PROGRAMS_OF_A_SWEEP = 4
"""The start, the slices, what comes of them, and new lanes in the places of old ones."""


STIFFNESS = {"k": cj.Parameter(lambda s: s.forces["spring"].stiffness, cj.Log())}
PLACE = {"x": cj.quantities.Position("mass", "x")}


def along(scene_and_state, count):
    """Derivatives at a number of instants."""
    return cj.sensitivities(*scene_and_state, END, STIFFNESS, PLACE, np.linspace(0.0, END, count))


@pytest.fixture
def compiled():
    """The number of programs that JAX has compiled since the test began, or taken from its cache
    on disk, as a function."""
    events: list[str] = []

    def note(event: str, duration_secs: float, **_: str | int) -> None:
        del duration_secs
        if event == COMPILED:
            events.append(event)

    jax.monitoring.register_event_duration_secs_listener(note)
    yield lambda: len(events)
    jax.monitoring.unregister_event_duration_listener(note)


def compiling(compiled, calls):
    """The calls, of those by name, that compile programs, and how many."""
    counts = {}
    for name, call in calls.items():
        before = compiled()
        call()
        counts[name] = compiled() - before
    return {name: count for name, count in counts.items() if count}


@pytest.fixture(scope="module")
def damped():
    """A mass on a damped spring: least to compile."""
    return on_spring("mass", 50.0, 2.0, 0.3, 0.5)


@pytest.fixture(scope="module")
def rod():
    """A rod that hangs on a pin, with clearance, and starts without contact."""
    law = cj.laws.HuntCrossley(0.7, cj.laws.GivenStiffness(1e8))
    pin = bearing(law, "rod", journal_point=(0.0, 0.2, 0.0), clearance=0.8e-3)
    return one_body("rod", {"pin": pin}, inertia=(1e-3, 2e-3, 3e-3), position=(1e-4, -0.2, 0.0))


def _saved(scene_and_state, count, settings=None, throw=True):
    save = cj.Saving(np.linspace(0.0, END, count))
    return cj.simulate(*scene_and_state, END, settings, save, throw=throw)


def test_other_numbers_of_instants_and_steps_compile_nothing(damped, compiled):
    scene, _ = damped

    def seen(count):
        return cj.observe(scene, _saved(damped, count)).energies["mechanical"]

    def steps(end):
        return cj.simulate(*damped, end, save=cj.Saving(steps=True)).steps

    assert len(seen(7)) == 7 and len(steps(0.01)) > 1
    calls = {str(count): partial(seen, count) for count in (3, 64, 700)}
    assert compiling(compiled, calls | {"longer": partial(steps, END)}) == {}


def test_what_a_run_keeps_and_its_coordinates_compile_no_other_observation(damped, compiled):
    scene, _ = damped
    plain, booked = _saved(damped, 5), _saved(damped, 5, cj.Settings(ledger=True))
    absolute = _saved(damped, 5, cj.Settings(coordinates=cj.AbsoluteCoordinates()))
    first = cj.observe(scene, plain)
    before = compiled()
    seen = [cj.observe(scene, solution) for solution in (booked, absolute)]
    assert compiled() == before
    assert set(seen[0].energies) == set(first.energies) | {"supplied"}
    np.testing.assert_allclose(seen[1].energies["kinetic"], first.energies["kinetic"], rtol=1e-4)


def test_a_sweep_of_more_lanes_compiles_nothing_and_another_axis_its_programs_once(
    damped, compiled
):
    stiffness, damping = STIFFNESS["k"].variation, lambda s: s.forces["spring"].damping
    both = {"damping": cj.Axis(damping, [0.1, 0.5])}

    def swept(values, others=None):
        return cj.sweep(*damped, END, {"k": cj.Axis(stiffness, values)} | (others or {}))

    swept([40.0, 50.0])
    before = compiled()
    swept([30.0, 45.0, 60.0])
    assert compiled() == before
    swept([40.0, 50.0], both)
    assert compiled() - before <= PROGRAMS_OF_A_SWEEP
    before = compiled()
    swept([41.0, 52.0, 60.0], both)
    assert compiled() == before


SHORT = 0.02


OTHER_SETTINGS = {
    "tolerances": cj.Settings(rtol=1e-6, atol=1e-10),
    "landing": cj.Settings(landing_tolerance=1e-9),
    "steps": cj.Settings(max_steps=10_000, first_step=1e-6),
}


def clearance(scene):
    return scene.joints["pin"].clearance


def swept(scene_and_state, lanes=4, greatest=1.5e-3, end=SHORT, settings=None, **options):
    axes = {"clearance": cj.Axis(clearance, np.linspace(1e-3, greatest, lanes))}
    outputs = {"speed": cj.Peak(cj.quantities.Velocity("rod", "y"), "m/s")}
    return cj.sweep(*scene_and_state, end, axes, outputs, settings, progress=False, **options)


def test_no_other_number_of_a_sweep_compiles_anything(rod, compiled):
    """With contacts, and so with what is said of them at the end."""
    swept(rod)
    changes = {
        "lanes": {"lanes": 7},
        "more lanes than places": {"lanes": 70},
        "one lane": {"lanes": 1},
        "bounds": {"greatest": 2.5e-3},
        "end": {"end": 0.5 * SHORT},
        "ends": {"end": lambda scene: 10.0 * float(clearance(scene))},
        "start": {"start_time": 1e-3},
        **{name: {"settings": settings} for name, settings in OTHER_SETTINGS.items()},
    }
    calls = {name: partial(swept, rod, **change) for name, change in changes.items()}
    assert compiling(compiled, calls) == {}


def test_no_other_number_of_a_run_compiles_anything(rod, compiled):
    """Lengths, law, masses, state, times and settings are arguments of one program."""
    scene, state = rod
    cj.simulate(scene, state, SHORT)
    pin = replace(scene.joints["pin"], clearance=1.1e-3, journal_length=0.03)
    pin = replace(pin, law=cj.laws.HuntCrossley(0.5, cj.laws.GivenStiffness(2e8)))
    other = cj.Scene({"rod": cj.Body(1.5, (2e-3, 3e-3, 4e-3))}, {"pin": pin})
    moved = cj.State({"rod": cj.body_state((-1e-4, -0.2, 0.0), velocity=(0.1, 0.0, 0.0))})
    changes = {
        "scene": (other, state, SHORT),
        "state": (scene, moved, SHORT),
        "end": (scene, state, 0.5 * SHORT),
        **{name: (scene, state, SHORT, settings) for name, settings in OTHER_SETTINGS.items()},
    }
    calls = {name: partial(cj.simulate, *change) for name, change in changes.items()}
    assert compiling(compiled, calls) == {}


def test_nothing_saved_is_nothing_observed(damped):
    scene, _ = damped
    failed = _saved(damped, 5, cj.Settings(max_steps=1), throw=False)
    none = cj.observe(scene, failed, jax.tree.map(lambda leaf: leaf[:0], failed.saved))
    assert none.times.shape == none.energies["kinetic"].shape == (0,)


@pytest.mark.slow
def test_records_of_few_lengths_are_compiled_for_derivatives(damped, compiled):
    along(damped, 3)
    along(damped, 64)
    before = compiled()
    few, many = along(damped, 63), along(damped, 500)
    assert compiled() == before
    assert few.derivatives["x"].shape == (63, 1) and many.derivatives["x"].shape == (500, 1)
    np.testing.assert_allclose(few.derivatives["x"][-1], many.derivatives["x"][-1], rtol=1e-12)


def test_a_time_given_twice_is_seen_twice(damped):
    times = [0.0, 0.1, 0.1, 0.1, 0.2, END, END]
    once, at = np.unique(times, return_inverse=True)
    seen, expected = (
        cj.sensitivities(*damped, END, STIFFNESS, PLACE, each) for each in (times, once)
    )
    np.testing.assert_array_equal(seen.outputs["x"], expected.outputs["x"][at])
    np.testing.assert_array_equal(seen.derivatives["x"], expected.derivatives["x"][at])

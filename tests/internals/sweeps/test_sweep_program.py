"""The programs of a sweep: all code that decides a lane's numbers is in them."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import diffrax
import numpy as np
import pytest

import clearjoint as cj
from clearjoint._math.vectors import fold_constants
from clearjoint._simulation.lanes.lane import SAVED, Common
from clearjoint._simulation.run import impact_recorder
from clearjoint._simulation.run.impact_recorder import ImpactRecorder
from clearjoint._simulation.run.outputs import requested_by
from clearjoint._simulation.step.method import Scheme
from clearjoint._sweeps.outputs import sampled_channels
from clearjoint._sweeps.store.program import RUN, programs
from clearjoint._sweeps.work import Chunks
from tests.support.one_body import bearing, one_body
from tests.support.rotor import OUTPUTS, SAMPLED, Turnings, angle, rotor, spin
from tests.support.slow import slow

USUAL = cj.Settings(atol=1e-9)


def of(scene, state, outputs: dict[str, Any] | None = None, settings=USUAL):
    """Programs of a sweep with the given outputs."""
    requested = requested_by(outputs, SAMPLED)
    sections = requested.sections.items()
    channels = {n: {k: q for k, (q, _) in o.channels.items()} for n, o in sections}
    if requested.quantities:
        channels[SAVED] = sampled_channels(requested, scene)
    common = Common(
        Scheme.of(settings),
        fold_constants(scene),
        start_time=np.zeros(()),
        max_steps=np.asarray(1000),
        reductions=requested.reductions,
        sections={name: section.state_recorder for name, section in sections},
        impacts={name: ImpactRecorder(table.joint) for name, table in requested.tables.items()},
        channels=channels,
    )
    return programs(common, state)


class Law(cj.laws.Hertz):
    """Elastic contact, by code of the tests' own."""

    gain, energy_gain = 1.0, 1.0

    def force(self, gap, entry_speed):
        return self.gain * super().force(gap, entry_speed)

    def stored_energy(self, gap):
        return self.energy_gain * super().stored_energy(gap)


class Grip(cj.extend.AbstractFriction):
    """Friction, by code of the tests' own."""

    gain = 1.0

    def ratio(self, slip_speed):
        return self.gain * slip_speed


def pendulum(**axial) -> tuple[cj.Scene, cj.State]:
    """One body in a bearing with play."""
    pin = bearing(Law(1e10), "arm", journal_point=(0.0, 0.5, 0.0), friction=Grip(), **axial)
    place = {"inertia": (0.1,) * 3, "gravity": (0.0, -9.81, 0.0), "position": (0.0, -0.5, 0.0)}
    return one_body("arm", {"pin": pin}, **place)


@pytest.fixture(scope="module")
def usual():
    return of(*pendulum())


@pytest.mark.parametrize("of_class", [Law, slow(Grip)])
def test_code_of_the_scene_makes_another_program(usual, of_class, monkeypatch):
    monkeypatch.setattr(of_class, "gain", 2.0)
    assert of(*pendulum()) != usual


def test_only_what_is_read_counts(usual, monkeypatch):
    monkeypatch.setattr(Law, "energy_gain", 2.0)
    assert of(*pendulum()) == usual


@pytest.mark.slow
@pytest.mark.parametrize(
    "others",
    [
        {"rtol": 1e-7},
        {"landing_tolerance": 1e-10},
        {"controller": diffrax.PIDController(1e-6, 1e-9, pcoeff=0.1)},
        {"solver": diffrax.Dopri5()},
        {"ledger": True},
    ],
)
def test_settings_make_another_program(usual, others):
    assert of(*pendulum(), settings=replace(USUAL, **others)) != usual


@pytest.mark.slow
def test_a_stabilisation_makes_another_program():
    held = pendulum(axial=cj.FixedAxially())
    other = replace(USUAL, stabilisation=cj.Baumgarte(5.0, 6.0))
    assert of(*held) != of(*held, settings=other)


def test_a_worker_that_would_run_other_code_refuses():
    common = SimpleNamespace(programs=((RUN, "this"),))
    work: Any = SimpleNamespace(common=common)
    with pytest.raises(RuntimeError, match="other code than the process that made the sweep"):
        Chunks(work, {0: [0]}, lambda: {RUN: "other"})(0)


@pytest.mark.slow
def test_numbers_of_scene_and_state_are_none_of_the_program(usual):
    scene, state = pendulum()
    scene = cj.set_value(scene, lambda s: s.joints["pin"].clearance, 1e-4)
    assert of(scene, cj.set_value(state, lambda s: s.bodies["arm"].position[0], 1e-5)) == usual


NOTHING = {
    "update": lambda self, tally, now: tally,
    "results": lambda self, tally, now: dict.fromkeys(self.units(), 0.0),
}
"""Methods that reduce nothing."""


@pytest.mark.parametrize("name", ["update", slow("results")])
def test_code_of_an_output_concerns_its_variables(name, monkeypatch):
    before = of(*rotor(), OUTPUTS)
    assert set(before) > {RUN, "swing_angle", "zero_time", "largest", "angle_rms", "turnings_end"}
    monkeypatch.setattr(Turnings, name, NOTHING[name])
    after = of(*rotor(), OUTPUTS)
    changed_names = {key for key in before if before[key] != after[key]}
    assert {key.partition("_")[0] for key in changed_names} == {"turnings"}


@pytest.mark.slow
def test_how_impacts_are_found_concerns_their_table(usual, monkeypatch):
    outputs = {"hits": cj.ImpactTable(2), "count": cj.ImpactCount("pin")}
    before = of(*pendulum(), outputs)
    assert before[RUN] == usual[RUN]
    monkeypatch.setattr(impact_recorder, "end_in_step", lambda law, start, end, h: 0.5)
    after = of(*pendulum(), outputs)
    changed = {name for name in before if before[name] != after[name]}
    assert changed == {f"hits_{name}" for name in (*impact_recorder.IMPACT_UNITS, "count")}


@pytest.mark.slow
def test_another_quantity_concerns_its_variables():
    def found(quantity):
        outputs = {
            "swing_x": quantity,
            "swing_spin": spin,
            "zero": cj.Section(quantity, {"spin": (spin, "rad/s")}, 1),
            "largest": cj.Peak(spin, "1"),
            "late": cj.Statistics(lambda now: quantity(now), "1"),
        }
        return of(*rotor(), outputs)

    one, other = found(angle), found(spin)
    assert one == found(lambda here: angle(here))
    assert {name for name in one if one[name] != other[name]} == {
        *("swing_x", "zero_time", "zero_count", "zero_spin"),
        *("late_mean", "late_rms", "late_smallest", "late_largest"),
    }

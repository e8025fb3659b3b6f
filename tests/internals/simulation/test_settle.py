"""Runs until a motion is periodic or steady."""

import math

import numpy as np
import pytest
from scipy.special import ellipk

import clearjoint as cj
from clearjoint import Settling
from clearjoint import quantities as q
from clearjoint._simulation.run import settle
from clearjoint._simulation.run.settle import Strobe, columns, section_strobe, stillness, strobe_of
from clearjoint.extend import Formulation
from tests.support.one_body import Z, hinge, one_body

GRAVITY = 9.81


def mapped(rate, count):
    """Iterates of the logistic map."""
    rows = [0.4]
    for _ in range(count - 1):
        rows.append(rate * rows[-1] * (1.0 - rows[-1]))
    return Strobe(np.array(rows)[:, None], np.ones(1))


@pytest.mark.parametrize(("rate", "multiple"), [(2.8, 1), (3.2, 2), (3.5, 4), (3.55, 8)])
def test_the_logistic_map_repeats_itself_with_its_known_periods(rate, multiple):
    assert mapped(rate, 600).multiple(8, 1e-6) == multiple
    assert mapped(rate, 600).change(multiple)[-1] < 1e-6


def test_chaos_has_no_period_and_settled_statistics_and_a_drift_has_neither():
    chaos = mapped(3.9, 600)
    assert chaos.multiple(8, 1e-3) is None and chaos.statistics_settled()
    drift = Strobe(np.linspace(0.0, 1.0, 600)[:, None], np.ones(1))
    assert drift.multiple(8, 1e-3) is None and not drift.statistics_settled()
    slow = Strobe(1.0 + np.exp(-0.01 * np.arange(600.0))[:, None], np.ones(1))
    assert slow.multiple(8, 1e-5) is None and slow.multiple(8, 1e-3) == 1


@pytest.mark.parametrize("seed", range(10))
def test_a_vibration_that_decays_is_not_taken_for_a_longer_period(seed):
    """It may resemble itself after three periods long before it vanishes."""
    rng = np.random.default_rng(seed)
    multiple, decay = rng.integers(1, 5), rng.uniform(0.5, 0.99)
    angles = 2.0 * np.pi / rng.integers(2, 9, 5) + rng.normal(0.0, 0.01, 5)
    periods = np.arange(2000)
    vibrations = decay**periods * np.cos(np.outer(angles, periods) + rng.uniform(0.0, 6.0, (5, 1)))
    motion = np.tile(rng.normal(size=(5, multiple)), 2000)[:, :2000] + vibrations
    strobes = [Strobe(motion.T[:count], np.ones(5)) for count in range(10, 2001, 10)]
    assert next(m for m in (s.multiple(8, 1e-5) for s in strobes) if m is not None) == multiple


@pytest.mark.parametrize("kind", Settling)
def test_a_motion_has_settled_unless_it_has_not_or_its_run_failed(kind):
    state, none = cj.State({}), np.zeros(0)
    settled = settle.Settled(kind, state, 1.0, 0.0, 10, None, None, none, cj.RESULTS.successful)
    assert settled.settled == (kind.name in ("PERIODIC", "STEADY", "STATIONARY"))


def test_two_equal_periods_are_no_proof():
    rows = np.array([1.0, 2.0, 0.3, 0.3, 0.3])[:, None]
    assert Strobe(rows, np.ones(1)).multiple(8, 1e-6) is None
    assert Strobe(np.append(rows, [[0.3]], axis=0), np.ones(1)).multiple(8, 1e-6) == 1


def turning(times, rate):
    """A body that turns about z, on a circle of 0.1 m."""
    half, zero = 0.5 * rate * times, 0.0 * times
    around = 0.1 * np.stack([np.cos(rate * times), np.sin(rate * times), zero], axis=1)
    body = cj.BodyState(
        around,
        np.stack([np.cos(half), zero, zero, np.sin(half)], axis=1),
        rate * around[:, [1, 0, 2]] * [-1.0, 1.0, 1.0],
        np.stack([zero, zero, zero + rate], axis=1),
    )
    return cj.State({"crank": body})


def test_a_crank_repeats_itself_after_a_turn_though_euler_parameters_need_two():
    phases, rate = 16, 50.0
    times = 2.0 * np.pi / rate * np.arange(1, 5 * phases + 1) / phases
    assert strobe_of(turning(times, rate), phases).multiple(8, 1e-9) == 1
    assert strobe_of(turning(times, 1.5 * rate), phases).multiple(8, 1e-9) == 2
    assert strobe_of(turning(times, rate), phases).scales.max() == pytest.approx(10.0, rel=1e-2)
    assert stillness(turning(times, rate), phases) > 0.5
    assert stillness(turning(times, 0.0), phases) == 0.0
    assert columns(turning(times, rate))["orientation"].shape == (80, 1, 16)


def test_crossings_are_compared_by_their_channels_and_waits():
    times, flips = np.cumsum(np.tile([1.0, 1.1], 10)), np.tile([0.5, -0.5], 10)
    assert section_strobe(times, [flips], [None]).multiple(4, 1e-9) == 2
    assert section_strobe(times, [np.abs(flips)], [None]).multiple(4, 1e-9) == 2
    assert section_strobe(np.arange(20.0), [np.abs(flips)], [None]).multiple(4, 1e-9) == 1
    assert section_strobe(np.arange(20.0), [1e-3 * flips], [None]).multiple(4, 1e-2) == 2
    assert section_strobe(np.zeros(0), [np.zeros(0)], [None]).multiple(4, 1e-9) is None


def test_crossings_at_half_a_revolution_are_equal():
    """Rounding errors decide the sign of the angle."""
    signs = np.random.default_rng(0).choice([-1.0, 1.0], 20)
    signs[-4:] = [1.0, -1.0, -1.0, 1.0]
    angles = signs * (np.pi - 1e-12)
    assert section_strobe(np.arange(20.0), [angles], [2.0 * np.pi]).multiple(4, 1e-9) == 1
    assert section_strobe(np.arange(20.0), [angles], [None]).multiple(4, 1e-9) != 1


MISTAKEN = {
    "nothing to look at": ({}, "`period` must be given if and only if `section` is not"),
    "a period that is none": ({"period": 0.0}, "`period` must be positive, but is 0.0"),
    "a period in a text": ({"period": "1 s"}, "`period` must be a number"),
    "a span of no section": ({"period": 1.0, "span": 1.0}, "`span` must be None beside a period"),
    "a quantity for a section": (
        {"section": q.Angle("arm", Z), "span": 1.0},
        "`section` must be a Section, but is 'Angle'",
    ),
    "a section without its span": (
        {"section": cj.Section(q.Angle("arm", Z), {"x": (q.Position("arm", "x"), "m")}, 9)},
        "`span` must be given with a section",
    ),
    "no periods": ({"period": 1.0, "periods": 0}, "`periods` must be a whole number"),
    "no multiple": ({"period": 1.0, "largest_multiple": 0}, "`largest_multiple` must be a whole"),
    "no tolerance": ({"period": 1.0, "tolerance": 0.0}, "`tolerance` must be positive"),
}


@pytest.mark.parametrize("case", MISTAKEN)
def test_what_can_not_settle_is_told(case):
    options, message = MISTAKEN[case]
    with pytest.raises(ValueError, match=message):
        cj.settle(*cj.mechanisms.double_pendulum(), **options)


@pytest.mark.parametrize("progress", [True, False])
def test_a_bar_is_shown_if_progress_is_wanted(progress, monkeypatch):
    class Shown(Exception):  # noqa: N818 (it ends the run before its first step)
        pass

    def shown(show, **options):
        raise Shown(show)

    monkeypatch.setattr(settle, "ProgressBar", shown)
    with pytest.raises(Shown, match=str(progress)):
        cj.settle(*pendulum(), period=1.0, progress=progress)


def test_an_interrupted_search_returns_all_runs_so_far(monkeypatch):
    """The second run is interrupted after half of its time."""
    rate, lengths = 50.0, iter([160, 80])

    def simulate(scene, state, end, settings, save, **options):
        length = next(lengths)
        times = np.asarray(save.times)[:length]
        saved = cj.results.Trajectory(times, turning(times, rate))
        crossings = {"settle": cj.results.Crossings(times[::16], {"speed": times[::16]})}
        formulation, code = Formulation(cj.JointCoordinates()), cj.RESULTS.successful
        none = None, None, None, formulation, ()
        found = cj.results.Solution(times[-1], state, code, 30, 20, saved, *none, crossings)
        if length < len(save.times):
            raise cj.RunInterrupted(found)
        return found

    monkeypatch.setattr(settle, "simulate", simulate)
    with pytest.raises(cj.RunInterrupted, match="interrupted at t = 1.5 s") as stopped:
        cj.settle(*pendulum(), section=PASSAGE, span=0.1, tolerance=1e-12, progress=False)
    found = stopped.value.solution
    np.testing.assert_allclose(found.times, 0.1 / 16 * np.arange(1, 241))
    np.testing.assert_allclose(found.states.bodies["crank"].spin[:, 2], rate)
    assert (found.attempts, found.accepted, found.saved_count) == (60, 40, 240)
    assert len(found.outputs["settle"]) == 15


def pendulum(*dampers):
    """A thin rod of 1 m on a hinge, and a state in which it is let go at 1 rad."""
    forces = {
        str(k): cj.TorsionalSpring("ground", "rod", Z, stiffness=0.0, damping=damping)
        for k, damping in enumerate(dampers)
    }
    return one_body(
        "rod",
        {"hinge": hinge("ground", "rod", point_second=(0.0, 0.5, 0.0))},
        forces,
        inertia=(1 / 12, 1e-3, 1 / 12),
        gravity=(0, -GRAVITY, 0),
        position=(0.5 * math.sin(1.0), -0.5 * math.cos(1.0), 0.0),
        orientation=(math.cos(0.5), 0.0, 0.0, math.sin(0.5)),
    )


PASSAGE = cj.Section(q.Position("rod", "x"), {"speed": (q.Velocity("rod", "x"), "m/s")}, count=1)


@pytest.mark.slow
def test_a_free_pendulum_settles_at_once_with_the_period_of_the_elliptic_integral():
    settled = cj.settle(*pendulum(), section=PASSAGE, span=1.8)
    length = 2.0 / 3.0
    exact = 4.0 * math.sqrt(length / GRAVITY) * ellipk(math.sin(0.5) ** 2)
    assert settled.kind is Settling.PERIODIC and settled.multiple == 1 and settled.settled
    assert settled.period == pytest.approx(exact, rel=1e-6)
    assert settled.periods <= 10 and "periodic after" in str(settled)


def test_a_span_with_more_crossings_than_there_is_room_for_is_refused(monkeypatch):
    monkeypatch.setattr(settle, "ROOM", 4)
    with pytest.raises(ValueError, match="`span` must .* fewer than 16 times, but is 1.8"):
        cj.settle(*pendulum(), section=PASSAGE, span=1.8, progress=False)


@pytest.mark.slow
def test_a_damped_pendulum_comes_to_rest_and_one_that_has_not_is_said_to():
    scene, state = pendulum(0.5)
    settled = cj.settle(scene, state, section=PASSAGE, span=1.8)
    assert settled.kind is Settling.STEADY
    np.testing.assert_allclose(settled.state.bodies["rod"].position, (0.0, -0.5, 0.0), atol=1e-5)
    early = cj.settle(scene, state, section=PASSAGE, span=0.2, periods=5)
    assert early.kind is Settling.UNSETTLED and not early.settled
    failed = cj.settle(scene, state, cj.Settings(max_steps=5), section=PASSAGE, span=1.8)
    assert failed.kind is Settling.FAILED and failed.result == cj.RESULTS.max_steps_reached
    assert "step limit" in str(failed)


@pytest.mark.slow
def test_a_driven_crank_goes_on_from_where_it_settled():
    """With play in its pin and friction, both from the end and from whole periods before."""
    speed = 300.0
    scene, state = cj.mechanisms.slider_crank(0.05e-3, speed=speed)
    settled = cj.settle(
        scene, state, period=2.0 * math.pi / speed, periods=40, tolerance=1e-3, largest_multiple=2
    )
    assert settled.kind in (Settling.PERIODIC, Settling.STATIONARY)
    assert settled.time == pytest.approx(settled.periods * settled.period)
    after = [
        cj.simulate(scene, settled.state, start + 1e-3, cj.presets.accurate, start_time=start).final
        for start in (settled.time, settled.start_time)
    ]
    for one, other in zip(*(run.bodies.values() for run in after), strict=True):
        np.testing.assert_allclose(one.position, other.position, rtol=0.0, atol=1e-9)

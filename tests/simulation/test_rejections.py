"""Rejected steps of runs whose reasons are known."""

import jax.numpy as jnp
import numpy as np
import pytest

import clearjoint as cj
from tests.support.dropped_rod import dropped_rod
from tests.support.one_body import Z, hinge, one_body
from tests.support.oscillator import on_spring
from tests.support.rotating_mechanisms import KINDS, rotating

OUTPUTS = {"rejected": cj.RejectedSteps()}
STEPS = cj.Saving(steps=True)
RESOLUTION = 1e-10
"""A little more than the longest time past an event at which a step may end, s."""


def rejections_of(scene, state, end, settings=None, save=STEPS, outputs=OUTPUTS, **options):
    """The rejected steps of a run, and its solution, after checks that hold for all runs."""
    options |= {"outputs": outputs, "throw": False, "progress": False}
    solution = cj.simulate(scene, state, end, settings, save, **options)
    table = solution.outputs["rejected"]
    assert sum(table.counts.values()) == solution.attempts - solution.accepted == len(table)
    for reason, count in table.counts.items():
        assert (table.reason == reason).sum() == count
    # A rejected step starts where an accepted one ended, and is tried again with a shorter length.
    times = solution.steps.times
    assert np.isin(table.start, times).all() and (np.diff(table.start) >= 0.0).all()
    following = np.append(times, np.inf)[np.searchsorted(times, table.start, "right")]
    taken = np.isfinite(following)  # not of the step in which a run failed
    assert (following[taken] < (table.start + table.length)[taken]).all()
    repeated = np.diff(table.start) == 0.0
    assert (np.diff(table.length)[repeated] < 0.0).all()
    return table, solution


def assert_contact_events_are_passed(scene, table, solution):
    """In each step that is rejected for an event, a contact begins or ends according to the
    penetrations after the accepted steps."""
    observed = cj.observe(scene, solution, solution.steps)
    depths = [c.penetration for family in observed.contacts.values() for c in family.values()]
    changes = (np.diff(np.array(depths) > 0.0, axis=1) != 0).any(axis=0)
    events = solution.steps.times[1:][changes]
    passing = table.reason == cj.results.Rejection.CONTACT
    for start, length in zip(table.start[passing], table.length[passing], strict=True):
        assert ((events > start) & (events <= start + length + RESOLUTION)).any()


def pushed_ball(rate):
    """A ball 0.1 mm from the centre of a socket with 1 mm of clearance, and a force that grows from
    zero by `rate`, N/s: it is at 0.1 mm + rate t^3 / 6 until it touches the wall."""
    law = cj.laws.LankaraniNikravesh(0.9, 1e9)
    socket = cj.BallInSocket("ground", "ball", socket_radius=10e-3, clearance=1e-3, law=law)
    push = cj.AppliedLoad("ball", (lambda t: rate * t, 0.0, 0.0))
    start = {"inertia": (1e-4,) * 3, "position": (0.1e-3, 0.0, 0.0)}
    return one_body("ball", {"socket": socket}, {"push": push}, **start)


@pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=pytest.mark.slow) for k in (1, 2))])
def test_a_first_step_beyond_the_onset_ends_there_and_the_tables_change_no_bit(seed):
    """At the start nothing announces the onset. In flight there is no integration error."""
    rate = np.random.default_rng(seed).uniform(0.5, 2.0)
    onset = (6.0 * 0.9e-3 / rate) ** (1.0 / 3.0)
    scene, state = pushed_ball(rate)
    settings, end = cj.Settings(first_step=1.5 * onset), 1.6 * onset
    late, two = cj.RejectedSteps(after=onset), cj.RejectedSteps(count=2)
    outputs = {**OUTPUTS, "late": late, "two": two}
    table, solution = rejections_of(scene, state, end, settings, outputs=outputs)
    assert (table.start[0], table.reason[0]) == (0.0, "contact event")
    assert table.length[0] == pytest.approx(1.5 * onset, rel=1e-12)
    assert solution.steps.times[1] == pytest.approx(onset, abs=RESOLUTION)
    # The impact has steps with too large an error; later ones may pass the next onset.
    assert set(table.reason) == {"contact event", "error estimate"}
    without = cj.simulate(scene, state, end, settings, STEPS, progress=False)
    for name in ("position", "velocity", "orientation", "spin"):
        pair = [getattr(run.steps.states.bodies["ball"], name) for run in (solution, without)]
        np.testing.assert_array_equal(*pair)
    assert without.attempts == solution.attempts
    late, two = solution.outputs["late"], solution.outputs["two"]
    np.testing.assert_array_equal(late.start, table.start[table.start >= onset])
    assert 0 < sum(late.counts.values()) == len(late) < len(table)
    np.testing.assert_array_equal(two.length, table.length[:2])
    assert two.counts == table.counts and two.reason.tolist() == table.reason[:2].tolist()
    frame = table.to_dataframe()
    assert frame["reason"].tolist() == table.reason.tolist()
    np.testing.assert_array_equal(frame["length [s]"], table.length)
    assert str(table).startswith(f"rejected steps: {table.counts['error estimate']} error estimate")


def test_a_first_step_of_periods_has_too_large_an_error():
    long = cj.Settings(first_step=6.0)
    table, _ = rejections_of(*on_spring(), 10.0, long, start_time=2.0)
    assert (table.start[0], table.length[0], table.reason[0]) == (2.0, 6.0, "error estimate")
    assert set(table.reason) == {"error estimate"}


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.slow
def test_a_load_that_is_no_number_from_an_instant_on(seed):
    end = np.random.default_rng(seed).uniform(0.05, 0.15)
    load = cj.AppliedLoad("ball", lambda t: (jnp.sqrt(end - t), 0.0, 0.0))
    scene, state = one_body("ball", forces={"load": load}, position=(0.1, 0, 0))
    table, solution = rejections_of(scene, state, 1.0)
    assert solution.result == cj.RESULTS.step_too_small
    assert solution.time == pytest.approx(end, abs=1e-9)
    passing = table.start + table.length > end
    np.testing.assert_array_equal(table.reason[passing], "not finite")
    assert table.counts["not finite"] == passing.sum() > 10


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.slow
def test_a_driver_with_a_kink_that_it_does_not_declare(seed):
    kink = np.random.default_rng(seed).uniform(0.05, 0.15)
    angle = lambda t: jnp.where(t < kink, 0.0, 0.1 * (t - kink))  # noqa: E731
    drive = cj.PrescribedAngle("ground", "shaft", Z, angle)
    scene, state = one_body(
        "shaft", {"hinge": hinge("ground", "shaft"), "drive": drive}, inertia=(0.1,) * 3
    )
    table, solution = rejections_of(scene, state, 0.2)
    assert solution.result == cj.RESULTS.not_followed
    assert solution.time == pytest.approx(kink, abs=1e-9)
    # Stages beyond the kink see it as an error of the constraints; steps whose stages are all
    # before it do not.
    assert set(table.reason) == {"error estimate", "driver"} and table.reason[-1] == "driver"
    assert (table.start + table.length > kink).all()


@pytest.mark.slow
def test_steps_of_a_body_that_a_torque_accelerates_turn_too_far():
    """The angular velocity is the torque times the time over the moment of inertia."""
    torque, inertia, arm = 30.0, 0.02 + 5.0 * 0.1**2, 0.1
    axle = {"axle": hinge("ground", "rotor", point_second=(-arm, 0, 0))}
    motor = {"motor": cj.DriveTorque("ground", "rotor", Z, torque)}
    body = {"mass": 5.0, "inertia": (0.02,) * 3}
    scene, state = one_body("rotor", axle, motor, **body, position=(arm, 0.0, 0.0))
    outputs = {**OUTPUTS, "peak": cj.Peak(cj.quantities.Position("rotor", "x"), "m")}
    settings = cj.Settings(first_step=0.5, coordinates=cj.JointCoordinates())
    table, solution = rejections_of(scene, state, 1.0, settings, outputs=outputs)
    turned = table.length * torque / inertia * (table.start + table.length)
    assert table.counts["rotation"] >= 1
    assert (turned[table.reason == "rotation"] > 0.75).all()
    taken = np.diff(solution.steps.times) * torque / inertia * solution.steps.times[1:]
    assert taken.max() <= 0.75


@pytest.mark.slow
def test_events_are_passed_by_the_steps_that_are_rejected_for_them():
    runs = [(*dropped_rod(), 0.03), (*cj.mechanisms.double_pendulum(), 0.2)]
    runs += [rotating(kind, seed) for kind in KINDS for seed in range(8)]
    passing = []
    for scene, state, end in runs:
        table, solution = rejections_of(scene, state, end)
        assert_contact_events_are_passed(scene, table, solution)
        passing.append(table.counts["contact event"])
    assert passing[0] >= 1 and passing[1] >= 5 and sum(passing[2:]) > 10


@pytest.mark.slow
def test_runs_with_derivatives_list_their_rejected_steps_too():
    scene, state = dropped_rod()
    clearance = {"c": cj.Parameter(lambda s: s.joints["pin"].clearance, cj.Log())}
    found = cj.sensitivities(scene, state, 0.03, clearance, OUTPUTS, [0.03])
    table = found.outputs["rejected"]
    assert sum(table.counts.values()) == found.attempts - found.accepted > 0


def test_rejected_steps_of_a_sweep_are_refused():
    masses = {"mass": cj.Axis(lambda s: s.bodies["ball"].mass, [1.0, 2.0])}
    with pytest.raises(ValueError, match=r"outputs\['rejected'\].*simulate\(\) for it"):
        cj.sweep(*on_spring(), 0.1, axes=masses, outputs=OUTPUTS)
    for name, value in (("count", 0), ("after", np.nan)):
        with pytest.raises(ValueError, match=f"`{name}`"):
            cj.RejectedSteps(**{name: value})

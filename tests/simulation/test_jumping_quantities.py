"""Reductions of quantities that jump at the end of a step: at a breakpoint of a load, or where a
contact of a dashpot begins or ends. They are compared with the change of momentum."""

import jax
import numpy as np
import pytest

import clearjoint as cj
from tests.support.slow import slow_but

GRAVITY, TIME = 9.81, 0.3
ACCELERATION, FORCE = cj.quantities.Acceleration("b", "z"), cj.quantities.ContactForce("floor")


def loaded_ball(rng, start_time):
    """A ball over a floor with a dashpot, under a load that is switched at random times. Return
    also the switched accelerations, and the mass."""
    mass = 10.0 ** rng.uniform(-2, 1)
    stiffness = mass * 10.0 ** rng.uniform(4.5, 5.5)
    law = cj.laws.SpringDashpot(stiffness, np.sqrt(stiffness * mass) * rng.uniform(0.2, 4.0))
    times = start_time + np.sort(rng.uniform(-0.05, TIME + 0.05, 6))
    times[2] = start_time
    load = cj.PiecewiseConstant(np.sort(times), mass * rng.uniform(-20.0, 20.0, 6))
    floor = cj.Stop("ground", "b", normal=(0, 0, 1), law=law, thickness=1.0)
    scene = cj.Scene(
        {"b": cj.Body(mass, (1.0, 1.0, 1.0))},
        {"floor": floor},
        {"load": cj.AppliedLoad("b", force=(0.0, 0.0, load))},
        gravity=(0.0, 0.0, -GRAVITY),
    )
    velocity = (0.0, 0.0, rng.uniform(-2.0, 1.0))
    start = cj.State({"b": cj.body_state((0.0, 0.0, rng.uniform(0.0, 0.1)), velocity=velocity)})
    return scene, start, load, mass


@pytest.mark.filterwarnings("ignore::clearjoint.UnusualValueWarning")
@pytest.mark.parametrize("seed", slow_but([0], range(3)))
def test_integrals_of_what_jumps_are_changes_of_momentum(seed):
    rng = np.random.default_rng(seed)
    start_time = [0.0, 0.1, -7.3][seed]
    scene, start, load, mass = loaded_ball(rng, start_time)
    end, window = start_time + TIME, {"after": start_time + 0.04, "until": float(load.times[4])}
    of_load = cj.Peak(lambda now: ACCELERATION(now) - FORCE(now) / mass, "m/s^2", **window)
    times = np.array([start_time, window["after"], window["until"], end])
    found = cj.simulate(
        scene,
        start,
        end,
        save=cj.Saving(times, states=False),
        settings=cj.Settings(rtol=1e-8),
        outputs={
            "all": cj.Integral(ACCELERATION, "m/s"),
            "part": cj.Statistics(ACCELERATION, "m/s^2", **window),
            "force": cj.Integral(FORCE, "N s"),
            "peak": cj.Peak(FORCE, "N"),
            "range": cj.Statistics(FORCE, "N"),
            "load": of_load,
            "speed": cj.quantities.Velocity("b", "z"),
        },
        start_time=start_time,
    ).outputs
    first, after, until, last = found["speed"]
    np.testing.assert_allclose(found["all"], last - first, atol=1e-5)
    duration = window["until"] - window["after"]
    np.testing.assert_allclose(found["part_mean"] * duration, until - after, atol=1e-5)

    def mean_load(low, high):
        edges = np.unique(np.clip([*load.times, low, high], low, high))
        middles = 0.5 * (edges[1:] + edges[:-1])
        switched = np.maximum(np.searchsorted(load.times, middles, side="right") - 1, 0)
        values = np.asarray(load.values)[switched]
        return np.diff(edges) @ values, values.max()

    momentum = mass * (last - first + GRAVITY * TIME) - mean_load(start_time, end)[0]
    np.testing.assert_allclose(found["force"] / mass, momentum / mass, atol=1e-5)
    # The load just before the end of the window counts, not that from then on.
    highest = mean_load(window["after"], window["until"])[1] / mass - GRAVITY
    np.testing.assert_allclose(found["load"], highest, rtol=1e-12)
    assert found["range_largest"] <= found["peak"] * (1.0 + 1e-3)


def test_a_journal_with_a_dashpot_wears_by_its_impulse():
    """A journal spins without friction and falls onto the wall: the speed of sliding is constant,
    and the integral of the force is the change of momentum."""
    mass, spin, rate, radius = 2.0, 300.0, 1e-15, 0.01
    joint = cj.ClearanceJoint(
        *("ground", "shaft"),
        bearing_radius=radius,
        clearance=2e-4,
        journal_length=0.02,
        law=cj.laws.SpringDashpot(1e6, 3e3),
    )
    body = cj.Body(mass, (1e-2, 1e-2, 1e-2))
    scene = cj.Scene({"shaft": body}, {"pin": joint}, gravity=(0.0, -GRAVITY, 0.0))
    start, end = cj.State({"shaft": cj.body_state((0.0, 0.0, 0.0), spin=(0.0, 0.0, spin))}), 0.03
    wear = {"wear": cj.ArchardWear("pin", rate * 1e9, 1e9)}
    wear["late"] = cj.ArchardWear("pin", rate * 1e9, 1e9, after=0.01)
    axes = {"spin": cj.Axis.initial(lambda state: state.bodies["shaft"].spin[2], [spin, 2 * spin])}
    speed = {"speed": cj.quantities.Velocity("shaft", "y")}
    saved = cj.Saving([0.01], states=False)
    found = cj.sweep(scene, start, end, axes, wear | speed, save=saved, progress=False)
    speeds = found["final_velocity"].sel(body="shaft", component="y").values
    sliding = rate * (radius - 2e-4) * axes["spin"].values
    expected = sliding * mass * (speeds + GRAVITY * end)
    np.testing.assert_allclose(found["wear"], expected, rtol=2e-3)
    later = sliding * mass * (speeds - found["speed"].values[:, 0] + GRAVITY * (end - 0.01))
    np.testing.assert_allclose(found["late"], later, rtol=2e-3)


def rises_of_acceleration(times, loads, rate, place, speed, end):
    """Times at which the acceleration of an oscillator of unit mass under switched loads rises
    through zero, from the solution in closed form on a fine grid."""
    found = []
    last = -1.0 if loads[0] < rate**2 * place else 1.0
    for start, stop, load in zip(times, [*times[1:], end], loads, strict=True):
        elapsed = np.linspace(0.0, stop - start, 20001)
        cosine, sine, middle = np.cos(rate * elapsed), np.sin(rate * elapsed), load / rate**2
        path = middle + (place - middle) * cosine + speed / rate * sine
        acceleration = np.concatenate([[last], -(rate**2) * (path - middle)])
        rises = np.flatnonzero((acceleration[:-1] < 0.0) & (acceleration[1:] >= 0.0))
        found += list(start + elapsed[rises])
        speed = speed * cosine[-1] - rate * (place - middle) * sine[-1]
        place, last = path[-1], acceleration[-1]
    return found


def test_sections_find_rises_before_and_at_jumps():
    """The acceleration of an oscillator with switched loads: one of eight motions has a
    rise in the same step as a jump back below zero."""
    rng, rate, end = np.random.default_rng(8), np.sqrt(300.0), 0.3
    spring = cj.SpringDamper("ground", "b", (-50, 0, 0), (0, 0, 0), stiffness=300.0, free_length=50)
    section = cj.Section(
        cj.quantities.Acceleration("b", "x"), {"x": cj.quantities.Position("b", "x")}
    )
    for _ in range(8):
        times, loads = np.sort([0.0, *rng.uniform(0.02, 0.28, 5)]), rng.uniform(-10.0, 10.0, 6)
        place, speed = rng.uniform(-0.05, 0.05), rng.uniform(-0.5, 0.5)
        load = cj.AppliedLoad("b", force=(cj.PiecewiseConstant(times, loads), 0.0, 0.0))
        body = cj.Body(1.0, (1.0, 1.0, 1.0))
        scene = cj.Scene({"b": body}, forces={"spring": spring, "load": load})
        start = cj.State({"b": cj.body_state((place, 0, 0), velocity=(speed, 0, 0))})
        found = cj.simulate(scene, start, end, outputs={"rises": section}).outputs["rises"].times
        expected = rises_of_acceleration(times, loads, rate, place, speed, end)
        np.testing.assert_allclose(found, expected, atol=2e-5)


def test_gradients_of_peaks_at_moving_events_are_refused():
    """The speed of a body is largest when its load is switched over: its derivative by a mass is
    that at a fixed time, but not that by the time of the switch."""
    load = cj.AppliedLoad("b", force=(cj.PiecewiseConstant([0.0, 0.1], [4.0, -6.0]), 0.0, 0.0))
    scene = cj.Scene({"b": cj.Body(2.0, (1.0, 1.0, 1.0))}, forces={"load": load})
    start = cj.State({"b": cj.body_state((0.0, 0.0, 0.0))})
    paths = {
        "mass": lambda scene: scene.bodies["b"].mass,
        "switch": lambda scene: scene.forces["load"].force[0].times[1],
    }
    fastest = {"speed": cj.Peak(cj.quantities.Velocity("b", "x"), "m/s")}
    predict = cj.predictor(scene, start, 0.2, {"mass": paths["mass"]}, fastest)
    slope = jax.grad(lambda values: predict(values)["speed"])(predict.values)["mass"]
    assert float(slope) == pytest.approx(-4.0 * 0.1 / 2.0**2, rel=1e-6)
    predict = cj.predictor(scene, start, 0.2, paths, fastest)
    with pytest.raises(ValueError, match="at an event at 0.1 s"):
        jax.grad(lambda values: predict(values)["speed"])(predict.values)


@pytest.mark.filterwarnings("ignore::clearjoint.UnusualValueWarning")
def test_gradients_of_peaks_at_an_onset_are_refused():
    """The force of an overdamped contact is largest at the onset, whose time depends on gravity."""
    law = cj.laws.SpringDashpot(1e5, 3e3)
    floor = cj.Stop("ground", "b", normal=(0, 0, 1), law=law, thickness=1.0)
    down = (0.0, 0.0, -GRAVITY)
    scene = cj.Scene({"b": cj.Body(2.0, (1.0, 1.0, 1.0))}, {"floor": floor}, gravity=down)
    start = cj.State({"b": cj.body_state((0.0, 0.0, 0.02))})
    paths = {"gravity": lambda scene: scene.gravity[2]}
    outputs = {"force": cj.Peak(FORCE, "N")}
    predict = cj.predictor(scene, start, 0.1, paths, outputs)
    largest = np.sqrt(2.0 * GRAVITY * 0.02)
    assert float(predict(predict.values)["force"]) == pytest.approx(3e3 * largest, rel=1e-6)
    with pytest.raises(ValueError, match=r"outputs\['force'\].*at an event at 0.0638"):
        jax.grad(lambda values: predict(values)["force"])(predict.values)

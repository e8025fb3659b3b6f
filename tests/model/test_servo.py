"""Servos against SciPy from sample to sample, and exact invariants."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import clearjoint as cj
from studies.robots.sampled_servo import SampledPid
from tests.support.difference_quotients import Places, by_differences, parameters_at
from tests.support.shaft import INERTIA, ON_SHAFT, ORIGIN, Z, shaft, turned
from tests.support.slow import slow_but

TIGHT = cj.Settings(rtol=1e-10)
QUIET = {"progress": False}


def one_inertia(servo, inertia=INERTIA, damping=None):
    across = max(0.03, float(inertia))
    oil = {} if damping is None else {"oil": cj.TorsionalSpring(*ON_SHAFT, 0.0, damping)}
    return shaft(body=cj.Body(1.0, (across, across, inertia)), servo=servo, **oil)


def motion(scene, state, end, times, settings=TIGHT, **options):
    """Angle and speed of the shaft at times, and the solution."""
    outputs = {
        "angle": cj.quantities.JointAngle("bearing"),
        "speed": cj.quantities.JointAngularVelocity("bearing"),
        "torque": cj.quantities.MotorTorque("servo"),
    }
    save = cj.Saving(times, states=False)
    return cj.simulate(scene, state, end, settings, save, outputs=outputs, **options, **QUIET)


def test_a_servo_starts_at_a_sample_of_any_time():
    """After days too, when rounding errors of the time are a part of a period, and if the start is
    a little before the sample."""
    rate = 1000.0
    scene, state = one_inertia(cj.Servo(*ON_SHAFT, 0.5, rate, 20.0, 0.3)), turned(speed=2.0)
    starts = np.array([300, 300, *np.random.default_rng(0).integers(1e7, 1e9, 12)]) / rate
    starts[1] -= 1e-14
    runs = (cj.simulate(scene, state, t + 5.5 / rate, TIGHT, start_time=t) for t in starts)
    ends = [run.final.bodies["shaft"].spin[2] for run in runs]
    np.testing.assert_allclose(ends, ends[0], rtol=1e-7)


def damped_rates(t, y, u):
    """Of the angle and the speed of the shaft in oil, under a torque u."""
    return [y[1], (u - 0.03 * y[1]) / INERTIA]


CASES = {
    "sensor": {"speed_from": "sensor"},
    "one period": {"delay": 0.005, "speed_from": "sensor"},
    "integral": {"integral": 150.0, "delay": 0.002},
    "saturated": {"integral": 40.0, "torque_limit": 1.1},
    "limited speed": {"speed_limit": 1.7, "torque_limit": 3.0},
}


@pytest.mark.parametrize("name", slow_but(["one period", "saturated"], CASES))
def test_it_moves_as_scipy_says_from_sample_to_sample(name):
    """PD and PID of a damped inertia, with a goal that changes between samples."""
    options = CASES[name]
    target = cj.Polynomial([0.5, 0.6, -1.0])
    goal = target.coefficients
    servo = cj.Servo(*ON_SHAFT, target, 200.0, 18.0, derivative=0.25, **options)
    times = np.sort(np.random.default_rng(3).uniform(0.0, 0.4, 30))
    scene = one_inertia(servo, damping=0.03)
    found = motion(scene, turned(0.1, 0.7), 0.4, times).outputs
    law = SampledPid(
        *(200.0, 18.0, 0.25, options.get("integral", 0.0), options.get("delay", 0.0)),
        options.get("torque_limit", np.inf),
        lambda t: goal[0] + goal[1] * t + goal[2] * t**2,
        lambda t: goal[1] + 2.0 * goal[2] * t,
        options.get("speed_limit", np.inf) / 200.0,
        by_difference=options.get("speed_from") != "sensor",
    )
    states, torques = law.run(damped_rates, [0.1, 0.7], 0.4, lambda y: y, times)
    np.testing.assert_allclose(found["angle"], states[:, 0], rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(found["speed"], states[:, 1], rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(found["torque"], torques, rtol=0.0, atol=1e-8)
    if name == "saturated":
        assert (np.abs(torques) == 1.1).sum() > 3 and (np.abs(torques) < 1.0).sum() > 3


def memories(servo, count):
    """The servo's memory at the first samples while its arm is held at zero."""
    still = cj.testing.moving(ORIGIN, (1.0, 0.0, 0.0, 0.0), ORIGIN, ORIGIN)
    held = {"ground": still, "arm": still}
    servo = cj.extend.unpack(servo)
    memory = servo.initial_memory(held, 0.0)
    for k in range(count):
        yield {name: float(value) for name, value in memory.items()}
        memory = servo.updated_memory("sample", memory, held, (k + 1) / 4.0)


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_the_goal_follows_by_its_speed_and_the_integral_up_to_the_limit(sense):
    """Of a jump of the target; all numbers are exact. The integral reaches the limit, of the torque
    or of the motor, and stays."""
    follower = cj.Servo(
        "ground", "arm", Z, 0.5 * sense, 4.0, 2.0, derivative=0.5, speed_limit=0.625
    )
    for k, memory in enumerate(memories(follower, 6), start=1):
        goal, before = (sense * min(0.15625 * number, 0.5) for number in (k, k - 1))
        assert memory["goal"] == goal
        assert memory["torque"] == 2.0 * goal + 0.5 * (goal - before) * 4.0
    motor = {"stall_torque": 0.5, "no_load_speed": 3.0}
    for limits, largest in (
        ({"torque_limit": 0.375}, 0.375),
        ({"torque_limit": 0.375} | motor, 0.375),
        ({"torque_limit": 0.625} | motor, 0.5),
        (motor, 0.5),
    ):
        integrator = cj.Servo("ground", "arm", Z, 0.5 * sense, 4.0, 0.0, integral=1.0, **limits)
        for k, memory in enumerate(memories(integrator, 6), start=1):
            reached = sense * min(0.125 * k, largest)
            assert memory["integral"] == memory["torque"] == reached


PLAY, FLANK, DAMPED = math.radians(0.5), 4e3, 1.5 * 0.5 / 0.3
ROTOR, LINK, WEIGHT = 0.004, 0.02, 0.6
SPEED, DRAG = 0.05, 0.1


def geared(servo):
    """A rotor, play of half a degree, and a link with Stribeck friction and gravity."""
    hinges = {
        f"hinge of the {name}": cj.RevoluteJoint("ground", name, ORIGIN, ORIGIN, Z, Z)
        for name in ("rotor", "link")
    }
    radius = 0.02
    law = cj.laws.MemorylessHuntCrossley(
        0.5, FLANK / radius**2, design_speed=0.3 * radius, exponent=1.0
    )
    rub = cj.frictions.BrownMcPhee(1.3, 1.0, SPEED)
    joints = {
        **hinges,
        "gear": cj.Backlash("rotor", "link", play=PLAY, radius=radius, law=law),
        "friction": cj.JointFriction("ground", "link", rub, DRAG, Z, radius=1.0, viscosity=0.02),
    }
    bodies = {"rotor": cj.Body(0.1, (0.01, 0.01, ROTOR)), "link": cj.Body(1.0, (0.03, 0.03, LINK))}
    # The spring stands for gravity: a constant moment would never reverse the flanks' load.
    forces = {"servo": servo, "weight": cj.TorsionalSpring("ground", "link", Z, WEIGHT, 0.0)}
    return cj.Scene(bodies, joints, forces)


AT_REST = cj.State({name: cj.body_state(ORIGIN) for name in ("rotor", "link")})


def rates_with_play(t, y, u):
    theta = y[1] - y[0], y[3] - y[2]
    load = 0.0
    for side in (1.0, -1.0):
        depth, rate = side * theta[0] - 0.5 * PLAY, side * theta[1]
        if depth > 0.0:
            load += side * FLANK * depth * max(1.0 + DAMPED * rate, 0.0)
    x = y[3] / SPEED
    rub = DRAG * (np.tanh(4.0 * x) + 0.3 * x / (0.25 * x * x + 0.75) ** 2)
    return [y[2], y[3], (u + load) / ROTOR, (-load - rub - 0.02 * y[3] - WEIGHT * y[1]) / LINK]


def swing(t):
    return 0.4 * np.sin(9.0 * t)


TABLE = np.arange(0, 201) / 200.0
"""Times of a log, at the samples of the servo."""


@pytest.mark.parametrize("of_link", [True, pytest.param(False, marks=pytest.mark.slow)])
def test_with_play_and_friction_behind_the_motor(of_link):
    """The encoder sits on the link behind the play, or on the rotor before it. The servo drives the
    rotor, by the steps of a log at its own rate."""
    encoder = cj.Encoder("ground", "link", Z) if of_link else None
    target, gains = cj.PiecewiseConstant(TABLE, swing(TABLE)), (200.0, 8.0, 0.12)
    options = {"delay": 0.005, "torque_limit": 1.5, "encoder": encoder, "torque_constant": 0.5}
    scene = geared(cj.Servo("ground", "rotor", Z, target, *gains, **options))
    times = np.linspace(0.02, 0.4, 20)
    outputs = {
        "rotor": cj.quantities.JointAngle("hinge of the rotor"),
        "link": cj.quantities.JointAngle("hinge of the link"),
        "current": cj.quantities.MotorCurrent("servo"),
    }
    saving = cj.Saving(times, states=False)
    coordinates = cj.JointCoordinates() if of_link else cj.AbsoluteCoordinates()
    settings = cj.Settings(rtol=1e-10, coordinates=coordinates)
    found = cj.simulate(scene, AT_REST, 0.4, settings, saving, outputs=outputs, **QUIET).outputs
    goal = lambda t: swing(math.floor(t * 200.0 + 1e-6) / 200.0)  # noqa: E731
    law = SampledPid(*gains, delay=0.005, limit=1.5, goal=goal)
    read = (lambda y: (y[1], y[3])) if of_link else (lambda y: (y[0], y[2]))
    states, torques = law.run(rates_with_play, np.zeros(4), 0.4, read, times, max_step=2e-4)
    np.testing.assert_allclose(found["rotor"], states[:, 0], rtol=0.0, atol=1e-7)
    np.testing.assert_allclose(found["link"], states[:, 1], rtol=0.0, atol=1e-7)
    np.testing.assert_allclose(found["current"], torques / 0.5, atol=1e-5)
    assert np.abs(states[:, 0] - states[:, 1]).max() > 0.4 * PLAY


def test_any_rate_and_delay():
    """Also delays of whole periods, with which samples and commands coincide; and a late start."""
    times = np.array([0.0923, 0.2])
    for rate in (30.0, 100.0 / 3.0, 333.3):
        for delay in (0.0, 1.0 / rate, 2.0 / rate, 3.0 * (1.0 / rate), 2.37 / rate):
            servo = cj.Servo(*ON_SHAFT, 0.5, rate, 3.0, 0.05, delay=delay, delay_periods=3)
            scene = one_inertia(servo, damping=0.03)
            found = motion(scene, turned(0.1, 0.7), 0.2, times).outputs["angle"]
            law = SampledPid(rate, 3.0, 0.05, delay=delay, goal=lambda t: 0.5)
            rows, _ = law.run(damped_rates, [0.1, 0.7], 0.2, lambda y: y, times)
            np.testing.assert_allclose(found, rows[:, 0], rtol=0.0, atol=1e-9)
            late = motion(scene, turned(0.1, 0.7), 3000.2, 3000.0 + times, start_time=3000.0)
            np.testing.assert_allclose(late.outputs["angle"], rows[:, 0], rtol=0.0, atol=1e-7)


@pytest.mark.parametrize(
    "coordinates",
    [cj.JointCoordinates(), pytest.param(cj.AbsoluteCoordinates(), marks=pytest.mark.slow)],
)
def test_the_voltage_limits_the_torque_between_samples_too(coordinates):
    """A slow servo whose motor reaches its no-load speed within a sample: w' = limit(w)/J."""
    stall, no_load = 0.8, 3.0
    servo = cj.Servo(
        *(*ON_SHAFT, 40.0, 10.0, 3.0), stall_torque=stall, no_load_speed=no_load, torque_limit=0.5
    )
    times = np.linspace(0.0, 0.09, 10)
    settings = cj.Settings(rtol=1e-11, coordinates=coordinates)
    found = motion(one_inertia(servo), turned(), 0.09, times, settings)

    def limited(speed):
        """The command of 0.5 N m, below stall (1 - w/no-load), with a parabola at the kink."""
        width, excess = 0.02 * stall, 0.5 - stall * (1.0 - speed / no_load)
        if abs(excess) < width:
            return 0.5 - (excess + width) ** 2 / (4.0 * width)
        return 0.5 - max(excess, 0.0)

    options = {"method": "DOP853", "t_eval": times, "rtol": 1e-11, "max_step": 1e-4}
    path = solve_ivp(lambda t, y: [limited(y[0]) / INERTIA], (0.0, 0.09), [0.0], **options)
    np.testing.assert_allclose(found.outputs["speed"], path.y[0], atol=1e-6)
    assert found.outputs["torque"][1] == 0.5 and found.outputs["torque"][-1] < 0.4


SERVO = cj.Servo(
    *ON_SHAFT, 0.5, 200.0, 18.0, 0.25, 60.0, delay=0.0031, torque_limit=6.0, offset=0.001
)


SCENE, START_STATE = one_inertia(SERVO, damping=0.03), turned(0.1, 0.7)


PATHS = {
    name: lambda scene, name=name: getattr(scene.forces["servo"], name)
    for name in ("proportional", "derivative", "integral", "delay", "rate", "offset")
} | {"inertia": lambda scene: scene.bodies["shaft"].inertia[2]}
PLACES: Places = {name: (path, 1e-4 * float(path(SCENE))) for name, path in PATHS.items()}


START = 0.0137
"""Between two samples."""


def test_derivatives_are_those_of_the_sampled_motion():
    """Central differences of runs, which SciPy confirms above; also by rate, delay and offset."""
    times = np.array([0.08131, 0.14, 0.2007])
    outputs = {"angle": cj.quantities.JointAngle("bearing")}
    run = SCENE, START_STATE, 0.21, parameters_at(PLACES), outputs, times, TIGHT
    found = cj.sensitivities(*run, start_time=START, **QUIET).derivatives["angle"]

    def angles(scene):
        return motion(scene, START_STATE, 0.21, times, start_time=START).outputs["angle"]

    np.testing.assert_allclose(found, by_differences(SCENE, PLACES, angles), rtol=1e-5)


@pytest.mark.slow
def test_reverse_mode_has_the_same_derivatives():
    """Also of the integral of the squared torque, which jumps at instants that parameters move."""
    times = np.array([0.08131, 0.14, 0.2007])
    torque = cj.quantities.MotorTorque("servo")

    def square(now):
        return torque(now) ** 2

    outputs = {"angle": cj.quantities.JointAngle("bearing"), "torque": torque}
    options = {"settings": TIGHT, "start_time": START}
    run = SCENE, START_STATE, 0.21, parameters_at(PLACES), outputs, times
    found = cj.sensitivities(*run, **options, **QUIET)
    predict = cj.predictor(SCENE, START_STATE, 0.21, PATHS, outputs, times, **options)
    here = {name: jnp.asarray(path(SCENE)) for name, path in PATHS.items()}
    backward = jax.jacrev(predict)(here)
    for name in outputs:
        for k, parameter in enumerate(PATHS):
            np.testing.assert_allclose(
                backward[name][parameter], found.derivatives[name][:, k], rtol=1e-8, atol=1e-9
            )
    effort = {"effort": cj.Integral(square, "N^2 m^2")}
    predict = cj.predictor(SCENE, START_STATE, 0.21, PATHS, effort, **options)
    gradient = jax.grad(lambda values: predict(values)["effort"])(here)

    def efforts(scene):
        run = cj.simulate(scene, START_STATE, 0.21, TIGHT, outputs=effort, start_time=START)
        return run.outputs["effort"]

    expected = dict(zip(PATHS, by_differences(SCENE, PLACES, efforts), strict=True))
    assert gradient == pytest.approx(expected, rel=2e-4)


def test_a_run_continues_from_a_state_in_the_middle():
    """Also at an instant of a sample, where the memory is that after the sample."""
    times = np.array([0.05, 0.1, 0.2])
    whole = motion(SCENE, START_STATE, 0.2, times)
    for middle in (0.0874, 0.086):
        first = motion(SCENE, START_STATE, middle, [middle])
        second = motion(SCENE, first.final, 0.2, times[1:], start_time=middle)
        for name, values in second.outputs.items():
            np.testing.assert_allclose(values, whole.outputs[name][1:], rtol=1e-9)
    # Without the memory it is a servo that is switched on.
    other = cj.State(first.final.bodies)
    assert motion(SCENE, other, 0.2, times[1:], start_time=middle).outputs["angle"][0] != (
        pytest.approx(whole.outputs["angle"][1], rel=1e-6)
    )
    given = {"servo": {"torque": 0.0, "command 0": 0.0, "command 1": 0.0}}
    idle = cj.State(turned().bodies, memory=given)
    assert motion(SCENE, idle, 0.003, [0.003]).outputs["angle"] == pytest.approx(0.0, abs=1e-15)


def test_lanes_of_a_sweep_equal_single_runs():
    times = np.array([0.05, 0.101, 0.2])
    rates = [90.0, 200.0, 310.0]
    axes = {"rate": cj.Axis(PATHS["rate"], rates)}
    outputs = {
        "angle": cj.quantities.JointAngle("bearing"),
        "torque": cj.quantities.MotorTorque("servo"),
    }
    save = cj.Saving(times, states=False)
    swept = cj.sweep(SCENE, START_STATE, 0.2, axes, outputs, TIGHT, save, **QUIET)
    for k, rate in enumerate(rates):
        alone = motion(cj.set_value(SCENE, PATHS["rate"], rate), START_STATE, 0.2, times).outputs
        for name in outputs:
            np.testing.assert_allclose(swept[name][k], alone[name], rtol=1e-9)


def test_it_counts_revolutions():
    """A servo that lags by more than half a revolution does not turn back."""
    target = cj.PiecewiseLinear([0.0, 0.1, 0.6], [0.0, 0.0, 30.0])
    scene = one_inertia(cj.Servo(*ON_SHAFT, target, 200.0, 2.0, 1.0, torque_limit=0.3))
    solution = motion(scene, turned(), 8.0, [0.6, 8.0])
    assert solution.final.memory["servo"]["angle"] == pytest.approx(30.0, abs=1e-3)
    lagging, last = solution.outputs["angle"]
    assert last == pytest.approx(30.0 - 10.0 * np.pi, abs=1e-3)
    # After 0.5 s at 0.3 N m, as far as the target is known modulo a revolution it would be behind.
    assert abs(lagging) < 0.5 * 0.3 / INERTIA * 0.5**2 + 1e-6 < 30.0 - 8.0 * np.pi


@pytest.mark.filterwarnings("ignore::clearjoint.UnusualValueWarning")
def test_reductions_take_the_torque_before_and_after_its_jump():
    """A steady ramp of the target: each held torque, of known length, and the largest of them."""
    target, rate = cj.Polynomial([0.0, 1.0]), 50.0
    servo = cj.Servo(*ON_SHAFT, target, rate, 10.0, torque_constant=0.5)
    scene = one_inertia(servo, inertia=1e9)
    torque = cj.quantities.MotorTorque("servo")
    outputs = {
        "largest": cj.Peak(torque, "N m"),
        "mean": cj.Statistics(torque, "N m"),
        "late": cj.Quantiles(torque, "N m", np.linspace(-0.05, 5.15, 53), [0.5]),
    }
    found = cj.simulate(scene, turned(), 0.5, outputs=outputs, **QUIET).outputs
    # The shaft hardly moves: 25 steps of 10 N m/rad times k/50 rad, the last one held no longer.
    held = 10.0 * np.arange(25) / rate
    assert found["largest"] == pytest.approx(held[-1], rel=1e-6)
    assert found["mean_mean"] == pytest.approx(held.mean(), rel=1e-6)
    assert found["mean_rms"] == pytest.approx(np.sqrt(np.mean(held**2)), rel=1e-6)
    assert found["late_0.5"] == pytest.approx(np.median(held), abs=0.1)


class SampledDamper(cj.extend.AbstractSampledForce):
    """A user's element: a force against the speed that it read last."""

    body: str
    damping: float
    period: float

    def body_names(self):
        return (self.body,)

    def instants(self):
        return {"sample": cj.extend.Periodic(self.period)}

    def initial_memory(self, motions, t):
        return {"force": -self.damping * motions[self.body].velocity.x}

    def updated_memory(self, name, memory, motions, t):
        return self.initial_memory(motions, t)

    def held_wrenches(self, memory, motions, t):
        force = cj.extend.Vector(memory["force"], 0.0, 0.0)
        return {self.body: motions[self.body].wrench(force, cj.extend.ZERO)}


def test_a_sampled_force_of_a_user():
    """Of six bodies, each with its own period T: v(k+1) = v(k) (1 - c T/m)."""
    names = [f"ball {k}" for k in np.random.default_rng(1).permutation(6)]
    bodies = {name: cj.Body(2.0, (1.0, 1.0, 1.0)) for name in names}
    periods = dict(zip(names, np.linspace(0.011, 0.05, 6), strict=True))
    forces = {f"brake of {name}": SampledDamper(name, 3.0, t) for name, t in periods.items()}
    state = cj.State({name: cj.body_state(ORIGIN, velocity=(1.0, 0.0, 0.0)) for name in names})
    final = cj.simulate(cj.Scene(bodies, forces=forces), state, 0.2, **QUIET).final
    for name, period in periods.items():
        count, rest = divmod(0.2 + 1e-12, period)
        expected = (1.0 - 1.5 * period) ** count * (1.0 - 1.5 * rest)
        assert final.bodies[name].velocity[0] == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"delay": 0.011}, r"`delay` must be at most .* 1/\(200.0 Hz\), but is 0.011"),
        ({"speed_from": "encoder"}, "`speed_from` must be in"),
        ({"delay_periods": 0}, "`delay_periods` must be a whole number"),
        ({"stall_torque": 1.0}, "`no_load_speed` must be given together with `stall_torque`"),
        ({"no_load_speed": 1.0}, "`stall_torque` must be given together with `no_load_speed`"),
        ({"torque_limit": -1.0}, "`torque_limit` must be positive"),
    ],
)
def test_wrong_arguments_are_refused(options, words):
    with pytest.raises(ValueError, match=words):
        cj.Servo(*ON_SHAFT, 0.5, 200.0, 18.0, **options)


@pytest.mark.parametrize(
    ("memory", "words"),
    [
        (
            {"servos": {}},
            r"`state.memory` must be of sampled forces of the scene, \['servo'\].*did",
        ),
        (
            {"servo": {"torqe": 0.0}},
            r"`state.memory\['servo'\]` must be one of.*did you mean 'torque",
        ),
    ],
)
def test_a_memory_of_another_name_is_refused(memory, words):
    with pytest.raises(ValueError, match=words):
        cj.simulate(SCENE, cj.State(turned().bodies, memory=memory), 0.1, **QUIET)


def test_servos_are_refused_where_they_do_not_belong():
    with pytest.raises(ValueError, match="without sampled forces, but is .'servo'.: take simulate"):
        cj.simulate_nonsmooth(SCENE, turned(), 0.1, step=1e-3)
    axes = {"delay": cj.Axis(PATHS["delay"], [0.001, 0.011])}
    outputs = {"top": cj.Peak(cj.quantities.JointAngle("bearing"), "rad")}
    with pytest.warns(UserWarning, match="Lane 1: Argument `delay` must be at most"):
        cj.sweep(SCENE, turned(), 0.1, axes, outputs, **QUIET)
    with pytest.raises(ValueError, match="`torque_constant` must be that of 'servo' in N m/A"):
        cj.quantities.MotorCurrent("servo").check(SCENE)
    for quantity in (cj.quantities.MotorCurrent("servos"), cj.quantities.MotorTorque("servos")):
        with pytest.raises(ValueError, match="`drive` must be one of"):
            quantity.check(SCENE)

"""Play, friction and inertia of robots from logs that SciPy simulates."""

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

import clearjoint as cj
from clearjoint import plot
from studies.robots.geared_joint import COUNTS, NOISE, GearedJoint, log_table, swinging
from tests.support.rig import rig

JOINT = GearedJoint()
FIND = {"elbow": {"play": "1 deg", "friction": None, "damping": None, "inertia": 0.02}}
TRUTH = {
    "elbow play": JOINT.play,
    "elbow friction": JOINT.friction,
    "elbow damping": JOINT.damping,
    "elbow inertia": JOINT.inertia,
}
DRY = cj.frictions.RegularisedCoulomb(1.0, 1e-4)
QUIET = {"progress": False}


@pytest.fixture
def with_drive(tmp_path):
    """Returns the robot with a drive whose play is twice the true one."""

    def make(**options):
        gear = {"stiffness": JOINT.stiffness, "damping": JOINT.flank_damping}
        drive = cj.Drive(armature=JOINT.armature, play="1 deg", **gear, **options)
        return rig(tmp_path).with_drive("elbow", drive)

    return make


@pytest.fixture
def robot(with_drive):
    return with_drive()


def log_of(table, side="elbow"):
    encoder = cj.LogColumn.encoder("counts", COUNTS, zero=2048, noise=NOISE)
    current = cj.LogColumn.current("i", torque_constant=0.05, ratio=100.0)
    options = {"angles": {side: encoder}, "torques": {"elbow": current}}
    return cj.RobotLog.read(table, time="t", **options)


def held(found):
    """Which intervals hold the true values."""
    limits = found.fit.intervals
    return {name: limits[name][0] <= value <= limits[name][1] for name, value in TRUTH.items()}


def test_play_friction_and_inertia_of_a_log(robot):
    table = log_table(JOINT, *swinging(0, 1.5))
    found = cj.fit_robot(robot, log_of(table), FIND, {"elbow": "torque"}, grow=(), **QUIET)
    estimates = found.fit.estimates
    for name, (low, high) in found.fit.intervals.items():
        if name in TRUTH:
            assert low < TRUTH[name] < high
            assert estimates[name] == pytest.approx(TRUTH[name], rel=0.2), name
    assert found.fit.p_value > 1e-3 and not found.undetermined
    assert found.robot.scene.joints["elbow backlash"].play == estimates["elbow play"]
    assert "elbow drive" not in found.robot.scene.forces
    loop = found.hysteresis()["elbow"]
    assert np.abs(loop.position - loop.predicted_position).max() < 6 * NOISE * 2 * np.pi / COUNTS
    np.testing.assert_array_equal(loop.torque, loop.predicted_torque)
    (axes,) = plot.joint_hysteresis(found)
    np.testing.assert_array_equal(axes.get_lines()[1].get_xdata(), loop.predicted_position)
    assert found.to_dataframe().loc["elbow play", "estimate"] == estimates["elbow play"]


def test_a_load_that_never_reverses_does_not_show_the_play(with_drive):
    robot = with_drive(friction=JOINT.friction, viscosity=JOINT.damping, law=DRY)
    # The motor holds the link against gravity, and moves it little.
    held_up = JOINT.mass * 9.81 * JOINT.length * np.sin(0.8)
    times, torques = swinging(0, 0.5, size=0.3)
    table = log_table(JOINT, times, torques + held_up, start=0.8)
    found = cj.fit_robot(robot, log_of(table), {"elbow": ["play"]}, {"elbow": "torque"}, **QUIET)
    sentence = "The play of elbow cannot be determined: the motion never reverses its load."
    assert found.undetermined == {"elbow play": sentence}
    assert found.held["elbow play"] == (pytest.approx(np.radians(1.0)), "rad")
    assert sentence in str(found) and "not identifiable" in str(found)
    assert np.isnan(found.to_dataframe().loc["elbow play", "low"])


def test_a_friction_of_zero_is_bounded_and_makes_no_other_estimate_wrong(robot, with_drive):
    log = log_of(log_table(replace(JOINT, friction=0.0), *swinging(1, 1.5), seed=1))
    options = {"driven_by": {"elbow": "torque"}, "grow": (), **QUIET}
    # A bias of less than the noise is not determined either.
    bias = {"bias": cj.Parameter.bias("elbow position", scale=cj.Linear(1e-12))}
    found = cj.fit_robot(robot, log, FIND, parameters=bias, **options)
    assert found.held["bias"] == (0.0, "rad")
    low, high = found.limits["elbow friction"]
    estimates, errors = found.fit.estimates, found.fit.standard_errors
    for name, value in TRUTH.items():
        assert name == "elbow friction" or abs(estimates[name] - value) < 3.3 * errors[name], name
    assert low == 0.0 and found.fit.p_value > 1e-3
    assert (
        f"is at most {high:.3g} N m (95 %): a smaller value" in found.undetermined["elbow friction"]
    )
    assert (
        found.to_dataframe().loc["elbow friction", "high"] == found.intervals["elbow friction"][1]
    )
    # With a known friction at the limit, chi squared is about 3.84 higher, or more if it rises
    # already from zero on.
    known = with_drive(friction=high, law=DRY)
    others = {"elbow": {name: start for name, start in FIND["elbow"].items() if name != "friction"}}
    rise = cj.fit_robot(known, log, others, **options).fit.chi_squared - found.fit.chi_squared
    assert 3.0 < rise < 10.0


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(12))
def test_random_joints_are_found_from_the_same_starts(seed, robot):
    """A third of them without friction, a third without damping, and a third without play."""
    generator = np.random.default_rng(1000 + seed)

    def drawn(low, high, nothing):
        if generator.random() < 1.0 / 3.0:
            return nothing
        return float(np.exp(generator.uniform(np.log(low), np.log(high))))

    truth = {"friction": drawn(0.05, 0.5, 0.0), "damping": drawn(0.01, 0.2, 0.0)}
    play, inertia = drawn(0.003, 0.02, 1e-7), drawn(0.005, 0.03, 0.02)
    joint, side = replace(JOINT, play=play, inertia=inertia, **truth), ("elbow", "elbow motor")
    motion = swinging(seed, generator.uniform(1.5, 3.0))
    log = log_of(log_table(joint, *motion, side=side[seed % 2], seed=seed), side[seed % 2])
    found = cj.fit_robot(robot, log, FIND, {"elbow": "torque"}, **QUIET)
    values = found.to_dataframe()["estimate"]
    assert found.fit.p_value > 1e-4
    for kind, value in truth.items():
        assert values[f"elbow {kind}"] == pytest.approx(value, rel=0.02, abs=3e-3), kind
    assert values["elbow inertia"] == pytest.approx(inertia, rel=0.02)
    assert found.intervals["elbow play"][0] <= play + 3e-3


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1, 2, 3])
def test_a_log_without_play_does_not_show_one(robot, seed):
    log = log_of(log_table(replace(JOINT, play=1e-7), *swinging(seed, 1.5), seed=seed))
    found = cj.fit_robot(robot, log, FIND, {"elbow": "torque"}, **QUIET)
    low, high = found.intervals["elbow play"]
    assert low < 1e-5 and high < np.radians(1.0)  # below the start
    assert found.fit.chi_squared <= chi_squared_of_truth(found, {"elbow play": 1e-7})


def chi_squared_of_truth(found, others=()):
    """Chi squared of one run with the true values, from rest at zero in the middle of the play."""
    fit = found.fit
    known = {**TRUTH, **dict(others)}
    true = {name: known.get(name, 0.0) for name in fit.parameters}
    once = {"guess": true, "max_iterations": 1, "check_runs": 0, **QUIET}
    return cj.identify(fit.scene, fit.state, fit.measurements, fit.parameters, **once).chi_squared


@pytest.mark.slow
@pytest.mark.parametrize("side", ["elbow", "elbow motor"])
def test_intervals_hold_the_truth_in_27_of_30_draws(side, robot):
    counts = dict.fromkeys(TRUTH, 0)
    for seed in range(30):
        log = log_of(log_table(JOINT, *swinging(seed, 6.0), side=side, seed=seed), side)
        found = cj.fit_robot(robot, log, FIND, {"elbow": "torque"}, **QUIET)
        counts = {name: counts[name] + inside for name, inside in held(found).items()}
        # In the lowest minimum, the likelihood is at least that of the truth.
        assert found.fit.chi_squared <= chi_squared_of_truth(found), seed
    assert min(counts.values()) >= 27, counts


@dataclass(frozen=True)
class StartsInPlay(GearedJoint):
    """A joint whose rotor starts at a place in the play, from -1 to 1."""

    place: float = 0.0

    def at_rest(self, angle):
        return super().at_rest(angle) + np.array([0.5 * self.place * self.play, 0.0, 0.0, 0.0])


@pytest.mark.slow
@pytest.mark.parametrize("place", [-1.0, 1.0])
def test_a_motor_that_starts_at_a_flank(place, robot):
    table = log_table(StartsInPlay(place=place), *swinging(0, 3.0))
    found = cj.fit_robot(robot, log_of(table), FIND, {"elbow": "torque"}, **QUIET)
    fit = found.fit
    assert not found.undetermined and fit.estimates["elbow motor start in the play"] * place > 0.5
    for name, value in TRUTH.items():
        assert abs(fit.estimates[name] - value) < 3.3 * fit.standard_errors[name], name


@pytest.mark.slow
def test_torques_of_a_joint_that_follows_its_angle(tmp_path):
    """Against linear least squares of torque = J q'' + m g l sin q + c sign q' + d q'."""
    robot = rig(tmp_path, inertia=0.02)
    times = np.arange(3001) / 1000.0  # the second derivative of a spline errs by (w h)^2 / 12
    phase = 2.0 * np.pi * times
    q, qd = 0.6 * np.sin(phase) + 0.2 * np.sin(2.3 * phase), np.zeros(0)
    qd = 2 * np.pi * (0.6 * np.cos(phase) + 0.46 * np.cos(2.3 * phase))
    qdd = -((2 * np.pi) ** 2) * (0.6 * np.sin(phase) + 0.2 * 2.3**2 * np.sin(2.3 * phase))
    about_joint = JOINT.inertia + JOINT.mass * JOINT.length**2
    weight = JOINT.mass * 9.81 * JOINT.length * np.sin(q)
    resisting = JOINT.friction * np.sign(qd) + JOINT.damping * qd
    noise = 0.02 * np.random.default_rng(0).standard_normal(len(times))
    torques = about_joint * qdd + weight + resisting + noise
    table = pd.DataFrame({"t": times, "q [rad]": q, "tau [N m]": torques})
    torque = cj.LogColumn("tau", noise=0.02)
    log = cj.RobotLog.read(table, angles={"elbow": "q"}, torques={"elbow": torque})
    find = {"elbow": ["friction", "damping", "inertia"]}
    found = cj.fit_robot(robot, log, find, {"elbow": "angle"}, **QUIET)
    columns = np.stack([np.sign(qd), qd, qdd], axis=1)
    fixed = weight + JOINT.mass * JOINT.length**2 * qdd
    expected, *_ = np.linalg.lstsq(columns, torques - fixed, rcond=None)
    errors = 0.02 * np.sqrt(np.diag(np.linalg.inv(columns.T @ columns)))
    names = ["elbow friction", "elbow damping", "elbow inertia"]
    for name, value, error in zip(names, expected, errors, strict=True):
        assert found.fit.estimates[name] == pytest.approx(value, abs=0.3 * error)
        assert found.fit.standard_errors[name] == pytest.approx(error, rel=0.05)


def servo_log(gain, size, noise=1e-4):
    """A log of a motor on a rigid joint, which SciPy simulates, with the delay and the bias of its
    sensor: goals and positions, and the positions without noise."""
    times = np.arange(0.0, 0.8, 0.005)
    goals = size * (1.0 - np.cos(9.0 * times))
    about_joint = JOINT.inertia + JOINT.mass * JOINT.length**2 + JOINT.armature

    def rates(t, y):
        goal = goals[min(int(t / 0.005 + 1e-9), len(goals) - 1)]
        resisting = JOINT.friction * np.tanh(y[1] / 1e-4) + JOINT.damping * y[1]
        torque = gain * (goal - y[0]) - JOINT.weight * np.sin(y[0]) - resisting
        return y[1], torque / about_joint

    options = {"method": "LSODA", "rtol": 1e-9, "atol": 1e-11, "max_step": 1e-3}
    motion = solve_ivp(rates, (0.0, 0.8), (0.0, 0.0), dense_output=True, **options)
    angles = motion.sol(np.maximum(times - DELAY, 0.0))[0] + BIAS
    noisy = angles + noise * np.random.default_rng(0).standard_normal(len(times))
    table = pd.DataFrame({"t": times, "goal [rad]": goals, "q [rad]": noisy})
    columns = {"elbow": cj.LogColumn("q", noise=noise)}, {"elbow": "goal"}
    return cj.RobotLog.read(table, angles=columns[0], goals=columns[1]), angles


DELAY, BIAS = 0.008, 0.02


def test_logs_that_were_not_fitted_are_predicted(tmp_path):
    drive = cj.Drive(armature=JOINT.armature, friction=0.15, viscosity=0.1, law=DRY)
    robot = rig(tmp_path).with_drive("elbow", drive)
    motor = cj.Motor(*robot.motor_side("elbow"), 0.0, proportional=20.0, derivative=0.0)
    sensor = {
        "delay": cj.Parameter.delay("elbow position"),
        "bias": cj.Parameter.bias("elbow position"),
    }
    log, _ = servo_log(20.0, 0.4)
    find, options = {"elbow": ["friction", "damping"]}, {"parameters": sensor, "grow": (), **QUIET}
    found = cj.fit_robot(robot, log, find, {"elbow": motor}, **options)
    for name in ("elbow friction", "elbow damping", "delay", "bias"):
        low, high = found.fit.intervals[name]
        assert low < (TRUTH | {"delay": DELAY, "bias": BIAS})[name] < high, name
    # The friction of a drive without play is that of the fit, and not a second one.
    assert [n for n in found.robot.scene.joints if "friction" in n] == ["elbow motor friction"]
    np.testing.assert_allclose(
        found.predict(log)["elbow position"], found.predictions["elbow position"], atol=3e-4
    )
    other, expected = servo_log(35.0, -0.3)
    stiffer = {"elbow": replace(motor, proportional=35.0)}
    predicted = found.predict(other, stiffer)["elbow position"]
    np.testing.assert_allclose(predicted, expected, atol=1e-3)
    assert np.abs(found.predict(other)["elbow position"] - expected).max() > 0.02


def test_a_poor_fit_with_a_delay_is_tried_again_in_windows(tmp_path):
    drive = cj.Drive(armature=JOINT.armature, friction=0.15, viscosity=0.1, law=DRY)
    robot = rig(tmp_path).with_drive("elbow", drive)
    motor = cj.Motor(*robot.motor_side("elbow"), 0.0, proportional=20.0, derivative=0.0)
    delay = {"delay": cj.Parameter.delay("elbow position")}
    log, _ = servo_log(20.0, 0.4)  # with a bias, which the fit lacks
    options = {"parameters": delay, "max_iterations": 4, **QUIET}
    with pytest.warns(UserWarning):
        result = cj.fit_robot(robot, log, {"elbow": ["damping"]}, {"elbow": motor}, **options)
    assert result.fit.p_value < 1e-3 and {"delay", "elbow damping"} <= result.fit.estimates.keys()
    assert len(result.fit.searches) > 1


@pytest.mark.slow
def test_the_loss_of_a_gear_is_found(tmp_path):
    """Two inertias on a spring, whose torque times the loss adds to the friction of the rotor."""
    gear = {"stiffness": 200.0, "damping": 0.5}
    drive = cj.Drive(armature=JOINT.armature, friction=0.2, loss=0.1, law=DRY, **gear)
    robot = rig(tmp_path).with_drive("elbow", drive)
    times, torques = swinging(0, 2.0, size=1.5)
    torque, about_joint = CubicSpline(times, torques, bc_type="natural"), JOINT.inertia + 0.0625

    def rates(t, y):
        spring = 200.0 * (y[1] - y[0])
        transmitted = spring + 0.5 * (y[3] - y[2])
        resisting = (0.2 + 0.3 * abs(spring)) * np.tanh(y[2] / 1e-4)
        of_link = (-JOINT.weight * np.sin(y[1]) - transmitted) / about_joint
        return y[2], y[3], (torque(t) - resisting + transmitted) / JOINT.armature, of_link

    options = {"method": "LSODA", "t_eval": times, "rtol": 1e-8, "atol": 1e-10, "max_step": 2e-3}
    angles = solve_ivp(rates, (0.0, 2.0), np.zeros(4), **options).y[1]
    noisy = angles + 1e-3 * np.random.default_rng(0).standard_normal(len(times))
    table = pd.DataFrame({"t": times, "q [rad]": noisy, "tau [N m]": torques})
    angle = cj.LogColumn("q", noise=1e-3)
    log = cj.RobotLog.read(table, angles={"elbow": angle}, torques={"elbow": "tau"})
    find = {"elbow": ["friction", "loss"]}
    found = cj.fit_robot(robot, log, find, {"elbow": "torque"}, grow=(), **QUIET)
    for name, value in {"elbow friction": 0.2, "elbow loss": 0.3}.items():
        low, high = found.fit.intervals[name]
        assert low < value < high and high - low < 0.1, (name, low, high)


LOG = log_of(log_table(JOINT, *swinging(0, 0.1)))
WRONG = {
    "joint": ({"elbo": ["play"]}, {"elbow": "torque"}, "one of elbow, but is 'elbo': .*'elbow'"),
    "kind": ({"elbow": ["plays"]}, {"elbow": "torque"}, "one of play, stiffness.*'play'"),
    "text": ({"elbow": "play"}, {"elbow": "torque"}, "a list or dictionary, but is 'play'"),
    "unit": ({"elbow": {"play": "1 kg"}}, {"elbow": "torque"}, "find, `elbow.play`: found '1 kg'"),
    "zero": ({"elbow": {"friction": 0.0}}, {"elbow": "torque"}, r"'friction'\]` must be.* is 0.0"),
    "mode": ({"elbow": ["play"]}, {"elbow": "torques"}, "one of angle, torque, held torque"),
    "not logged": ({"elbow": ["play"]}, {"elbow": "angle"}, "what the log has for 'elbow motor'"),
    "no loss": ({"elbow": ["loss"]}, {"elbow": "torque"}, "whose drive has a loss.*with_drive"),
    "no law": ({"elbow": ["restitution"]}, {"elbow": "torque"}, "a law with a restitution"),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_does_not_fit_together_is_refused(name, robot):
    find, driven_by, message = WRONG[name]
    with pytest.raises(ValueError, match=message):
        cj.fit_robot(robot, LOG, find, driven_by, **QUIET)


def test_unknown_noise_and_play_are_refused(robot, tmp_path):
    table = log_table(JOINT, *swinging(0, 0.1))
    table["q [rad]"] = table["counts"] * 1e-3
    current = cj.LogColumn.current("i", 0.05)
    log = cj.RobotLog.read(table, angles={"elbow": "q"}, torques={"elbow": current})
    with pytest.raises(ValueError, match="noise of 'elbow position'.*pass LogColumn"):
        cj.fit_robot(robot, log, FIND, {"elbow": "torque"}, **QUIET)
    wrong = {"parameters": {"b": cj.Parameter.bias("elbow torque")}}
    with pytest.raises(ValueError, match="must be a bias of measured series: elbow position, but"):
        cj.fit_robot(robot, LOG, FIND, {"elbow": "torque"}, **wrong, **QUIET)
    bare = rig(tmp_path)
    with pytest.raises(ValueError, match="'elbow backlash' in the scene.*with_drive"):
        cj.fit_robot(bare, LOG, {"elbow": ["play"]}, {"elbow": "torque"}, **QUIET)
    with pytest.raises(ValueError, match="joint with an armature.*with_drive"):
        cj.fit_robot(bare, LOG, {"elbow": ["armature"]}, {"elbow": "torque"}, **QUIET)

"""What goal and position of a servo tell of the joint that it moves: the servo and a geared joint
with play are simulated by SciPy, and fitted with `cj.Servo`, and with the continuous `cj.Motor`."""

import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

import clearjoint as cj
from clearjoint.plot import style
from studies.robots.draws import COVERAGE, Draw, coverage
from studies.robots.geared_joint import COUNTS, NOISE, RATE, URDF, GearedJoint, counted, swinging
from studies.robots.sampled_servo import SampledPid

JOINT = GearedJoint()
PROPORTIONAL, DERIVATIVE = 12.0, 0.4
"""Gains of the servo, N m/rad and N m s/rad."""
END = 6.0
"""Length of the log, s."""
DRAWS = 30
TRUTH = {
    "elbow play": JOINT.play,
    "elbow friction": JOINT.friction,
    "elbow damping": JOINT.damping,
    "elbow inertia": JOINT.inertia,
}
FIND = {"elbow": {"play": "1 deg", "friction": 0.1, "damping": 0.02, "inertia": 0.02}}


def servo_log(seed: int, end: float = END) -> pd.DataFrame:
    """Return a log of goal and position of the link, by an encoder there; at each sample the servo
    reads both, and one sample later its torque acts until the next."""
    times, goals = swinging(seed, end, size=0.5)
    law = SampledPid(
        RATE,
        PROPORTIONAL,
        DERIVATIVE,
        delay=1.0 / RATE,
        goal=lambda t: goals[round(t * RATE)],
    )
    states, _ = law.run(
        lambda t, y, torque: JOINT.rates(y, torque),
        JOINT.at_rest(0.0),
        end,
        lambda y: (y[1], y[3]),
        times,
        method="LSODA",
        rtol=1e-8,
        atol=1e-10,
    )
    return pd.DataFrame({"t": times, "goal [rad]": goals, "counts": counted(states[:, 1], seed)})


def robot() -> cj.results.Robot:
    """Return the robot with a drive whose play is twice the true one."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "rig.urdf"
        path.write_text(URDF.format(inertia=JOINT.inertia))
        gear: dict[str, Any] = {"stiffness": JOINT.stiffness, "damping": JOINT.flank_damping}
        drive = cj.Drive(armature=JOINT.armature, play="1 deg", **gear)
        return cj.load_robot(path).with_drive("elbow", drive)


def fitted(table: pd.DataFrame, sampled: bool = True) -> Draw:
    """Return the fit of a log by a `Servo`, or by a `Motor` with the same gains."""
    rig, begun = robot(), time.process_time()
    gains: dict[str, Any] = {"proportional": PROPORTIONAL, "derivative": DERIVATIVE}
    side = rig.motor_side("elbow")
    if sampled:
        encoder = cj.Encoder(*rig.link_side("elbow"))
        drive = cj.Servo(*side, 0.0, RATE, **gains, delay=1.0 / RATE, encoder=encoder)
    else:
        drive = cj.Motor(*side, 0.0, **gains)
    log = cj.RobotLog.read(
        table,
        angles={"elbow": cj.LogColumn.encoder("counts", COUNTS, zero=2048, noise=NOISE)},
        goals={"elbow": "goal"},
    )
    found = cj.fit_robot(rig, log, FIND, {"elbow": drive}, progress=False)
    return Draw(found, TRUTH, time.process_time() - begun)


def measure(quick: bool) -> tuple[list[tuple[str, ...]], Draw]:
    """Return the table of true values, estimates and coverage, head first, and the first draw."""
    end = 1.5 if quick else END
    draws = [fitted(servo_log(seed, end)) for seed in range(1 if quick else DRAWS)]
    first, by_motor = draws[0], fitted(servo_log(0, end), sampled=False)
    head = "parameter", "true", "by `Servo`", *COVERAGE, "by `Motor`"
    rows: list[tuple[str, ...]] = [head]
    for name, value in TRUTH.items():
        servo, motor = (f"{draw.estimate(name):.4g}" for draw in (first, by_motor))
        rows.append((name, f"{value:.4g}", servo, *coverage(draws, name), motor))
    servo, motor = (f"{draw.mean_square:.3g}" for draw in (first, by_motor))
    rows.append(("mean square of the residuals", "1", servo, "", "", motor))
    median, motor = np.median([draw.seconds for draw in draws]), by_motor.seconds
    rows.append(("processor time of a fit", "", f"{median:.1f} s", "", "", f"{motor:.1f} s"))
    return rows, first


def figure(draw: Draw) -> Figure:
    """Draw the last second of a log: the goal, and the position as logged and as predicted."""
    series = draw.found.fit.measurements.series["elbow position"]
    goals, times = draw.found.log.goals["elbow"], np.asarray(series.times)
    predicted, shown = draw.found.predictions["elbow position"], times >= times[-1] - 1.0
    canvas = Figure(figsize=(7.0, 4.5), layout="constrained")
    above, below = canvas.subplots(2, 1, sharex=True, height_ratios=(2, 1))
    late = goals.times >= times[-1] - 1.0
    above.step(goals.times[late], goals.values[late], where="post", color=style.GREY, label="goal")
    above.plot(times[shown], np.asarray(series.values)[shown], ".", markersize=2, label="logged")
    above.plot(times[shown], predicted[shown], color=style.VERMILLION, label="predicted")
    above.set_ylabel("angle, rad")
    above.legend()
    residuals = draw.found.fit.residuals["elbow position"]
    below.plot(times[shown], np.asarray(residuals)[shown], ".", markersize=3)
    below.set(xlabel="time, s", ylabel="residual over noise")
    return canvas

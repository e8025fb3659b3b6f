"""Public logs of robots: our fit, and the prediction of logs that were not fitted, beside that of
MuJoCo's standard joint."""

import json
import tempfile
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

import clearjoint as cj
from clearjoint.plot import style
from studies.robots.standard_joint import Numbers, StandardJoint, standard_currents

Rows = list[tuple[str, ...]]
COUNT = 2.0 * np.pi / 4096
"""Resolution of the encoders of both servos, rad."""
URDF = """<robot name="rig"><link name="base"/><link name="arm"><inertial>
<origin xyz="0 0 -{length}"/><mass value="{mass}"/>
<inertia ixx="{inertia}" iyy="{inertia}" izz="{inertia}" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="servo" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
</joint></robot>"""


@dataclass(frozen=True)
class Prediction:
    """Logged position of a log that was not fitted, and what two fits predict, (N,) rad."""

    title: str
    times: np.ndarray
    logged: np.ndarray
    ours: np.ndarray
    mujoco: np.ndarray


def rms(*differences: np.ndarray) -> float:
    """Return the root mean square of all numbers."""
    return float(np.sqrt(np.mean(np.concatenate(differences) ** 2)))


def rig(joint: StandardJoint, drive: cj.Drive) -> cj.results.Robot:
    """Return the robot of the same link, with a drive."""
    numbers = {"length": joint.length, "mass": joint.mass, "inertia": joint.inertia}
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings(action="ignore"):
        path = Path(folder) / "rig.urdf"
        path.write_text(URDF.format(**numbers))
        return cj.load_robot(path).with_drive("servo", drive)


def fitted(*arguments: object, **options: object) -> cj.results.RobotFit:
    """Return a fit, without the warning that real residuals are above the noise of the encoder."""
    with warnings.catch_warnings(action="ignore", category=cj.PoorFitWarning):
        return cj.fit_robot(*arguments, **options, grow=(), progress=False)  # pyright: ignore


def estimates(found: cj.results.RobotFit, names: Mapping[str, str]) -> Rows:
    """Return estimates and 95 % intervals of parameters, which are named in the table."""
    rows = []
    for name, shown in names.items():
        if name in found.intervals:
            value = found.held[name][0] if name in found.held else found.fit.estimates[name]
            low, high = found.intervals[name]
            rows.append((shown, f"{value:.3g}", f"{low:.3g} to {high:.3g}"))
        else:
            rows.append((shown, "not identifiable", ""))
    return rows


def figure(shown: list[Prediction]) -> Figure:
    """Draw logged and predicted positions."""
    canvas = Figure(figsize=(7.0, 2.6 * len(shown)), layout="constrained")
    for axes, part in zip(np.atleast_1d(canvas.subplots(len(shown), 1)), shown, strict=True):
        since = part.times - part.times[0]
        axes.plot(since, part.logged, ".", color=style.GREY, markersize=3, label="logged")
        axes.plot(since, part.ours, color=style.BLUE, label="clearjoint")
        axes.plot(since, part.mujoco, "--", color=style.VERMILLION, label="MuJoCo's joint")
        axes.set(title=part.title, ylabel="angle, rad")
    axes.set_xlabel("time, s")
    canvas.axes[0].legend()
    return canvas


# A pendulum on a servo, Rhoban/bam. ------------------------------------------------------------

PENDULUM = StandardJoint(mass=0.49, length=0.1, inertia=1e-5)
KP = 200
"""Gain of the servo in the log that is fitted, in its units."""
DUTY = 4096 / (2.0 * np.pi) / (256 * 885)
"""Share of the voltage per unit of gain and rad, of the firmware, by the authors."""
TRAJECTORIES = "sin_time_square", "sin_sin", "up_and_down", "lift_and_drop"
START: Numbers = {"friction": 0.02, "damping": 0.02, "armature": 2e-3, "gain": 0.4}


def pendulum_logs(folder: Path) -> dict[tuple[int, str], cj.RobotLog]:
    """Return the logs of the XL330 by gain and trajectory, as long as the torque is on."""
    logs = {}
    for path in sorted(folder.glob("*.json")):
        content = json.loads(path.read_text())
        table = pd.DataFrame(content["entries"])
        logs[content["kp"], content["trajectory"]] = cj.RobotLog.read(
            table.head(int(np.cumprod(table["torque_enable"].to_numpy(int)).sum())),
            time="timestamp",
            angles={"servo": cj.LogColumn("position [rad]", noise=COUNT / np.sqrt(12.0))},
            goals={"servo": "goal_position [rad]"},
        )
    return logs


def pendulum(folder: Path) -> tuple[list[Rows], list[Prediction]]:
    """Fit one log of the pendulum, and predict those of other trajectories and gains."""
    logs = pendulum_logs(folder)
    drive = cj.Drive(armature=2e-3, stiffness=100.0, damping=0.1, friction=0.02, loss=0.2)
    robot = rig(PENDULUM, drive)
    behind = {"delay": 2e-3, "encoder": cj.Encoder(*robot.link_side("servo"))}
    servo = cj.Servo(*robot.motor_side("servo"), 0.0, 500.0, START["gain"], **behind)
    find = {"servo": {"friction": None, "damping": 0.02, "armature": None, "loss": None}}
    further = {
        "gain": cj.Parameter(lambda s: s.forces["servo drive"].proportional, cj.Log()),
        "offset": cj.Parameter.bias("servo position"),
    }
    log = logs.pop((KP, TRAJECTORIES[0]))
    found = fitted(robot, log, find, {"servo": servo}, parameters=further)
    standard = PENDULUM.fitted(log, {**START, "offset": 0.0})

    def both(kp: int, log: cj.RobotLog) -> tuple[np.ndarray, np.ndarray]:
        # The gain tells the torque at full voltage too.
        own, other = (
            {"gain": gain * kp / KP, "limit": gain / (KP * DUTY)}
            for gain in (found.fit.estimates["gain"], standard["gain"])
        )
        changes = {"proportional": own["gain"], "torque_limit": own["limit"]}
        driven_by = {"servo": replace(found.fit.scene.forces["servo drive"], **changes)}
        ours = found.predict(log, driven_by)["servo position"]
        return ours, PENDULUM.predicted(standard | other, log)

    rows: Rows = [("rms of prediction, mrad", "clearjoint", "MuJoCo's joint")]
    shown, parts = [], {"fitted": {(KP, TRAJECTORIES[0]): log}}
    parts |= {
        f"not fitted, gain {kp}": {key: part for key, part in logs.items() if key[0] == kp}
        for kp in sorted({key[0] for key in logs})
    }
    for title, part in parts.items():
        errors: tuple[list[np.ndarray], list[np.ndarray]] = [], []
        for (kp, trajectory), log in part.items():
            logged, pair = log.angles["servo"], both(kp, log)
            for own, predicted in zip(errors, pair, strict=True):
                own.append(predicted - logged.values)
            if (kp, trajectory) == (KP, "sin_sin"):
                shown.append(Prediction(f"XL330, not fitted: {trajectory}", *logged[:2], *pair))
        rows.append((title, *(f"{1e3 * rms(*own):.0f}" for own in errors)))
    names = {"servo friction": "friction, N m", "servo loss": "loss of the gear"}
    names |= {"servo damping": "damping with back EMF, N m s/rad"}
    names |= {"servo armature": "armature, kg m²", "gain": "gain, N m/rad"}
    return [[("parameter", "estimate", "95 %"), *estimates(found, names)], rows], shown


# A servo that holds its position, pulled by elastic bands, roboninecom. --------------------------

LEVER = StandardJoint(mass=0.05, length=0.0, inertia=2e-4)
HOLDING_GAIN = 8e-3 * 1.91 / COUNT
"""Gain of the STS3215, N m/rad: of the voltage per count that the log has as its load, times the
stall torque of the data sheet, N m."""
WINDOWS = (1.6, 6.4), (8.4, 12.9), (14.6, 19.4), (21.3, 25.9)
"""Times between the moves to the goal, s; the first window is fitted."""
HOLDING: Numbers = {"friction": 0.05, "damping": 0.6, "armature": 0.028, "gain": HOLDING_GAIN}
"""Starts: friction and armature of this servo by Rhoban/bam."""
PULL, LAGS = 0.19, (0.05, -0.1)
"""Start of the largest pull, N m, and starts of the age of a position in the log, s."""


def stand(path: Path) -> tuple[list[Rows], list[Prediction]]:
    """Fit the log of the servo between two moves, and predict it between others."""
    angle = cj.LogColumn.encoder("pos (5)", 4096, zero=2047)
    goals = {"servo": cj.LogColumn.encoder("target pos (5)", 4096, zero=2047)}
    log = cj.RobotLog.read(path, time="timestamp", angles={"servo": angle}, goals=goals)
    table = pd.read_csv(path)
    # The pullers stretch the bands by up to 400 counts, in opposite directions.
    stretch = (2347 - table["pos (4)"]).clip(0) - (table["pos (3)"] - 1747).clip(0)
    times, pull = log.angles["servo"].times, stretch.to_numpy() / 400.0

    gear: dict[str, Any] = {"play": "0.3 deg", "stiffness": 60.0, "damping": 0.1}
    gear |= {"friction": 0.05, "viscosity": 0.6, "link_friction": 0.01}
    drive = cj.Drive(armature=HOLDING["armature"], **gear)
    robot = rig(LEVER, drive)
    bands = cj.DriveTorque(*robot.link_side("servo"), cj.PiecewiseLinear(times, PULL * pull))
    robot = robot.with_elements({"bands": bands})
    encoder = cj.Encoder(*robot.link_side("servo"))
    servo = cj.Servo(*robot.motor_side("servo"), 0.0, 200.0, HOLDING_GAIN, encoder=encoder)

    def pulled(scene: cj.Scene, state: cj.State, largest: Any) -> tuple[cj.Scene, cj.State]:
        values = largest * jnp.asarray(pull)
        return cj.set_value(scene, lambda s: s.forces["bands"].torque.values, values), state

    first, *others = (log.between(*window) for window in WINDOWS)
    find, options = {"servo": ["play", "friction", "damping"]}, {"max_iterations": 40}
    fits, starts = [], [HOLDING | {"pull": PULL, "lag": lag} for lag in LAGS]
    for lag in LAGS:
        further = {
            "pull": cj.Parameter.change(pulled, PULL, cj.Log(), "N m"),
            "lag": cj.Parameter.delay("servo position", value=lag),
        }
        fits.append(fitted(robot, first, find, {"servo": servo}, parameters=further, **options))
    found = min(fits, key=lambda found: found.fit.chi_squared)
    standard_joint = replace(LEVER, pull=(times, pull))
    standard = standard_joint.fitted(first, *starts, known=("gain", "armature"))
    errors = []
    for part in (first, *others):
        pair = found.predict(part)["servo position"], standard_joint.predicted(standard, part)
        errors.append([(predicted - part.angles["servo"].values) / COUNT for predicted in pair])
    rows: Rows = [
        ("rms of prediction, counts", "clearjoint", "MuJoCo's joint"),
        ("fitted", *(f"{rms(own):.1f}" for own in errors[0])),
        ("not fitted", *(f"{rms(*own):.1f}" for own in zip(*errors[1:], strict=True))),
    ]
    names = {"servo play": "play, rad", "servo friction": "friction, N m"}
    names |= {"pull": "largest pull, N m"}
    return [[("parameter", "estimate", "95 %"), *estimates(found, names)], rows], []


# Six joints that follow their log, shamilmamedov/dynamic_calibration. ---------------------------

JOINTS = "shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3"
GAINS = 14.87, 13.26, 11.13, 10.62, 11.03, 11.47
"""Torque per current, N m/A, that the authors cite."""
FITTED = "identification_data/ur-20_02_10-30sec_12harm.csv", 635, 2635
OTHERS = {
    "other harmonics": ("identification_data/ur-20_02_12-40sec_12harm.csv", 1000, 2500),
    "point to point": ("validation_data/ur-20_01_17-ptp_10_points.csv", 700, 2700),
}
"""Logs, and the rows from which and before which they are taken."""
ACCURACY, CURRENT = 1e-4, 0.2
"""Noise of the angles, rad, and of the currents, A, for the fit."""


def ur10e_log(folder: Path, name: str, begin: int, end: int) -> cj.RobotLog:
    """Return every other row of a part of a log."""
    table = pd.read_csv(folder / name, header=None).iloc[begin:end:2]
    joints = list(enumerate(f"{joint}_joint" for joint in JOINTS))
    return cj.RobotLog.read(
        table,
        time=0,
        angles={n: cj.LogColumn(1 + k, unit="rad", noise=ACCURACY) for k, n in joints},
        torques={n: cj.LogColumn.current(13 + k, GAINS[k], noise=CURRENT) for k, n in joints},
    )


def ur10e(folder: Path) -> tuple[list[Rows], list[Prediction]]:
    """Fit the currents of the UR10e on a given motion, and predict those on others."""
    path, log = folder.parent / "URe" / "urdf" / "ur10e.urdf", ur10e_log(folder, *FITTED)
    with warnings.catch_warnings(action="ignore", category=cj.NotCarriedOverWarning):
        robot = cj.load_robot(path)
        standard = standard_currents(robot, log)
    for joint in robot.joints:
        robot = robot.with_drive(joint, cj.Drive(armature=1.0))
    find = {n: {"friction": 6.0, "damping": 8.0, "armature": None} for n in robot.joints}
    gains = {f"{n} gain": cj.Parameter.gain(f"{n} torque") for n in robot.joints}
    driven_by = dict.fromkeys(robot.joints, "angle")
    found = fitted(robot, log, find, driven_by, parameters=gains, max_iterations=20)
    others = {title: ur10e_log(folder, *part) for title, part in OTHERS.items()}
    rows: Rows = [("joint", "friction, N m", "damping, N m s/rad", "armature, kg m²", "N m/A")]
    for n, known in zip(robot.joints, GAINS, strict=True):
        kinds = [f"{n} {kind}" for kind in ("friction", "damping", "armature")]
        cells = [value for _, value, _ in estimates(found, dict.fromkeys(kinds, ""))]
        rows.append((n, *cells, f"{known / found.fit.estimates[f'{n} gain']:.3g}"))
    errors: Rows = [("rms error over rms current", "clearjoint", "MuJoCo's joint")]
    for title, part in {"fitted": log, **others}.items():
        ours, theirs = found.predict(part), standard(part)
        shares = [
            [rms(ours[f"{n} torque"] - v) / rms(v), rms(theirs[n] - v) / rms(v)]
            for n, (_, v, _, _) in part.torques.items()
        ]
        errors.append((title, *(f"{share:.1%}" for share in np.mean(shares, axis=0))))
    return [rows, errors], []


COLLECTIONS = {
    "Rhoban/bam": ("bam/data.bak/raw", pendulum),
    "roboninecom/Measuring-Backlash-in-Popular-UART-Servos": (
        "logs/motor_telemetry_single.csv",
        stand,
    ),
    "shamilmamedov/dynamic_calibration": ("dataset_ur10e", ur10e),
}
"""Where logs are in repositories of GitHub, and how they are fitted."""


def measure(folder: Path) -> tuple[list[Rows], list[Prediction]]:
    """Return the tables of the repositories in a folder, and predictions to draw."""
    tables, shown = [], []
    for repository, (path, fit) in COLLECTIONS.items():
        present = sorted(folder.rglob(path))
        if not present:
            print(f"No logs of {repository} in {folder}: clone it from GitHub, see the README.")
            continue
        rows, parts = fit(present[0])
        tables, shown = [*tables, *rows], [*shown, *parts]
    return tables, shown

"""A six-joint arm with play in every joint, simulated by Pinocchio and SciPy: which plays and
frictions does one motion determine?"""

import importlib
import tempfile
import time
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

import clearjoint as cj
from clearjoint.plot import style
from studies.robots.draws import COVERAGE, Draw, coverage

LINKS = {
    # Axis, origin in the parent's frame, m, centre of mass, m, mass, kg, and length, m, of a
    # cylinder along z: about the dimensions and masses of the UR5 in ROS's package ur_description.
    "pan": ("0 0 1", "0 0 0.089159", "0 0 0", 3.7, 0.178),
    "lift": ("0 1 0", "0 0.13585 0", "0 0 0.28", 8.393, 0.56),
    "elbow": ("0 1 0", "0 -0.1197 0.425", "0 0 0.25", 2.275, 0.5),
    "wrist 1": ("0 1 0", "0 0 0.39225", "0 0 0", 1.219, 0.12),
    "wrist 2": ("0 0 1", "0 0.093 0", "0 0 0", 1.219, 0.12),
    "wrist 3": ("0 1 0", "0 0 0.09465", "0 0.06 0", 0.3, 0.1),
}
RADIUS, LEAN = 0.06, 0.5
"""Radius of the cylinders, m, and angle by which the base leans, rad, so that gravity loads all
joints at the start."""
LINK = """<link name="{name} link"><inertial><origin xyz="{centre}"/><mass value="{mass}"/>
<inertia ixx="{across}" iyy="{across}" izz="{along}" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{name} link"/>
<origin xyz="{origin}" rpy="{lean} 0 0"/><axis xyz="{axis}"/>
<limit lower="-9" upper="9" effort="1000" velocity="10"/></joint>"""
PLAY = np.radians([0.2, 0.2, 0.25, 0.3, 0.3, 0.4])
FRICTION = np.array([4.0, 4.0, 2.0, 0.6, 0.6, 0.4])
ARMATURE = np.array([1.5, 1.5, 0.8, 0.15, 0.15, 0.1])
DAMPING, STIFFNESS = 4.0 * ARMATURE, 2e4 * ARMATURE
FLANK_DAMPING = 4e-3 * STIFFNESS
PROPORTIONAL, DERIVATIVE = 3000.0 * ARMATURE, 80.0 * ARMATURE
"""Gains of the drives, N m/rad and N m s/rad."""
START = np.array([0.0, 0.6, 0.9, -0.7, 0.0, 0.3])
"""Angles at the start, rad, with the arm leaning forward."""
SWING = np.array([0.5, 0.35, 0.5, 0.6, 0.7, 0.8])
RATE, NOISE = 200.0, 1e-4
"""Samples per second, Hz, and noise of the encoders of the motors, rad."""
REST, END = 0.06, 1.0
"""Time at rest, and length of the log, s."""
DRAWS, GUESS = 15, "0.4 deg"
KINDS = "play", "friction"
SETTINGS = replace(cj.presets.identification, rtol=1e-7, derivative_tolerance=100.0)
"""Errors of runs are below 1e-4 of the noise, and runs take 0.6 of the time of the default."""
COULOMB = cj.frictions.RegularisedCoulomb(1.0, regularisation_speed=1e-4)


@dataclass(frozen=True)
class SimulatedArm:
    """The first joints of the arm, `count`, with rotors behind gears with play. Its links move by
    Pinocchio's articulated-body algorithm, and SciPy integrates."""

    count: int
    end: float

    @property
    def names(self) -> list[str]:
        """Names of the joints."""
        return [*LINKS][: self.count]

    def of(self, numbers: np.ndarray) -> np.ndarray:
        """Return the numbers of its joints."""
        return numbers[: self.count]

    @cached_property
    def urdf(self) -> str:
        """The arm as URDF; the links of further joints are fixed."""
        text, parent = '<robot name="arm"><link name="base"/>', "base"
        for name, (axis, origin, centre, mass, length) in LINKS.items():
            numbers = {"axis": axis, "origin": origin, "centre": centre, "mass": mass}
            numbers["across"] = mass * (3 * RADIUS**2 + length**2) / 12
            numbers["lean"] = LEAN if name == "pan" else 0.0
            link = LINK.format(name=name, parent=parent, along=mass * RADIUS**2 / 2, **numbers)
            is_fixed = name not in self.names
            text += link.replace("revolute", "fixed") if is_fixed else link
            parent = f"{name} link"
        return f"{text}</robot>"

    @cached_property
    def times(self) -> np.ndarray:
        """Times of the log, (N,) s."""
        return np.arange(round(self.end * RATE) + 1) / RATE

    @cached_property
    def goals(self) -> np.ndarray:
        """Goals of the joints, (N, n) rad."""
        begun = np.clip((self.times - REST) / 0.3, 0.0, 1.0) ** 2
        angles, phases = 0.0, np.random.default_rng(1).uniform(0.0, 2.0 * np.pi, (2, len(START)))
        for frequency, share, phase in ((0.9, 0.6, phases[0]), (2.1, 0.4, phases[1])):
            sines = np.sin(2.0 * np.pi * frequency * self.times[:, None] + phase)
            angles = angles + begun[:, None] * share * sines * SWING
        return (START + angles)[:, : self.count]

    @cached_property
    def motion(self) -> np.ndarray:
        """Angles of the motors, (N, n) rad."""
        pinocchio: Any = importlib.import_module("pinocchio")
        model = pinocchio.buildModelFromXML(self.urdf)
        data, goal = model.createData(), CubicSpline(self.times, self.goals, bc_type="natural")
        goal_rate, half, stiffness = goal.derivative(), 0.5 * self.of(PLAY), self.of(STIFFNESS)
        friction, damping, armature, flank_damping, proportional, derivative = map(
            self.of, (FRICTION, DAMPING, ARMATURE, FLANK_DAMPING, PROPORTIONAL, DERIVATIVE)
        )

        def rates(t: float, y: np.ndarray) -> np.ndarray:
            motor, link, motor_speed, speed = y.reshape(4, self.count)
            twist = link - motor
            beyond = twist - np.clip(twist, -half, half)
            gear = stiffness * beyond + flank_damping * (speed - motor_speed)
            gear = np.where(beyond * gear > 0.0, gear, 0.0)  # a flank pushes, and does not pull
            drive = proportional * (goal(t) - motor) + derivative * (goal_rate(t) - motor_speed)
            resisting = friction * np.tanh(motor_speed / 1e-4) + damping * motor_speed
            of_link = pinocchio.aba(model, data, link, speed, -gear)
            of_motor = (drive - resisting + gear) / armature
            return np.concatenate([motor_speed, speed, of_motor, of_link])

        start = self.of(START)
        held = pinocchio.computeGeneralizedGravity(model, data, start).round(6)
        ahead = np.sign(held) * half + held / stiffness
        begin = np.concatenate([start + ahead, start, np.zeros(2 * self.count)])
        options: dict[str, Any] = {"method": "LSODA", "rtol": 1e-7, "atol": 1e-9, "max_step": 5e-3}
        solution = solve_ivp(rates, (0.0, self.end), begin, t_eval=self.times, **options)
        assert solution.success
        return solution.y[: self.count].T

    def robot(self) -> cj.results.Robot:
        """Return the arm with drives, whose plays and frictions are those of the first guess."""
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "arm.urdf"
            path.write_text(self.urdf)
            arm = cj.load_robot(path)
        for k, name in enumerate(self.names):
            gear: dict[str, Any] = {"stiffness": STIFFNESS[k], "damping": FLANK_DAMPING[k]}
            gear |= {"friction": 0.5 * FRICTION[k], "viscosity": DAMPING[k], "law": COULOMB}
            drive = cj.Drive(armature=ARMATURE[k], play=GUESS, **gear)
            arm = arm.with_drive(name, drive)
        return arm

    def fitted(
        self,
        seed: int,
        start: cj.results.RobotFit | None = None,
        kinds: Sequence[str] = KINDS,
        max_iterations: int = 40,
    ) -> Draw:
        """Return the fit of plays and frictions to the motors' positions with noise, from another
        fit if one is given."""
        begun, generator = time.process_time(), np.random.default_rng(seed)
        arm = self.robot() if start is None else start.robot
        noisy = self.motion + NOISE * generator.standard_normal(self.motion.shape)
        table = pd.DataFrame({"t": self.times} | dict(zip(self.names, noisy.T, strict=True)))
        columns = {f"{n} motor": cj.LogColumn(n, unit="rad", noise=NOISE) for n in self.names}
        drives = {
            name: cj.Motor(
                *arm.motor_side(name),
                cj.Spline.through(self.times, self.goals[:, k]),
                *(PROPORTIONAL[k], DERIVATIVE[k]),
            )
            for k, name in enumerate(self.names)
        }
        log = cj.RobotLog.read(table, angles=columns)
        find = dict.fromkeys(self.names, kinds)
        options: dict[str, Any] = {"settings": SETTINGS, "max_iterations": max_iterations}
        options["progress"] = False
        found = cj.fit_robot(arm, log, find, drives, grow=(), **options)
        truth = {f"{name} play": PLAY[k] for k, name in enumerate(self.names)}
        truth |= {f"{name} friction": FRICTION[k] for k, name in enumerate(self.names)}
        return Draw(found, truth, time.process_time() - begun)


def measure(quick: bool) -> tuple[list[list[tuple[str, ...]]], cj.results.RobotFit]:
    """Return the tables of coverage and, unless `quick`, of inertias, and the first fit."""
    arm = SimulatedArm(1, 0.4) if quick else SimulatedArm(len(LINKS), END)
    draws = [arm.fitted(0)]
    for seed in range(1, 1 if quick else DRAWS):
        draws.append(arm.fitted(seed, draws[0].found))
        print(f"draw {seed}: {draws[-1].seconds:.0f} s", flush=True)
    first = draws[0].found
    return [table(draws), *([] if quick else [inertias(arm, first)])], first


def inertias(arm: SimulatedArm, first: cj.results.RobotFit) -> list[tuple[str, ...]]:
    """Return the table of the masses and moments of inertia that the first log would determine
    together with plays and frictions, head first: their standard deviations over their values."""
    kinds = "mass", "inertia"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", cj.PoorFitWarning)  # One run is no fit yet.
        fit = arm.fitted(0, first, (*KINDS, *kinds), max_iterations=1).found.fit
    rows: list[tuple[str, ...]] = [("link of", *(f"deviation of the {kind}" for kind in kinds))]
    for name in arm.names:
        cells = []
        for label in (f"{name} {kind}" for kind in kinds):
            cells.append("not determined")
            if label in fit.parameters:
                cells[-1] = f"{fit.standard_errors[label] / fit.estimates[label]:.2g}"
        rows.append((name, *cells))
    return rows


def table(draws: Sequence[Draw]) -> list[tuple[str, ...]]:
    """Return the table of true values, of estimates and intervals of the first of several draws,
    and of the coverage of all."""
    first = draws[0].found
    rows: list[tuple[str, ...]] = [("parameter", "true", "estimate", "95 %", *COVERAGE)]
    for label, true in draws[0].truth.items():
        factor, unit = (np.degrees(1.0), "deg") if label.endswith("play") else (1.0, "N m")
        title = f"{label}, {unit}"
        if label not in first.intervals:
            rows.append((title, f"{true * factor:.3g}", first.undetermined[label], "", "", ""))
            continue
        ends = " to ".join(f"{end * factor:.4g}" for end in first.intervals[label])
        value = f"{draws[0].estimate(label) * factor:.4g}"
        rows.append((title, f"{true * factor:.3g}", value, ends, *coverage(draws, label)))
    mean_square = f"{draws[0].mean_square:.2f}"
    rows.append(("mean square of the residuals", "1", mean_square, "", "", ""))
    for what, some in (("the first fit", draws[:1]), ("a further fit, median", draws[1:])):
        if some:
            seconds = f"{np.median([draw.seconds for draw in some]):.0f} s"
            rows.append((f"processor time of {what}", "", seconds, "", "", ""))
    return rows


def figure(found: cj.results.RobotFit) -> Figure:
    """Draw the residuals of the motors' positions over their noise, and the predicted motion."""
    canvas = Figure(figsize=(7.0, 4.5), layout="constrained")
    above, below = canvas.subplots(2, 1, sharex=True)
    for (name, series), (colour, _) in zip(
        found.fit.measurements.series.items(), style.lines(), strict=False
    ):
        above.plot(series.times, series.values, ".", color=colour, markersize=2)
        above.plot(
            series.times, found.predictions[name], color=colour, label=name.split(" motor")[0]
        )
        below.plot(series.times, found.fit.residuals[name], ".", color=colour, markersize=3)
    above.set_ylabel("angle of the motor, rad")
    above.legend(ncols=6, fontsize="small", loc="lower center", bbox_to_anchor=(0.5, 1.0))
    below.set(xlabel="time, s", ylabel="residual over noise")
    return canvas

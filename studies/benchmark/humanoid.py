"""A humanoid with play and servos in all 29 joints: clearjoint and MuJoCo at equal error.

    python -m studies.benchmark.humanoid [--quick] [--write]

Needs the extra `mujoco`. Times are processor times. `--write` replaces the table in the README.
"""

import argparse
import importlib
import tempfile
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import clearjoint as cj
from clearjoint.testing import optimise_programs
from studies.benchmark.ladder_scenes import GRAVITY, MANY, humanoid_urdf
from studies.benchmark.table import processor_time, replace_table, shown
from studies.common.report import markdown

HERE = Path(__file__).resolve().parent
GEAR: dict[str, Any] = {"armature": 1e-5, "ratio": 100.0, "play": "0.5 deg", "stiffness": 2000.0}
FLANKS: dict[str, dict[str, Any]] = {"damper, 2 N m s/rad": {"damping": 2.0}, "restitution": {}}
"""What takes energy from the flanks: a damper, or an impact with the default restitution, of which
MuJoCo has an approximation."""
RATE, PROPORTIONAL, DERIVATIVE, LIMIT = 200.0, 200.0, 5.0, 100.0
"""Samples per second, Hz, gains, N m/rad and N m s/rad, and largest torque of a servo, N m. Torques
act one sample after the reading."""
GOAL = 0.2
"""Goal of all joints, rad; they start at zero."""
SPAN, QUICK_SPAN = 1.0, 0.02
TARGETS = (1e-2, 1e-3, 1e-4)
"""Largest errors of an angle, rad, that count as equal."""
TOLERANCES = 10.0 ** np.arange(-1.5, -8.5, -0.5)
FINEST = 1e-11
"""Relative tolerance of the motion with which others are compared."""
STEPS = 2 ** np.arange(3, 9)
"""MuJoCo's steps in a period of the servos; with fewer, all runs are unstable."""
INTEGRATORS = "implicitfast", "RK4"
HEAD = ("flanks", "error, rad", "clearjoint", "MuJoCo", "ratio")


def humanoid(**flanks: Any) -> cj.results.Robot:
    """Return the humanoid with drive trains, but without servos."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "humanoid.urdf"
        path.write_text(humanoid_urdf(MANY), encoding="utf-8")
        robot = cj.load_robot(path, gravity=GRAVITY)
    for name in robot.joints:
        robot = robot.with_drive(name, cj.Drive(**GEAR, **flanks))
    return robot


class Here:
    """The humanoid in clearjoint for some `span`, s."""

    def __init__(self, robot: cj.results.Robot, span: float):
        gains = RATE, PROPORTIONAL, DERIVATIVE
        options: dict[str, Any] = {"torque_limit": LIMIT, "delay": 1.0 / RATE}
        servos = {
            f"{n} servo": cj.Servo(*robot.motor_side(n), GOAL, *gains, **options)
            for n in robot.joints
        }
        self._robot, self._state = robot.with_elements(servos), robot.state()
        self._times = np.arange(round(span * RATE) + 1) / RATE

    def run(self, rtol: float, save: bool = True) -> np.ndarray:
        """Return the angles of all joints at the servos' samples, (N, 29) rad."""
        kept = cj.Saving(self._times) if save else None
        arguments = self._state, self._times[-1], cj.Settings(rtol=float(rtol)), kept
        solution = cj.simulate(self._robot.scene, *arguments, progress=False)
        angles = self._robot.angles(solution) if save else {}
        return (
            np.stack([angles[name] for name in self._robot.joints], axis=1) if save else np.empty(0)
        )


class There:
    """The humanoid in MuJoCo, by the file that `cj.save_mjcf` writes."""

    def __init__(self, robot: cj.results.Robot, span: float, integrator: str):
        # Type checkers do not know the attributes of the compiled module.
        self._mujoco: Any = importlib.import_module("mujoco")
        # An unstable run would otherwise write a file MUJOCO_LOG.TXT for each warning.
        self._mujoco.set_mju_user_warning(lambda text: None)
        self._samples = round(span * RATE)
        torques = {f"{n} servo": cj.DriveTorque(*robot.motor_side(n), 0.0) for n in robot.joints}
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "humanoid.xml"
            cj.save_mjcf(robot.with_elements(torques), path, integrator=integrator)
            self._model = self._mujoco.MjModel.from_xml_path(str(path))
        self._data = self._mujoco.MjData(self._model)

        def addresses(names: Sequence[str]) -> np.ndarray:
            return np.array([self._model.joint(name).qposadr[0] for name in names])

        self._motors = addresses([f"{name} motor" for name in robot.joints])
        self._links = addresses(robot.joints)
        self._controls = np.array([self._model.actuator(name).id for name in torques])

    def run(self, steps: int) -> np.ndarray:
        """Return what `Here.run` does, for a number of steps in a period of the servos."""
        data, model = self._data, self._model
        model.opt.timestep = 1.0 / RATE / steps
        self._mujoco.mj_resetData(model, data)
        before, angles, torque = data.qpos[self._motors], [data.qpos[self._links]], None
        for _ in range(self._samples):
            angle = data.qpos[self._motors]
            command = PROPORTIONAL * (GOAL - angle) - DERIVATIVE * RATE * (angle - before)
            command = np.clip(command, -LIMIT, LIMIT)
            # At the start the torque acts at once.
            data.ctrl[self._controls] = command if torque is None else torque
            before, torque = angle, command
            self._mujoco.mj_step(model, data, nstep=steps)
            angles.append(data.qpos[self._links])
        return np.array(angles)


class Cost(NamedTuple):
    """Setting of a program that reaches an error, with the processor time of a run, s."""

    setting: str
    seconds: float

    def __str__(self) -> str:
        return f"{shown(self.seconds)} ({self.setting})"


def cheapest(
    run: Callable[[Any], np.ndarray],
    settings: Iterable[Any],
    label: str,
    exact: np.ndarray,
) -> dict[float, Cost]:
    """Return for each target that is reached the cost of the first setting that reaches it."""
    costs: dict[float, Cost] = {}
    for setting in settings:
        error = np.abs(run(setting) - exact).max()
        reached = [target for target in TARGETS if error <= target and target not in costs]
        if reached:
            seconds = processor_time(lambda s=setting: len(run(s)), 3).seconds
            costs |= dict.fromkeys(reached, Cost(label.format(setting), seconds))
        if len(costs) == len(TARGETS):
            break
    return costs


def compared(kind: str, span: float) -> list[tuple[str, ...]]:
    """Return the rows of the table for one kind of flanks."""
    robot = humanoid(**FLANKS[kind])
    here = Here(robot, span)
    here.run(TOLERANCES[0])
    optimise_programs()
    exact = here.run(FINEST)
    own = cheapest(here.run, TOLERANCES, "rtol {:.0e}", exact)
    others = {}
    for integrator in INTEGRATORS:
        there = There(robot, span, integrator)
        # Both programs have the same motion with dampers only.
        reference = exact if kind != "restitution" else there.run(2 * STEPS[-1])
        others[integrator] = cheapest(there.run, STEPS, f"{integrator}, {{}} steps", reference)
    rows = []
    for target in TARGETS:
        cells = own.get(target)
        reached = [costs[target] for costs in others.values() if target in costs]
        best = min(reached, key=lambda cost: cost.seconds, default=None)
        ratio = f"{cells.seconds / best.seconds:.2g}" if cells and best else ""
        rows.append((kind, f"{target:g}", str(cells or "-"), str(best or "not reached"), ratio))
    return rows


def main(arguments: Sequence[str] | None = None) -> list[tuple[str, ...]]:
    """Measure, print and, with `--write`, keep the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="20 ms with dampers only")
    parser.add_argument("--write", action="store_true", help="replace the table in the README")
    options = parser.parse_args(arguments)
    cj.configure()
    kinds, span = ([*FLANKS][:1], QUICK_SPAN) if options.quick else ([*FLANKS], SPAN)
    rows = [HEAD, *(row for kind in kinds for row in compared(kind, span))]
    print(markdown(rows))
    if options.write:
        replace_table(HERE / "README.md", markdown(rows), "humanoid")
    return rows


if __name__ == "__main__":
    main()

"""MuJoCo's standard joint, without play, fitted to the log of a servo as its package `mujoco.sysid`
does it: by SciPy's least squares over rollouts."""

import importlib
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import UnivariateSpline
from scipy.optimize import least_squares, lsq_linear

import clearjoint as cj

STEP = 1e-3
"""Time step of MuJoCo, s."""
SIGNED = "offset", "lag"
"""Numbers that may be negative; of others the logarithm is fitted."""
Numbers = dict[str, float]
XML = """<mujoco><option timestep="{step}" integrator="implicitfast"/><worldbody><body>
<inertial pos="0 0 -{length}" mass="{mass}" diaginertia="{inertia} {inertia} {inertia}"/>
<joint name="joint" axis="0 1 0"/></body></worldbody>
<actuator><position joint="joint" kp="1" forcelimited="true" forcerange="-1 1"/>
<motor joint="joint"/></actuator></mujoco>"""


@dataclass(frozen=True)
class StandardJoint:
    """A hinge with MuJoCo's `damping`, `frictionloss` and `armature`, a position actuator, and a
    link that hangs on it: its mass, kg, distance of the centre of mass, m, and inertia, kg m^2.

    `pull` is a further torque over a parameter "pull": times and values.
    """

    mass: float
    length: float
    inertia: float
    pull: tuple[np.ndarray, np.ndarray] = (np.zeros(1), np.zeros(1))

    @cached_property
    def model(self) -> Any:
        """The model, whose numbers `predicted` replaces."""
        mujoco: Any = importlib.import_module("mujoco")
        spec = mujoco.MjSpec.from_string(
            XML.format(step=STEP, mass=self.mass, length=self.length, inertia=self.inertia)
        )
        return spec.compile()

    def predicted(self, numbers: Mapping[str, float], log: cj.RobotLog) -> np.ndarray:
        """Return the position at the log's times, (N,) rad, from its first position, at rest."""
        mujoco: Any = importlib.import_module("mujoco")
        rollout: Any = importlib.import_module("mujoco.rollout")
        model, logged, goals = self.model, log.angles["servo"], log.goals["servo"]
        data, offset = mujoco.MjData(model), numbers.get("offset", 0.0)
        model.dof_damping[0], model.dof_armature[0] = numbers["damping"], numbers["armature"]
        model.dof_frictionloss[0] = numbers["friction"]
        gain, limit = numbers["gain"], numbers.get("limit", 1e6)
        model.actuator_gainprm[0, 0], model.actuator_biasprm[0, 1] = gain, -gain
        model.actuator_forcerange[0] = -limit, limit
        mujoco.mj_setConst(model, data)
        lag = numbers.get("lag", 0.0)
        times = log.start + STEP * np.arange(round((log.end - log.start) / STEP) + 2)
        held = np.searchsorted(goals.times, times, side="right") - 1
        pulls = numbers.get("pull", 0.0) * np.interp(times, *self.pull)
        controls = np.stack([goals.values[np.maximum(held, 0)], pulls], axis=1)
        begin = np.array([log.start, logged.values[0] - offset, 0.0])
        states, _ = rollout.rollout(model, data, begin, controls)
        at = np.append(log.start, states[0, :, 0]), np.append(begin[1], states[0, :, 1])
        return np.interp(logged.times - lag, *at) + offset

    def fitted(self, log: cj.RobotLog, *starts: Numbers, known: Sequence[str] = ()) -> Numbers:
        """Return the numbers that fit a log best, of those to which each of the starts leads; those
        that are known keep them."""
        names, logged = [n for n in starts[0] if n not in known], log.angles["servo"].values
        signed = np.array([name in SIGNED for name in names])

        def numbers(x: np.ndarray) -> Numbers:
            values = np.where(signed, x, np.exp(np.where(signed, 0.0, np.clip(x, -30.0, 10.0))))
            return starts[0] | dict(zip(names, values.tolist(), strict=True))

        def residuals(x: np.ndarray) -> np.ndarray:
            return self.predicted(numbers(x), log) - logged

        # Rollouts with dry friction are rough at smaller differences.
        options: dict[str, Any] = {"diff_step": 1e-4, "x_scale": np.where(signed, 0.01, 1.0)}
        ends = [
            least_squares(
                residuals, [s[n] if n in SIGNED else np.log(s[n]) for n in names], **options
            )
            for s in starts
        ]
        return numbers(min(ends, key=lambda end: end.cost).x)


def standard_currents(
    robot: cj.results.Robot, log: cj.RobotLog
) -> Callable[[cj.RobotLog], dict[str, np.ndarray]]:
    """Fit MuJoCo's joints, and a gain of each torque sensor, to torques on a given motion by least
    squares of `mj_inverse`; return the function that predicts the torques of a log."""
    mujoco: Any = importlib.import_module("mujoco")
    with tempfile.TemporaryDirectory() as folder:
        cj.save_mjcf(robot, Path(folder) / "robot.xml")
        model = mujoco.MjModel.from_xml_path(str(Path(folder) / "robot.xml"))
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)

    def columns(log: cj.RobotLog) -> dict[str, np.ndarray]:
        data, motion, torques = mujoco.MjData(model), {}, []
        for name, (times, values, noise, _) in log.angles.items():
            weights = np.full(len(times), 1.0 / (noise or np.inf))
            spline = UnivariateSpline(times, np.unwrap(values), weights, k=3, s=len(times))
            motion[name] = [spline.derivative(k)(times) if k else spline(times) for k in range(3)]
        for k in range(len(times)):
            for name, (q, v, a) in motion.items():
                joint = data.joint(name)
                joint.qpos, joint.qvel, joint.qacc = q[k], v[k], a[k]
            mujoco.mj_inverse(model, data)
            torques.append([data.joint(name).qfrc_inverse[0] for name in motion])
        return {
            name: np.stack([torque, np.sign(v), v, a], axis=1)
            for (name, (_, v, a)), torque in zip(motion.items(), np.transpose(torques), strict=True)
        }

    numbers = {
        name: lsq_linear(part, log.torques[name].values, (0.0, np.inf)).x
        for name, part in columns(log).items()
    }
    return lambda log: {name: part @ numbers[name] for name, part in columns(log).items()}

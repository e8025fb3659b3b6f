"""A double pendulum in space with ideal hinges, in MuJoCo and in clearjoint."""

import importlib.util

import numpy as np

import clearjoint as cj
from clearjoint import plot
from studies.validation.check import Check

END = 2.0
"""s."""
STEP = 1e-4
"""Step of MuJoCo's fourth-order Runge-Kutta method, s."""
MODEL = f"""
<mujoco>
  <compiler angle="radian"/>
  <option gravity="0 0 -9.81" integrator="RK4" timestep="{STEP}"/>
  <worldbody>
    <body name="upper">
      <joint name="first" axis="0 1 0"/>
      <inertial pos="0.5 0 0" mass="2" diaginertia="0.01 0.2 0.2"/>
      <body name="lower" pos="1 0 0">
        <joint name="second" axis="1 0 0"/>
        <inertial pos="0 0.3 0" mass="1" diaginertia="0.1 0.01 0.1"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
SPIN = 1.0
"""Initial rate of the second hinge, rad/s."""


def has_mujoco() -> bool:
    """Return whether the optional package `mujoco` is installed."""
    return importlib.util.find_spec("mujoco") is not None


def double_pendulum() -> list[Check]:
    """Check the angles of both hinges at the end; no checks without MuJoCo.

    The first hinge is horizontal, and the second along the upper arm, so that the motion is
    spatial.
    """
    if not has_mujoco():
        print("No row of MuJoCo, which is not installed: pip install -e '.[mujoco]'")
        return []
    names = ("angle of the first hinge at 2 s", "angle of the second hinge at 2 s")
    return [
        Check("MuJoCo, double pendulum", name, "rad", float(theirs), float(ours))
        for name, theirs, ours in zip(names, _mujoco(), _clearjoint(), strict=True)
    ]


def _mujoco() -> np.ndarray:
    """Return the final angles of MuJoCo, (2,) rad within half a revolution."""
    from mujoco import MjData, MjModel, mj_step  # pyright: ignore

    model = MjModel.from_xml_string(MODEL)
    data = MjData(model)
    data.qvel[:] = (0.0, SPIN)
    mj_step(model, data, nstep=round(END / STEP))
    return np.remainder(data.qpos + np.pi, 2.0 * np.pi) - np.pi


def _clearjoint() -> list[float]:
    """Return the final angles of clearjoint, rad."""
    origin, x, y = (0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
    bodies = {
        "upper": cj.Body(2.0, (0.01, 0.2, 0.2)),
        "lower": cj.Body(1.0, (0.1, 0.01, 0.1)),
    }
    joints = {
        "first": cj.RevoluteJoint("ground", "upper", origin, (-0.5, 0.0, 0.0), y, y),
        "second": cj.RevoluteJoint("upper", "lower", (0.5, 0.0, 0.0), (0.0, -0.3, 0.0), x, x),
    }
    scene = cj.Scene(bodies, joints, gravity=(0.0, 0.0, -9.81))
    lower = cj.body_state((1.0, 0.3, 0.0), velocity=(0.0, 0.0, 0.3 * SPIN), spin=(SPIN, 0.0, 0.0))
    start = cj.State({"upper": cj.body_state((0.5, 0.0, 0.0)), "lower": lower})
    angles = {name: cj.quantities.JointAngle(name) for name in joints}
    solution = cj.simulate(scene, start, END, cj.Settings(rtol=1e-11), cj.Saving([END]))
    return [float(plot.series(scene, solution, angle)[-1]) for angle in angles.values()]

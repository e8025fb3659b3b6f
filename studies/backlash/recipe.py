"""The shafts in MuJoCo, by its documented recipe: two hinges on one axis, the second with a limit.

Recipe: https://mujoco.readthedocs.io/en/stable/modeling.html, "Backlash" (requested in issue 995 of
google-deepmind/mujoco). The limit's stiffness and damping are given directly for a unit of inertia,
so that they are those of the contact; an impedance of almost one makes them act in full. MuJoCo's
default limit is critically damped with a time constant of 20 ms.
"""

import numpy as np
from mujoco import MjData, MjModel, mjtIntegrator, rollout  # pyright: ignore

from studies.backlash.shafts import DAMPING, END, FREQUENCY, LINK, MOTOR, PLAY, SPEED, Motion, timed

STIFF = (
    f'solreflimit="{-(FREQUENCY**2)} {-2.0 * DAMPING * FREQUENCY}" '
    'solimplimit="0.9999 0.9999 0.001 0.5 1"'
)
"""Limit with the stiffness and damping of the contact."""
MODEL = f"""
<mujoco>
  <compiler angle="radian"/>
  <option gravity="0 0 0"/>
  <worldbody>
    <body name="motor">
      <joint name="motor" axis="0 0 1"/>
      <inertial pos="0 0 0" mass="1" diaginertia="5e-3 5e-3 {MOTOR}"/>
      <body name="link">
        <joint name="play" axis="0 0 1" limited="true" range="{-0.5 * PLAY} {0.5 * PLAY}"
               LIMIT/>
        <inertial pos="0 0 0" mass="1" diaginertia="5e-3 5e-3 {LINK}"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


def _states(
    step: float, integrator: str, play: float, limit: str = STIFF
) -> tuple[np.ndarray, float]:
    """Return times, angles and rates after each step, (steps, 5), and the time of the run, s."""
    model = MjModel.from_xml_string(MODEL.replace("LIMIT", limit))
    model.opt.timestep = step
    model.opt.integrator = getattr(mjtIntegrator, f"mjINT_{integrator.upper()}")
    model.jnt_range[1] = (-0.5 * play, 0.5 * play)
    data = MjData(model)
    start = np.array([0.0, 0.0, 0.0, SPEED, -SPEED])
    count = round(END / step)
    (states, _), seconds = timed(lambda: rollout.rollout(model, data, start, nstep=count))
    return np.asarray(states)[0], seconds


def run(step: float, integrator: str, play: float = PLAY) -> tuple[Motion, float]:
    """Return the final motion, and the time of the run, s."""
    states, seconds = _states(step, integrator, play)
    _, motor, opened, rate, opening = states[-1]
    return Motion(np.array([motor, motor + opened]), np.array([rate, rate + opening])), seconds


def path(step: float, integrator: str, limit: str = STIFF) -> tuple[np.ndarray, np.ndarray]:
    """Return times, s, and the motor's angle minus the link's, rad, of each step."""
    states, _ = _states(step, integrator, PLAY, limit)
    return states[:, 0], -states[:, 2]


def derivative(step: float, integrator: str, change: float) -> tuple[float, float]:
    """Return the derivative of the link's final angle by central differences with a relative change
    of the backlash, and the time of the two runs, s.
    """
    by = change * PLAY
    (more, first), (less, second) = (run(step, integrator, PLAY + s * by) for s in (1.0, -1.0))
    return float(more.angles[1] - less.angles[1]) / (2.0 * by), first + second

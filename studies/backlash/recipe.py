"""The shafts in MuJoCo, as `clearjoint.save_mjcf` writes them.

MuJoCo's documentation makes backlash of two hinges on one axis, of which the second has a limit
(https://mujoco.readthedocs.io/en/stable/modeling.html, "Backlash"; requested in issue 995 of
google-deepmind/mujoco). The shafts are both on the ground, so that the limit is that of a fixed
tendon, the difference of their angles, which is the same constraint. It has the stiffness and
damping of the contact. MuJoCo's default limit is critically damped with a time constant of 20 ms.
"""

import tempfile
from pathlib import Path

import numpy as np
from mujoco import MjData, MjModel, mjtIntegrator, rollout  # pyright: ignore

import clearjoint as cj
from studies.backlash.ours import shafts
from studies.backlash.shafts import END, PLAY, Motion, timed

DEFAULT = (0.02, 1.0), (0.9, 0.95, 0.001, 0.5, 2.0)
"""MuJoCo's default `solref` and `solimp` of limits."""


def model() -> MjModel:
    """Return the compiled file: the joints "motor" and "link", and the tendon "play"."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "shafts.xml")
        cj.save_mjcf(shafts()[0], path, shafts()[1])
        return MjModel.from_xml_path(str(path))


def _states(
    step: float, integrator: str, play: float, own_limit: bool = False
) -> tuple[np.ndarray, float]:
    """Return times, angles and rates of motor and link after each step, (steps, 5), and the time of
    the run, s; `own_limit`: with MuJoCo's default limit."""
    recipe = model()
    recipe.opt.timestep = step
    recipe.opt.integrator = getattr(mjtIntegrator, f"mjINT_{integrator.upper()}")
    recipe.tendon_range[0] = (-0.5 * play, 0.5 * play)
    if own_limit:
        recipe.tendon_solref_lim[0], recipe.tendon_solimp_lim[0] = DEFAULT
    data = MjData(recipe)
    start = np.concatenate([[0.0], recipe.key_qpos[0], recipe.key_qvel[0]])
    count = round(END / step)
    (states, _), seconds = timed(lambda: rollout.rollout(recipe, data, start, nstep=count))
    return np.asarray(states)[0], seconds


def run(step: float, integrator: str, play: float = PLAY) -> tuple[Motion, float]:
    """Return the final motion, and the time of the run, s."""
    states, seconds = _states(step, integrator, play)
    return Motion(states[-1, 1:3], states[-1, 3:]), seconds


def path(step: float, integrator: str, own_limit: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Return times, s, and the motor's angle minus the link's, rad, of each step."""
    states, _ = _states(step, integrator, PLAY, own_limit)
    return states[:, 0], states[:, 1] - states[:, 2]


def derivative(step: float, integrator: str, change: float) -> tuple[float, float]:
    """Return the derivative of the link's final angle by central differences with a relative change
    of the backlash, and the time of the two runs, s.
    """
    by = change * PLAY
    (more, first), (less, second) = (run(step, integrator, PLAY + s * by) for s in (1.0, -1.0))
    return float(more.angles[1] - less.angles[1]) / (2.0 * by), first + second

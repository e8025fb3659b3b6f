"""Chain of links whose joints have motors and backlash, in clearjoint and by MuJoCo's recipe.

Link k hangs on link k - 1 by an ideal hinge and moves in the plane. A rotor turns about the same
axis, with backlash between rotor and link. The rotors start with alternate directions, the links at
rest, without further loads. MuJoCo's documentation makes backlash of a second hinge with a small
range (https://mujoco.readthedocs.io/en/stable/modeling.html, "Backlash"): a joint is a hinge of the
rotor on the previous link and one of the link on the rotor. `clearjoint.save_mjcf` writes them so,
with the stiffness and damping of the contacts.

The error of each program is measured against a far finer setting of the same program.
"""

import math
import tempfile
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

import numpy as np

import clearjoint as cj
from studies.benchmark.table import (
    SHORT,
    Plan,
    Row,
    Sample,
    interleaved,
    on_cores,
    processor_time,
    row,
    seconds,
)

JOINTS, QUICK_JOINTS = (1, 3, 10, 30), (1,)
SPAN = 0.05
"""Simulated time, s."""
RTOL, FINE_RTOL = 1e-5, 1e-9
STEP, FINE_STEP = 1e-5, 1e-6
"""MuJoCo's steps, s."""

LENGTH, MASS, ROTOR, LINK = 0.2, 1.0, 5e-3, 4e-3
"""Length, m, mass, kg, and moments of inertia of a rotor and of a link about its centre, kg m^2."""
PLAY, SPEED = 0.01, 2.0
"""Backlash from flank to flank, rad, and initial speed of the rotors, rad/s."""
FREQUENCY, DAMPING = 2000.0, 0.2
"""Undamped frequency, rad/s, and damping ratio of a contact."""
RADIUS = 0.05
"""Radius of the flanks, m; without effect, as frequency and damping are given."""
ROTOR_MASS = 0.5
"""Mass of a rotor, kg."""

Run = Callable[[float], tuple[np.ndarray, Sample]]
"""Function of a tolerance or step that returns final angles of the links, rad, and the time."""


def chain(joints: int) -> tuple[cj.Scene, cj.State]:
    """Return the scene and its initial state; links lie along X and turn about Z."""
    axis, centre = (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)
    near, far = (-0.5 * LENGTH, 0.0, 0.0), (0.5 * LENGTH, 0.0, 0.0)
    about_hinge = LINK + MASS * (0.5 * LENGTH) ** 2
    mass = ROTOR * about_hinge / (ROTOR + about_hinge) / RADIUS**2
    requested = math.exp(-math.pi * DAMPING / math.sqrt(1.0 - DAMPING**2))
    law = cj.laws.KelvinVoigt(requested, mass * FREQUENCY**2, mass)
    bodies, elements, states = {}, {}, {}
    before, end = "ground", centre
    for k in range(joints):
        link, rotor = f"link {k + 1}", f"rotor {k + 1}"
        bodies[link] = cj.Body(MASS, (LINK, LINK, LINK))
        bodies[rotor] = cj.Body(ROTOR_MASS, (ROTOR, ROTOR, ROTOR))
        elements[f"bearing {k + 1}"] = cj.RevoluteJoint(before, rotor, end, centre, axis, axis)
        elements[f"hinge {k + 1}"] = cj.RevoluteJoint(rotor, link, centre, near, axis, axis)
        elements[f"play {k + 1}"] = cj.Backlash(rotor, link, play=PLAY, radius=RADIUS, law=law)
        states[link] = cj.body_state(((k + 0.5) * LENGTH, 0.0, 0.0))
        spin = SPEED if k % 2 == 0 else -SPEED
        states[rotor] = cj.body_state((k * LENGTH, 0.0, 0.0), spin=(0.0, 0.0, spin))
        before, end = link, far
    return cj.Scene(bodies, elements), cj.State(states)


class ClearjointChain:
    """The chain in clearjoint."""

    def __init__(self, joints: int):
        self._joints, (self._scene, self._state) = joints, chain(joints)

    def run(self, rtol: float) -> tuple[np.ndarray, Sample]:
        """Return the final angles of the links, (joints,) rad, and the time of the call, for a
        relative tolerance.
        """
        found: list[cj.results.Solution] = []

        def call() -> int:
            settings = cj.Settings(rtol=rtol)
            found.append(cj.simulate(self._scene, self._state, SPAN, settings, progress=False))
            return int(found[0].attempts)

        sample = processor_time(call, SHORT)
        bodies = found[0].final.bodies
        turned = [bodies[f"link {k + 1}"].orientation for k in range(self._joints)]
        return np.array([2.0 * math.atan2(p[3], p[0]) for p in turned]), sample


class MujocoChain:
    """The chain in MuJoCo."""

    def __init__(self, joints: int):
        from mujoco import MjData, MjModel  # pyright: ignore

        scene, state = chain(joints)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "chain.xml")
            cj.save_mjcf(scene, path, state, integrator="RK4")
            self._model = MjModel.from_xml_path(str(path))
        self._data = MjData(self._model)

    def run(self, step: float) -> tuple[np.ndarray, Sample]:
        """Return the final angles of the links, (joints,) rad, and the time of the steps, for a
        fixed step in s.
        """
        from mujoco import mj_resetDataKeyframe, mj_step  # pyright: ignore

        count = round(SPAN / step)
        self._model.opt.timestep = SPAN / count
        mj_resetDataKeyframe(self._model, self._data, 0)

        def call() -> int:
            mj_step(self._model, self._data, nstep=count)
            return count

        sample = processor_time(call)
        return np.cumsum(self._data.qpos.reshape(-1, 2).sum(axis=1)), sample


def rows(plan: Plan) -> list[Row]:
    """Measure each chain in clearjoint and in MuJoCo, with the errors of both."""
    has_mujoco = find_spec("mujoco") is not None
    if not has_mujoco:
        print("MuJoCo is not installed (pip install mujoco): rows of backlash have no ratio.")
    found = []
    for joints in QUICK_JOINTS if plan.quick else JOINTS:
        runs: dict[str, tuple[Run, float, float]] = {
            "here": (ClearjointChain(joints).run, RTOL, FINE_RTOL)
        }
        if has_mujoco:
            runs["there"] = MujocoChain(joints).run, STEP, FINE_STEP
        calls = {
            name: lambda k, run=run, setting=setting: run(setting)[1]
            for name, (run, setting, _) in runs.items()
        }
        with on_cores(1):
            times = {
                name: seconds(found) for name, found in interleaved(calls, plan.rounds).items()
            }
            errors = [f"{_error(*case):.0e}" for case in runs.values()]
        plural = "s" if joints > 1 else ""
        label = f"{joints} joint{plural} with backlash, {SPAN:g} s; off {' and '.join(errors)} rad"
        name = f"MuJoCo, RK4, steps of {1e6 * STEP:g} µs"
        found.append(row(label, times["here"], times.get("there"), name if has_mujoco else ""))
    return found


def _error(run: Run, setting: float, finer: float) -> float:
    """Return the largest difference of the final angles from those at a finer setting, rad."""
    return float(np.abs(run(setting)[0] - run(finer)[0]).max())

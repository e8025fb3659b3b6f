"""Ideal chains and humanoids in MuJoCo at equal error, and right-hand sides of chains in Pinocchio.

Programs that are not installed are reported, and their rows left out.
"""

import importlib
import math
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any, TypeAlias

import numpy as np

import clearjoint as cj
from studies.benchmark.chain import LENGTH, MASS, ideal_chain
from studies.benchmark.ladder_scenes import GRAVITY, humanoid, humanoid_urdf
from studies.benchmark.table import SHORT, processor_time, shown

SPAN = 0.2
"""Simulated time, s."""
TARGET = 1e-6
"""Largest error of a position at the end that counts as equal, m."""
FINEST = 1e-11
"""Relative tolerance of the solution with which positions are compared."""
MOST_STEPS = 20_000
"""Largest number of MuJoCo's steps that is tried."""
INTEGRATORS = ("RK4", "implicitfast")
STAGES = 6
"""Right-hand sides in an attempted step of clearjoint's default method, Tsit5, which takes over one
of its seven from the step before."""
EVALUATIONS = 2000
"""Number of right-hand sides that are timed together."""
DOWN = -9.81
"""Component Y of gravity in the chain, m/s^2."""

Positions: TypeAlias = np.ndarray
"""(bodies, 3), m."""


@dataclass(frozen=True)
class Compared:
    """Times of clearjoint and of another program, s."""

    label: str
    here: float
    other: float

    def cells(self) -> tuple[str, ...]:
        """Return the row of the table."""
        return self.label, shown(self.here), shown(self.other), f"{self.here / self.other:.3g}"


def yardsticks(
    sizes: Mapping[str, tuple[int, ...]], steps: Mapping[tuple[str, int], float]
) -> list[Compared]:
    """Compare each ideal chain and humanoid of the given sizes with the other programs.

    **Arguments:** `steps`: measured times of a step of `simulate`, s, by scene and size; a scene
    without a time is left out.
    """
    found: list[Compared] = []
    for package, extra, rows in (("mujoco", "mujoco", _mujoco), ("pinocchio", "pin", _pinocchio)):
        if find_spec(package) is None:
            print(f"{package} is not installed (pip install {extra}): its rows are left out.")
            continue
        for scene in sizes:
            for size in sizes[scene]:
                if (scene, size) not in steps:
                    continue
                for compared in rows(scene, size, steps[scene, size]):
                    found.append(compared)
                    print(" | ".join(compared.cells()), file=sys.stderr, flush=True)
    return found


def _mujoco(scene: str, size: int, step: float) -> Iterator[Compared]:
    """Yield the comparisons of a scene with MuJoCo's integrators."""
    del step
    if scene not in ("ideal", "humanoid"):
        return
    model, mechanism = (
        (chain_model(size), ideal_chain(size))
        if scene == "ideal"
        else (humanoid_urdf(size), humanoid(size))
    )
    here = Here(*mechanism)
    exact = here.run(FINEST)
    rtol = next(
        r for r in 10.0 ** np.arange(-4.0, -10.0, -0.5) if _error(here.run(r), exact) < TARGET
    )
    time_here = processor_time(lambda: len(here.run(rtol)), SHORT).seconds
    there = MujocoTree(model, list(here.scene.bodies), GRAVITY if scene == "humanoid" else None)
    for integrator in INTEGRATORS:
        count = 16
        while _error(there.run(integrator, count), exact) > TARGET and count < MOST_STEPS:
            count *= 2
        run = _bound(there.run, integrator, count)
        error = _error(run(), exact)
        equal = "" if error <= TARGET else f", off {error:.0e} m"
        seconds = processor_time(lambda run=run: len(run()), SHORT).seconds
        to = f"{SPAN:g} s to {TARGET:g} m"
        label = f"{scene}, {size}: {to}; MuJoCo, {integrator}, {count} steps{equal}"
        yield Compared(label, time_here, seconds)


def _bound(function: Callable[..., Positions], *arguments: object) -> Callable[[], Positions]:
    return lambda: function(*arguments)


def _error(positions: Positions, exact: Positions) -> float:
    return float(np.abs(positions - exact).max())


class Here:
    """A scene in clearjoint.

    - `scene`: the scene.
    """

    def __init__(self, scene: cj.Scene, state: cj.State):
        self.scene, self._state = scene, state

    def run(self, rtol: float) -> Positions:
        """Return the positions of all bodies after `SPAN`, for a relative tolerance."""
        settings = cj.Settings(rtol=float(rtol))
        final = cj.simulate(self.scene, self._state, SPAN, settings, progress=False).final
        return np.array([final.bodies[name].position for name in self.scene.bodies])


def chain_model(rods: int) -> str:
    """Return `ideal_chain` in MuJoCo's XML."""
    across = MASS * LENGTH**2 / 12.0
    opened = "".join(
        f'<body name="rod {k + 1}" pos="{LENGTH if k else 0.0} 0 0"><joint axis="0 0 1"/>'
        f'<inertial pos="{0.5 * LENGTH} 0 0" mass="{MASS}" '
        f'diaginertia="{1e-3 * across!r} {across!r} {across!r}"/>'
        for k in range(rods)
    )
    return (
        f'<mujoco><option gravity="0 {DOWN} 0"/><worldbody>{opened}{"</body>" * rods}'
        "</worldbody></mujoco>"
    )


class MujocoTree:
    """A tree of bodies at rest in MuJoCo.

    **Arguments:** `model`: MJCF or URDF; `bodies`: names of the bodies in the order of positions;
    `gravity`: m/s^2, if the model does not have it.
    """

    def __init__(self, model: str, bodies: list[str], gravity: tuple[float, ...] | None):
        from mujoco import MjData, MjModel  # pyright: ignore

        self._model = MjModel.from_xml_string(model)
        if gravity is not None:
            self._model.opt.gravity[:] = gravity
        self._data = MjData(self._model)
        self._bodies = [self._model.body(name).id for name in bodies]

    def run(self, integrator: str, count: int) -> Positions:
        """Return the positions of the bodies after `SPAN`, for a number of steps."""
        from mujoco import mj_kinematics, mj_resetData, mj_step, mjtIntegrator  # pyright: ignore

        self._model.opt.integrator = getattr(mjtIntegrator, f"mjINT_{integrator.upper()}")
        self._model.opt.timestep = SPAN / count
        mj_resetData(self._model, self._data)
        mj_step(self._model, self._data, nstep=count)
        mj_kinematics(self._model, self._data)
        return self._data.xipos[self._bodies].copy()


def _pinocchio(scene: str, size: int, step: float) -> Iterator[Compared]:
    """Yield the comparison of a chain's right-hand side with Pinocchio's `aba`."""
    if scene != "ideal":
        return
    # Type checkers do not know the attributes of the compiled module.
    pin: Any = importlib.import_module("pinocchio")
    model, place = pin.Model(), pin.SE3.Identity()
    across = MASS * LENGTH**2 / 12.0
    inertia = pin.Inertia(
        MASS, np.array([0.5 * LENGTH, 0.0, 0.0]), np.diag([1e-3 * across, across, across])
    )
    joint = 0
    for k in range(size):
        joint = model.addJoint(joint, pin.JointModelRZ(), place, f"hinge {k + 1}")
        model.appendBodyToJoint(joint, inertia, pin.SE3.Identity())
        place = pin.SE3(np.eye(3), np.array([LENGTH, 0.0, 0.0]))
    model.gravity.linear = np.array([0.0, DOWN, 0.0])
    data, q, zeros = model.createData(), np.linspace(0.0, 1.0, size), np.zeros(size)
    pin.aba(model, data, q, zeros, zeros)
    least = math.inf
    for _ in range(SHORT):
        begun = time.process_time()
        for _ in range(EVALUATIONS):
            pin.aba(model, data, q, zeros, zeros)
        least = min(least, (time.process_time() - begun) / EVALUATIONS)
    label = f"{scene}, {size}: right-hand side (a step / {STAGES}); Pinocchio, aba"
    yield Compared(label, step / STAGES, least)

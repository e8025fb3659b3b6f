"""Robots' files: which can be loaded, and accelerations beside those of Pinocchio and MuJoCo."""

import importlib
import re
import warnings
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import jax
import numpy as np

import clearjoint as cj

REMEDIES: dict[str, Any] = {
    "free_root": True,
    "balance_inertia": True,
    "bound_mass": 1e-3,
    "bound_inertia": 1e-6,
}
"""Arguments of `load_robot` that its messages name as remedies, with the values to try."""
STATES = 3
"""Number of random states of a robot in which accelerations are compared."""
LARGEST = 1.0
"""Largest position, rad or m, and speed, rad/s or m/s, of a joint."""


@dataclass(frozen=True)
class Loaded:
    """How a file was loaded.

    - `options`: the arguments that were needed, and `refused`: the message if none help.
    - `bodies`: number of bodies.
    - `beside`: the other program, and `difference`: the largest difference of a joint's
      acceleration from its, over the largest one or, if less, 1 rad/s^2 or m/s^2; ``None`` if
      not compared.
    """

    name: str
    options: dict[str, Any]
    refused: str = ""
    bodies: int = 0
    beside: str = ""
    difference: float | None = None


def robot_files(folder: Path) -> Iterator[Path]:
    """Yield the URDF files and the MJCF files with a body in a folder, at any depth."""
    for path in sorted(folder.rglob("*")):
        if path.suffix == ".urdf" or (
            path.suffix == ".xml"
            and "<mujoco" in (text := path.read_text("utf-8", "replace"))
            and "<body" in text
        ):
            yield path


def load(path: Path) -> tuple[cj.results.Robot | None, Loaded]:
    """Load a file as a user does who follows the messages."""
    options: dict[str, Any] = {}
    while True:
        try:
            with warnings.catch_warnings(action="ignore"):
                robot = cj.load_robot(path, **options)
            return robot, Loaded(path.name, options, bodies=len(robot.scene.bodies))
        except ValueError as error:
            message = str(error)
            named = [name for name in REMEDIES if re.search(rf"\b{name}\b", message)]
            further = {name: REMEDIES[name] for name in named if name not in options}
            if not further:
                return None, Loaded(path.name, options, refused=message)
            options |= further


def accelerations(robot: cj.results.Robot, state: cj.State, springs: bool) -> dict[str, float]:
    """Return the accelerations of hinges and sliders, rad/s^2 or m/s^2, with gravity alone or with
    the `springs` and dampers of the file, as if no joint closed a loop, followed another or rubbed.
    """
    scene, tree = robot.scene, robot.angles(state)
    kept = {name: joint for name, joint in scene.joints.items() if name in tree}
    scene = cj.Scene(scene.bodies, kept, scene.forces if springs else {}, scene.gravity)
    formulation = cj.extend.Formulation(cj.JointCoordinates(), cj.Baumgarte(0.0, 0.0))
    parts = (jax.tree.map(np.asarray, part) for part in (scene, formulation, state))
    scene, formulation, state = map(cj.extend.unpack, parts)
    system = cj.extend.System(scene, formulation)
    rates = system.dynamics(dict(system.encode(state.bodies)), {}, 0.0).variable_rates
    # The coordinates of a joint are those of its end that is farther from the root of the tree, and
    # measure the motion of that end relative to the other.
    free = [name for name, rate in rates.items() if isinstance(rate, cj.BodyState)]
    placed, ends = {cj.GROUND, *free}, {}
    while len(ends) < len(kept):
        for name, joint in kept.items():
            pair = joint.pair()
            if name not in ends and placed & {*pair}:
                (ends[name],) = {*pair} - placed
                placed |= {*pair}
    signs = {name: 1.0 if ends[name] == kept[name].pair()[1] else -1.0 for name in robot.joints}
    return {name: sign * float(rates[ends[name]].speeds[0]) for name, sign in signs.items()}


def of_pinocchio(path: Path, q: dict[str, Any], v: dict[str, Any]) -> dict[str, float]:
    """Return the accelerations under gravity by Pinocchio's articulated-body algorithm."""
    pinocchio: Any = importlib.import_module("pinocchio")

    model = pinocchio.buildModelFromUrdf(str(path))
    data, position, speed = model.createData(), pinocchio.neutral(model), np.zeros(model.nv)
    joints = {name: model.joints[model.getJointId(name)] for name in q}
    for name, joint in joints.items():
        x = q[name]
        # The position of a continuous joint is a point on the unit circle.
        position[joint.idx_q : joint.idx_q + joint.nq] = (
            [x] if joint.nq == 1 else [np.cos(x), np.sin(x)]
        )
        speed[joint.idx_v] = v[name]
    found = pinocchio.aba(model, data, position, speed, np.zeros(model.nv))
    return {name: float(found[joint.idx_v]) for name, joint in joints.items()}


def of_mujoco(path: Path, q: dict[str, Any], v: dict[str, Any]) -> dict[str, float]:
    """Return the accelerations by MuJoCo, without contacts, limits, constraints, drives, springs of
    tendons, and fluid."""
    mujoco: Any = importlib.import_module("mujoco")

    model = mujoco.MjModel.from_xml_path(str(path))
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)
    model.opt.density = model.opt.viscosity = model.tendon_stiffness[:] = 0.0
    data = mujoco.MjData(model)
    for name in q:
        data.joint(name).qpos, data.joint(name).qvel = q[name], v[name]
    mujoco.mj_forward(model, data)
    return {name: float(data.joint(name).qacc[0]) for name in q}


def difference(path: Path, robot: cj.results.Robot) -> tuple[str, float]:
    """Return the other program, and the largest difference of accelerations from its."""
    is_urdf = path.suffix == ".urdf"
    of_other, generator, worst = (
        of_pinocchio if is_urdf else of_mujoco,
        np.random.default_rng(0),
        0.0,
    )
    free = [name for name in robot.joints if name not in robot.leaders]
    for _ in range(STATES):
        numbers = generator.uniform(-LARGEST, LARGEST, (2, len(free)))
        state = robot.state(*(dict(zip(free, row, strict=True)) for row in numbers))
        q, v = (
            {k: part[k] for k in robot.joints}
            for part in (robot.angles(state), robot.speeds(state))
        )
        ours, others = accelerations(robot, state, springs=not is_urdf), of_other(path, q, v)
        size = max(1.0, *map(abs, others.values()))
        worst = max(worst, *(abs(ours[name] - others[name]) / size for name in q))
    return "Pinocchio" if is_urdf else "MuJoCo", worst


def survey(folder: Path) -> list[Loaded]:
    """Load all files of a folder, and compare the accelerations of those without other inertias
    than in the file."""
    rows = []
    for path in robot_files(folder):
        try:
            robot, row = load(path)
            if robot is not None and robot.joints and not row.options.keys() - {"free_root"}:
                beside, worst = difference(path, robot)
                row = replace(row, beside=beside, difference=worst)
        except ImportError as error:
            print(f"{path.name}: {error}")
            continue
        rows.append(row)
    return rows


def table(rows: list[Loaded]) -> list[tuple[str, ...]]:
    """Return the table of files, head first, and numbers of all files in the last rows."""
    cells: list[tuple[str, ...]] = [("file", "bodies", "arguments needed", "largest difference")]
    for row in rows:
        options = ", ".join(f"{name}={value}" for name, value in row.options.items())
        beside = "" if row.difference is None else f"{row.difference:.0e} from {row.beside}"
        cells.append((row.name, str(row.bodies or ""), row.refused or options, beside))
    return cells


def counts(rows: list[Loaded]) -> list[tuple[str, str]]:
    """Return how many files load, and the largest difference of accelerations."""
    kinds = Counter(
        "refused" if r.refused else "arguments" if r.options else "default" for r in rows
    )
    compared = [r.difference for r in rows if r.difference is not None]
    return [
        ("files", str(len(rows))),
        ("loaded by default", str(kinds["default"])),
        ("loaded with arguments that the messages name", str(kinds["arguments"])),
        ("refused, with element and remedy", str(kinds["refused"])),
        ("largest difference of an acceleration", f"{max(compared, default=0.0):.0e}"),
    ]

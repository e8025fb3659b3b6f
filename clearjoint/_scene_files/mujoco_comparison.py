"""Runs of an MJCF file in MuJoCo beside those of its scene."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import jax
import numpy as np
from typing_extensions import override

from .._export.tables import aligned, number
from .._fields.checks import require, require_positive
from .._model.bodies import State
from .._model.scene import Scene
from .._simulation.run.saving import Saving
from .._simulation.run.simulate import simulate
from .._simulation.step.settings import Settings
from .documents import FileLocation
from .files import FilePath
from .mjcf import Model, mujoco_package
from .mjcf_writer import MjcfWriter, mjcf_of
from .robot import Robot

SAMPLES = 500
"""Largest number of times at which two runs are compared."""
FILE = "the MJCF file"


@dataclass(frozen=True)
class MujocoComparison:
    """Motion in MuJoCo beside that of the scene, for n lengths of MuJoCo's time step.

    - `timesteps`: (n,) s, of MuJoCo.
    - `times`: (N,) s, from zero, at which the runs are compared.
    - `positions`: of each hinge and slider in the run of the scene, (N,) rad or m, by name.
    - `in_mujoco`: positions of the same joints in MuJoCo, (n, N) rad or m, by name. If a motion
      diverges, because the step is too long for a flank, its later numbers are NaN or arbitrary.
    - `largest_difference`: between `positions` and `in_mujoco` over all times, (n,) rad or m, by
      name of the joint; infinite after divergence.

    ``print(comparison)`` shows the largest differences as a table.

    >>> still = {"elbow": np.zeros(2)}
    >>> off = {"elbow": np.array([[0.0, 2e-3], [0.0, 1e-4]])}
    >>> print(cj.results.MujocoComparison((1e-3, 1e-4), np.array([0.0, 0.1]), still, off))
    largest difference elbow
    step of 1 ms       0.002
    step of 0.1 ms    0.0001
    """

    timesteps: tuple[float, ...]
    times: np.ndarray
    positions: Mapping[str, np.ndarray]
    in_mujoco: Mapping[str, np.ndarray]

    @property
    def largest_difference(self) -> dict[str, np.ndarray]:
        differences = {name: self.in_mujoco[name] - q for name, q in self.positions.items()}
        largest = {name: np.abs(rows).max(axis=1) for name, rows in differences.items()}
        return {name: np.nan_to_num(part, nan=np.inf) for name, part in largest.items()}

    @override
    def __str__(self) -> str:
        largest = self.largest_difference
        rows = [["largest difference", *largest]]
        for step, row in zip(self.timesteps, zip(*largest.values(), strict=True), strict=True):
            shown = [number(part) if np.isfinite(part) else "diverged" for part in row]
            rows.append([f"step of {number(1e3 * step, 3)} ms", *shown])
        return "\n".join(aligned(rows))


def compare_with_mujoco(
    scene: Scene | Robot,
    state: State,
    end_time: float,
    *,
    timesteps: Sequence[float] | None = None,
    path: FilePath | None = None,
    integrator: str = "implicitfast",
    settings: Settings | None = None,
) -> MujocoComparison:
    """Simulate a scene or robot, and its file in MuJoCo; return the differences of the joints.

    ```python
    import clearjoint as cj

    play = {"backlash": "1 deg", "torsional_stiffness": 200.0, "restitution": 0.4}
    robot = cj.load_robot("arm.urdf", play={"wrist": play})
    state = robot.state({"elbow": 0.3})
    print(cj.compare_with_mujoco(robot, state, end_time=0.2, timesteps=(1e-3, 1e-4, 1e-5)))
    ```

    `save_mjcf` tells what the file has. Differences come from the error of MuJoCo's time steps,
    which decreases with their length, and from what the file lacks. After some tens of impacts, a
    motion with play is often chaotic: any two runs then differ.

    **Arguments:**

    - `scene`: a `Scene`, or a `Robot`. The actuators of a robot's file do not act.
    - `state`: at the start.
    - `end_time`: s.
    - `timesteps`: s, of MuJoCo, adjusted so that a whole number of them fits between two of the
      compared times; by default that of the file, a quarter and a sixteenth of it.
    - `path`: of an MJCF file with the joints of the scene by name, such as one of `save_mjcf` that
      you have changed; by default the one that `save_mjcf` writes.
    - `integrator`: of MuJoCo, unless `path` is given.
    - `settings`: of the run of the scene, as in `simulate`.

    **Raises:** `ValueError` as `save_mjcf` and `simulate`, and for a file without a joint of the
    scene. `ImportError` without the extra ``mujoco``. **Warns:** as `save_mjcf`.
    """
    require_positive("end_time", end_time, "give it in s")
    location = FileLocation(FILE if path is None else str(path))
    writer, content = mjcf_of(scene, state, location, timestep=None, integrator=integrator)
    mujoco = mujoco_package(location)
    if path is None:
        model = mujoco.MjModel.from_xml_string(content)
    else:
        with location.in_errors():
            model = mujoco.MjModel.from_xml_path(str(Path(path)))
    if timesteps is None:
        timesteps = [model.opt.timestep / part for part in (1, 4, 16)]
    remedy = "give at least one, in s"
    require(len(timesteps) > 0, "timesteps", timesteps, "a sequence of positive numbers", remedy)
    for step in timesteps:
        require_positive("timesteps", step, remedy)
    count = int(np.clip(end_time / max(timesteps), 1, SAMPLES))
    times = np.linspace(0.0, end_time, count + 1)
    mechanism = scene.scene if isinstance(scene, Robot) else scene
    solution = simulate(mechanism, state, end_time, settings, Saving(times), progress=False)
    motion = writer.motion(solution.states)
    # Hinges and sliders have one number, balls four and free joints seven.
    positions = {name: q[:, 0] for name, (q, _) in motion.items() if q.shape[1] == 1}
    expected, remedy = "one with a hinge or slider", "add one; other joints are not compared"
    require(bool(positions), "scene", [*writer.joints], expected, remedy)
    for name in positions:
        has_joint = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name) >= 0
        require(has_joint, "path", str(path), f"a file with a joint {name!r}", "add the joint")
    # MuJoCo would restart a motion that diverges; the comparison shows it as it is.
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    for k in range(model.nu):
        # An actuator of the robot's file, which the scene lacks, gets no force.
        if model.actuator(k).name not in writer.controls:
            model.actuator_gainprm[k], model.actuator_biasprm[k] = 0.0, 0.0
    counts = [max(round(times[1] / step), 1) for step in timesteps]  # of steps between two times
    runs = [_run(model, writer, state, times, steps, [*positions]) for steps in counts]
    in_mujoco = {name: np.stack([run[name] for run in runs]) for name in positions}
    return MujocoComparison(tuple(float(times[1] / n) for n in counts), times, positions, in_mujoco)


def _run(
    model: Model, writer: MjcfWriter, state: State, times: np.ndarray, steps: int, names: list[str]
) -> dict[str, np.ndarray]:
    """Return the positions in MuJoCo of the joints `names` at `times`, (N,) rad or m by name, in a
    run from the `state` with `steps` time steps between two of the times, evenly spaced from 0."""
    mujoco = mujoco_package(FileLocation(FILE))
    data, step = mujoco.MjData(model), times[1] / steps
    model.opt.timestep = step
    data.qpos[:], data.qvel[:] = writer.start(model, state)
    addresses = np.array([model.joint(name).qposadr[0] for name in names], dtype=int)
    # Controls are taken in the middle of each step: the error is then proportional to the square of
    # the step's length.
    middles = step * (np.arange(steps * (len(times) - 1)) + 0.5)
    controls = {
        model.actuator(name).id: np.asarray(jax.vmap(control)(middles))
        for name, control in writer.controls.items()
    }
    positions = [data.qpos[addresses]]
    for k in range(len(times) - 1):
        for j in range(k * steps, (k + 1) * steps):
            for index, control in controls.items():
                data.ctrl[index] = control[j]
            mujoco.mj_step(model, data)
        positions.append(data.qpos[addresses])
    return dict(zip(names, np.array(positions).T, strict=True))

"""A double pendulum in space with ideal hinges, in MuJoCo, Exudyn and clearjoint."""

from typing import Any

import numpy as np

import clearjoint as cj
from clearjoint import plot
from studies.validation.check import Check
from studies.validation.programs import installed

END = 2.0
"""s."""
STEP = 1e-4
"""Step of MuJoCo's fourth-order Runge-Kutta method, s."""
SHORTER = 2.5e-4
"""The shorter of the two steps of Exudyn, s."""
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


def double_pendulum() -> list[Check]:
    """Check the angles of both hinges at the end with each program that is installed.

    The first hinge is horizontal, and the second along the upper arm, so that the motion is
    spatial.
    """
    there = installed({"MuJoCo": _mujoco, "Exudyn": _exudyn})
    ours = _clearjoint() if there else []
    return [
        Check(f"{name}, double pendulum", f"angle of the {hinge} hinge at 2 s", "rad", value, own)
        for name, run in there.items()
        for hinge, value, own in zip(("first", "second"), run().tolist(), ours, strict=True)
    ]


def _mujoco() -> np.ndarray:
    """Return the final angles of MuJoCo, (2,) rad within half a revolution."""
    from mujoco import MjData, MjModel, mj_step  # pyright: ignore

    model = MjModel.from_xml_string(MODEL)
    data = MjData(model)
    data.qvel[:] = (0.0, SPIN)
    mj_step(model, data, nstep=round(END / STEP))
    return np.remainder(data.qpos + np.pi, 2.0 * np.pi) - np.pi


def _exudyn() -> np.ndarray:
    """Return the final angles of Exudyn, (2,) rad, extrapolated from two steps of order two."""
    coarse, fine = _exudyn_run(2.0 * SHORTER), _exudyn_run(SHORTER)
    return (4.0 * fine - coarse) / 3.0


def _exudyn_run(step: float) -> np.ndarray:
    """Return the final angles of Exudyn's generalised alpha method with a step in s, (2,) rad."""
    import exudyn as exu  # pyright: ignore
    from exudyn import utilities

    eu: Any = utilities
    system: Any = exu.SystemContainer().AddSystem()
    options = {"gravity": [0.0, 0.0, -9.81], "nodeType": exu.NodeType.RotationEulerParameters}
    upper = system.CreateRigidBody(
        inertia=eu.RigidBodyInertia(2.0, np.diag((0.01, 0.2, 0.2))),
        referencePosition=[0.5, 0.0, 0.0],
        **options,
    )
    lower = system.CreateRigidBody(
        inertia=eu.RigidBodyInertia(1.0, np.diag((0.1, 0.01, 0.1))),
        referencePosition=[1.0, 0.3, 0.0],
        initialVelocity=[0.0, 0.0, 0.3 * SPIN],
        initialAngularVelocity=[SPIN, 0.0, 0.0],
        **options,
    )
    ground = system.CreateGround()
    for pair, place, axis in (
        ([ground, upper], [0.0, 0.0, 0.0], [0.0, 1.0, 0.0]),
        ([upper, lower], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]),
    ):
        system.CreateRevoluteJoint(itemNumbers=pair, position=place, axis=axis)
    system.Assemble()
    settings: Any = exu.SimulationSettings()
    settings.timeIntegration.numberOfSteps = round(END / step)
    settings.timeIntegration.endTime = END
    settings.timeIntegration.newton.relativeTolerance = 1e-10
    settings.timeIntegration.verboseMode = 0
    settings.solution.file.write = False
    system.SolveDynamic(settings)
    turned, second = (
        np.reshape(system.GetObjectOutputBody(body, exu.OutputVariableType.RotationMatrix), (3, 3))
        for body in (upper, lower)
    )
    relative = turned.T @ second
    return np.arctan2((-turned[2, 0], relative[2, 1]), (turned[0, 0], relative[1, 1]))


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

"""A ball that falls on a spring and damper, in MuJoCo, Exudyn and clearjoint.

The force of the floor is K depth + D rate, and is zero where the damper would pull.
"""

import math
from itertools import pairwise
from typing import Any

import numpy as np

import clearjoint as cj
from studies.real_bounces.ball import BALL, FLOOR, GRAVITY, LOWEST, scene
from studies.validation.check import Check
from studies.validation.programs import installed

MASS, RADIUS, HEIGHT, END = 1.0, 0.05, 0.5, 1.55
"""kg; m; height of the ball's lowest point at the start, m; s, in the flight after four
impacts."""
STIFFNESS, DAMPING = 1e4, 20.0
"""N/m, N s/m."""
STEPS = (5e-4, 2.5e-4, 1.25e-4)
"""Steps of MuJoCo's fourth-order Runge-Kutta method, s."""
SHORTEST = 1e-10
"""Length of step, s, at which the start or the end of a contact counts as found."""
IMPEDANCE = 1e-4
"""Least impedance that MuJoCo allows."""
TOLERANCE = 1e-11
"""Tolerance of Exudyn's Runge-Kutta method of order five, whose steps vary."""


def bounce() -> list[Check]:
    """Check the height and the velocity at the end with each program that is installed."""
    there = installed({"MuJoCo": _mujoco, "Exudyn": _exudyn})
    ours = _clearjoint() if there else np.zeros(2)
    names = {"height of the ball": "m", "velocity of the ball": "m/s"}
    return [
        Check(f"{program}, bouncing ball", f"{name} at {END} s", unit, float(value), float(own))
        for program, run in there.items()
        for (name, unit), value, own in zip(names.items(), run(), ours, strict=True)
    ]


def mujoco_orders() -> np.ndarray:
    """Return the order at which the height and the velocity of MuJoCo converge, (2,)."""
    runs = [_mujoco_run(step, IMPEDANCE) for step in STEPS]
    coarse, fine = (abs(a - b) for a, b in pairwise(runs))
    return np.log2(coarse / fine)


def _mujoco() -> np.ndarray:
    """Return the final height, m, and velocity, m/s, of MuJoCo.

    An impedance d adds d times the weight to the force of the floor. Two runs remove this, as the
    result is proportional to d, and two others the error of the steps, which has order four.
    """
    coarse, fine = (_mujoco_run(step, IMPEDANCE) for step in STEPS[-2:])
    stiffer = _mujoco_run(STEPS[-1], 2.0 * IMPEDANCE)
    return fine + (fine - coarse) / 15.0 + (fine - stiffer)


def _mujoco_run(longest: float, impedance: float) -> np.ndarray:
    """Return the final height, m, and velocity, m/s, of MuJoCo with steps in s.

    The floor is the limit of a slide joint. A step in which the contact starts or ends is halved
    until it is `SHORTEST`, because the force jumps there.
    """
    from mujoco import MjData, MjModel, mj_forward, mj_step  # pyright: ignore

    model = MjModel.from_xml_string(f"""
<mujoco>
  <option gravity="0 0 {-GRAVITY}" integrator="RK4" tolerance="0"/>
  <worldbody>
    <body>
      <joint type="slide" axis="0 0 1" limited="true" range="0 100"
        solreflimit="{-STIFFNESS / MASS} {-DAMPING / MASS}"
        solimplimit="{impedance} {impedance} 0.001 0.5 1"/>
      <inertial pos="0 0 0" mass="{MASS}" diaginertia="1 1 1"/>
    </body>
  </worldbody>
</mujoco>
""")
    data = MjData(model)
    data.qpos[0] = HEIGHT
    mj_forward(model, data)
    step = longest
    while data.time < END - SHORTEST:
        before = data.time, data.qpos.copy(), data.qvel.copy()
        pushes = data.qfrc_constraint[0] > 0.0
        model.opt.timestep = step = min(step, END - data.time)
        mj_step(model, data)
        mj_forward(model, data)
        if (data.qfrc_constraint[0] > 0.0) != pushes and step > SHORTEST:
            data.time, data.qpos[:], data.qvel[:] = before
            mj_forward(model, data)
            step *= 0.5
        else:
            step = min(2.0 * step, longest)
    return np.array([data.qpos[0], data.qvel[0]])


def _exudyn() -> np.ndarray:
    """Return the final height, m, and velocity, m/s, of Exudyn."""
    import exudyn as exu  # pyright: ignore
    from exudyn import itemInterface

    def force(system: Any, t: float, item: int, height: float, velocity: float, *_: float) -> float:
        """Return the force that acts on the ball downwards, N."""
        pull = STIFFNESS * height + DAMPING * velocity
        return min(pull, 0.0) if height < 0.0 else 0.0

    items: Any = itemInterface
    system: Any = exu.SystemContainer().AddSystem()
    node = system.AddNode(items.Node1D(initialCoordinates=[HEIGHT]))
    system.AddObject(items.ObjectMass1D(mass=MASS, nodeNumber=node))
    ground = system.AddNode(items.NodePointGround())
    ends = [
        system.AddMarker(items.MarkerNodeCoordinate(nodeNumber=number, coordinate=0))
        for number in (ground, node)
    ]
    system.AddObject(
        items.ObjectConnectorCoordinateSpringDamper(
            markerNumbers=ends,
            stiffness=STIFFNESS,
            damping=DAMPING,
            springForceUserFunction=force,
        )
    )
    system.AddLoad(items.LoadCoordinate(markerNumber=ends[1], load=-MASS * GRAVITY))
    system.Assemble()
    settings: Any = exu.SimulationSettings()
    settings.timeIntegration.endTime = END
    settings.timeIntegration.relativeTolerance = TOLERANCE
    settings.timeIntegration.absoluteTolerance = TOLERANCE
    settings.timeIntegration.minimumStepSize = 1e-14
    settings.timeIntegration.verboseMode = 0
    settings.solution.file.write = False
    system.SolveDynamic(settings, solverType=exu.DynamicSolverType.DOPRI5)
    kinds = exu.OutputVariableType.Coordinates, exu.OutputVariableType.Coordinates_t
    return np.array([float(np.squeeze(system.GetNodeOutput(node, kind))) for kind in kinds])


def _clearjoint() -> np.ndarray:
    """Return the final height, m, and velocity, m/s, of clearjoint."""
    ratio = 0.5 * DAMPING / math.sqrt(STIFFNESS * MASS)
    # The law is given by the restitution that it would have if the damper could pull.
    restitution = math.exp(-math.pi * ratio / math.sqrt(1.0 - ratio**2))
    law = cj.laws.KelvinVoigt(restitution, STIFFNESS, effective_mass=MASS)
    made = scene(law, MASS, 2.0 * RADIUS)
    start = cj.State({BALL: cj.body_state((0.0, RADIUS + HEIGHT, 0.0))})
    found = cj.simulate(
        made, start, END, cj.Settings(rtol=1e-11), cj.Saving(impacts=True), progress=False
    )
    assert found.impacts is not None
    assert len(found.impacts.of(FLOOR, LOWEST).onset) == 4
    ball = found.final.bodies[BALL]
    return np.array([ball.position[1] - RADIUS, ball.velocity[1]])

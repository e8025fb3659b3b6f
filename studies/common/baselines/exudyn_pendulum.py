"""The paper's double pendulum in Exudyn (PyPI `exudyn`, 1.13.6), as its users would run it.

Rigid bodies with Euler parameters, an ideal `CreateRevoluteJoint`, and one
`ObjectContactSphereSphere` a base: a journal sphere inside a hollow bearing sphere, stiffness
exponent 1.5. Its impact model 1 (Hunt-Crossley, F = K delta^1.5 (1 + 3 (1 - e)/2 rate/entry speed))
with e = (1 + c^2)/2 is Lankarani and Nikravesh's law for a requested restitution c; it latches the
entry speed at onset and floors it (`minimumImpactVelocity`). Default solver: implicit generalised
alpha of index 3, spectral radius 0.9, modified Newton, and the step sizes that contacts recommend,
which land on onsets; the default smallest step (1e-8 s) fails at the first impact, hence 1e-10 s.

How the model differs from `scipy_pendulum`:

- The spheres' centres must stay level, while the bearing is endless along Z. Each bearing sphere
  therefore rides on a slider of 1e-6 kg along the ground's Z axis, tied to the journal's height.
  (Hollow spheres fixed to the ground are the simpler model; r2 is then off by 2e-4 m at 0.1 s.)
- The hinge holds at position level (index 3), without Baumgarte's terms.
- The force is not clamped at zero: a base that separates faster than its entry speed over the
  damping factor is pulled (which did not happen within 0.5 s).
- Second order with numerical damping; the step across a separation is not adapted.

Against the event-exact reference (c 0.5 mm, e 0.9), the first impact's onset, entry speed and peak
force are right within 1e-12 s, 1e-8 and 1e-4 (relative) for any step up to 1e-3 s, and r2 at 0.1 s
is off by 8e-6, 7e-6, 1e-6 and 3e-8 m for steps of 1e-4, 2e-5, 5e-6 and 1e-6 s.
`EXUDYN_MODULE=fast` in the environment selects Exudyn's build without range checks (10 % faster).
"""

import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from studies.common.baselines.scipy_pendulum import (
    BEARING_RADIUS,
    BROAD,
    GRAVITY,
    JOURNAL_LENGTH,
    MASS,
    SLENDER,
    YOUNG_MODULUS,
    BaselineRun,
    ravn_contact,
)

try:
    import exudyn as exu
    from exudyn import utilities
except ImportError as error:
    raise ImportError("this baseline needs Exudyn: pip install exudyn") from error

eu: Any = utilities  # its own annotations declare enumerations and floats as int

ENTRY_SPEED_FLOOR = 1e-6
"""Floor of the entry speed, m/s."""
SLIDER_MASS = 1e-6
"""Mass of a bearing sphere, which moves along the axis only, kg."""
SMALLEST_STEP = 1e-10
"""Smallest step, s."""


@dataclass(frozen=True)
class FirstImpact:
    """Onset, s, entry speed, m/s, and peak force, N, of the first impact of base V."""

    onset: float
    entry_speed: float
    peak_force: float


@dataclass(frozen=True)
class _Model:
    """The assembled system, and the contact and its data node at base V."""

    system: Any
    arms: tuple[int, int]
    contact: int
    entry_speeds: int


def _arm(system: Any, inertia: tuple[float, float, float], position: list[float]) -> int:
    return system.CreateRigidBody(
        inertia=eu.RigidBodyInertia(MASS, np.diag(inertia)),
        referencePosition=position,
        gravity=list(GRAVITY),
        nodeType=exu.NodeType.RotationEulerParameters,
    )


def _bearing(system: Any, journal: int, z: float) -> int:
    """Return the marker of a bearing sphere that follows the journal along the ground's Z axis."""
    node = system.AddNode(eu.Node1D(referenceCoordinates=[0.0]))
    slider = system.AddObject(
        eu.Mass1D(
            mass=SLIDER_MASS,
            nodeNumber=node,
            referencePosition=[0.0, 0.0, z],
            referenceRotation=eu.RotationMatrixY(-0.5 * np.pi),
        )
    )
    bearing = system.AddMarker(eu.MarkerBodyRigid(bodyNumber=slider))
    system.AddObject(eu.SphericalJoint(markerNumbers=[bearing, journal], constrainedAxes=[0, 0, 1]))
    return bearing


def _base(
    system: Any, arm: int, z: float, clearance: float, restitution: float, young: float
) -> tuple[int, int]:
    """Add the contact of the base at `z`, m, and return its object and data node."""
    law = ravn_contact(clearance, restitution, young)
    journal = system.AddMarker(eu.MarkerBodyRigid(bodyNumber=arm, localPosition=[-0.5, 0.0, z]))
    entry_speeds = system.AddNode(
        eu.NodeGenericData(initialCoordinates=[clearance, 0.0, 0.0, 0.0], numberOfDataCoordinates=4)
    )
    contact = system.AddObject(
        eu.ObjectContactSphereSphere(
            markerNumbers=[journal, _bearing(system, journal, z)],
            nodeNumber=entry_speeds,
            spheresRadii=[BEARING_RADIUS - clearance, BEARING_RADIUS],
            isHollowSphere1=True,
            contactStiffness=law.stiffness,
            contactStiffnessExponent=1.5,
            impactModel=1,
            restitutionCoefficient=0.5 * (1.0 + restitution**2),
            minimumImpactVelocity=ENTRY_SPEED_FLOOR,
        )
    )
    return contact, entry_speeds


def _model(clearance: float, restitution: float, young: float = YOUNG_MODULUS) -> _Model:
    system = exu.SystemContainer().AddSystem()
    arm_2 = _arm(system, (SLENDER, BROAD, BROAD), [0.5, 0.0, 0.0])
    arm_3 = _arm(system, (BROAD, BROAD, SLENDER), [1.0, 0.0, 0.5])
    system.CreateRevoluteJoint(
        itemNumbers=[arm_2, arm_3], position=[1.0, 0.0, 0.0], axis=[1.0, 0.0, 0.0]
    )
    contact, entry_speeds = _base(
        system, arm_2, -0.5 * JOURNAL_LENGTH, clearance, restitution, young
    )
    _base(system, arm_2, 0.5 * JOURNAL_LENGTH, clearance, restitution, young)
    return _Model(system, (arm_2, arm_3), contact, entry_speeds)


def _settings(duration: float, step: float) -> Any:
    settings = exu.SimulationSettings()
    settings.timeIntegration.endTime = duration
    settings.timeIntegration.numberOfSteps = round(duration / step)
    settings.timeIntegration.minimumStepSize = SMALLEST_STEP
    settings.timeIntegration.generalizedAlpha.spectralRadius = 0.9
    settings.timeIntegration.newton.useModifiedNewton = True
    settings.linearSolver.solverType = exu.LinearSolverType.EXUdense
    settings.solution.file.write = False
    settings.solution.sensors.writePeriod = SMALLEST_STEP  # that is, every step
    return settings


def run(
    duration: float, step: float, clearance: float = 5e-4, restitution: float = 0.9
) -> BaselineRun:
    """Simulate from rest.

    **Arguments:** `duration` and the largest `step`, s; radial `clearance` m; requested
    `restitution`. The right-hand sides counted are Newton iterations, one residual each.
    """
    model = _model(clearance, restitution)
    model.system.Assemble()
    settings = _settings(duration, step)
    start = time.perf_counter()
    model.system.SolveDynamic(settings)
    seconds = time.perf_counter() - start
    r2, r3 = (
        np.array(model.system.GetObjectOutputBody(arm, exu.OutputVariableType.Position))
        for arm in model.arms
    )
    iterations = model.system.sys["dynamicSolver"].it
    return BaselineRun(r2, r3, iterations.currentStepIndex, iterations.newtonStepsCount, seconds)


def first_impact(step: float) -> FirstImpact:
    """Simulate the first impact of base V with a largest step, s, and every step recorded."""
    model = _model(5e-4, 0.9)
    force, entry_speeds = (
        model.system.AddSensor(sensor)
        for sensor in (
            eu.SensorObject(
                objectNumber=model.contact,
                storeInternal=True,
                outputVariableType=exu.OutputVariableType.Force,
            ),
            eu.SensorNode(
                nodeNumber=model.entry_speeds,
                storeInternal=True,
                outputVariableType=exu.OutputVariableType.Coordinates,
            ),
        )
    )
    model.system.Assemble()
    model.system.SolveDynamic(_settings(0.0105, step))
    forces = model.system.GetSensorStoredData(force)[:, 1:]
    t, gap, _, entry_speed, _ = model.system.GetSensorStoredData(entry_speeds).T
    inside = np.argmax(gap < 0.0)
    onset = t[inside] + gap[inside] / entry_speed[inside]
    peak = np.linalg.norm(forces, axis=1).max()
    return FirstImpact(float(onset), float(entry_speed[inside]), float(peak))


def probes(
    young: float, restitution: float, clearance: float, times: np.ndarray, step: float
) -> np.ndarray:
    """Return x and y of the bases V and W at `times`, s, (4, T) m, interpolated between steps."""
    model = _model(clearance, restitution, young)
    sensors = [
        model.system.AddSensor(
            eu.SensorBody(
                bodyNumber=model.arms[0],
                localPosition=[-0.5, 0.0, z],
                storeInternal=True,
                outputVariableType=exu.OutputVariableType.Position,
            )
        )
        for z in (-0.5 * JOURNAL_LENGTH, 0.5 * JOURNAL_LENGTH)
    ]
    model.system.Assemble()
    model.system.SolveDynamic(_settings(float(times[-1]), step))
    rows = []
    for sensor in sensors:
        t, x, y, _ = model.system.GetSensorStoredData(sensor).T
        rows += [np.interp(times, t, x), np.interp(times, t, y)]
    return np.stack(rows)

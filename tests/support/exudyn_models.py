"""Two models built in Exudyn, for comparison with the same models in clearjoint.

All constants are SI. Body frames sit at the centres of mass and are parallel to the global frame at
t = 0, so that points and axes below are the same in body and in global axes then.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

exu = pytest.importorskip("exudyn")
eu = pytest.importorskip("exudyn.utilities")

GRAVITY = (0.0, 0.0, -9.81)
"""m/s^2, of the spatial double pendulum; the bouncing mass has none."""

MASS_1, MASS_2 = 2.0, 1.5
"""kg."""
INERTIA_1 = np.array([[0.040, 0.004, 0.0], [0.004, 0.150, -0.010], [0.0, -0.010, 0.160]])
INERTIA_2 = np.array([[0.090, 0.0, 0.012], [0.0, 0.110, 0.0], [0.012, 0.0, 0.040]])
"""kg m^2, about the centre of mass in body axes."""
CENTRE_1 = np.array([0.4, 0.1, 0.0])
CENTRE_2 = np.array([0.9, 0.3, -0.2])
"""Centres of mass at t = 0, m. The spherical joint to the ground is at the origin."""
ELBOW = np.array([0.8, 0.2, 0.0])
"""The revolute joint between the bodies at t = 0, m."""
ELBOW_AXIS = np.array([1.0, 2.0, 2.0]) / 3.0
"""Its axis at t = 0."""
SPIN_1 = np.array([0.5, -1.0, 2.0])
"""Angular velocity of body 1 at t = 0, rad/s."""
ELBOW_RATE = 3.0
"""Angular velocity of body 2 relative to body 1 about the axis at t = 0, rad/s."""

BOUNCE_MASS = 2.0
"""kg."""
BOUNCE_STIFFNESS = 6.6e10
"""N/m^1.5, of the only contact; with two equal bases give each half of it."""
BOUNCE_CLEARANCE, BEARING_RADIUS = 5e-4, 10e-3
"""m; the mass is a sphere centred in a hollow sphere at t = 0."""


@dataclass(frozen=True)
class Bounce:
    """Speeds in m/s, peak force in N and contact time in s of one impact."""

    entry_speed: float
    exit_speed: float
    peak_force: float
    contact_time: float


def initial_velocities() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Velocities of both centres, m/s, and the spin of body 2, rad/s, that the joints allow."""
    spin_2 = SPIN_1 + ELBOW_RATE * ELBOW_AXIS
    velocity_1 = np.cross(SPIN_1, CENTRE_1)
    velocity_2 = np.cross(SPIN_1, ELBOW) + np.cross(spin_2, CENTRE_2 - ELBOW)
    return velocity_1, velocity_2, spin_2


def _settings(duration: float, step: float) -> Any:
    settings = exu.SimulationSettings()
    settings.timeIntegration.endTime = duration
    settings.timeIntegration.numberOfSteps = round(duration / step)
    settings.timeIntegration.minimumStepSize = 1e-12
    settings.timeIntegration.generalizedAlpha.spectralRadius = 1.0
    settings.timeIntegration.generalizedAlpha.useIndex2Constraints = True
    settings.timeIntegration.generalizedAlpha.useNewmark = True
    settings.timeIntegration.newton.relativeTolerance = 1e-10
    settings.linearSolver.solverType = exu.LinearSolverType.EXUdense
    settings.solution.file.write = False
    settings.solution.sensors.writePeriod = 1e-12  # that is, every step
    return settings


def _body(
    system: Any, mass: float, inertia: np.ndarray, centre: np.ndarray, v: np.ndarray, w: np.ndarray
) -> int:
    return system.CreateRigidBody(
        inertia=eu.RigidBodyInertia(mass, inertia),
        referencePosition=list(centre),
        initialVelocity=list(v),
        initialAngularVelocity=list(w),
        gravity=list(GRAVITY),
    )


def _history(system: Any, sensor: int) -> tuple[np.ndarray, np.ndarray]:
    data = system.GetSensorStoredData(sensor)
    return data[:, 0], data[:, 1:]


def _double_pendulum(duration: float, step: float) -> tuple[np.ndarray, np.ndarray]:
    system = exu.SystemContainer().AddSystem()
    velocity_1, velocity_2, spin_2 = initial_velocities()
    first = _body(system, MASS_1, INERTIA_1, CENTRE_1, velocity_1, SPIN_1)
    second = _body(system, MASS_2, INERTIA_2, CENTRE_2, velocity_2, spin_2)
    ground = system.CreateGround()
    system.CreateSphericalJoint(itemNumbers=[ground, first], position=[0.0, 0.0, 0.0])
    system.CreateRevoluteJoint(
        itemNumbers=[first, second], position=list(ELBOW), axis=list(ELBOW_AXIS)
    )
    sensors = [
        system.AddSensor(
            eu.SensorBody(
                bodyNumber=body,
                storeInternal=True,
                outputVariableType=exu.OutputVariableType.Position,
            )
        )
        for body in (first, second)
    ]
    system.Assemble()
    system.SolveDynamic(_settings(duration, step))
    histories = [_history(system, sensor) for sensor in sensors]
    return histories[0][0], np.stack([history[1] for history in histories], axis=1)


def spatial_double_pendulum(times: np.ndarray, step: float = 5e-4) -> np.ndarray:
    """Positions of both centres of mass at `times`, (n, 2, 3) m.

    Body 1 hangs on the ground by a spherical joint, body 2 on body 1 by a revolute joint with a
    skew axis. Generalised alpha at `step` s and half of it, extrapolated (Richardson). `times`, s,
    must be multiples of `step`.
    """
    coarse_times, coarse = _double_pendulum(float(times[-1]), step)
    fine_times, fine = _double_pendulum(float(times[-1]), 0.5 * step)
    rows = [np.abs(grid[:, None] - times).argmin(axis=0) for grid in (coarse_times, fine_times)]
    assert np.allclose(coarse_times[rows[0]], times, rtol=0.0, atol=1e-9)
    return (4.0 * fine[rows[1]] - coarse[rows[0]]) / 3.0


def _bouncing_mass(restitution: float, speed: float) -> tuple[Any, list[int]]:
    """The system, and sensors of the velocity, the force, and the contact's memory."""
    system = exu.SystemContainer().AddSystem()
    body = system.CreateRigidBody(
        inertia=eu.InertiaSphere(BOUNCE_MASS, BEARING_RADIUS), initialVelocity=[0.0, speed, 0.0]
    )
    markers = [
        system.AddMarker(eu.MarkerBodyRigid(bodyNumber=number))
        for number in (body, system.CreateGround())
    ]
    entry_speeds = system.AddNode(
        eu.NodeGenericData(
            initialCoordinates=[BOUNCE_CLEARANCE, 0.0, 0.0, 0.0], numberOfDataCoordinates=4
        )
    )
    contact = system.AddObject(
        eu.ObjectContactSphereSphere(
            markerNumbers=markers,
            nodeNumber=entry_speeds,
            isHollowSphere1=True,
            spheresRadii=[BEARING_RADIUS - BOUNCE_CLEARANCE, BEARING_RADIUS],
            contactStiffness=BOUNCE_STIFFNESS,
            contactStiffnessExponent=1.5,
            impactModel=1,
            restitutionCoefficient=restitution,
            minimumImpactVelocity=1e-6,
        )
    )
    kinds = exu.OutputVariableType
    sensors = [
        eu.SensorBody(bodyNumber=body, storeInternal=True, outputVariableType=kinds.Velocity),
        eu.SensorObject(objectNumber=contact, storeInternal=True, outputVariableType=kinds.Force),
        eu.SensorNode(
            nodeNumber=entry_speeds, storeInternal=True, outputVariableType=kinds.Coordinates
        ),
    ]
    return system, [system.AddSensor(sensor) for sensor in sensors]


def bounce(restitution: float, speed: float = 0.1, step: float = 1e-7) -> Bounce:
    """One impact of a mass that moves along Y at `speed`, m/s, in a hollow sphere; no gravity.

    Hunt and Crossley's law with exponent 1.5 and the requested `restitution`:
    F = K delta^1.5 (1 + 3 (1 - restitution)/2 rate/entry speed). Instants where the gap is zero are
    found by one Newton step from the nearest recorded one.
    """
    system, sensors = _bouncing_mass(restitution, speed)
    system.Assemble()
    contact_time = 3.2 * (BOUNCE_MASS / BOUNCE_STIFFNESS) ** 0.4 * speed**-0.2  # Hertz's
    system.SolveDynamic(_settings(BOUNCE_CLEARANCE / speed + 1.5 * contact_time, step))
    t, velocity = _history(system, sensors[0])
    force, entry_speeds = (_history(system, sensor)[1] for sensor in sensors[1:])
    inside = np.flatnonzero(entry_speeds[:, 0] < 0.0)
    ends = [t[i] + entry_speeds[i, 0] / velocity[i, 1] for i in (inside[0], inside[-1])]
    return Bounce(
        float(entry_speeds[inside[0], 2]),
        float(-velocity[-1, 1]),
        float(np.linalg.norm(force, axis=1).max()),
        float(ends[1] - ends[0]),
    )

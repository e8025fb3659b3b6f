"""The same models in another simulator: Exudyn, an optional extra."""

from typing import Any

import numpy as np
import pytest

import clearjoint as cj
from tests.support.one_body import ORIGIN, bearing, hinge, one_body

NEEDED = "Exudyn is not installed: pip install -e '.[exudyn]'"
exu: Any = pytest.importorskip("exudyn", reason=NEEDED)
eu: Any = pytest.importorskip("exudyn.utilities", reason=NEEDED)
KINDS = exu.OutputVariableType


def solved(system: Any, duration: float, step: float) -> None:
    """Integrate by generalised alpha without damping, in equal steps, s."""
    system.Assemble()
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
    system.SolveDynamic(settings)


GRAVITY, ELBOW, AXIS = (0.0, 0.0, -9.81), np.array([0.8, 0.2, 0.0]), np.array([1.0, 2.0, 2.0]) / 3.0
"""m/s^2; of the revolute joint between the bodies at the start, m and global."""
MASSES = 2.0, 1.5
INERTIAS = (
    np.array([[0.040, 0.004, 0.0], [0.004, 0.150, -0.010], [0.0, -0.010, 0.160]]),
    np.array([[0.090, 0.0, 0.012], [0.0, 0.110, 0.0], [0.012, 0.0, 0.040]]),
)
CENTRES = np.array([[0.4, 0.1, 0.0], [0.9, 0.3, -0.2]])
"""At the start, m, with axes parallel to the global ones."""
SPINS = np.array([0.5, -1.0, 2.0]) + np.outer([0.0, 3.0], AXIS)
AT_ELBOW = np.cross(SPINS[0], ELBOW)
VELOCITIES = np.cross(SPINS[0], CENTRES[0]), AT_ELBOW + np.cross(SPINS[1], CENTRES[1] - ELBOW)


def double_pendulum(times: np.ndarray, step: float) -> np.ndarray:
    """Positions of both centres of mass at times, (N, 2, 3) m, which are multiples of the step."""
    system = exu.SystemContainer().AddSystem()
    bodies = [
        system.CreateRigidBody(
            inertia=eu.RigidBodyInertia(mass, inertia),
            referencePosition=[*centre],
            initialVelocity=[*velocity],
            initialAngularVelocity=[*spin],
            gravity=[*GRAVITY],
        )
        for mass, inertia, centre, velocity, spin in zip(
            MASSES, INERTIAS, CENTRES, VELOCITIES, SPINS, strict=True
        )
    ]
    ground = system.CreateGround()
    system.CreateSphericalJoint(itemNumbers=[ground, bodies[0]], position=[0.0, 0.0, 0.0])
    system.CreateRevoluteJoint(itemNumbers=bodies, position=[*ELBOW], axis=[*AXIS])
    options = {"storeInternal": True, "outputVariableType": KINDS.Position}
    sensors = [system.AddSensor(eu.SensorBody(bodyNumber=body, **options)) for body in bodies]
    solved(system, float(times[-1]), step)
    histories = [system.GetSensorStoredData(sensor) for sensor in sensors]
    rows = np.abs(histories[0][:, :1] - times).argmin(axis=0)
    assert np.allclose(histories[0][rows, 0], times, rtol=0.0, atol=1e-9)
    return np.stack([history[rows, 1:] for history in histories], axis=1)


@pytest.mark.slow
def test_spatial_double_pendulum_with_ideal_joints():
    """A spherical joint and a revolute joint about a skew axis, full inertias, spinning start."""
    names, times = ("one", "two"), np.array([0.25, 0.5, 1.0])
    ends = (ELBOW - centre for centre in CENTRES)
    joints = {
        "ball": cj.SphericalJoint("ground", "one", ORIGIN, -CENTRES[0]),
        "elbow": hinge(*names, *ends, AXIS),
    }
    bodies = dict(zip(names, map(cj.Body, MASSES, INERTIAS), strict=True))
    states = {
        name: cj.body_state(centre, velocity=velocity, spin=spin)
        for name, centre, velocity, spin in zip(names, CENTRES, VELOCITIES, SPINS, strict=True)
    }
    scene, save = cj.Scene(bodies, joints, gravity=GRAVITY), cj.Saving(times)
    solution = cj.simulate(scene, cj.State(states), 1.0, cj.Settings(rtol=1e-9), save=save)
    coarse, fine = (double_pendulum(times, step) for step in (5e-4, 2.5e-4))
    theirs = (4.0 * fine - coarse) / 3.0
    for k, name in enumerate(names):
        ours = solution.states.bodies[name].position
        np.testing.assert_allclose(ours, theirs[:, k], rtol=0, atol=1e-7)


MASS, STIFFNESS, CLEARANCE, RADIUS, SPEED, STEP = 2.0, 6.6e10, 5e-4, 10e-3, 0.1, 1e-7
"""kg; N/m^1.5, of one contact; m; m; m/s; s."""


def bounce(restitution: float) -> tuple[float, float, float]:
    """Speed after one impact, m/s, peak force, N, and duration, s, of a mass in a hollow sphere,
    without gravity, by Hunt and Crossley's law.

    Instants where the gap is zero are found by one Newton step from the nearest recorded one.
    """
    system = exu.SystemContainer().AddSystem()
    sphere = eu.InertiaSphere(MASS, RADIUS)
    body = system.CreateRigidBody(inertia=sphere, initialVelocity=[0.0, SPEED, 0.0])
    markers = [
        system.AddMarker(eu.MarkerBodyRigid(bodyNumber=number))
        for number in (body, system.CreateGround())
    ]
    start = {"initialCoordinates": [CLEARANCE, 0.0, 0.0, 0.0], "numberOfDataCoordinates": 4}
    memory = system.AddNode(eu.NodeGenericData(**start))
    contact = system.AddObject(
        eu.ObjectContactSphereSphere(
            markerNumbers=markers,
            nodeNumber=memory,
            isHollowSphere1=True,
            spheresRadii=[RADIUS - CLEARANCE, RADIUS],
            contactStiffness=STIFFNESS,
            contactStiffnessExponent=1.5,
            impactModel=1,
            restitutionCoefficient=restitution,
            minimumImpactVelocity=1e-6,
        )
    )
    stored = {"storeInternal": True}
    sensors = (
        eu.SensorBody(bodyNumber=body, outputVariableType=KINDS.Velocity, **stored),
        eu.SensorObject(objectNumber=contact, outputVariableType=KINDS.Force, **stored),
        eu.SensorNode(nodeNumber=memory, outputVariableType=KINDS.Coordinates, **stored),
    )
    numbers = [system.AddSensor(sensor) for sensor in sensors]
    hertz = 3.2 * (MASS / STIFFNESS) ** 0.4 * SPEED**-0.2  # duration, s
    solved(system, CLEARANCE / SPEED + 1.5 * hertz, STEP)
    velocity, force, gap = map(system.GetSensorStoredData, numbers)
    inside = np.flatnonzero(gap[:, 1] < 0.0)
    begin, end = (gap[i, 0] + gap[i, 1] / velocity[i, 2] for i in (inside[0], inside[-1]))
    return -velocity[-1, 2], np.linalg.norm(force[:, 1:], axis=1).max(), end - begin


@pytest.mark.parametrize("restitution", [1.0, 0.9, 0.5])
def test_bounce_by_hunt_and_crossley(restitution):
    """One impact of a journal in its bearing; the two bases share the stiffness of one contact."""
    law = cj.laws.HuntCrossley(restitution, 0.5 * STIFFNESS)
    pin = {"pin": bearing(law, "journal", bearing_radius=RADIUS, clearance=CLEARANCE)}
    scene, state = one_body("journal", pin, mass=MASS, velocity=(0, SPEED, 0))
    save = cj.Saving(impacts=True)
    solution = cj.simulate(scene, state, 0.007, cj.Settings(rtol=1e-9), save)
    impact = solution.impacts.of("pin", "V")
    found = impact.exit_speed[0], 2 * impact.peak_force[0], impact.duration[0]
    assert found == pytest.approx(bounce(restitution), rel=1e-6)

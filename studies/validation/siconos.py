"""A four-bar linkage with three clearance joints, with the reference file of Siconos.

The example is siconos/siconos-tutorials, examples/mechanics/FourBarLinkageWith3clearance: contacts
are rigid, plastic (restitution 0) and rub with Coulomb's coefficient 0.1. It ran with steps of
1e-4 s by the rule of Moreau and Jean, as `simulate_nonsmooth` does.
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np

import clearjoint as cj
from clearjoint.extend import Scalar
from studies.validation.check import Check

CRANK, COUPLER, ROCKER, FRAME = 1.0, 4.0, 2.5, 3.0
"""Lengths, m. Each moving bar has a mass of 1 kg, evenly distributed."""
BEARING, JOURNAL = 0.06, 0.055
"""Radii, m."""
GRAVITY, FRICTION, STEP = 9.81, 0.1, 1e-4
"""m/s^2; coefficient; length of the example's steps, s."""
PI = 3.14159265
"""The constant of the example, which its reference values contain."""
GAIN, RATE = 200.0, 10.0
"""Gain of the controller, N m s, and the rate at which its error decays, 1/s."""
Z = (0.0, 0.0, 1.0)
TIMES = np.linspace(0.05, 1.0, 20)
"""Times of the rows of the reference file, s."""


PUBLISHED = (
    (1.66792292859, 1.30537227818),
    (1.98517641733, 1.45644890569),
    (2.43135473995, 1.65737043916),
    (2.94423040053, 1.83865135),
    (3.46942975792, 1.96019134941),
    (3.97996925229, 2.00357165217),
    (4.45576229398, 1.96825543839),
    (4.88214968203, 1.860835779),
    (5.2488802518, 1.69550679451),
    (5.5456124428, 1.4996569265),
    (5.77600425684, 1.30880521083),
    (5.92850073432, 1.18538817936),
    (5.9969604176, 1.13159296426),
    (5.98246835654, 1.14226185344),
    (5.88582139165, 1.21910795488),
    (5.70753085975, 1.3628660128),
    (5.44874443283, 1.55562568572),
    (5.11678646211, 1.76109079352),
    (4.70713197194, 1.91412378333),
    (4.23844821567, 1.99555527947),
)
"""Angles of the crank and of the rocker in the file at these times, rad."""
FIRST_SPEED, FIRST_TORQUE = 4.395065412241380, 189.7939140287401
"""Speed of the crank, rad/s, and torque of the controller, N m, in the file at 0.05 s."""


class Controller(cj.extend.AbstractDriveTorque):
    """The torque of the example, by which the crank's angle follows 6 sin(0.75 pi t)."""

    first: str = eqx.field(static=True)
    second: str = eqx.field(static=True)
    axis: tuple[float, float, float] = Z
    orientation: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)

    def torque_at(self, angle: Scalar, speed: Scalar, t: Scalar) -> Scalar:
        """Return the torque, N m, at the crank's angle, rad, and speed, rad/s, and the time, s."""
        return control_torque(angle, speed, t)


def control_torque(angle: Scalar, speed: Scalar, t: Scalar) -> Scalar:
    """Return the torque of the controller, N m.

    It needs the angles of a linkage without clearance and their first and second derivatives by
    the crank's angle. All terms are those of the example, also where they are approximate.
    """
    omega = 0.75 * PI
    error = jnp.remainder(angle - 6.0 * jnp.sin(omega * t) + jnp.pi, 2.0 * jnp.pi) - jnp.pi
    error_rate = speed - 6.0 * omega * jnp.cos(omega * t)
    wanted = -6.0 * omega**2 * jnp.sin(omega * t) - RATE * error_rate
    # Angles of the rocker and of the coupler, from the closed loop.
    k1 = -2.0 * CRANK * ROCKER * jnp.sin(angle)
    k2 = 2.0 * ROCKER * (FRAME - CRANK * jnp.cos(angle))
    k3 = FRAME**2 + CRANK**2 - COUPLER**2 + ROCKER**2 - 2.0 * FRAME * CRANK * jnp.cos(angle)
    rocker = 2.0 * (PI + jnp.atan2(-k1 - jnp.sqrt(k1**2 + k2**2 - k3**2), k3 - k2))
    coupler = jnp.atan2(
        ROCKER * jnp.sin(rocker) - CRANK * jnp.sin(angle),
        FRAME - CRANK * jnp.cos(angle) + ROCKER * jnp.cos(rocker),
    )
    # Their derivatives by the crank's angle.
    a, b, c = coupler - rocker, rocker - angle, coupler - angle
    long, short = CRANK / COUPLER, CRANK / ROCKER
    s1, s2 = long * jnp.sin(b) / jnp.sin(a), short * jnp.sin(c) / jnp.sin(a)
    curvature_1 = (
        -long * jnp.cos(b) / jnp.sin(a)
        - long * jnp.sin(b) * jnp.cos(a) / jnp.sin(a) ** 2 * s1
        - 2.0 * long * jnp.sin(c) / (jnp.cos(2.0 * a) - 1.0) * s2
    )
    curvature_2 = (
        -short * jnp.cos(c) / jnp.sin(a)
        + 2.0 * short * jnp.sin(b) / (jnp.cos(2.0 * a) - 1.0) * s1
        + short * jnp.sin(c) * jnp.cos(a) / jnp.sin(a) ** 2 * s2
    )
    # Half the moments of inertia about the ends of the bars; the crank's has the coupler's mass.
    i1, i2, i3 = CRANK**2 * 2.0 / 3.0, COUPLER**2 / 6.0, ROCKER**2 / 6.0
    couple = 0.5 * CRANK * COUPLER
    inertia = 2.0 * (i1 + i2 * s1**2 + i3 * s2**2 + couple * jnp.cos(c) * s1)
    coriolis = (
        2.0 * i2 * s1 * curvature_1
        + 2.0 * ROCKER**2 / 12.0 * s2 * curvature_2
        + couple * (jnp.cos(c) * curvature_1 + s1 * (jnp.sin(c) - s1 * jnp.sin(c)))
    )
    weights = GRAVITY * (
        1.5 * CRANK * jnp.cos(angle)
        + 0.5 * COUPLER * jnp.cos(coupler) * s1
        + 0.5 * ROCKER * jnp.cos(rocker) * s2
    )
    feedback = GAIN * (error_rate + RATE * error)
    return inertia * wanted + coriolis * speed * (speed - RATE * error) + weights - feedback


def four_bar() -> tuple[cj.Scene, cj.State]:
    """Return the scene and its initial state, with the journals in the middle of their bearings."""
    law = cj.laws.LankaraniNikravesh(restitution=0.0, stiffness=1e8)

    def joint(bearing: str, journal: str, bearing_x: float, journal_x: float) -> cj.ClearanceJoint:
        return cj.ClearanceJoint(
            bearing,
            journal,
            bearing_point=(bearing_x, 0.0, 0.0),
            journal_point=(journal_x, 0.0, 0.0),
            bearing_radius=BEARING,
            clearance=BEARING - JOURNAL,
            journal_length=0.1,
            law=law,
            friction=cj.frictions.RegularisedCoulomb(FRICTION, 1e-3),
        )

    def bar(length: float) -> cj.Body:
        moment = length**2 / 12.0
        return cj.Body(1.0, (1e-3, moment, moment))

    origin = (0.0, 0.0, 0.0)
    joints = {
        "pivot": cj.RevoluteJoint("ground", "crank", origin, (-0.5 * CRANK, 0.0, 0.0), Z, Z),
        "coupler plane": cj.PlanarJoint("ground", "coupler", origin, origin, Z, Z),
        "rocker plane": cj.PlanarJoint("ground", "rocker", origin, origin, Z, Z),
        "first": joint("coupler", "crank", -0.5 * COUPLER, 0.5 * CRANK),
        "second": joint("rocker", "coupler", 0.5 * ROCKER, 0.5 * COUPLER),
        "third": joint("ground", "rocker", FRAME, -0.5 * ROCKER),
    }
    bars = {"crank": bar(CRANK), "coupler": bar(COUPLER), "rocker": bar(ROCKER)}
    forces = {"controller": Controller("ground", "crank")}
    scene = cj.Scene(bars, joints, forces, gravity=(0.0, -GRAVITY, 0.0))
    angles = {
        "crank": 1.570823772407980,
        "coupler": 0.3532842020624460,
        "rocker": 1.264872058968431,
    }
    at = {
        "crank": (0.5 * np.cos(angles["crank"]), 0.5 * np.sin(angles["crank"]), 0.0),
        "coupler": (1.876454585097650, 1.691962091335582, 0.0),
        "rocker": (FRAME + 0.3764686197082958, 1.191962183453451, 0.0),
    }
    states = {
        name: cj.body_state(at[name], orientation=cj.rotation(Z, angle))
        for name, angle in angles.items()
    }
    return scene, cj.State(states)


class Comparison(NamedTuple):
    """The checks, and for each length of step, s, the largest difference of an angle, rad."""

    checks: list[Check]
    steps: list[float]
    differences: list[float]
    extrapolated: float


def four_bar_checks(quick: bool) -> Comparison:
    """Compare the controller and the motion with the file, with halved steps.

    Our error is proportional to the step, so that twice the values of the shortest step less those
    of the step before have an error of higher order.
    """
    steps = [STEP / 2**k for k in range(3 if quick else 6)]
    runs = [motion(step) for step in steps]
    published = np.array(PUBLISHED)
    limit = 2.0 * runs[-1] - runs[-2]
    source = "Siconos, FourBarLinkageWith3clearance"
    torque = float(control_torque(PUBLISHED[0][0], FIRST_SPEED, TIMES[0]))
    checks = [Check(source, "torque of the controller at 0.05 s", "N m", FIRST_TORQUE, torque)]
    for row in (0, 1, 9, 19):
        for column, name in enumerate(("angle of the crank", "angle of the rocker")):
            values = float(published[row, column]), float(limit[row, column])
            checks.append(Check(source, f"{name} at {TIMES[row]:.3g} s", "rad", *values))
    differences = [_largest(run, published) for run in runs]
    return Comparison(checks, steps, differences, _largest(limit, published))


def motion(step: float) -> np.ndarray:
    """Return the angles of crank and rocker, (20, 2) rad, of a run with steps in s."""
    scene, start = four_bar()
    save = cj.Saving(TIMES)
    solution = cj.simulate_nonsmooth(scene, start, TIMES[-1], save, step=step, restitution=0.0)
    assert solution.saved is not None
    bodies = solution.saved.states.bodies
    return np.stack([_angle(bodies["crank"]), _angle(bodies["rocker"])], axis=1)


def _angle(bar: cj.BodyState) -> np.ndarray:
    """Return the angle of a bar within a revolution, rad, in 0 to 2 pi."""
    return 2.0 * np.arctan2(bar.orientation[:, 3], bar.orientation[:, 0]) % (2.0 * np.pi)


def _largest(run: np.ndarray, published: np.ndarray) -> float:
    """Return the largest difference of an angle at any time, rad."""
    return float(np.max(np.abs(run - published)))

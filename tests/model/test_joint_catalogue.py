"""Ideal joints and drives by closed forms: their constraint equations, and, in one scene of many
machines beside each other, their motions, reactions and work."""

import math
from functools import partial

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

import clearjoint as cj
from clearjoint.extend import unpack
from studies.catalogue import machines as of
from studies.catalogue.machines import ORIGIN, X, Y, Z
from tests.support.shaft import angle_about


def turned_about(axis, angle, speed, frame=None, position=ORIGIN, velocity=ORIGIN):
    """A body whose frame has turned by an angle about a fixed axis, with the spin of that."""
    rotation = Rotation.from_rotvec(angle * np.asarray(axis))
    rotation = rotation if frame is None else rotation * frame
    spin = rotation.inv().apply(speed * np.asarray(axis))
    return cj.body_state(position, rotation.as_quat(scalar_first=True), velocity, spin)


AT_REST = cj.body_state(ORIGIN)


def constraints(joint, **states):
    """Values and rates of the joint's constraint equations."""
    bodies = {name: cj.Body(1.0, (1.0, 1.0, 1.0)) for name in states}
    report = cj.constraint_report(cj.Scene(bodies, {"it": joint}), cj.State(states))
    return report.values, report.rates


def held(joint, tolerance=1e-12, **states):
    """Assert that the joint allows a motion."""
    values, rates = constraints(joint, **states)
    np.testing.assert_allclose(values, 0.0, atol=tolerance)
    np.testing.assert_allclose(rates, 0.0, atol=1e-11)


def test_the_error_of_a_gear_out_of_mesh_is_reported():
    joint = cj.GearJoint("ground", "a", "b", Z, Z, 10, 30)
    for angle in (0.1, 0.1 + 2.0 * math.pi * 7 / 10):
        values, _ = constraints(joint, a=turned_about(Z, angle, 0.0), b=AT_REST)
        assert values == pytest.approx(0.1)


@pytest.mark.parametrize("angle", [0.0, 0.7, 2.9, -1.3])
def test_universal_joint_turns_as_hookes(angle):
    tilt, speed = 0.6, 3.0
    second, ratio = of.hooke(angle, tilt)
    frame = Rotation.from_rotvec(tilt * Y)
    driven = turned_about(frame.apply(Z), second, speed * ratio, frame)
    joint = cj.UniversalJoint("a", "b", ORIGIN, ORIGIN, X, Y)
    held(joint, a=turned_about(Z, angle, speed), b=driven)


@pytest.mark.parametrize("turns", [0.1, 0.5, 17.3, -4000.9])
@pytest.mark.parametrize("lead", [0.004, -0.25])
def test_screw_advances_by_its_lead_in_a_turn(turns, lead):
    speed, angle = 5.0, 2.0 * math.pi * turns
    along = {"position": turns * lead * X, "velocity": speed * lead / (2.0 * math.pi) * X}
    joint = cj.ScrewJoint("a", "b", ORIGIN, ORIGIN, X, X, lead)
    held(joint, 1e-11, a=AT_REST, b=turned_about(X, angle, speed, **along))


@pytest.mark.parametrize("turns", [0.03, 12.4, -700.7])
@pytest.mark.parametrize("internal", [False, True])
def test_gears_turn_by_their_teeth(turns, internal):
    """Over many turns, on an arm that turns itself: relative to the arm 17 : 51 and 19 : 44."""
    for first, second in ((17, 51), (19, 44)):
        angle, speed = 2.0 * math.pi * turns, 7.0
        ratio = (1.0 if internal else -1.0) * first / second
        axis = np.array([0.6, 0.0, 0.8])
        joint = cj.GearJoint("arm", "a", "b", axis, axis, first, second, internal, 0.3)
        held(
            joint,
            arm=turned_about(axis, 0.4, 2.0),
            a=turned_about(axis, 0.4 + angle + 0.3, 2.0 + speed),
            b=turned_about(axis, 0.4 + angle * ratio, 2.0 + speed * ratio),
        )


@pytest.mark.parametrize(
    ("make", "complaint"),
    [
        (lambda: cj.GearJoint("ground", "a", "b", Z, Z, 17.5, 51), "`teeth_first`.*17.5"),
        (lambda: cj.GearJoint("ground", "a", "b", Z, Z, 17, 0), "`teeth_second`.*teeth"),
        (lambda: cj.GearJoint("a", "a", "b", Z, Z, 17, 51), "`carrier`.*carries the gears"),
        (lambda: cj.GearJoint("ground", "a", "b", 0 * Z, Z, 17, 51), "`axis_first`"),
        (lambda: cj.extend.Marker("a", ORIGIN, 0 * Z).along(), "`axis`.*non-zero length"),
        (lambda: cj.ScrewJoint("a", "b", ORIGIN, ORIGIN, X, X, 0.0), "`lead`.*RevoluteJoint"),
        (lambda: cj.DistanceJoint("a", "b", ORIGIN, ORIGIN, -1.0), "`length`"),
        (lambda: cj.Motor("a", "b", Z, 0.0, -1.0, 0.0), "`proportional`"),
        (lambda: cj.Motor("a", "b", Z, 0.0, 1.0, 0.0, torque_limit=0.0), "`torque_limit`"),
        (lambda: cj.TorsionalSpring("a", "b", Z, -1.0), "`stiffness`"),
        (lambda: cj.PrescribedAngle("a", "b", Z, [1.0, 2.0]), "`function`.*Spline.through"),
        (lambda: cj.Spline.through([0.0, 1.0, 1.0], [0, 1, 2]), "`times`.*increasing"),
        (lambda: cj.Spline.through([0.0, 1.0], [0, 1, 2]), "`values`.*shape"),
        (lambda: cj.Spline([0.0], [0.0], [0.0]), "`times`.*two or more times"),
        (lambda: cj.Spline([0.0, 1.0], [0.0, np.nan], [0.0, 0.0]), "`values`.*finite"),
        (lambda: cj.Polynomial([]), "`coefficients`.*a row"),
    ],
)
def test_invalid_elements_are_refused(make, complaint):
    with pytest.raises(ValueError, match=complaint):
        make()


RIGID = partial(cj.simulate_nonsmooth, step=1e-3)


@pytest.mark.parametrize("run", [cj.simulate, pytest.param(RIGID, marks=pytest.mark.slow)])
@pytest.mark.parametrize("pitch", [1e-5, 1e-4, 0.1])
def test_a_rack_is_not_followed_beyond_half_a_revolution(run, pitch):
    """From there on, the angle of the pinion would be wrong, in a watch too."""
    body = cj.Body(0.01, (1e-6, 1e-6, 1e-6))
    pinion = cj.RevoluteJoint("ground", "pinion", ORIGIN, ORIGIN, Z, Z)
    guide = cj.PrismaticJoint("ground", "rack", ORIGIN, ORIGIN, X)
    rack = cj.JointCoupling(pinion, guide, cj.Polynomial((0.0, pitch)))  # m/rad
    joints = {"pinion": pinion, "guide": guide, "rack": rack}
    scene = cj.Scene({"pinion": body, "rack": body}, joints)
    moving = cj.body_state((3.0 * pitch, 0.0, 0.0), velocity=(2.0 * pitch, 0.0, 0.0))
    state = cj.State({"pinion": turned_about(Z, 3.0, 2.0), "rack": moving})
    solution = run(scene, state, 1.0, throw=False)
    assert solution.result == cj.RESULTS.not_followed
    assert solution.time == pytest.approx(0.5 * (math.pi - 3.0), abs=1.1e-3)


@pytest.mark.slow
def test_a_hinge_follows_whole_ratios_over_many_revolutions():
    body = cj.Body(1.0, (0.01, 0.01, 0.01))
    leader, follower = (
        cj.RevoluteJoint("ground", name, ORIGIN, ORIGIN, Z, Z) for name in ("leader", "follower")
    )
    coupling = cj.JointCoupling(leader, follower, cj.Polynomial((0.2, -3.0)))
    joints = {"leader": leader, "follower": follower, "coupling": coupling}
    scene = cj.Scene({"leader": body, "follower": body}, joints)
    state = {"leader": turned_about(Z, 0.0, 2.0), "follower": turned_about(Z, 0.2, -6.0)}
    final = cj.simulate(scene, cj.State(state), 20.0).final.bodies
    assert np.cos(angle_about(final["leader"]) - 40.0) == pytest.approx(1.0, abs=1e-9)
    assert np.cos(angle_about(final["follower"]) + 119.8) == pytest.approx(1.0, abs=1e-9)


def test_splines_go_through_their_table_smoothly():
    """As SciPy's natural ones, and on along the tangents."""
    times, values = np.array([0.1, 0.3, 0.4, 0.9]), np.array([1.0, -2.0, 0.5, 0.3])
    spline = unpack(cj.Spline.through(times, values))
    natural = CubicSpline(times, values, bc_type="natural")
    for t in np.linspace(0.1, 0.9, 17):
        assert float(spline(t)) == pytest.approx(float(natural(t)), abs=1e-12)
    for end, t in ((0.1, -0.5), (0.9, 2.0)):
        tangent = natural(end) + natural(end, 1) * (t - end)
        assert float(spline(t)) == pytest.approx(float(tangent), rel=1e-12)
    assert float(unpack(cj.Polynomial([1.0, -2.0, 0.5]))(3.0)) == -0.5


def test_a_motor_clips_its_torque():
    """Exactly, but for a bend over a fiftieth of the limit."""
    motor = cj.Motor("a", "b", Z, cj.Polynomial([0.5, 3.0]), 2.0, derivative=0.1, torque_limit=1.0)
    for angle, speed, torque in ((0.4, 3.0, 0.2), (-0.4, 3.0, 1.0), (1.4, 3.0, -1.0)):
        assert float(motor.torque_at(angle, speed, 0.0)) == pytest.approx(torque, rel=1e-12)
    at_limit = float(motor.torque_at(0.0, 3.0, 0.0))
    assert at_limit == pytest.approx(1.0 - 0.02 / 4.0)
    assert float(motor.torque_at(math.pi + 0.4, 3.0, 0.0)) == pytest.approx(-1.0)
    assert float(motor.torque_at(2 * math.pi + 0.4, 3.0, 0.0)) == pytest.approx(0.2)

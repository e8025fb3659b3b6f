"""Friction of ideal joints against closed forms."""

import numpy as np
import pytest

import clearjoint as cj
from tests.support.observations import observed
from tests.support.shaft import INERTIA, ON_SHAFT, ORIGIN, Z, shaft, turned

LOAD = 0.5
COULOMB = cj.frictions.RegularisedCoulomb(1.0, regularisation_speed=1e-4)
BRISTLES = cj.frictions.LuGre(1.2, 1.0, stribeck_speed=0.05, stiffness=1e4, damping=10.0)
COORDINATES = pytest.mark.parametrize(
    "coordinates",
    [cj.JointCoordinates(), pytest.param(cj.AbsoluteCoordinates(), marks=pytest.mark.slow)],
)


def hinged(friction, torque=0.0, spin=0.0, viscosity=None):
    """A shaft whose bearing has friction, with a motor's torque, N m."""
    rub = cj.JointFriction("ground", "shaft", friction, LOAD, Z, radius=1.0, viscosity=viscosity)
    return shaft(friction=rub, motor=cj.DriveTorque(*ON_SHAFT, torque)), turned(speed=spin)


@COORDINATES
def test_bristles_hold_a_hinge_below_its_breakaway_moment(coordinates):
    settings = cj.Settings(coordinates=coordinates)
    elastic = cj.frictions.ElastoPlastic(
        1.2, 1.0, stribeck_speed=0.05, elastic_deflection=0.8e-4, stiffness=1e4, damping=10.0
    )
    scene, state = hinged(elastic, torque=0.15)
    ended = cj.simulate(scene, state, 2.0, settings).final.bodies["shaft"]
    # The bristles deflect by 0.15 N m over their stiffness of 0.5e4 N m/rad, and not more.
    assert 2.0 * ended.orientation[3] == pytest.approx(0.3e-4, rel=1e-6)
    scene, state = hinged(BRISTLES, torque=0.3)
    held = [cj.simulate(scene, state, time, settings).final.bodies["shaft"] for time in (1.0, 2.0)]
    assert held[1].orientation[3] - held[0].orientation[3] == pytest.approx(0.0, abs=1e-9)
    scene, state = hinged(BRISTLES, torque=0.7)
    ended = cj.simulate(scene, state, 0.5, settings).final.bodies["shaft"]
    assert ended.spin[2] == pytest.approx(0.5 * (0.7 - LOAD) / INERTIA, rel=0.02)


@COORDINATES
def test_a_hinge_slides_as_in_the_closed_form(coordinates):
    """J dw/dt = T - T_C - k w, with the ledger of the energy, and no reaction of the load."""
    torque, viscosity, time = 0.7, 0.1, 0.4
    scene, state = hinged(COULOMB, torque, spin=1.0, viscosity=viscosity)
    settings = cj.Settings(coordinates=coordinates, ledger=True)
    solution = cj.simulate(scene, state, time, settings, cj.Saving([time], impacts=True))
    last = (torque - LOAD) / viscosity
    expected = last + (1.0 - last) * np.exp(-viscosity * time / INERTIA)
    assert solution.final.bodies["shaft"].spin[2] == pytest.approx(expected, rel=1e-6)
    assert len(solution.impacts) == 0
    work = solution.final.work
    gained = 0.5 * INERTIA * (expected**2 - 1.0)
    balance = work["supplied"] - work["friction"] - work["film"]
    assert gained == pytest.approx(balance, rel=1e-6)
    reaction = cj.observe(scene, solution).reactions["bearing"]["shaft"]
    np.testing.assert_allclose(reaction.force, 0.0, atol=1e-12)


def test_a_slider_stops_after_the_distance_of_its_friction():
    """On a rail that is inclined in space, between two bodies, of which one is held."""
    axis, mass, speed = np.array([2.0, -1.0, 2.0]) / 3.0, 3.0, 0.8
    joints = {
        "rail": cj.PrismaticJoint("ground", "block", ORIGIN, ORIGIN, axis=axis),
        "friction": cj.JointFriction("ground", "block", BRISTLES, load=6.0, axis=2.0 * axis),
    }
    scene = cj.Scene({"block": cj.Body(mass, (0.1, 0.1, 0.1))}, joints)
    state = cj.State({"block": cj.body_state(ORIGIN, velocity=speed * axis)})
    block = cj.simulate(scene, state, 1.0).final.bodies["block"]
    distance = mass * speed**2 / (2.0 * 6.0)
    np.testing.assert_allclose(block.position, distance * axis, rtol=0.02)
    assert np.linalg.norm(block.velocity) < 1e-5


def test_a_ball_keeps_its_axis_and_loses_speed_evenly():
    spin = np.array([3.0, -2.0, 6.0])
    joints = {
        "ball": cj.SphericalJoint("ground", "rotor", ORIGIN, ORIGIN),
        "friction": cj.JointFriction("ground", "rotor", COULOMB, load=10.0, radius=0.02),
    }
    scene = cj.Scene({"rotor": cj.Body(1.0, (INERTIA, INERTIA, INERTIA))}, joints)
    state = cj.State({"rotor": cj.body_state(ORIGIN, spin=spin)})
    rotor = cj.simulate(scene, state, 0.3).final.bodies["rotor"]
    left = 7.0 - 0.3 * 10.0 * 0.02 / INERTIA
    np.testing.assert_allclose(rotor.spin, spin * left / 7.0, rtol=1e-6)


def test_joint_friction_refuses_what_it_cannot_be():
    scene, state = hinged(COULOMB)
    with pytest.raises(ValueError, match="`axis` must be given for a slider"):
        cj.JointFriction("ground", "arm", COULOMB, 1.0)
    with pytest.raises(ValueError, match=r"not friction of an ideal joint.*take simulate"):
        cj.simulate_nonsmooth(scene, state, 0.1, step=1e-3, restitution=0.5)


def test_a_spring_presses_by_its_elastic_torque_beside_the_constant_load():
    """Whatever the spring's damping, and a law of ratio 1 at this speed."""
    stiffness, angle, ratio, spin = 40.0, -0.3, 0.2, 5.0
    rub = cj.JointFriction(
        "ground", "shaft", COULOMB, LOAD, Z, radius=1.0, pressed_by="spring", load_ratio=ratio
    )
    spring = cj.TorsionalSpring(*ON_SHAFT, stiffness, damping=3.0)
    seen = observed(shaft(friction=rub, spring=spring), turned(angle, spin))
    (contact,) = seen.contacts["friction"].values()
    expected = LOAD + ratio * abs(stiffness * angle)
    assert float(np.squeeze(contact.normal_force)) == pytest.approx(expected, rel=1e-12)

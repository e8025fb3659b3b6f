"""Mechanisms with their first states, against published values and independent equations."""

import math

import diffrax
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import clearjoint as cj
from tests.support.andrews_equations import PUBLISHED, angles

FINE = cj.Settings(solver=diffrax.Dopri8(), rtol=1e-13, atol=1e-13, stabilisation=cj.Projection())


def turn(body):
    """The angle about Z of bodies that turn about it only, rad."""
    return 2.0 * np.arctan2(body.orientation[..., 3], body.orientation[..., 0])


def squeezed(bodies):
    """The seven angles of the literature."""
    k = {name: turn(body) for name, body in bodies.items()}
    own = [k["K1"], k["K2"], k["K3"], k["K4"], k["K5"], k["K6"], k["K7"]]
    return np.array(own) - np.array([0, k["K1"], 0, k["K5"], 0, k["K7"], 0])


@pytest.mark.slow
def test_the_squeezer_runs_as_published():
    """The published digits hold to 1.5e-9; the equations of the literature, integrated afresh, tell
    that the last ones are not its own."""
    scene, state = cj.mechanisms.andrews_squeezer()
    solution = cj.simulate(scene, state, 0.03, FINE, save=cj.Saving([0.03]))
    assert not solution.redundant_constraints
    found = squeezed(solution.final.bodies)

    def error(expected):
        off = found - np.asarray(expected)
        return np.abs(off - 2.0 * math.pi * np.round(off / (2.0 * math.pi))).max()

    assert error(PUBLISHED) < 2e-9
    assert error(angles(0.03, 3e-14)) < 1e-11


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ({"clearance": {"crank": 1e-4}}, "`clearance`.*'crank foot'.*is 'crank'"),
        ({"lengths": (0.1, 0.05, 0.05, 0.3)}, "`lengths`.*rods that span.*another angle"),
        ({"lengths": (0.1, 0.3, 0.25, 0.1), "angle": 0.0}, "`lengths`.*rods that span the 0 m"),
    ],
)
def test_an_impossible_four_bar_is_refused(arguments, complaint):
    with pytest.raises(ValueError, match=complaint):
        cj.mechanisms.four_bar(**arguments)


RODS = {
    "four_bar": {"crank": 0.1, "coupler": 0.3, "rocker": 0.25},
    "quick_return": {"crank": 0.05, "lever": 0.25},
    "double_four_bar": {f"rod {k}": 1.0 for k in range(1, 6)},
}


@pytest.mark.parametrize("name", RODS)
def test_rods_are_slender(name):
    scene, _ = getattr(cj.mechanisms, name)()
    for rod, length in RODS[name].items():
        body = scene.bodies[rod]
        across = float(body.mass) * length**2 / 12.0
        np.testing.assert_allclose(body.inertia[1:], across, rtol=1e-14)


def test_bars_of_the_spatial_four_bar_are_cylinders():
    bodies = cj.mechanisms.spatial_four_bar()[0].bodies
    bars = {"crank": (0.02, 0.1960, "y"), "coupler": (0.122, 1.4158, "x")}
    for name, (length, mass, axis) in (bars | {"rocker": (0.074, 0.3157, "y")}).items():
        bar = cj.Body.cylinder(20e-3, length, mass=mass, axis=axis)
        assert float(bodies[name].mass) == mass
        np.testing.assert_allclose(bodies[name].inertia, bar.inertia, rtol=1e-14)


GRAVITY = {
    "double_pendulum": (0.0, 9.81, 0.0),
    "guided_slider_crank": (0.0, -9.81, 0.0),
    "rotor_in_bearing": (0.0, -9.81, 0.0),
    "spatial_four_bar": (0.0, 0.0, -9.81),
    "robot_arm": (0.0, 0.0, -9.81),
    "bricard": (0.0, -9.81, 0.0),
    "double_four_bar": (0.0, -9.81, 0.0),
}


@pytest.mark.parametrize("name", GRAVITY)
def test_gravity_is_as_described(name):
    scene, _ = getattr(cj.mechanisms, name)()
    np.testing.assert_array_equal(scene.gravity, GRAVITY[name])


def test_gravity_loads_the_robot_s_nominal_pose_as_published():
    """The moments of the links' weights about the hinges: 0, 31.6399 and 6.0351 N m."""
    scene, state = cj.mechanisms.robot_arm(None)
    moments = []
    for k in range(3):
        joint, parent = scene.joints[f"joint {k + 1}"], f"link {k}"
        at, axes = np.zeros(3), np.eye(3)
        if k > 0:
            body = state.bodies[parent]
            axes = Rotation.from_quat(np.roll(body.orientation, -1)).as_matrix()
            at = np.asarray(body.position)
        hinge, axis = at + axes @ joint.point_first, axes @ joint.axis_first
        weights = [
            np.cross(state.bodies[link].position - hinge, float(body.mass) * scene.gravity)
            for link, body in list(scene.bodies.items())[k:]
        ]
        moments.append(-np.sum(weights, axis=0) @ axis)
    np.testing.assert_allclose(moments, [0.0, 31.6399, 6.0351], atol=1e-4)


@pytest.mark.parametrize(
    ("options", "pins"), [({}, 6), ({"pins": 4, "lobes": 7, "angle": 0.4, "speed": -20.0}, 4)]
)
def test_a_cycloid_stage_starts_with_its_play_around_all_pins(options, pins):
    """The disc's centre turns with the shaft, and the disc backwards by a lobe in a turn."""
    play, eccentricity, z = 2e-5, 1e-3, (0.0, 0.0, 1.0)
    scene, state = cj.mechanisms.cycloid_stage(play, **options)
    assert [name for name in scene.joints if name.startswith("pin")] == [
        f"pin {k}" for k in range(1, pins + 1)
    ]
    angle, speed = options.get("angle", 0.0), options.get("speed", 10.0)
    ratio = -1.0 / options.get("lobes", 10)
    for name, share in (("shaft", 1.0), ("disc", ratio), ("output", ratio)):
        body = state.bodies[name]
        np.testing.assert_allclose(body.orientation, cj.rotation(z, share * angle), atol=1e-15)
        np.testing.assert_allclose(body.spin, (0.0, 0.0, share * speed), rtol=1e-15)
    disc = state.bodies["disc"]
    outwards = np.array([np.cos(angle), np.sin(angle), 0.0])
    np.testing.assert_allclose(disc.position, eccentricity * outwards, rtol=1e-15)
    np.testing.assert_allclose(
        disc.velocity, np.cross(z, outwards) * eccentricity * speed, rtol=1e-15
    )
    axes = Rotation.from_quat(disc.orientation, scalar_first=True)
    for k in range(pins):
        joint = scene.joints[f"pin {k + 1}"]
        hole = disc.position + axes.apply(joint.bearing_point)
        distance = np.linalg.norm(axes.apply(joint.journal_point) - hole)
        assert float(joint.clearance) - distance == pytest.approx(play, rel=1e-10)


def test_a_rotor_starts_at_its_offset_and_speed():
    for offset in ((0.0, -1.0), (0.3, 0.4)):
        _, state = cj.mechanisms.rotor_in_bearing(5e-5, offset=offset, speed=70.0)
        rotor = state.bodies["rotor"]
        np.testing.assert_allclose(rotor.position, 5e-5 * np.array([*offset, 0.0]), rtol=1e-15)
        np.testing.assert_array_equal([rotor.velocity, rotor.spin], [(0, 0, 0), (0, 0, 70.0)])
    lowest = cj.mechanisms.rotor_in_bearing(5e-5)[1].bodies["rotor"]
    np.testing.assert_array_equal(lowest.position, (0.0, -5e-5, 0.0))


@pytest.mark.parametrize("mechanism", [cj.mechanisms.robot_arm, cj.mechanisms.four_bar])
def test_mechanisms_without_a_speed_start_at_rest(mechanism):
    scene, state = mechanism()
    for body in state.bodies.values():
        np.testing.assert_array_equal([body.velocity, body.spin], np.zeros((2, 3)))
    motors = [joint for name, joint in scene.joints.items() if name.startswith("motor")]
    assert [float(motor.speed) for motor in motors] == [0.0] * len(motors)

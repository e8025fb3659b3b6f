"""Armatures of joints against Pinocchio and closed forms, in both coordinates."""

from dataclasses import replace

import jax
import numpy as np
import pytest

import clearjoint as cj
from tests.scene_files.test_random_robots import random_motion, random_robot
from tests.support.many_states import system_of
from tests.support.one_body import ORIGIN, X, hinge

FEW, MANY = range(2), range(100, 130)
SEEDS = [*FEW, *(pytest.param(seed, marks=pytest.mark.slow) for seed in MANY)]
pytestmark = pytest.mark.filterwarnings("ignore::clearjoint.NotCarriedOverWarning")


def with_armatures(scene: cj.Scene, generator: np.random.Generator) -> tuple[cj.Scene, dict]:
    """A scene with armatures of random hinges and sliders, and these by name; zero for none."""
    armatures = {
        name: generator.uniform(0.1, 50.0) * generator.integers(0, 2) for name in scene.joints
    }
    joints = {
        name: replace(joint, armature=armatures[name] or None)
        for name, joint in scene.joints.items()
    }
    return cj.Scene(scene.bodies, joints, scene.forces, scene.gravity), armatures


def dynamics_of(scene: cj.Scene, state: cj.State, coordinates, redundant: bool = False):
    system = system_of(scene, coordinates, 0.0, redundant)
    variables = system.encode(cj.extend.unpack(state).bodies)
    return system, variables, system.dynamics(variables, {}, 0.0)


@pytest.mark.parametrize("seed", SEEDS)
def test_pinocchio_accelerates_armatures_alike(seed, tmp_path):
    pinocchio = pytest.importorskip("pinocchio")
    generator, robot = np.random.default_rng(seed), random_robot(seed, ("revolute", "prismatic"))
    (tmp_path / "robot.urdf").write_text(robot)
    loaded, motion = cj.load_robot(tmp_path / "robot.urdf"), random_motion(robot, seed)
    scene, armatures = with_armatures(loaded.scene, generator)
    model = pinocchio.buildModelFromXML(robot)
    data, names = model.createData(), [*model.names][1:]
    model.armature = np.array([armatures[name] for name in names])
    q, qd = (np.array([part[name] for name in names]) for part in motion)
    expected = pinocchio.aba(model, data, q, qd, np.zeros(len(names)))
    state = loaded.state(motion.positions, motion.speeds)
    system, variables, joint = dynamics_of(scene, state, cj.JointCoordinates())
    rates, scale = joint.variable_rates, np.abs(expected).max()
    for name, rate in zip(names, expected, strict=True):
        found = float(rates[scene.joints[name].second].speeds[0])
        assert found == pytest.approx(rate, abs=1e-9 * scale), name
    model.armature = model.armature.copy()
    pinocchio.crba(model, data, q)
    matrix = np.triu(data.M) + np.triu(data.M, 1).T
    kinetic = float(system.energies(variables, 0.0)["kinetic"])
    assert kinetic == pytest.approx(0.5 * qd @ matrix @ qd, rel=1e-9)
    _, _, absolute = dynamics_of(scene, state, cj.AbsoluteCoordinates())
    for name, found in joint.accelerations.items():
        other = absolute.accelerations[name]
        for own, their in zip(jax.tree.leaves(found), jax.tree.leaves(other), strict=True):
            assert float(own) == pytest.approx(float(their), abs=1e-8 * scale)


def parallelogram(armatures: dict[str, float]) -> tuple[cj.Scene, cj.State]:
    """Cranks of 0.3 m and a coupler, all of 2 kg, at rest in the plane XY with gravity along -Y;
    the cranks are level."""
    length, bar = 0.3, cj.Body(2.0, (1e-3, 0.02, 0.02))
    ends = {"left": (-0.5 * length, 0, 0), "right": (0.5 * length, 0, 0)}
    points = {
        "A": ("ground", "crank", ORIGIN, ends["left"]),
        "B": ("crank", "coupler", ends["right"], ORIGIN),
        "C": ("coupler", "rocker", (0, 0.2, 0), ends["right"]),
        "D": ("rocker", "ground", ends["left"], (0, 0.2, 0)),
    }
    joints = {name: hinge(*ends, armature=armatures.get(name)) for name, ends in points.items()}
    places = {"crank": (0.5 * length, 0), "rocker": (0.5 * length, 0.2), "coupler": (length, 0)}
    state = cj.State({name: cj.body_state((*place, 0)) for name, place in places.items()})
    return cj.Scene(dict.fromkeys(places, bar), joints, {}, (0, -10, 0)), state


@pytest.mark.parametrize("coordinates", [cj.JointCoordinates(), cj.AbsoluteCoordinates()])
@pytest.mark.parametrize("armatures", [{"A": 0.3}, {"C": 0.3}, {"D": 0.3, "B": 0.2, "A": 1.0}])
def test_armatures_of_a_loop_add_their_inertia(armatures, coordinates):
    """All four joints turn with the cranks' speed, whichever the tree leaves out."""
    scene, state = parallelogram(armatures)
    _, _, dynamics = dynamics_of(scene, state, coordinates, redundant=True)
    inertia = 2 * (0.02 + 2.0 * 0.15**2) + 2.0 * 0.3**2 + sum(armatures.values())
    torque = 10.0 * 2.0 * (0.15 + 0.15 + 0.3)
    found = float(dynamics.accelerations["crank"].angular.z)
    assert found == pytest.approx(-torque / inertia, rel=1e-8)


def driven(armature, sliding: bool) -> tuple[cj.Scene, cj.State]:
    """A bar of 2 kg on a hinge or slider along X, hit by a ball of 1 kg with 3 m/s: on the hinge at
    0.4 m, on the slider at the centre."""
    bar, ball = cj.Body(2.0, (0.1, 0.2, 0.1)), cj.Body(1.0, (0.1, 0.1, 0.1))
    if sliding:
        joint = cj.PrismaticJoint("ground", "bar", ORIGIN, ORIGIN, X, armature=armature)
        start, velocity, point = (-0.05, 0, 0), (3.0, 0, 0), ORIGIN
    else:
        joint = hinge("ground", "bar", armature=armature)
        start, velocity, point = (0.4, -0.05, 0), (0, 3.0, 0), (0.4, 0, 0)
    points = {"point_first": ORIGIN, "point_second": point}
    sizes, law = {"radius_first": 0.02, "radius_second": 0.02}, cj.laws.HuntCrossley(0.6, 1e8)
    pair = cj.BallOnBall("ball", "bar", **sizes, **points, law=law)
    states = {"bar": cj.body_state(ORIGIN), "ball": cj.body_state(start, velocity=velocity)}
    return cj.Scene({"bar": bar, "ball": ball}, {"joint": joint, "pair": pair}), cj.State(states)


@pytest.mark.parametrize("sliding", [False, True])
def test_a_rigid_impact_accelerates_the_rotor_too(sliding):
    scene, state = driven(0.5, sliding)
    solution = cj.simulate_nonsmooth(scene, state, 0.02, step=1e-4, restitution=0.5)
    mass = 2.5 if sliding else (0.1 + 0.5) / 0.4**2
    impulse = 1.5 * 3.0 / (1.0 / 1.0 + 1.0 / mass)
    bar = solution.final.bodies["bar"]
    speed = bar.velocity[0] if sliding else 0.4 * bar.spin[2]
    assert speed == pytest.approx(impulse / mass, rel=1e-4)


def test_an_armature_must_be_positive():
    with pytest.raises(
        ValueError, match="`armature` must be positive, but is -1.0: .*kg m.2, or Non"
    ):
        hinge("ground", "arm", armature=-1.0)
    with pytest.raises(ValueError, match="`armature` must be positive, but is 0.0: .*kg, or None"):
        cj.PrismaticJoint("ground", "arm", ORIGIN, ORIGIN, X, armature=0.0)


def test_velocities_are_projected_with_the_inertia_of_the_rotor():
    """A disc of 0.2 kg m^2 with a rotor of 0.5 kg m^2 turns at 3 rad/s; one of 0.3 kg m^2, which is
    fixed to it, rests. Together they keep the angular momentum."""
    discs = {
        name: cj.Body(1.0, (inertia,) * 3) for name, inertia in (("first", 0.2), ("second", 0.3))
    }
    joints = {
        "hinge": hinge("ground", "first", armature=0.5),
        "weld": cj.FixedJoint("first", "second", ORIGIN, ORIGIN),
    }
    state = cj.State(
        {"first": cj.body_state(ORIGIN, spin=(0, 0, 3.0)), "second": cj.body_state(ORIGIN)}
    )
    system = system_of(cj.Scene(discs, joints), cj.AbsoluteCoordinates())
    variables = system.encode(cj.extend.unpack(state).bodies)
    found = system.decode(system.project_velocities(variables, 0.0))
    for body in found.values():
        assert float(body.spin.z) == pytest.approx(0.7 * 3.0 / 1.0)

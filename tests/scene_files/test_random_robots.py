"""Robots at random, read from URDF: their angles are those of the file, and Pinocchio computes the
same accelerations, with fixed links merged or not.

NumPy evaluates the equations of motion, so that nothing is compiled.
"""

import math
import operator
from collections.abc import Mapping
from typing import Any, NamedTuple
from xml.etree import ElementTree

import jax
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import clearjoint as cj
from tests.support import urdf
from tests.support.many_states import system_of
from tests.support.random_mjcf import random_box, text
from tests.support.robots import JOINT, accelerations, joint_accelerations, require_close, turned
from tests.support.slow import slow_but

FEW, MANY = range(2), range(100, 140)
SEEDS = slow_but(FEW, [*FEW, *MANY])
MOVING = "revolute", "continuous", "prismatic"


def rpy(generator: np.random.Generator) -> np.ndarray:
    """Angles of an <origin>: at random, in quarter turns, or zero."""
    quarters = generator.integers(-2, 3, 3) * math.pi / 2
    return [generator.uniform(-3, 3, 3), quarters, np.zeros(3)][generator.integers(3)]


def origin(generator: np.random.Generator) -> str:
    return urdf.tag("origin", xyz=text(generator.uniform(-1, 1, 3)), rpy=text(rpy(generator)))


def inertial(generator: np.random.Generator) -> str:
    """The inertia of a random box, in axes that are turned if the origin is."""
    mass, moments = random_box(generator)
    frame = Rotation.from_rotvec(generator.uniform(-1, 1, 3) * generator.integers(2)).as_matrix()
    tensor = frame @ np.diag(moments) @ frame.T
    upper = zip(*np.triu_indices(3), strict=True)
    entries = {f"i{'xyz'[row]}{'xyz'[column]}": tensor[row, column] for row, column in upper}
    return urdf.tag(
        "inertial", origin(generator), urdf.tag("mass", value=mass), urdf.tag("inertia", **entries)
    )


def random_robot(seed: int, kinds=MOVING, links: int = 9) -> str:
    """A tree of links, whose names are not in the order of the tree; about half of the joints are
    fixed, and some of the links at these have no mass. All moving links have mass."""
    generator = np.random.default_rng(seed)
    names = [f"link {k}" for k in generator.permutation(links)]
    parts = [urdf.tag("link", inertial(generator), name=names[0])]
    for k in range(1, links):
        # The first joint moves, so that there is a body.
        kind = generator.choice(kinds) if k == 1 or generator.random() < 0.5 else "fixed"
        has_mass = kind != "fixed" or generator.random() < 0.7
        axis = [*np.eye(3), -np.eye(3)[2], generator.uniform(-1, 1, 3)][generator.integers(5)]
        own = text(axis / np.linalg.norm(axis))
        parent, place = names[generator.integers(k)], origin(generator)
        parts += [
            urdf.tag("link", inertial(generator) if has_mass else "", name=names[k]),
            urdf.joint(f"to {names[k]}", kind, parent, names[k], own, place, limit=(10, 1, -9, 9)),
        ]
    ends = parts[1:]
    generator.shuffle(ends)  # the order of the file is not that of the tree either
    return urdf.robot(parts[0], *ends)


class Motion(NamedTuple):
    """Joints' positions (rad or m) and speeds, by name."""

    positions: dict[str, float]
    speeds: dict[str, float]


def random_motion(robot: str, seed: int) -> Motion:
    joints = ElementTree.fromstring(robot).findall("joint")
    names = [joint.attrib["name"] for joint in joints if joint.attrib["type"] != "fixed"]
    generator = np.random.default_rng(seed + 1)
    positions, speeds = generator.uniform(-2, 2, (2, len(names))).tolist()
    return Motion(dict(zip(names, positions, strict=True)), dict(zip(names, speeds, strict=True)))


def moved(robot: cj.results.Robot, motion: Motion, scene: cj.Scene | None = None):
    """The equations of motion, and the variables of a motion."""
    system = system_of(scene or robot.scene, JOINT)
    return system, dict(system.encode(cj.extend.unpack(robot.state(*motion)).bodies))


def joint_rates(robot: cj.results.Robot, motion: Motion) -> dict[str, float]:
    """Second time derivatives of the joints' positions, by name."""
    return joint_accelerations(robot, robot.state(*motion))


def homogeneous(turn: Rotation, place: Any) -> np.ndarray:
    """The matrix (4, 4) of a rotation and a translation, m."""
    columns = np.column_stack([turn.as_matrix(), place])
    return np.vstack([columns, (0.0, 0.0, 0.0, 1.0)])


def poses(robot: str, positions: Mapping[str, float]) -> dict[str, np.ndarray]:
    """Homogeneous matrices of the links' frames, by name, by the definitions of URDF."""
    root = ElementTree.fromstring(robot)
    joints = {joint.find("child").attrib["link"]: joint for joint in root.findall("joint")}

    def numbers(element, attribute):
        return [float(word) for word in element.attrib[attribute].split()]

    def pose(link):
        if link not in joints:
            return np.eye(4)
        joint, still = joints[link], np.zeros(3)
        origin, axis = joint.find("origin"), np.array(numbers(joint.find("axis"), "xyz"))
        roll, pitch, yaw = map(Rotation.from_rotvec, np.diag(numbers(origin, "rpy")))
        place = homogeneous(yaw * pitch * roll, numbers(origin, "xyz"))
        move = axis * positions.get(joint.attrib["name"], 0.0)
        turn, shift = (still, move) if joint.attrib["type"] == "prismatic" else (move, still)
        motion = homogeneous(Rotation.from_rotvec(turn), shift)
        return pose(joint.find("parent").attrib["link"]) @ place @ motion

    return {link.attrib["name"]: pose(link.attrib["name"]) for link in root.findall("link")}


@pytest.mark.parametrize("merge_fixed", [True, False])
@pytest.mark.parametrize("seed", SEEDS)
def test_links_are_where_the_definitions_of_urdf_put_them(seed, merge_fixed, read_robot):
    robot = random_robot(seed)
    motion = random_motion(robot, seed)
    loaded = read_robot(robot, merge_fixed=merge_fixed)
    system, variables = moved(loaded, motion)
    bodies = JOINT.decode(system.scene, variables)
    frames = loaded.links
    assert frames.keys() == poses(robot, {}).keys()
    for name, expected in poses(robot, motion.positions).items():
        frame, pose = frames[name], np.eye(4)
        if frame.body != cj.GROUND:
            body = bodies[frame.body]
            turn = turned(jax.tree.leaves(body.orientation))
            pose = homogeneous(turn, jax.tree.leaves(body.position))
        place = homogeneous(turned(frame.orientation), frame.point)
        np.testing.assert_allclose(pose @ place, expected, rtol=0.0, atol=1e-12)


def angles(robot: cj.results.Robot, scene: cj.Scene, motion: Motion) -> dict[str, float]:
    """Angles of all elements that have one (`quantities.JointAngle`), by name."""
    system, variables = moved(robot, motion, scene)
    now = cj.extend.Instant(system, 0.0, variables, entry_speeds={}, work={})
    names = [name for name, one in scene.joints.items() if hasattr(one, "relative_angle")]
    return {name: float(cj.quantities.JointAngle(name)(now)) for name in names}


@pytest.mark.parametrize("seed", SEEDS)
def test_angles_of_hinges_backlash_and_drives_are_those_of_the_file(seed, read_robot):
    robot = random_robot(seed, kinds=("revolute", "continuous"))
    motion = random_motion(robot, seed)
    play = {name: {"backlash": 1e-3, "torsional_stiffness": 1e4} for name in motion.positions}
    loaded = read_robot(robot, play=play)
    scene = loaded.scene
    hinges = {name: scene.joints[name] for name in motion.positions}
    drives = {
        f"{name} drive": cj.PrescribedRotation(hinge.first, hinge.second, hinge.axis_first, 1.0)
        for name, hinge in hinges.items()
    }
    driven = cj.Scene(scene.bodies, scene.joints | drives)
    for positions in (motion.positions, dict.fromkeys(motion.positions, 0.0)):
        found = angles(loaded, driven, Motion(positions, motion.speeds))
        assert len(found) == 3 * len(hinges)
        for name, angle in found.items():
            expected = positions[name.removesuffix(" drive").removesuffix(" backlash")]
            assert angle == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("seed", SEEDS)
def test_robots_without_gravity_stay_at_rest_in_their_play(seed, read_robot):
    robot = random_robot(seed, kinds=("revolute", "continuous"))
    names = random_motion(robot, seed).positions
    clearance = {"bearing_radius": 0.01, "clearance": 1e-4, "journal_length": 0.02}
    clearance |= {"law": cj.laws.Hertz(1e9)}
    backlash = {"backlash": 1e-3, "torsional_stiffness": 1e4}
    for play in (backlash, clearance):
        loaded = read_robot(robot, play=dict.fromkeys(names, play), gravity=None)
        found = accelerations(loaded.scene, loaded.state())
        assert np.abs([*found.values()]).max() < 1e-9


def resisting(robot: str, seed: int, mimics: int = 0) -> str:
    """The robot with damping, and with some joints that follow others."""
    generator = np.random.default_rng(seed + 2)
    root = ElementTree.fromstring(robot)
    joints = [joint for joint in root.findall("joint") if joint.attrib["type"] != "fixed"]
    for joint in joints:
        ElementTree.SubElement(joint, "dynamics", damping=repr(generator.uniform(0.1, 2.0)))
    chosen = generator.permutation(len(joints))
    for k in range(min(mimics, len(joints) - 1)):
        offset, ratio = generator.uniform(-0.3, 0.3), generator.uniform(-1.5, 1.5)
        attributes = {"multiplier": repr(ratio), "offset": repr(offset)}
        leader = joints[chosen[k + 1]].attrib["name"]  # which may follow another one
        ElementTree.SubElement(joints[chosen[k]], "mimic", joint=leader, **attributes)
    return ElementTree.tostring(root, encoding="unicode")


class Reference(NamedTuple):
    """Pinocchio's model of a robot, at a motion."""

    inertia: dict[tuple[str, str], float]
    torques: dict[str, float]
    accelerations: dict[str, float]


def pinocchio_of(robot: str, motion: Motion, rates: Mapping[str, float]) -> Reference:
    """Mass matrix, torques for given accelerations, accelerations without torques, by joint; all
    without damping, and as if no joint followed another."""
    pinocchio = pytest.importorskip("pinocchio")
    model = pinocchio.buildModelFromXML(robot)
    data, q = model.createData(), pinocchio.neutral(model)
    v, a = np.zeros(model.nv), np.zeros(model.nv)
    at = {name: model.joints[model.getJointId(name)] for name in motion.positions}
    for name, joint in at.items():
        x = motion.positions[name]
        q[joint.idx_q : joint.idx_q + joint.nq] = [x] if joint.nq == 1 else [np.cos(x), np.sin(x)]
        v[joint.idx_v], a[joint.idx_v] = motion.speeds[name], rates.get(name, 0.0)
    matrix = pinocchio.crba(model, data, q)
    matrix = np.triu(matrix) + np.triu(matrix, 1).T
    torques = pinocchio.rnea(model, data, q, v, a)
    free = pinocchio.aba(model, data, q, v, np.zeros(model.nv))
    indices = {name: joint.idx_v for name, joint in at.items()}
    return Reference(
        {(a, b): matrix[indices[a], indices[b]] for a in at for b in at},
        {name: torques[k] for name, k in indices.items()},
        {name: free[k] for name, k in indices.items()},
    )


@pytest.mark.parametrize("merge_fixed", [True, False])
@pytest.mark.parametrize("seed", SEEDS)
def test_pinocchio_computes_the_same_accelerations_and_torques(seed, merge_fixed, read_robot):
    robot = random_robot(seed)
    motion = random_motion(robot, seed)
    rates = random_motion(robot, seed + 50).positions
    expected = pinocchio_of(robot, motion, rates)
    loaded = read_robot(robot, merge_fixed=merge_fixed)
    fixed = [name for name, j in loaded.scene.joints.items() if isinstance(j, cj.FixedJoint)]
    assert not (merge_fixed and fixed)
    require_close(joint_rates(loaded, motion), expected.accelerations, 1e-9)
    torques = loaded.torques(motion.positions, motion.speeds, rates)
    require_close({name: float(torque) for name, torque in torques.items()}, expected.torques, 1e-9)


@pytest.mark.parametrize("seed", SEEDS)
def test_damped_joints_that_follow_others_move_as_pinocchios_equations_say(seed, read_robot):
    """With q = S z + offset of the independent joints z: S^T M S z'' = S^T (torques)."""
    robot = resisting(random_robot(seed), seed, mimics=2)
    loaded = read_robot(robot)
    joints = {j.attrib["name"]: j for j in ElementTree.fromstring(robot).findall("joint")}
    names = [*loaded.joints]
    mimics = {name: joints[name].find("mimic") for name in names}
    leaders = {name: mimic.attrib for name, mimic in mimics.items() if mimic is not None}
    assert {name: mimic["joint"] for name, mimic in leaders.items()} == loaded.leaders
    assert leaders or len(names) == 1
    free = [name for name in names if name not in leaders]
    given = random_motion(robot, seed)
    given = Motion(*({name: 0.2 * part[name] for name in free} for part in given))
    state = loaded.state(*given)
    motion = Motion(
        *({n: float(x) for n, x in part(state).items()} for part in (loaded.angles, loaded.speeds))
    )

    def slope(name: str, of: str) -> float:
        if name not in leaders:
            return float(name == of)
        return float(leaders[name]["multiplier"]) * slope(leaders[name]["joint"], of)

    matrix = np.array([[slope(name, of) for of in free] for name in names])
    for name, mimic in leaders.items():
        led = float(mimic["multiplier"]) * motion.positions[mimic["joint"]]
        assert motion.positions[name] == pytest.approx(float(mimic["offset"]) + led, abs=1e-12)
    reference = pinocchio_of(robot, motion, {})
    inertia = np.array([[reference.inertia[a, b] for b in names] for a in names])
    damping = [float(joints[n].find("dynamics").attrib["damping"]) for n in names]
    resisted = [
        reference.torques[n] + d * motion.speeds[n] for n, d in zip(names, damping, strict=True)
    ]
    independent = np.linalg.solve(matrix.T @ inertia @ matrix, matrix.T @ -np.array(resisted))
    expected = dict(zip(names, (matrix @ independent).tolist(), strict=True))
    require_close(joint_rates(loaded, motion), expected, 1e-9)
    first, second = (
        accelerations(loaded.scene, state, coordinates)
        for coordinates in (JOINT, cj.AbsoluteCoordinates())
    )
    require_close(second, first, 1e-9)
    # Without torques the joints move like this, so that inverse dynamics gives no torques for it.
    rates = dict(zip(free, independent.tolist(), strict=True))
    torques = loaded.torques(*given, rates)
    scale = np.abs(resisted).max()
    assert np.abs([torques[name] for name in names]).max() < 1e-9 * scale


@pytest.mark.parametrize("seed", SEEDS)
def test_states_of_angles_are_inverted(seed, read_robot):
    robot = random_robot(seed)
    loaded, generator = read_robot(robot), np.random.default_rng(seed)
    count = len(loaded.joints)
    q, qd = generator.uniform(-3.1, 3.1, (2, 7, count))
    states = loaded.state(q, qd)
    for k in range(7):
        at_once = jax.tree.map(operator.itemgetter(k), states)
        single = loaded.state(q[k], dict(zip(loaded.joints, qd[k], strict=True)))
        for a, b in zip(jax.tree.leaves(at_once), jax.tree.leaves(single), strict=True):
            np.testing.assert_allclose(a, b, rtol=0.0, atol=1e-14)
    positions, speeds = loaded.angles(states), loaded.speeds(states)
    assert tuple(positions) == tuple(speeds) == loaded.joints
    np.testing.assert_allclose(np.transpose([*positions.values()]), q, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(np.transpose([*speeds.values()]), qd, rtol=0.0, atol=1e-12)

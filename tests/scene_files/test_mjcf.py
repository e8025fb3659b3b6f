"""Robots from MJCF files: MuJoCo computes the same accelerations, of random robots too."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import clearjoint as cj
from tests.support.random_mjcf import file_of, frame, model_of, random_body, random_tree, text
from tests.support.robots import accelerations, accelerations_in_mujoco, turned
from tests.support.slow import slow_but

mujoco = pytest.importorskip("mujoco")
FEW, MANY = range(2), range(100, 130)
SEEDS = slow_but(FEW, [*FEW, *MANY])


def free_state(model, data, body: str, start: np.ndarray) -> cj.BodyState:
    """Of a free body, whose axes are the world's at the start."""
    index, velocity = model.body(body).id, np.zeros(6)
    mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_BODY, index, velocity, 0)
    orientation = turned(data.xquat[index]) * turned(start).inv()
    return cj.body_state(
        data.xipos[index],
        orientation.as_quat(scalar_first=True),
        velocity[3:],
        orientation.inv().apply(velocity[:3]),
    )


@pytest.mark.parametrize("seed", SEEDS)
def test_mujoco_computes_the_same_accelerations(seed, read_robot):
    """Hinges and sliders, one or several of a body, with references, springs and dampers, fixed
    links, and a free body that carries links."""
    generator = np.random.default_rng(seed)
    names = [f"body {k}" for k in generator.permutation(8)]
    tree = random_tree(generator, names[:5], fixed=True)
    carried = random_tree(generator, names[5:7], fixed=False)
    free = random_body(generator, names[7], '<freejoint name="free"/>', carried)
    robot = file_of(tree + free, generator)
    model, data = model_of(robot)
    start = model.body_quat[model.body(names[7]).id].copy()
    data.qpos[:] += 0.5 * generator.uniform(-1, 1, model.nq)
    data.qpos[model.joint("free").qposadr[0] + 3 :][:4] = Rotation.random(rng=generator).as_quat()
    data.qvel[:] = generator.uniform(-2, 2, model.nv)
    mujoco.mj_forward(model, data)
    loaded = read_robot(robot)
    q = {name: float(data.joint(name).qpos[0]) for name in loaded.joints}
    qd = {name: float(data.joint(name).qvel[0]) for name in loaded.joints}
    state = loaded.state(q, qd, free={names[7]: free_state(model, data, names[7], start)})
    for name, angle in loaded.angles(state).items():
        assert angle == pytest.approx(q[name], abs=1e-12)
        assert loaded.speeds(state)[name] == pytest.approx(qd[name], abs=1e-12)
    found = accelerations(loaded.scene, state)
    for name in [name for name in names if loaded.links[name].body == name]:
        # MuJoCo's is that of the body alone; here fixed bodies are parts of the body.
        expected = accelerations_in_mujoco(model, data, name, "XBODY")
        angular, linear = np.split(found[name], 2)
        turn = turned(state.bodies[name].orientation)
        spin, arm = turn.apply(state.bodies[name].spin), turn.apply(loaded.links[name].point)
        linear += np.cross(angular, arm) + np.cross(spin, np.cross(spin, arm))
        scale = np.abs(expected).max()
        assert np.abs(np.concatenate([angular, linear]) - expected).max() < 1e-9 * scale


@pytest.mark.parametrize("seed", SEEDS)
def test_torques_are_those_of_mujocos_inverse_dynamics(seed, read_robot):
    generator = np.random.default_rng(seed)
    names = [f"body {k}" for k in generator.permutation(6)]
    robot = file_of(random_tree(generator, names, fixed=True), generator)
    model, data = model_of(robot)
    data.qpos[:], data.qvel[:], data.qacc[:] = generator.uniform(-2, 2, (3, model.nv))
    mujoco.mj_inverse(model, data)
    loaded = read_robot(robot)
    assert [model.joint(k).name for k in range(model.njnt)] == [*loaded.joints]
    found = loaded.torques(data.qpos, data.qvel, data.qacc)
    scale = np.abs(data.qfrc_inverse).max()
    assert np.abs([*found.values()] - data.qfrc_inverse).max() < 1e-9 * scale


@pytest.mark.parametrize("seed", SEEDS)
def test_flags_of_the_file_and_resistances_of_actuators_have_mujocos_effect(seed, read_robot):
    generator = np.random.default_rng(seed)
    names = [f"body {k}" for k in generator.permutation(4)]
    tree = random_tree(generator, names, fixed=False)
    model, _ = model_of(file_of(tree, generator))
    flags = {name: generator.random() < 0.5 for name in ("spring", "damper", "gravity")}
    resistance = "armature damping" if hasattr(model, "actuator_armature") else ""
    disabled = " ".join(f'{name}="disable"' for name, is_off in flags.items() if is_off)
    rest = f"<option><flag {disabled}/></option><actuator>"
    for k in range(model.njnt):
        joint = f'{generator.choice(["joint", "jointinparent"])}="{model.joint(k).name}"'
        numbers = [f'{name}="{text(generator.uniform(0, 2))}"' for name in resistance.split()]
        for gear in generator.normal(size=generator.integers(3)):
            rest += f'<motor {joint} gear="{text(gear)}" {" ".join(numbers)}/>'
    robot = file_of(tree, generator, rest + "</actuator>")
    model, data = model_of(robot)
    data.qpos[:], data.qvel[:], data.qacc[:] = generator.uniform(-2, 2, (3, model.nv))
    mujoco.mj_inverse(model, data)
    found = read_robot(robot).torques(data.qpos, data.qvel, data.qacc)
    scale = np.abs(data.qfrc_inverse).max()
    assert np.abs([*found.values()] - data.qfrc_inverse).max() < 1e-9 * scale


ONE_HINGE = """<mujoco><option><flag {flags}/></option><worldbody>
<body name="arm"><joint name="hinge" frictionloss="2" damping="1 0.5" axis="0 1 0"/>
<inertial mass="1" pos="0.5 0 0" diaginertia="0.1 0.1 0.1"/></body></worldbody>
<equality><joint name="hold" joint1="hinge"/></equality>
<actuator><motor name="late" joint="hinge" delay="0.1" nsample="9"/></actuator></mujoco>"""


@pytest.mark.parametrize(
    ("flag", "friction", "coupling"),
    [
        ("", True, True),
        ("frictionloss", False, True),
        ("equality", True, False),
        ("constraint", False, False),
    ],
)
def test_disabled_constraints_and_what_a_robot_lacks(flag, friction, coupling, tmp_path):
    if not hasattr(mujoco.MjModel, "dof_dampingpoly"):
        pytest.skip("this version of MuJoCo has no dampers that are not linear")
    file = tmp_path / "robot.xml"
    file.write_text(ONE_HINGE.format(flags=f'{flag}="disable"' if flag else ""))
    with pytest.warns(cj.NotCarriedOverWarning) as caught:
        robot = cj.load_robot(file)
    assert ("hinge friction" in robot.scene.joints) == friction
    assert ("hinge coupling" in robot.scene.joints) == coupling
    (message,) = [str(warning.message) for warning in caught]
    assert ("equalities of hold" in message) != coupling
    assert "nonlinear springs and dampers of hinge" in message
    assert "actuators of other kinds of late" in message


@pytest.mark.parametrize("seed", SEEDS)
def test_equalities_accelerate_as_mujocos_jacobian_says(seed, read_robot):
    """At rest: M a = forces + J^T multipliers with J a = 0."""
    generator = np.random.default_rng(seed)
    names = [f"body {k}" for k in generator.permutation(7)]
    tree = random_tree(generator, names[:5], fixed=False)
    free = "".join(
        random_body(generator, name, f'<freejoint name="free {name}"/>', "") for name in names[5:]
    )
    anchor, coefficients = text(generator.uniform(-1, 1, 3)), text(generator.uniform(-1, 1, 5))
    equalities = (
        f'<connect name="pin" body1="{names[5]}" body2="{names[3]}" anchor="{anchor}"/>'
        f'<weld name="weld" body1="{names[2]}" body2="{names[6]}"/>'
        f'<joint joint1="to {names[1]}" joint2="to {names[4]}" polycoef="{coefficients}"/>'
        f'<joint joint1="to {names[0]}" polycoef="0.2 0 0 0 0"/>'
    )
    robot = file_of(tree + free, generator, f"<equality>{equalities}</equality>")
    model, data = model_of(robot)
    mujoco.mj_forward(model, data)
    matrix = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, matrix)
    jacobian = data.efc_J.reshape(-1, model.nv)
    force = data.qfrc_passive - data.qfrc_bias
    free_rates = np.linalg.solve(matrix, force)
    response = np.linalg.solve(matrix, jacobian.T)
    data.qacc[:] = free_rates - response @ np.linalg.solve(
        jacobian @ response, jacobian @ free_rates
    )
    loaded = read_robot(robot)
    q = {name: float(data.joint(name).qpos[0]) for name in loaded.joints}
    followers = {f"to {names[0]}", f"to {names[1]}"}
    # The equations are evaluated at MuJoCo's start, which violates the couplings.
    tree_only = read_robot(robot.split("<equality>")[0] + "</mujoco>")
    state = tree_only.state(q)
    assert {*loaded.leaders} == followers - {f"to {names[0]}"}
    kinds = {name: type(joint) for name, joint in loaded.scene.joints.items()}
    assert kinds["pin"] is cj.SphericalJoint and kinds["weld"] is cj.FixedJoint
    found = accelerations(loaded.scene, state)
    for name in names:
        expected = accelerations_in_mujoco(model, data, name)
        scale = max(np.abs(expected).max(), 10.0)
        assert np.abs(found[name] - expected).max() < 1e-8 * scale


@pytest.mark.parametrize("kind", ["connect", "weld"])
@pytest.mark.parametrize("seed", range(5))
def test_equalities_of_sites_are_those_of_bodies(seed, kind, read_robot):
    generator = np.random.default_rng(seed)
    bodies = [
        random_body(generator, name, f"<freejoint/><site name='on {name}' {frame(generator)}/>", "")
        for name in ("a", "b")
    ]
    sites = f'<equality><{kind} name="e" site1="on a" site2="on b"/></equality>'
    robot = file_of("".join(bodies), generator, sites)
    model, data = model_of(robot)
    mujoco.mj_forward(model, data)
    loaded = read_robot(robot)
    joint, start = loaded.scene.joints["e"], loaded.state()
    for body, point in (("a", joint.point_first), ("b", joint.point_second)):
        # At the start, the axes of all bodies are the world's.
        place = np.asarray(start.bodies[body].position) + np.asarray(point)
        assert place == pytest.approx(data.site(f"on {body}").xpos, abs=1e-12)
    if kind == "weld":
        first, second = (
            Rotation.from_matrix(data.site(f"on {body}").xmat.reshape(3, 3)) for body in "ab"
        )
        assert (turned(joint.orientation).inv() * first * second.inv()).magnitude() < 1e-9

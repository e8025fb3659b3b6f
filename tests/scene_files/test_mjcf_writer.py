"""Scenes and robots as MJCF files: MuJoCo accelerates them as clearjoint does, `load_robot` reads
them as they were, and play moves as closed forms say."""

import math
import warnings
from dataclasses import replace

import jax
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import clearjoint as cj
from studies.backlash import ours
from studies.backlash.shafts import END, FREQUENCY, exact
from tests.support import urdf
from tests.support.random_mjcf import file_of, random_body, random_box, random_tree
from tests.support.robots import accelerations, accelerations_in_mujoco, require_close
from tests.support.slow import slow_but

mujoco = pytest.importorskip("mujoco")
FEW, MANY = range(4), range(100, 140)
SEEDS = slow_but(FEW, [*FEW, *MANY])


@pytest.fixture
def written(tmp_path):
    """Write a scene or robot, and return MuJoCo's model."""

    def written(*arguments, **options):
        path = tmp_path / "written.xml"
        cj.save_mjcf(arguments[0], path, *arguments[1:], **options)
        return mujoco.MjModel.from_xml_path(str(path))

    return written


def at_keyframe(model):
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("start").id)
    mujoco.mj_forward(model, data)
    return data


def require_same_accelerations(model, data, scene, state, tolerance):
    found = accelerations(scene, state)
    expected = {name: accelerations_in_mujoco(model, data, name) for name in found}
    require_close(found, expected, tolerance)
    for name, body in state.bodies.items():
        assert data.body(name).xipos == pytest.approx(np.asarray(body.position), abs=1e-12)


class RandomScene:
    """A tree of bodies of random names, in random poses, on joints whose bodies are in any order,
    of which some have the axis of the joint before."""

    def __init__(self, generator: np.random.Generator, count: int = 7):
        self.generator = generator
        self.names = [f"body {k}" for k in generator.permutation(count)]
        self.poses = {"ground": (np.zeros(3), Rotation.identity())}
        self.axes: dict[str, np.ndarray] = {}
        self.pairs: dict[str, tuple[str, str]] = {}
        self.kinds: dict[str, type] = {}
        self.bodies, self.joints, self.parents = {}, {}, {}
        for k, name in enumerate(self.names):
            mass, moments = random_box(generator, least=0.3)
            turn = Rotation.random(rng=generator).as_matrix()
            whole = turn @ np.diag(moments) @ turn.T
            inertia = moments if k % 2 else 0.5 * (whole + whole.T)
            self.bodies[name] = cj.Body(mass, inertia)
            self.poses[name] = generator.uniform(-1, 1, 3), Rotation.random(rng=generator)
            parent = ["ground", *self.names[:k]][generator.integers(k + 1)]
            self.add_joint(name, parent)

    def local(self, body: str, vector: np.ndarray) -> np.ndarray:
        return self.poses[body][1].inv().apply(vector)

    def point(self, body: str, place: np.ndarray) -> np.ndarray:
        return self.local(body, place - self.poses[body][0])

    def pair(self, *names: str) -> tuple[str, str]:
        first, second = self.generator.permutation(names)
        return str(first), str(second)

    def add_joint(self, name: str, parent: str) -> None:
        generator = self.generator
        kind = generator.choice(
            [cj.RevoluteJoint, cj.PrismaticJoint, cj.SphericalJoint, cj.FixedJoint],
            p=[0.5, 0.3, 0.1, 0.1],
        )
        first, second = pair = self.pair(name, parent)
        axis = self.axes.get(parent) if generator.random() < 0.6 else None
        if axis is None or self.kinds[parent] is not kind:
            axis = Rotation.random(rng=generator).as_matrix()[0]
        place = generator.uniform(-1, 1, 3)
        points = self.point(first, place), self.point(second, place)
        relative = (self.poses[first][1].inv() * self.poses[second][1]).as_quat(scalar_first=True)
        armature = generator.uniform(0.1, 1.0) if generator.random() < 0.3 else None
        self.parents[name], self.kinds[name], self.pairs[name] = parent, kind, pair
        if kind is cj.RevoluteJoint:
            axes = self.local(first, axis), self.local(second, axis)
            joint = kind(*pair, *points, *axes, armature)
        elif kind is cj.PrismaticJoint:
            joint = kind(*pair, *points, self.local(first, axis), relative, armature=armature)
        elif kind is cj.FixedJoint:
            joint = kind(*pair, *points, relative)
        else:
            joint = kind(*pair, *points)
        self.joints[f"on {name}"] = joint
        if kind in (cj.RevoluteJoint, cj.PrismaticJoint):
            self.axes[name] = axis

    def along(self, kind: type) -> list[tuple[str, str, np.ndarray]]:
        """Pairs of bodies between which only joints of a kind with one axis are, with this axis:
        two bodies of a joint, and those of two joints in series."""
        found = []
        for name, parent in self.parents.items():
            if self.kinds[name] is kind:
                found.append((name, parent, self.axes[name]))
            before = self.parents.get(parent, "")
            is_same = name in self.axes and self.axes.get(parent) is self.axes[name]
            if before and is_same and self.kinds[name] is self.kinds[parent] is kind:
                found.append((name, before, self.axes[name]))
        return found

    def backlash(self, first: str, second: str, local: np.ndarray, axis: np.ndarray) -> cj.Backlash:
        """With play of 0.01 rad, of which some is left, or a flank is pressed by up to 1 mrad."""
        own = np.sign(self.local(first, axis) @ local) * self.local(second, axis)
        flanks = {"play": 0.01, "radius": 0.03, "law": cj.laws.SpringDashpot(1e7, 1e3)}
        free = cj.Backlash(first, second, axis_first=local, axis_second=own, **flanks)
        motions = self.motions()
        angle = float(cj.extend.unpack(free).relative_angle(motions).value)
        return replace(free, middle=angle + self.generator.uniform(-6e-3, 6e-3))

    def motions(self, state: cj.State | None = None, after: float = 0.0):
        """Of bodies in their poses, or moved from these by the velocities of a state, s."""
        still, motions = np.zeros(3), {}
        for name, (place, turn) in self.poses.items():
            if state is not None and name in state.bodies:
                body = state.bodies[name]
                place = place + after * np.asarray(body.velocity)
                turn = turn * Rotation.from_rotvec(after * np.asarray(body.spin))
            motions[name] = cj.testing.moving(place, turn.as_quat(scalar_first=True), still, still)
        return motions

    def moving(self, scene: cj.Scene) -> cj.State:
        """The pose of the file, with random velocities that the joints allow."""
        bodies = {
            name: cj.body_state(
                self.poses[name][0],
                self.poses[name][1].as_quat(scalar_first=True),
                *self.generator.uniform(-2, 2, (2, 3)),
            )
            for name in self.names
        }
        scalars = cj.extend.unpack(jax.tree.map(np.asarray, scene))
        coordinates = cj.JointCoordinates()
        variables = coordinates.encode(scalars, cj.extend.unpack(cj.State(bodies)).bodies)
        decoded = coordinates.decode(scalars, variables)
        return cj.State({name: cj.extend.pack(decoded[name]) for name in bodies})


@pytest.mark.parametrize("seed", SEEDS)
def test_mujoco_accelerates_random_scenes_alike(seed, written):
    """Springs, dampers, friction, torques, motors and pressed flanks, of joints and of bodies
    further apart."""
    generator = np.random.default_rng(seed)
    made = RandomScene(generator)
    joints, forces = dict(made.joints), {}
    for k, (a, b, axis) in enumerate(made.along(cj.RevoluteJoint)):
        first, second = pair = made.pair(a, b)
        local = made.local(first, axis) * generator.uniform(0.5, 2.0) * generator.choice([-1, 1])
        turned = Rotation.from_rotvec(axis * generator.uniform(-2, 2)) * made.poses[second][1]
        at_zero = (made.poses[first][1].inv() * turned).as_quat(scalar_first=True)
        law = cj.frictions.RegularisedCoulomb(1.0, 1e-9)
        steady = cj.PiecewiseConstant([0.0, 1.0], generator.uniform(-5, 5, 2))
        choices = {
            "spring": cj.TorsionalSpring(*pair, local, *generator.uniform(0.1, 3.0, 3), at_zero),
            "torque": cj.DriveTorque(*pair, local, steady),
            "motor": cj.Motor(
                *pair, local, cj.Polynomial(generator.uniform(-1, 1, 2)), 3.0, 0.5, 20.0, at_zero
            ),
            "friction": cj.JointFriction(*pair, law, 0.7, local, 0.9, viscosity=0.3),
            "backlash": made.backlash(first, second, local, axis),
        }
        for name in generator.permutation([*choices])[:4]:
            kind = forces if isinstance(choices[name], cj.extend.AbstractForce) else joints
            kind[f"{name} {k}"] = choices[name]
    for k, (a, b, axis) in enumerate(made.along(cj.PrismaticJoint)):
        first, second = pair = made.pair(a, b)
        points = generator.uniform(-1, 1, (2, 3))
        law = cj.frictions.RegularisedCoulomb(1.0, 1e-9)
        forces[f"bushing {k}"] = cj.Bushing(*pair, *points, *generator.uniform(0.1, 3.0, (2, 3)))
        local = made.local(first, axis)
        joints[f"friction {k}"] = cj.JointFriction(*pair, law, 0.7, local, point_second=points[0])
    ends = made.pair(*generator.choice([*made.bodies], 2, replace=False))
    rod = cj.SpringDamper(*ends, *generator.uniform(-1, 1, (2, 3)), 5.0, 0.5, 0.3)
    forces["spring of points"] = rod
    gravity = generator.uniform(-5, 5, 3)
    scene = cj.Scene(made.bodies, joints, forces, gravity)
    state = made.moving(scene)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        # Below an acceleration over 2000/s, MuJoCo's dry friction has no definite sign.
        model = written(scene, state, timestep=1e-4)
    data = at_keyframe(model)
    now, later = made.motions(), made.motions(state, 1e-6)
    for name in made.axes:
        joint = cj.extend.unpack(scene.joints[f"on {name}"])
        written_joint = data.joint(f"on {name}")
        position, after = (float(joint.position(motions).value) for motions in (now, later))
        turns = (position - written_joint.qpos[0]) / (2 * math.pi)
        assert turns == pytest.approx(round(turns), abs=1e-9)
        assert (after - position) / 1e-6 == pytest.approx(written_joint.qvel[0], abs=1e-4)
    # An impedance of 1e-4 is the error of flanks.
    has_flanks = any(isinstance(joint, cj.Backlash) for joint in joints.values())
    require_same_accelerations(model, data, scene, state, 1e-3 if has_flanks else 1e-6)


def driven(model, robot: cj.results.Robot, q, qd):
    """MuJoCo's data at positions and speeds of joints."""
    data = mujoco.MjData(model)
    for name, x, speed in zip(robot.joints, q, qd, strict=True):
        joint = model.joint(name)
        data.qpos[joint.qposadr[0]], data.qvel[joint.dofadr[0]] = x, speed
    mujoco.mj_forward(model, data)
    return data


@pytest.mark.filterwarnings("ignore::clearjoint.NotCarriedOverWarning")
@pytest.mark.parametrize("seed", SEEDS)
def test_robots_are_read_as_they_were(seed, tmp_path, read_robot, written):
    """MuJoCo accelerates a written robot as that of the first file, and so does clearjoint."""
    generator = np.random.default_rng(seed)
    names = [f"body {k}" for k in generator.permutation(7)]
    tree = random_tree(generator, names[:6], fixed=True)
    free = random_body(generator, names[6], '<freejoint name="free"/>', "")
    robot = file_of(tree + free, generator)
    first = read_robot(robot)
    q, qd = generator.uniform(-2, 2, (2, len(first.joints)))
    state = first.state(q, qd)
    model = written(first, state)
    again = cj.load_robot(tmp_path / "written.xml")
    assert {*again.joints} == {*first.joints}
    assert again.scene.bodies.keys() == first.scene.bodies.keys()
    second = again.state(*(dict(zip(first.joints, part, strict=True)) for part in (q, qd)))
    for name, body in state.bodies.items():
        other = second.bodies[name]
        for part in ("position", "velocity", "spin"):
            assert getattr(other, part) == pytest.approx(getattr(body, part), abs=1e-12)
    # Joints of one body, with links of almost no mass between them, lose two digits in MuJoCo too.
    close = 1e-7
    require_close(accelerations(again.scene, second), accelerations(first.scene, state), close)
    require_same_accelerations(model, at_keyframe(model), first.scene, state, close)
    original = mujoco.MjModel.from_xml_string(robot)
    rates = [driven(each, first, q, qd) for each in (model, original)]
    require_close(*({n: data.joint(n).qacc for n in first.joints} for data in rates), close)


@pytest.mark.filterwarnings("ignore::clearjoint.NotCarriedOverWarning")
@pytest.mark.parametrize("seed", SEEDS)
def test_mujoco_accelerates_drive_trains_alike(seed, read_robot, written):
    """Rotors that turn with the link, by a spring, and by pressed flanks, of hinges and sliders."""
    generator = np.random.default_rng(seed)
    names = [f"body {k}" for k in generator.permutation(6)]
    tree = random_tree(generator, names, fixed=True)
    robot = read_robot(file_of(tree, generator))
    q, qd = generator.uniform(-2, 2, (2, len(robot.joints)))
    positions, speeds = (dict(zip(robot.joints, part, strict=True)) for part in (q, qd))
    law = cj.frictions.RegularisedCoulomb(1.0, 1e-9)
    for name in robot.joints:
        inertia, stiffness, damping, friction, viscosity = generator.uniform(0.1, 2.0, 5)
        options = {"armature": inertia, "friction": friction, "viscosity": viscosity, "law": law}
        kind = generator.integers(4)
        if kind:
            options |= {"stiffness": 1e4 * stiffness, "damping": damping}
            positions[f"{name} motor"] = positions[name] + generator.uniform(-6e-3, 6e-3)
            speeds[f"{name} motor"] = generator.uniform(-2, 2)
        if kind > 1:
            options["play"] = 0.01
        robot = robot.with_drive(name, cj.Drive(**options))
    state = robot.state(positions, speeds)
    model = written(robot, state, timestep=1e-4)
    require_same_accelerations(model, at_keyframe(model), robot.scene, state, 1e-3)


INERTIAL = '<inertial pos="0.1 0 0" mass="1" diaginertia="0.1 0.1 0.1"/>'


@pytest.mark.parametrize("seed", FEW)
def test_properties_of_joints_and_actuators_are_read_as_they_were(
    seed, tmp_path, read_robot, written
):
    generator = np.random.default_rng(seed)
    a, b, c, d, e, f, g, h, i, j = generator.uniform(0.1, 2.0, 10)
    elbow = f"""<joint name="elbow" axis="0 1 0" range="-{a} {b}" frictionloss="{c}" damping="{d}"
      armature="{e}" stiffness="{f}" springref="{g}" actuatorfrcrange="-{h} {h}"/>"""
    grip = f'<joint name="grip" type="slide" axis="1 0 0" frictionloss="{i}"/>'
    others = (f'<joint name="{name}" axis="1 0 0"/>' for name in ("tilt", "held"))
    bodies = ""
    for joint in reversed((elbow, grip, *others)):
        bodies = f"<body>{joint}{INERTIAL}{bodies}</body>"
    rest = f"""
      <equality><joint name="e" joint1="grip" joint2="elbow" polycoef="{a} {b} {c} {d} {e}"/>
      <joint name="f" joint1="tilt" joint2="elbow" polycoef="{b} {c} {d} 0 {e}"/>
      <joint name="g" joint1="held" polycoef="{a} 0 0 0 0"/></equality><actuator>
      <position name="servo" joint="elbow" kp="{i}" kv="{j}" ctrlrange="-1 {a}"/>
      <motor name="push" joint="grip" gear="{g}" forcerange="-{h} {h}"/></actuator>"""
    file = file_of(bodies, generator, rest)
    first, original = read_robot(file), mujoco.MjModel.from_xml_string(file)
    model = written(first)
    again = cj.load_robot(tmp_path / "written.xml")
    assert again.limits == first.limits
    assert again.actuators == first.actuators
    assert again.leaders == first.leaders == {"grip": "elbow", "tilt": "elbow"}
    for numbers in ("damping", "frictionloss", "armature"):
        both = (getattr(each, f"dof_{numbers}") for each in (original, model))
        np.testing.assert_allclose(*both, rtol=1e-12)
    for attribute in ("jnt_range", "jnt_stiffness", "qpos_spring", "jnt_actfrcrange"):
        np.testing.assert_allclose(getattr(original, attribute), getattr(model, attribute))
    q = generator.uniform(-1, 1)
    one, other = (robot.angles(robot.state({"elbow": q})) for robot in (first, again))
    assert {*one} == {"elbow", "grip", "tilt", "held"}
    for name, position in one.items():
        assert float(position) == pytest.approx(float(other[name]), abs=1e-12)


def require_limit(model, name: str, limits: tuple[float, float], stiffness: float) -> None:
    joint = model.joint(name)
    assert joint.range == pytest.approx(limits, abs=1e-12)
    weight = model.dof_invweight0[joint.dofadr[0]]
    assert -model.jnt_solref[joint.id][0] == pytest.approx(stiffness * weight)


def test_stops_play_and_actuators_of_drives(read_robot, written):
    """Stops are at the limits of the file; of a stop and a play, the narrower one acts; an actuator
    acts on the rotor. The wider one is named."""
    joints = (
        'name="elbow" range="-0.4 0.9"',
        'name="grip" type="slide" range="-0.1 0.3"',
        'name="twist" range="2 6" armature="1e-6"',
    )
    bodies = "".join(f'<body><joint axis="0 1 0" {one}/>{INERTIAL}</body>' for one in joints)
    servo = '<actuator><position name="servo" joint="twist" kp="3"/></actuator>'
    file = file_of(bodies, np.random.default_rng(0), servo)
    law = cj.laws.SpringDashpot(2e6, 30.0)
    stops = {"elbow": {"torsional_stiffness": 500.0, "restitution": 0.3}, "grip": {"law": law}}
    play = {"elbow": {"backlash": 0.01, "torsional_stiffness": 900.0, "restitution": 0.3}}
    for added, limits, stiffness in (({}, (-0.4, 0.9), 500.0), (play, (-0.005, 0.005), 900.0)):
        robot = read_robot(file, play=added, stops=stops)
        robot = robot.with_drive("twist", cj.Drive(stiffness=80.0, damping=0.1))
        # Within the limits, whatever the revolution.
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", cj.NotCarriedOverWarning)
            model = written(robot, robot.state({"twist": 5.0 - 2 * math.pi}))
        messages = "".join(str(warning.message) for warning in caught)
        assert ("wider limits of elbow stop" in messages) == bool(added)
        require_limit(model, "elbow", limits, stiffness)
        require_limit(model, "grip", (-0.1, 0.3), 2e6)
        assert model.key_qpos[0][model.joint("twist").qposadr[0]] == pytest.approx(5.0)
        assert model.actuator("servo").trnid[0] == model.joint("twist motor").id
        assert model.tendon_stiffness == pytest.approx(80.0)
        # The rotor has almost no inertia beside the link's.
        assert model.opt.timestep == pytest.approx(
            2 * math.pi / 20 * math.sqrt(1e-6 / 80), rel=1e-3
        )
    # Also if the narrower one is added later.
    robot = read_robot(file, stops=stops)
    first, second, axis = robot.link_side("elbow")
    options = {"play": 0.01, "radius": 0.02, "law": cj.laws.SpringDashpot(900.0 / 0.02**2, 1.0)}
    narrow = cj.Backlash(first, second, axis_first=axis, axis_second=axis, **options)
    with pytest.warns(cj.NotCarriedOverWarning, match="wider limits of elbow stop"):
        model = written(robot.with_elements({"elbow play": narrow}))
    require_limit(model, "elbow", (-0.005, 0.005), 900.0)


@pytest.mark.parametrize("seed", FEW)
def test_loops_are_equations_of_the_file(seed, written):
    """Two bodies on balls of the ground and a third joint: its points coincide in the pose of the
    file. With a ball, they move in three ways; with a hinge or a weld, only about the line of the
    two balls on the ground."""
    generator = np.random.default_rng(seed)
    kinds = (cj.SphericalJoint, 3, 3), (cj.FixedJoint, 6, 5), (cj.RevoluteJoint, 6, 5)
    for kind, rows, rank in kinds:
        made = RandomScene(generator, 2)
        a, b = made.names
        made.joints.clear()
        places = generator.uniform(-1, 1, (3, 3))
        axis = Rotation.random(rng=generator).as_matrix()[0]
        turns = [made.poses[body][1] for body in (a, b)]
        options = {
            cj.SphericalJoint: [],
            cj.FixedJoint: [(turns[0].inv() * turns[1]).as_quat(scalar_first=True)],
            cj.RevoluteJoint: [made.local(a, axis), made.local(b, axis)],
        }
        ends = made.point(a, places[2]), made.point(b, places[2])
        joints = {
            "on a": cj.SphericalJoint("ground", a, places[0], made.point(a, places[0])),
            "on b": cj.SphericalJoint("ground", b, places[1], made.point(b, places[1])),
            "loop": kind(a, b, *ends, *options[kind]),
        }
        scene = cj.Scene(made.bodies, joints)
        state = made.moving(scene)
        model = written(scene, state)
        data = at_keyframe(model)
        assert data.ne == rows
        assert np.abs(data.efc_pos[:rows]).max() < 1e-9
        jacobian = data.efc_J.reshape(-1, model.nv)[:rows]
        assert np.linalg.matrix_rank(jacobian, tol=1e-9) == rank


def test_play_moves_as_the_closed_form_says(written):
    """Flights at constant speed and contacts of a damped oscillator, in MuJoCo."""
    scene, state = ours.shafts()
    model = written(scene, state, timestep=1e-6, integrator="RK4")
    data = at_keyframe(model)
    mujoco.mj_step(model, data, nstep=round(END / 1e-6))
    (truth,) = exact(np.array([END]))
    found = [data.joint(name).qpos[0] for name in ("motor", "link")]
    assert np.abs(found - truth.angles).max() < 3e-6
    # The shortest step of the default resolves the contact.
    period = 2 * math.pi / FREQUENCY
    assert written(scene, state).opt.timestep == pytest.approx(period / 20)


CHAIN = urdf.robot(
    urdf.link("base"),
    urdf.link("upper", 1, (0.01, 0.02, 0.02), xyz="0.15 0 0"),
    urdf.link("lower", 0.5, (0.002, 0.004, 0.004), xyz="0.1 0 0"),
    urdf.joint(
        "shoulder", "revolute", "base", "upper", "0 1 0", limit=(100, 9, -3, 3), damping=0.2
    ),
    urdf.joint("elbow", "continuous", "upper", "lower", "0 1 0", xyz="0.3 0 0"),
)


@pytest.fixture
def chain(read_robot):
    return read_robot(CHAIN)


def test_the_file_names_what_it_lacks(chain, read_robot, tmp_path):
    elbow = {"bearing_radius": 0.01, "clearance": 1e-4, "journal_length": 0.02}
    law = cj.laws.HuntCrossley(0.8, 1e9)
    scene = read_robot(CHAIN, play={"elbow": elbow | {"law": law}}).scene
    load = cj.AppliedLoad("lower", force=(1.0, 0.0, 0.0))
    floor = cj.Stop("ground", "lower", normal=(0, 0, 1), law=law)
    hinge, coulomb = ("ground", "upper"), cj.frictions.RegularisedCoulomb(1.0)
    friction = cj.JointFriction(
        *hinge, coulomb, 0.1, (0, 1, 0), 1.0, pressed_by="elbow", load_ratio=0.2
    )
    joints = scene.joints | {"floor": floor, "seal": friction}
    whole = cj.Scene(scene.bodies, joints, {"load": load})
    with pytest.warns(cj.NotCarriedOverWarning) as caught:
        cj.save_mjcf(whole, tmp_path / "lacking.xml", chain.state())
    (message,) = {str(warning.message) for warning in caught}
    assert "ideal joints, of elbow" in message
    assert "Stop of floor" in message and "AppliedLoad of load" in message
    assert "force of another element of seal" in message
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "lacking.xml"))
    assert model.nv == 2
    with pytest.warns(cj.NotCarriedOverWarning, match="limits of velocities of shoulder"):
        cj.save_mjcf(chain, tmp_path / "robot.xml")


def test_what_cannot_be_written_is_named(chain, tmp_path):
    path = tmp_path / "file.xml"
    place = (0.0, 1.0, 0.0)
    moved = cj.set_value(chain.state(), lambda state: state.bodies["lower"].position, place)
    world = cj.Scene({"world": cj.Body(1.0, (1.0, 1.0, 1.0))})
    here = cj.State({"world": cj.body_state((0, 0, 0))})
    for of, state, options, message in (
        (chain.scene, None, {}, "`state` must be given for a scene"),
        (chain, None, {"integrator": "euler"}, "`integrator` must be one of"),
        (chain, None, {"timestep": 0.0}, "timestep"),
        (chain.scene, moved, {}, r"joint of 'lower'.*assemble"),
        (world, here, {}, "MuJoCo compiles"),
    ):
        with pytest.raises(ValueError, match=message):
            cj.save_mjcf(of, path, state, **options)


@pytest.mark.slow  # compiles
def test_the_difference_falls_with_mujocos_step(chain):
    """A drive train with play, driven by a torque, with dry friction: MuJoCo's error falls to that
    of its impedance."""
    drive = cj.Drive(armature=0.02, play="0.5 deg", stiffness=800.0, damping=0.4)
    robot = chain.with_drive("elbow", drive)
    torque = cj.PiecewiseConstant([0.0, 0.02, 0.05], [2.0, -2.0, 0.5])
    robot = robot.with_elements({"torque": cj.DriveTorque(*robot.motor_side("elbow"), torque)})
    steps = 1e-4, 1e-5, 1e-6
    state = robot.state({"shoulder": 0.3, "elbow": -0.5}, {"shoulder": 1.0})
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", cj.NotCarriedOverWarning)
        found = cj.compare_with_mujoco(robot, state, 0.1, timesteps=steps, integrator="RK4")
    assert found.timesteps == pytest.approx(steps, rel=0.1)
    assert {*found.positions} == {"shoulder", "elbow", "elbow motor"}
    for name, largest in found.largest_difference.items():
        assert largest[2] < 0.3 * largest[0], name
        assert largest[2] < 1e-5, name
    head, *rows = str(found).splitlines()
    assert head.split() == ["largest", "difference", "shoulder", "elbow", "elbow", "motor"]
    assert [row.partition(" ms")[0] for row in rows] == [f"step of {x}" for x in (0.1, 0.01, 0.001)]


def test_motions_that_diverge_are_infinitely_far():
    off = {"elbow": np.array([[0.0, 1e-3, np.nan], [0.0, 1e-3, 2e-3]])}
    own = {"elbow": np.zeros(3)}
    found = cj.results.MujocoComparison((1e-2, 1e-3), np.arange(3.0), own, off)
    assert found.largest_difference["elbow"].tolist() == [math.inf, 2e-3]
    assert "diverged" in str(found)

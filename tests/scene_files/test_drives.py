"""Drive trains of robots against MuJoCo, SciPy and closed forms."""

from collections.abc import Callable
from typing import Any

import jax
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import clearjoint as cj
from clearjoint import Drive
from tests.support import urdf
from tests.support.random_mjcf import file_of, frame, model_of, random_body, random_inertial, text
from tests.support.robots import accelerations, joint_accelerations, require_close
from tests.support.slow import slow_but

FEW, MANY = range(2), range(100, 130)
SEEDS = slow_but(FEW, [*FEW, *MANY])
COORDINATES = cj.JointCoordinates(), cj.AbsoluteCoordinates()
SWING = [
    urdf.link("base"),
    urdf.link("upper", 1.5, (0.01, 0.03, 0.02), xyz="0.2 0 0"),
    urdf.joint("elbow", "revolute", "base", "upper", "0 1 0", limit=(50, 9, -1, 3)),
]
ARM = [
    *SWING,
    urdf.link("tool", 0.5, (0.001, 0.002, 0.002), xyz="0.1 0 0"),
    urdf.joint("slide", "prismatic", "upper", "tool", "1 0 0", xyz="0.4 0 0", limit=(50, 9, -1, 1)),
]
DRIVE = cj.Drive(armature="1e-5 kg m^2", ratio=100.0, play="0.5 deg", stiffness=900.0)


@pytest.fixture
def read(read_robot) -> Callable[..., cj.results.Robot]:
    return lambda parts=ARM, **options: read_robot(urdf.robot(*parts), **options)


def in_series(seed: int, names: list[str]) -> tuple[str, str, dict[str, cj.Drive]]:
    """A random tree in MJCF, once with one joint for each body, and once with two in series, of
    which the first has the armature and the second the stiffness and damping; and the drives."""
    generator = np.random.default_rng(seed)
    drives: dict[str, cj.Drive] = {}
    single, double = ([""] * len(names) for _ in range(2))
    for k in reversed(range(len(names))):
        name, (axis, point) = f"to {names[k]}", generator.uniform(-1, 1, (2, 3))
        armature, stiffness, damping, ratio = generator.uniform(0.5, 5.0, 4)
        shape = f'type="{generator.choice(["hinge", "slide"])}" axis="{text(axis)}" '
        shape += f'pos="{text(point)}"'
        rotor = f'armature="{text(armature)}"'
        joints = [f'<joint name="{name}" {shape} {rotor}/>'] * 2
        if k == 0 or generator.random() < 0.7:
            elastic = {"stiffness": stiffness, "damping": damping}
            drives[name] = cj.Drive(armature=armature / ratio**2, ratio=ratio, **elastic)
            spring = f'stiffness="{text(stiffness)}" damping="{text(damping)}"'
            joints = [
                f'<joint name="{name}" {shape}/>',
                f'<joint name="{name} motor" {shape} {rotor}/>'
                f'<joint name="{name}" {shape} {spring}/>',
            ]
        head = f'<body name="{names[k]}" {frame(generator)}>'
        inertial = random_inertial(generator)
        parent = int(generator.integers(k)) if k else 0
        for bodies, joint in zip((single, double), joints, strict=True):
            body = f"{head}{joint}{inertial}{bodies[k]}</body>"
            bodies[parent] = bodies[parent] + body if k else body
    files = [file_of(bodies[0], np.random.default_rng(seed)) for bodies in (single, double)]
    return files[0], files[1], drives


@pytest.mark.parametrize("seed", SEEDS)
def test_mujoco_accelerates_drives_in_series_alike(seed, read_robot):
    """MuJoCo has two joints in series without a body between them, of which the first has an
    armature and the second a spring: the motion of the rotor and of the link."""
    mujoco = pytest.importorskip("mujoco")
    generator = np.random.default_rng(seed)
    names = [f"body {k}" for k in generator.permutation(6)]
    single, double, drives = in_series(seed, names)
    robot = read_robot(single)
    for joint, drive in drives.items():
        robot = robot.with_drive(joint, drive)
    model, data = model_of(double)
    data.qpos[:] = generator.uniform(-1, 1, model.nq)
    data.qvel[:] = generator.uniform(-2, 2, model.nv)
    mujoco.mj_forward(model, data)
    joints = [model.joint(k).name for k in range(model.njnt)]
    found = dict(zip(joints, zip(data.qpos, data.qvel, data.qacc, strict=True), strict=True))
    numbers = {
        name: np.add(own, found.get(f"{name} motor", np.zeros(3))) if name in drives else own
        for name, own in found.items()
    }
    state = robot.state(*({n: v[k] for n, v in numbers.items()} for k in range(2)))
    for name, angle in robot.angles(state).items():
        assert angle == pytest.approx(numbers[name][0], abs=1e-12)
        assert robot.speeds(state)[name] == pytest.approx(numbers[name][1], abs=1e-12)
    expected = {name: part[2] for name, part in numbers.items()}
    require_close(joint_accelerations(robot, state), expected, 1e-9)
    # Absolute coordinates, in which `observe` computes.
    first, second = (accelerations(robot.scene, state, c) for c in COORDINATES)
    scale = max(map(abs, expected.values()))
    for name, rate in first.items():
        assert np.abs(rate - second[name]).max() < 1e-8 * max(scale, np.abs(rate).max()), name


INERTIA, WEIGHT, ARMATURE, STIFFNESS, DAMPING = 0.03 + 1.5 * 0.2**2, 1.5 * 9.81 * 0.2, 0.1, 9e2, 0.2
PLAY, TORQUE, SPEED = np.radians(0.5), 40.0, 30.0
LOSS, DRY, SMOOTH = 0.3, 0.5, 0.05


def reference(times: np.ndarray, play: float, damping: float, dry: float, loss: float):
    """Angles, rad, of rotor and link, (2, N), which start at rest at zero, by SciPy: two inertias
    with a spring and a damper that begin at the ends of the play and do not pull, and with friction
    of the rotor."""

    def rates(t, y):
        twist, rate = y[1] - y[0], y[3] - y[2]
        depth, side = abs(twist) - 0.5 * play, np.sign(twist)
        pushes = depth > 0.0
        torque = side * max(STIFFNESS * depth + damping * side * rate, 0.0) * pushes
        friction = (dry + loss * abs(torque)) * np.tanh(y[2] / SMOOTH)
        motor = TORQUE * np.sin(SPEED * t) + torque - friction
        return [y[2], y[3], motor / ARMATURE, (WEIGHT * np.cos(y[1]) - torque) / INERTIA]

    # So short that no flank passes the play within a step.
    options = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-14, "max_step": 1e-4}
    return solve_ivp(rates, (0.0, times[-1]), np.zeros(4), t_eval=times, **options).y[:2]


def swinging(read, **drive: Any) -> cj.results.Robot:
    """The arm, whose motor has a torque that oscillates."""
    drive = {"armature": ARMATURE, "stiffness": STIFFNESS, **drive}
    robot = read(SWING).with_drive("elbow", cj.Drive(**drive))
    torque = cj.DriveTorque(*robot.motor_side("elbow"), lambda t: TORQUE * jax.numpy.sin(SPEED * t))
    return robot.with_elements({"torque": torque})


def test_an_arm_with_play_and_compliance_moves_as_in_scipy(read):
    gear = {"armature": ARMATURE / 50.0**2, "ratio": 50.0}
    robot = swinging(read, **gear, play="0.5 deg", damping=DAMPING)
    times = np.linspace(0.03, 0.6, 20)
    settings = cj.Settings(rtol=1e-9, ledger=True)
    save = cj.Saving(times, impacts=True)
    solution = cj.simulate(robot.scene, robot.state(), 0.6, settings, save, progress=False)
    angles = robot.angles(solution)
    expected = reference(times, PLAY, DAMPING, 0.0, 0.0)
    assert len(solution.impacts) >= 5
    found = np.array([angles["elbow motor"], angles["elbow"]])
    assert np.abs(found - expected).max() < 1e-6
    assert np.ptp(expected[0] - expected[1]) > 1.2 * PLAY
    residual = cj.observe(robot.scene, solution).ledger_residual()
    assert np.abs(residual).max() < 1e-6


def test_a_drive_acts_where_it_says(read):
    robot = read()
    first, second, axis = robot.link_side("elbow")
    assert (first, second, axis.tolist()) == ("ground", "upper", [0.0, 1.0, 0.0])
    rigid = robot.with_drive("elbow", cj.Drive(armature=2e-5, ratio=50.0, friction=0.3))
    assert rigid.motor_side("elbow")[:2] == ("ground", "upper")
    assert [*rigid.angles(rigid.state())] == ["elbow", "slide"]
    drive = cj.Drive(1e-5, 100.0, "0.5 deg", 900.0, friction=0.3, viscosity=0.1, link_friction=0.2)
    geared = robot.with_drive("elbow", drive).with_drive(
        "slide", cj.Drive("20 g", 1.0, "0.1 mm", 1e6)
    )
    assert geared.motor_side("elbow")[:2] == ("ground", "elbow rotor")
    assert geared.link_side("elbow")[:2] == ("ground", "upper")
    joints = geared.scene.joints
    assert joints["elbow link friction"].pair() == ("ground", "upper")
    assert joints["slide backlash"].travel == pytest.approx(1e-4)
    assert geared.joints == robot.joints and {*geared.drives} == {"elbow", "slide"}
    state = geared.state([0.3, 0.1], {"elbow": 2.0})
    assert geared.angles(state) == pytest.approx(
        {"elbow": 0.3, "slide": 0.1, "elbow motor": 0.3, "slide motor": 0.1}
    )
    assert geared.speeds(state)["elbow motor"] == pytest.approx(2.0)
    state = geared.state({"elbow": 0.3, "elbow motor": 0.31})
    assert geared.angles(state)["elbow motor"] == pytest.approx(0.31)
    # Both rotors turn with the joints.
    q, qd, qdd = np.random.default_rng(0).uniform(-1, 1, (3, 2))
    plain, driven = robot.torques(q, qd, qdd), geared.torques(q, qd, qdd)
    assert [*driven] == ["elbow", "slide"]
    assert driven["elbow"] - plain["elbow"] == pytest.approx(0.1 * qdd[0], abs=1e-8)
    assert driven["slide"] - plain["slide"] == pytest.approx(0.02 * qdd[1], abs=1e-8)


@pytest.mark.parametrize(
    ("joint", "drive", "message"),
    [
        ("elbw", DRIVE, "`joint` must be one of the ideal hinges.*'elbw'.*did you mean 'elbow'"),
        ("elbow", Drive(1e-5, play="1 mm", stiffness=1.0), "drive, `play`: found '1 mm', .*rad"),
        ("slide", Drive(1e-5, play="1 deg", stiffness=1.0), "drive, `play`: found '1 deg', .*in m"),
        ("elbow", Drive(1e-5, play=-1.0), "`drive.play` must be positive, but is -1.0"),
        ("elbow", Drive(1e-5, play=0.01), "`drive.stiffness` must be given with a play"),
        ("elbow", Drive(stiffness=5.0), "`drive.armature` must be given, since joint 'elbow' has"),
        ("elbow", Drive(1e-5, damping=5.0), "`drive.damping` must be omitted without a stiffness"),
        (
            "elbow",
            Drive(1e-5, stiffness=5.0, restitution=0.5),
            "`drive.restitution` must be omitted",
        ),
        ("slide", Drive(1.0, stiffness=5.0, loss=0.1), "`drive.loss` must be omitted without a pl"),
        ("elbow", Drive(True), "`drive.armature` must be a number"),
        ("elbow", None, "`drive` must be a Drive"),
    ],
)
def test_errors_name_argument_and_remedy(read, joint, drive, message):
    with pytest.raises(ValueError, match=message):
        read().with_drive(joint, drive)


def test_a_rotor_needs_an_armature_and_has_no_size(read):
    pytest.importorskip("trimesh")
    robot = read().with_drive("elbow", DRIVE)
    joints = {**robot.scene.joints, "elbow motor": robot.scene.joints["elbow"]}
    with pytest.raises(ValueError, match=r"`bodies\['elbow rotor'\].is_massless` must be False"):
        cj.Scene(robot.scene.bodies, joints)
    views = [cj.view(each.scene, each.state(), inertias=True) for each in (read(), robot)]
    sizes = [max(np.abs(part.mesh.vertices).max() for part in view.parts) for view in views]
    assert sizes[0] == pytest.approx(sizes[1])


def test_a_second_drive_and_a_taken_name_are_refused(read):
    robot = read().with_drive("elbow", DRIVE)
    with pytest.raises(ValueError, match="`joint` must be without a drive, but is 'elbow'"):
        robot.with_drive("elbow", DRIVE)
    with pytest.raises(ValueError, match="`elements` must be a name that no joint"):
        robot.with_elements({"elbow": robot.scene.joints["slide"]})
    played = {"elbow": {"backlash": 0.01}}
    with pytest.raises(ValueError, match="`elements` must be a name .*'elbow backlash'"):
        read(play=played).with_drive("elbow", DRIVE)


@pytest.mark.parametrize("play", [None, "0.5 deg"])
def test_the_loss_of_a_gear_is_friction_over_the_transmitted_torque(read, play):
    law = cj.frictions.RegularisedCoulomb(1.0, regularisation_speed=SMOOTH)
    robot = swinging(read, damping=1e-6, play=play, friction=DRY, loss=LOSS, law=law)
    settings = cj.Settings(rtol=1e-9, ledger=True)
    solution = cj.simulate(robot.scene, robot.state(), 0.5, settings, progress=False)
    angles = robot.angles(solution.final)
    expected = reference(np.array([0.5]), 0.0 if play is None else PLAY, 1e-6, DRY, LOSS)[:, 0]
    assert [angles["elbow motor"], angles["elbow"]] == pytest.approx(expected, abs=1e-6)
    assert solution.final.work["friction"] > 1.0


def test_the_element_that_presses_is_checked(read):
    robot = read().with_drive("elbow", cj.Drive(1e-2, stiffness=9.0, loss=0.1))
    pressed = robot.scene.joints["elbow motor friction"]
    assert pressed.pressed_by == "elbow compliance"
    with pytest.raises(
        ValueError, match=r"`joints\['rub'\].pressed_by` must be .*'elbow comp.*'elbw'"
    ):
        robot.with_elements({"rub": cj.JointFriction(*FRICTION, pressed_by="elbw", load_ratio=0.1)})
    with pytest.raises(ValueError, match="`pressed_by` must be given if and only if `load_ratio`"):
        cj.JointFriction(*FRICTION, load_ratio=0.1)


FRICTION = "ground", "upper", cj.frictions.Dahl(0.1), 1.0, (0, 1, 0), 1.0


def test_armatures_of_joints_with_clearance_are_named(tmp_path):
    pytest.importorskip("mujoco")
    body = random_body(np.random.default_rng(0), "a", '<joint name="hinge" armature="0.1"/>', "")
    (tmp_path / "robot.xml").write_text(f"<mujoco><worldbody>{body}</worldbody></mujoco>")
    law = cj.laws.HuntCrossley(0.5, 1e9)
    play = {"bearing_radius": 0.01, "clearance": 1e-4, "journal_length": 0.02, "law": law}
    with pytest.warns(cj.NotCarriedOverWarning, match="armatures of hinge"):
        robot = cj.load_robot(tmp_path / "robot.xml", play={"hinge": play})
    with pytest.raises(ValueError, match="a joint with clearance has no drive"):
        robot.with_drive("hinge", DRIVE)

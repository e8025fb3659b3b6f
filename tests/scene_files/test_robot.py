"""Robots from files: states and angles, stops, friction, and messages."""

import jax
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import clearjoint as cj
from tests.support import urdf
from tests.support.many_states import system_of

FINGER = (0.01, 0.02, 0.02)
FOLLOWS = '<mimic joint="left finger" multiplier="-1" offset="0.01"/>'
WRIST = {"limit": (5, 1, -0.4, 0.9), "friction": 0.5, "damping": 0.1}
SLIDE = {"limit": (5, 1, -0.1, 0.2), "friction": 0.7, "damping": 3}
HAND = urdf.robot(
    urdf.link("base"),
    urdf.link("palm", 1, FINGER, xyz="0.3 0 0"),
    urdf.link("left", 0.5, FINGER),
    urdf.link("right", 0.5, FINGER),
    urdf.joint("wrist", "revolute", "base", "palm", "0 1 0", **WRIST),
    urdf.joint("left finger", "prismatic", "palm", "left", "0 2 0", **SLIDE),
    urdf.joint("right finger", "prismatic", "palm", "right", "0 1 0", FOLLOWS),
)
STOPS = {
    "wrist": {"torsional_stiffness": "10 kN m/rad", "restitution": 0.3},
    "left finger": {"law": cj.laws.ExactRestitution(0.3, 1e6, exponent=1.0)},
}


@pytest.fixture
def read(read_robot):
    """Read the hand, with a change to its text."""

    def read(old="", new="", **options):
        assert old in HAND
        return read_robot(HAND.replace(old, new), **options)

    return read


@pytest.mark.parametrize("seed", range(20))
def test_stops_are_at_the_limits_of_the_file(seed, read):
    loaded, generator = read(stops=STOPS), np.random.default_rng(seed)
    system = system_of(loaded.scene, cj.JointCoordinates())
    q = {name: generator.uniform(-1.2, 1.2) for name in STOPS}
    gaps = system.contact_gaps(system.encode(cj.extend.unpack(loaded.state(q)).bodies))
    radius = loaded.scene.joints["wrist stop"].radius
    for name, scale in (("wrist", radius), ("left finger", 1.0)):
        limits, found = loaded.limits[name], gaps[f"{name} stop"]
        depths = {label: float(gap.depth) / scale for label, gap in found.items()}
        lower, upper = ("flank", "flank") if name == "wrist" else ("end", "end")
        assert depths[f"upper {upper}"] == pytest.approx(q[name] - limits.upper, abs=1e-12)
        assert depths[f"lower {lower}"] == pytest.approx(limits.lower - q[name], abs=1e-12)
        walls = [depth for label, depth in depths.items() if "wall" in label]
        assert all(depth < -10.0 for depth in walls)


def test_resistances_are_those_of_the_file(read):
    scene = read().scene
    assert scene.forces["wrist damping"].damping == 0.1
    assert list(scene.forces["left finger damping"].damping) == [3.0, 0.0, 0.0]
    assert scene.joints["wrist friction"].load == 0.5
    assert scene.joints["left finger friction"].load == 0.7
    assert "wrist friction" not in read(friction=None).scene.joints
    law = cj.frictions.RegularisedCoulomb(1.0)
    assert read(friction=law).scene.joints["wrist friction"].friction is law
    assert not any("stop" in name for name in scene.joints)


@pytest.mark.parametrize("seed", range(5))
def test_angles_of_a_motion_continue_over_revolutions(seed, read):
    loaded = read('type="revolute"', 'type="continuous"')
    times = np.linspace(0.0, 1.0, 50)
    speed = np.random.default_rng(seed).uniform(-60, 60)
    states = loaded.state({"wrist": 0.25 + speed * times})
    found = loaded.angles(cj.results.Trajectory(times, states))["wrist"]
    assert found == pytest.approx(0.25 + speed * times, abs=1e-11)
    single = loaded.angles(states)["wrist"]  # within half a revolution of the limits' middle
    assert np.abs(single - 0.25).max() <= np.pi + 1e-12


def test_a_joint_that_follows_may_be_given_too(read):
    loaded = read()
    assert loaded.joints == ("wrist", "left finger", "right finger")
    state = loaded.state([0.1, 0.05, -0.04])
    assert loaded.angles(state)["right finger"] == pytest.approx(-0.04)


def test_torques_of_many_states_are_those_of_each_and_states_have_derivatives(read):
    loaded, generator = read(), np.random.default_rng(0)
    q, qd, qdd = (
        dict(zip(("wrist", "left finger"), generator.uniform(-0.1, 0.1, (2, 5)), strict=True))
        for _ in range(3)
    )
    found = loaded.torques(q, qd, qdd)
    for k in range(5):
        single = loaded.torques(*({n: v[k] for n, v in part.items()} for part in (q, qd, qdd)))
        for name, torque in single.items():
            assert found[name][k] == pytest.approx(float(torque), abs=1e-13)

    def palm(angle):
        return loaded.state({"wrist": angle}).bodies["palm"].position

    expected = -0.3 * np.array([np.sin(0.4), 0.0, np.cos(0.4)])
    assert jax.jacfwd(palm)(0.4) == pytest.approx(expected, abs=1e-14)


BALLS = """<mujoco><worldbody><body name="a" pos="0 0 1"><joint name="ball" type="ball"/>
<inertial mass="1" pos="0.1 0.2 0.3" diaginertia="1 1 1"/>
<body name="b"><joint name="hinge" pos="1 0 0"/>
<inertial mass="1" pos="0.1 0.2 0.3" diaginertia="1 1 1"/></body></body></worldbody></mujoco>"""


def test_ball_joints_have_euler_parameters(read_robot):
    pytest.importorskip("mujoco")
    loaded = read_robot(BALLS)
    assert loaded.joints == ("hinge",)
    turn = Rotation.from_rotvec([0.2, -0.4, 0.3]).as_quat(scalar_first=True)
    state = loaded.state({"ball": turn, "hinge": 0.3}, {"ball": (1.0, 2.0, 3.0)})
    assert loaded.angles(state)["ball"] == pytest.approx(turn)
    assert loaded.speeds(state)["ball"] == pytest.approx([1.0, 2.0, 3.0])
    assert loaded.torques({"ball": turn})["ball"].shape == (3,)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda r: r.state({"wrst": 1.0}), r"`q`.*'wrst'.*did you mean 'wrist'"),
        (lambda r: r.state([1.0, 2.0]), r"`q`.*\(\.\.\., 3\).*\(2,\): .*wrist, left finger"),
        (lambda r: r.state({"wrist": "30 deg"}), r"`q\['wrist'\]` must be a number or .*'30 deg'"),
        (lambda r: r.state(qd={"wrist": np.nan}), "`qd`.*finite numbers of joint 'wrist'"),
        (lambda r: r.state({"wrist": "up"}), r"`q\['wrist'\]` must be a number.*'up'"),
        (
            lambda r: r.state({"wrist": [0.0, 0.1, 0.2]}, {"wrist": [1.0, 2.0]}),
            r"`q and qd` must be arrays of equal lengths, but is .*\(2,\), \(3,\)",
        ),
        (lambda r: r.state({"right finger": 0.3}), r"`q\['right finger'\]`.*from joint 'left fing"),
        (lambda r: r.torques(qdd={"right finger": 3.0}), r"`qdd\['right finger'\]`"),
        (lambda r: r.state(free={"palm": cj.body_state((0, 0, 0))}), "`free`.*none, but is 'palm'"),
    ],
)
def test_wrong_positions_are_refused(read, call, message):
    with pytest.raises(ValueError, match=message):
        call(read())


@pytest.mark.parametrize(
    ("old", "new", "stops", "message"),
    [
        ("", "", {"right finger": {}}, r"'right finger', expected stops in one of the j"),
        ("", "", {"wrist": {"play": 1}}, r"`wrist`: found 'play', .*torsional_stiffness"),
        ("", "", {"wrist": {}}, r"`wrist`: .*`law`.*`torsional_stiffness`"),
        ("", "", {"left finger": {}}, r"`left finger`: .*a `law` of the ends"),
        ("", "", {"wrist": 1.0}, r"`wrist`: found 1.0, expected arguments by name"),
        ('friction="0.7" damping="3"/>', '/><mimic joint="right finger"/>', {}, "cycle"),
        ('offset="0.01"', 'offset="one"', {}, r"`right finger.mimic.offset`: found 'one'"),
        ('damping="0.1"', 'damping="-1"', {}, r"`wrist`: Argument `damping` must"),
        ('friction="0.5"', 'friction="-1"', {}, r"`wrist`: Argument `load` must"),
        ('"right finger"', '"wrist damping"', {}, r"`wrist`: .* no joint 'wrist damping'"),
    ],
)
def test_errors_name_file_and_joint(read, old, new, stops, message):
    with pytest.raises(ValueError, match=f"robot.urdf.*{message}"):
        read(old, new, stops=stops)


def test_wrong_options_are_refused(read):
    with pytest.raises(ValueError, match="`gravity` must be numbers, None or .*is 'earth': pass"):
        read(gravity="earth")
    with pytest.raises(ValueError, match=r"`wrist`: found \[\], expected also bearing_radius, jou"):
        read(play={"wrist": {}})


def test_mimics_of_other_joints_are_left_out_with_a_warning(tmp_path):
    text = HAND.replace('mimic joint="left finger"', 'mimic joint="x"')
    (tmp_path / "hand.urdf").write_text(text)
    with pytest.warns(cj.NotCarriedOverWarning, match="mimics, between .* of right finger"):
        loaded = cj.load_robot(tmp_path / "hand.urdf")
    assert loaded.leaders == {}


MANY = """<mujoco><asset><mesh name="m" file="absent.stl"/></asset><worldbody>
<body name="a" gravcomp="1"><joint name="j" armature="0.1"/>
<inertial mass="1" pos="0 0 0" diaginertia="1 1 1"/><geom type="mesh" mesh="m"/>
<site name="s"/><site name="u" pos="1 0 0"/></body></worldbody>
<tendon><spatial name="t"><site site="s"/><site site="u"/></spatial></tendon>
<actuator><general name="soft" joint="j" dyntype="filter" dynprm="0.1"/>
<position name="servo" joint="j" kp="5" kv="1" gear="2" ctrlrange="-1 1"/></actuator>
<sensor><jointpos joint="j"/></sensor></mujoco>"""


def test_one_warning_lists_what_mjcf_has_and_a_robot_lacks(tmp_path):
    pytest.importorskip("mujoco")
    (tmp_path / "many.xml").write_text(MANY)
    with pytest.warns(cj.NotCarriedOverWarning) as messages:
        loaded = cj.load_robot(tmp_path / "many.xml")
    (message,) = messages
    assert loaded.scene.joints["j"].armature == 0.1
    # The body's own moment of inertia about the joint is 1 kg m^2.
    assert float(loaded.torques(qdd={"j": 2.0})["j"]) == pytest.approx(2.0 + 0.2)
    for part in ("actuators of other kinds of soft", "tendons", "sensors"):
        assert part in str(message.message)
    assert "gravity compensation of a" in str(message.message)
    servo = cj.results.Actuator("j", 2.0, 5.0, (0.0, -5.0, -1.0), (-1.0, 1.0))
    assert loaded.actuators == {"servo": servo}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<mujoco><worldbody/></mujoco>", "robot.xml: .*no link that moves.*add a joint"),
        ("<mujoco><bodie/></mujoco>", "robot.xml: .*MuJoCo reads: correct the file"),
    ],
)
def test_wrong_mjcf_is_refused(read_robot, text, message):
    pytest.importorskip("mujoco")
    with pytest.raises(ValueError, match=message):
        read_robot(text)

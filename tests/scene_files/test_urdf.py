"""Robots from URDF files: bodies, joints, play in given joints, warnings of omitted contents."""

import math
import warnings

import numpy as np
import pytest

import clearjoint as cj
from clearjoint import constraint_report
from clearjoint.extend import Gap
from tests.support import urdf

VISUAL = '<visual><geometry><box size="1 0.1 0.1"/></geometry></visual>'
ELBOW = {"xyz": "1 0 0", "rpy": f"{0.5 * math.pi} 0 0", "damping": 0.1}
SLIDE = {"xyz": "0 0.5 0", "rpy": "0 0.3 0.2"}
ARM = '<?xml version="1.0"?>' + urdf.robot(
    urdf.link("base", 9),
    urdf.link("stand"),
    urdf.link("upper", 2, (0.001, 0.17, 0.17), VISUAL, xyz="0.5 0 0"),
    urdf.link("lower", 1, (0.001, 0.02, 0.021), xyz="0 0.25 0", rpy=f"0 0 {0.5 * math.pi}"),
    urdf.link("rail", 1, (0.01, 0.01, 0.01)),
    urdf.link("tool", 0.1, (1e-4, 1e-4, 1e-4)),
    urdf.joint("foot", "fixed", "base", "stand", xyz="0 0 1"),
    urdf.joint("shoulder", "continuous", "stand", "upper", "0 1 0"),
    urdf.joint("elbow", "revolute", "upper", "lower", "0 0 1", **ELBOW, limit=(10, 2, -1, 1)),
    urdf.joint("slide", "prismatic", "lower", "rail", "0 1 0", '<mimic joint="elbow"/>', **SLIDE),
    urdf.joint("flange", "fixed", "rail", "tool", rpy="0.1 0.2 0.3"),
    '<gazebo/><material name="red"/>',
    name="arm",
)
PLAY = {"bearing_radius": 0.01, "clearance": 1e-4, "journal_length": 0.02}
PLAY |= {"law": cj.laws.Hertz(1e9)}


@pytest.fixture
def robot(tmp_path):
    """Read a robot, with a change to its text; also returns the texts of the warnings."""

    def robot(old="", new="", **options):
        assert old in ARM
        (tmp_path / "arm.urdf").write_text(ARM.replace(old, new))
        with warnings.catch_warnings(record=True) as messages:
            warnings.simplefilter("always")
            read = cj.load_robot(tmp_path / "arm.urdf", **options)
        return read.scene, read.state(), [str(entry.message) for entry in messages]

    return robot


MERGED = ["upper", "lower", "rail"]


def test_moving_links_are_bodies_parallel_to_the_root_at_zero(robot):
    scene, state, _ = robot()
    assert list(scene.bodies) == MERGED
    assert scene.bodies["upper"].inertia.tolist() == [0.001, 0.17, 0.17]
    # (0.02, 0.001, 0.021) in the link's axes, which the elbow's <origin> turns by 90 deg about x.
    assert scene.bodies["lower"].inertia.tolist() == [0.02, 0.021, 0.001]
    assert np.allclose(state.bodies["upper"].position, (0.5, 0.0, 1.0))
    assert np.allclose(state.bodies["lower"].position, (1.0, 0.0, 1.25))
    for body in state.bodies.values():
        assert body.orientation.tolist() == [1.0, 0.0, 0.0, 0.0]
    assert scene.gravity is not None and scene.gravity.tolist() == [0.0, 0.0, -9.81]


def test_fixed_links_can_be_bodies(robot):
    scene, state, _ = robot(merge_fixed=False)
    assert list(scene.bodies) == [*MERGED, "tool"]
    assert isinstance(scene.joints["flange"], cj.FixedJoint)
    assert np.abs(constraint_report(scene, state, 0.0).values).max() < 1e-14


def test_the_root_may_be_named_ground(robot):
    scene, _, _ = robot('"base"', '"ground"')
    assert list(scene.bodies) == MERGED


def test_a_moving_link_named_ground_is_renamed(robot, tmp_path):
    scene, _, _ = robot('"upper"', '"ground"')
    assert list(scene.bodies) == ["ground link", "lower", "rail"]
    assert scene.joints["elbow"].first == "ground link"
    assert cj.load_robot(tmp_path / "arm.urdf").links["ground"].body == "ground link"


def test_the_root_can_be_free(robot, tmp_path):
    inertia = '<mass value="9"/><inertia ixx="1" iyy="1" izz="1"/>'
    scene, state, messages = robot('<mass value="9"/>', inertia, free_root=True)
    assert list(scene.bodies) == ["base", *MERGED]
    assert scene.joints["shoulder"].first == "base"
    assert not any("inertia of" in text for text in messages)
    links = cj.load_robot(tmp_path / "arm.urdf", free_root=True).links
    assert links["stand"].point == (0.0, 0.0, 1.0)
    (tmp_path / "ball.urdf").write_text(urdf.robot(urdf.link("ball", 9, (1, 1, 1))))
    with pytest.raises(ValueError, match=r"ball.urdf: .*'ball'.*free_root=True"):
        cj.load_robot(tmp_path / "ball.urdf")
    ball = cj.load_robot(tmp_path / "ball.urdf", free_root=True).scene
    assert float(ball.bodies["ball"].mass) == 9.0


def test_joints_fit_the_state(robot):
    scene, state, _ = robot()
    kinds = {name: type(joint).__name__ for name, joint in scene.joints.items()}
    hinge = "RevoluteJoint"
    assert kinds == {
        "shoulder": hinge,
        "elbow": hinge,
        "slide": "PrismaticJoint",
        "slide coupling": "JointCoupling",
    }
    assert np.allclose(scene.joints["shoulder"].point_first, (0.0, 0.0, 1.0))
    assert scene.joints["elbow"].axis_first.tolist() == [0.0, -1.0, 0.0]
    assert scene.joints["elbow"].axis_second.tolist() == [0.0, -1.0, 0.0]
    report = constraint_report(scene, state, 0.0)
    assert np.abs(report.values).max() < 1e-14


@pytest.mark.parametrize(
    ("kind", "joint", "freedoms"),
    [("planar", cj.PlanarJoint, 5), ("spherical", cj.SphericalJoint, 5), ("floating", None, 8)],
)
def test_other_types_of_joints(robot, kind, joint, freedoms):
    scene, state, messages = robot('type="prismatic"', f'type="{kind}"')
    assert "mimics, between other joints than hinges and sliders, of slide;" in messages[-1]
    assert joint is None or isinstance(scene.joints["slide"], joint)
    assert constraint_report(scene, state).degrees_of_freedom() == freedoms


def test_namespaces_prefixes_and_unknown_shapes_do_not_matter(robot):
    scene, _, messages = robot('<robot name="arm">', '<robot name="arm" xmlns="http://a.b">')
    assert list(scene.bodies) == MERGED
    _, _, messages = robot("<gazebo/>", '<sensor:camera name="c"/>')
    assert "<sensor:camera>" in messages[-1]
    robot('<box size="1 0.1 0.1"/>', '<capsule radius="1" length="1"/>')
    robot('<?xml version="1.0"?>', "\n")


IMPOSSIBLE = '<inertia ixx="0.001" iyy="0.02" izz="0.9"/>'


def test_impossible_inertias_are_balanced(robot):
    """As by MuJoCo's `balanceinertia`."""
    old = '<inertia ixx="0.001" iyy="0.02" izz="0.021"/>'
    scene, _, messages = robot(old, IMPOSSIBLE, balance_inertia=True)
    assert scene.bodies["lower"].inertia == pytest.approx(np.full(3, 0.921 / 3), rel=1e-15)
    assert "impossible inertias, replaced by their mean moment, of links lower." in messages[0]
    _, _, messages = robot(balance_inertia=True)
    assert len(messages) == 1


def test_masses_and_inertias_are_bounded(robot):
    """As by MuJoCo's `boundmass` and `boundinertia`."""
    light = urdf.link("tip") + urdf.joint("spin", "continuous", "rail", "tip") + "</robot>"
    with pytest.raises(ValueError, match=r"`tip`: found 'no mass', .*bound_mass=1e-3"):
        robot("</robot>", light)
    scene, _, messages = robot("</robot>", light, bound_mass=1e-3, bound_inertia=1e-6)
    assert float(scene.bodies["tip"].mass) == 1e-3
    assert scene.bodies["tip"].inertia == pytest.approx(np.full(3, 1e-6), rel=1e-14)
    assert "increased, of bodies tip." in messages[0]
    with pytest.raises(ValueError, match="Argument `bound_mass` must be"):
        robot(bound_mass=-1.0)


def test_frames_of_links_are_returned(robot, tmp_path):
    robot()
    frames = cj.load_robot(tmp_path / "arm.urdf").links
    assert list(frames) == ["base", "stand", "upper", "lower", "rail", "tool"]
    assert frames["stand"] == cj.results.LinkPose("ground", (0.0, 0.0, 1.0))
    assert frames["upper"].point == (-0.5, 0.0, 0.0)
    assert frames["tool"].body == "rail"
    assert np.linalg.norm(frames["tool"].orientation) == pytest.approx(1.0)


def test_one_warning_lists_omitted_contents(robot):
    _, _, messages = robot()
    (text,) = messages
    for left in (
        "not carried over: visual shapes of upper;",
        "inertia of the fixed links of base; <gazebo>.",
    ):
        assert left in text


@pytest.mark.parametrize(
    ("old", "new", "play", "message"),
    [
        ("", "", {"elbo": PLAY}, r"found 'elbo', .* did you mean 'elbow'\?"),
        ("", "", {"slide": PLAY}, r"found 'slide', expected play in one of the hinges elbow, sh"),
        ("", "", {"elbow": PLAY | {"clearence": 1}}, r"`elbow`: .* did you mean 'clearance'\?"),
        ("", "", {"elbow": PLAY | {"clearance": -1}}, r"`elbow`: Argument `clearance` must be pos"),
        ('type="prismatic"', 'type="helical"', {}, r"`slide`: found 'helical', expected one of"),
        ('<link name="stand"/>', "", {}, r"`foot.child`: found 'stand', expected the name of a l"),
        ('<joint name="foot" type="fixed"', '<joint name="foot" type="floating"', {}, "no mass"),
        ('<child link="tool"/>', '<child link="rail"/>', {}, r"`flange.child`: .*joint 'slide'"),
        ('<child link="rail"/>', '<child link="upper"/>', {}, "`slide.child`: .*joint 'shoulder'"),
        ('<joint name="foot" type="fixed">', "<joint>", {}, r"`joint\[0\]`: .*an attribute `name`"),
        ("</robot>", '<link name="x"/></robot>', {}, r"found \['base', 'x'\], expected one root"),
        ('izz="0.021"', 'izz="0.9"', {}, r"`lower`: .*principal moment .*balance_inertia=True"),
        ('izz="0.021"', "", {}, r"`lower.inertial.inertia.izz`: .*an attribute `izz` of <inertia>"),
        ('iyy="0.02" izz="0.021"', 'iyy="0" izz="0"', {}, r"`lower`: .*balance_inertia=True"),
        ('"0.001" iyy="0.02" izz="0.021"', '"0" iyy="1" izz="1"', {}, "lower`: .*bound_inertia=1e"),
        ('<mass value="2"/>', '<mass value="-2"/>', {}, r"`upper.inertial.mass`: found -2.0"),
        ('<mass value="2"/>', '<mass value="${m}"/>', {}, r"`upper.inertial.mass.value`: .*xacro"),
        ('"0.5 0 0"', '"${length} 0 0"', {}, r"`upper.inertial.origin.xyz`: found '\${len.*xacro"),
        ("</robot>", "", {}, r"arm.urdf: found 'no XML', .*\(no element found: line"),
        ('<parent link="upper"/>', "", {}, r"`elbow`: found None, expected an element <parent"),
        ("", "", {"elbow": {"backlash": "0.1 mm"}}, r"`elbow.backlash`: found '0.1 mm', .* in rad"),
        ("", "", {"elbow": {"backlash": -1.0}}, r"`elbow`: Argument `.*` must be positive"),
        ("", "", {"elbow": {"backlash": "0 deg"}}, r"`elbow`: Argument `backlash` must be positiv"),
        ("", "", {"elbow": {"backlash": None}}, r"`elbow`: Argument `backlash` must be a number"),
        ("", "", {"shoulder": {"backlash": 1e-3}}, r"`shoulder`: .*no effort limit: give it in N"),
        ("", "", {"elbow": {"backlash": 1e-3, "play": 1}}, r"`elbow`: found 'play', expected one"),
        ('"slide"', '"elbow backlash"', {"elbow": {"backlash": 1e-3}}, "`elbow`: .* no joint 'elb"),
        ('"foot"', '"elbow backlash"', {"elbow": {"backlash": 1e-3}}, "`elbow`: .* no joint 'elb"),
        ("", "", {"elbow": 1e-3}, r"`elbow`: found 0.001, expected arguments by name"),
        ('joint name="slide"', 'joint name="elbow"', {}, r"found 'elbow', expected the name of"),
        ('<link name="tool">', '<link name="rail">', {}, r"found 'rail', expected the name of"),
        ('<link name="tool">', '<link name="">', {}, r"`link\[5\]`: .*an attribute `name`"),
        ('<axis xyz="0 1 0"/>', '<axis xyz="0 1"/>', {}, r"`shoulder.axis.xyz`: .*3 finite number"),
        ('<axis xyz="0 1 0"/>', '<axis xyz="0 0 0"/>', {}, r"`shoulder`: Argument `axis_first` "),
        ('rpy="0.1 0.2 0.3"', 'rpy="nan 0.2 0.3"', {}, r"`flange.origin.rpy`: found 'nan 0.2 0.3'"),
        ('effort="10"', 'effort="ten"', {}, r"`elbow.limit.effort`: found 'ten', expected a fin"),
    ],
)
def test_errors_have_locations(robot, old, new, play, message):
    with pytest.raises(ValueError, match=message):
        robot(old, new, play=play)


def test_backlash_is_added_to_a_hinge(robot):
    given = {"backlash": "0.1 deg", "torsional_stiffness": "20 N m/mrad", "restitution": 0.3}
    scene, _, _ = robot(play={"elbow": {"backlash": "0.1 deg"}, "shoulder": given})
    hinge, elbow = scene.joints["elbow"], scene.joints["elbow backlash"]
    assert isinstance(hinge, cj.RevoluteJoint) and isinstance(elbow, cj.Backlash)
    assert elbow.play == pytest.approx(math.radians(0.1), rel=1e-15)
    assert (elbow.first, elbow.second) == (hinge.first, hinge.second)
    assert np.array_equal(elbow.axis_second, hinge.axis_second)

    def torque(backlash: cj.Backlash, angle: float) -> float:
        gap = Gap(backlash.radius * angle, 0.0)
        return float(backlash.radius * backlash.law.force(gap, 0.0))

    assert torque(scene.joints["shoulder backlash"], 1e-3) == pytest.approx(20.0, rel=1e-12)
    assert scene.joints["shoulder backlash"].law.restitution == 0.3
    assert torque(elbow, 0.1 * float(elbow.play)) == pytest.approx(10.0, rel=1e-12)  # the limit


def test_clearances_are_read_with_units(robot):
    scene, _, _ = robot(play={"elbow": PLAY | {"clearance": "0.05 mm"}})
    assert scene.joints["elbow"].clearance == 0.05e-3


def test_limits_are_returned(robot, tmp_path):
    robot()
    limits = cj.load_robot(tmp_path / "arm.urdf").limits
    assert limits == {"elbow": cj.results.JointLimits(-1.0, 1.0, 10.0, 2.0)}


def test_long_chains_and_hostile_files_end_soon(robot, tmp_path):
    links = [urdf.link(f"l{k}", 1, (1, 1, 1)) for k in range(1, 300)]
    joints = [urdf.joint(f"j{k}", "fixed", f"l{k - 1}", f"l{k}") for k in reversed(range(1, 300))]
    (tmp_path / "chain.urdf").write_text(urdf.robot(urdf.link("l0"), *links, *joints))
    assert len(cj.load_robot(tmp_path / "chain.urdf", merge_fixed=False).scene.bodies) == 299
    with pytest.raises(ValueError, match=r"chain.urdf: .*no link that moves"):
        cj.load_robot(tmp_path / "chain.urdf")
    entities = '<!ENTITY a "aaaaaaaaaa">' + "".join(
        f'<!ENTITY {chr(98 + k)} "{f"&{chr(97 + k)};" * 10}">' for k in range(9)
    )
    (tmp_path / "bomb.urdf").write_text(f'<!DOCTYPE r [{entities}]><robot name="&j;"/>')
    with pytest.raises(ValueError, match="bomb.urdf: found 'no XML'"):
        cj.load_robot(tmp_path / "bomb.urdf")


def test_a_robot_becomes_a_scene_file(robot, tmp_path):
    scene, state, _ = robot(play={"elbow": PLAY})
    cj.save(scene, state, tmp_path / "arm.toml")
    read, _ = cj.load(tmp_path / "arm.toml")
    assert read.joints["elbow"].clearance == 1e-4
    assert read.joints["slide coupling"].function.coefficients.tolist() == [0.0, 1.0]

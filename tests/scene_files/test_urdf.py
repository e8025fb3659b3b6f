"""Robots from URDF files: bodies, joints, play in given joints, warnings of omitted contents."""

import math
import warnings

import numpy as np
import pytest

import clearjoint as cj
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
def read(tmp_path):
    """Read a robot, with a change to its text; also returns the texts of the warnings."""

    def read(old="", new="", **options):
        assert old in ARM
        (tmp_path / "arm.urdf").write_text(ARM.replace(old, new))
        with warnings.catch_warnings(record=True) as messages:
            warnings.simplefilter("always")
            loaded = cj.load_robot(tmp_path / "arm.urdf", **options)
        return loaded, [str(entry.message) for entry in messages]

    return read


MERGED = ["upper", "lower", "rail"]


def drift(loaded: cj.results.Robot) -> float:
    return np.abs(cj.constraint_report(loaded.scene, loaded.state(), 0.0).values).max()


def test_moving_links_are_bodies_parallel_to_the_root_at_zero(read):
    loaded, _ = read()
    bodies = loaded.scene.bodies
    assert list(bodies) == MERGED
    # (0.02, 0.001, 0.021) in the link's axes, which the elbow's <origin> turns by 90 deg about x.
    assert bodies["lower"].inertia.tolist() == [0.02, 0.021, 0.001]
    for body in loaded.state().bodies.values():
        assert body.orientation.tolist() == [1.0, 0.0, 0.0, 0.0]
    assert loaded.scene.gravity.tolist() == [0.0, 0.0, -9.81]


def test_joints_frames_and_limits_are_those_of_the_file(read):
    loaded, _ = read()
    joints = loaded.scene.joints
    assert {name: type(joint) for name, joint in joints.items()} == {
        "shoulder": cj.RevoluteJoint,
        "elbow": cj.RevoluteJoint,
        "slide": cj.PrismaticJoint,
        "slide coupling": cj.JointCoupling,
    }
    assert joints["elbow"].axis_first.tolist() == [0.0, -1.0, 0.0]
    assert joints["elbow"].axis_second.tolist() == [0.0, -1.0, 0.0]
    assert drift(loaded) < 1e-14
    assert list(loaded.links) == ["base", "stand", "upper", "lower", "rail", "tool"]
    assert loaded.links["stand"] == cj.results.LinkPose("ground", (0.0, 0.0, 1.0))
    assert loaded.links["tool"].body == "rail"
    assert loaded.limits == {"elbow": cj.results.JointLimits(-1.0, 1.0, 10.0, 2.0)}


def test_a_link_may_be_named_ground(read):
    loaded, _ = read('"base"', '"ground"')
    assert list(loaded.scene.bodies) == MERGED
    loaded, _ = read('"upper"', '"ground"')  # moves
    assert list(loaded.scene.bodies) == ["ground link", "lower", "rail"]
    assert loaded.scene.joints["elbow"].first == loaded.links["ground"].body == "ground link"


def test_the_root_can_be_free(read, tmp_path):
    inertia = '<mass value="9"/><inertia ixx="1" iyy="1" izz="1"/>'
    loaded, messages = read('<mass value="9"/>', inertia, free_root=True)
    assert list(loaded.scene.bodies) == ["base", *MERGED]
    assert loaded.scene.joints["shoulder"].first == "base"
    assert not any("inertia of" in text for text in messages)
    assert loaded.links["stand"].point == (0.0, 0.0, 1.0)
    (tmp_path / "ball.urdf").write_text(urdf.robot(urdf.link("ball", 9, (1, 1, 1))))
    with pytest.raises(ValueError, match=r"ball.urdf: .*'ball'.*free_root=True"):
        cj.load_robot(tmp_path / "ball.urdf")
    ball = cj.load_robot(tmp_path / "ball.urdf", free_root=True).scene
    assert float(ball.bodies["ball"].mass) == 9.0


@pytest.mark.parametrize(
    ("kind", "joint", "freedoms"),
    [("planar", cj.PlanarJoint, 5), ("spherical", cj.SphericalJoint, 5), ("floating", None, 8)],
)
def test_other_types_of_joints(read, kind, joint, freedoms):
    loaded, messages = read('type="prismatic"', f'type="{kind}"')
    assert "mimics, between other joints than hinges and sliders, of slide;" in messages[-1]
    assert joint is None or isinstance(loaded.scene.joints["slide"], joint)
    report = cj.constraint_report(loaded.scene, loaded.state())
    assert report.degrees_of_freedom() == freedoms


def test_namespaces_prefixes_and_unknown_shapes_do_not_matter(read):
    loaded, _ = read('<robot name="arm">', '<robot name="arm" xmlns="http://a.b">')
    assert list(loaded.scene.bodies) == MERGED
    _, messages = read("<gazebo/>", '<sensor:camera name="c"/>')
    assert "<sensor:camera>" in messages[-1]
    read('<box size="1 0.1 0.1"/>', '<capsule radius="1" length="1"/>')
    read('<?xml version="1.0"?>', "\n")


def test_impossible_inertias_are_balanced(read):
    """As by MuJoCo's `balanceinertia`."""
    loaded, messages = read('izz="0.021"', 'izz="0.9"', balance_inertia=True)
    inertia = loaded.scene.bodies["lower"].inertia
    assert inertia == pytest.approx(np.full(3, 0.921 / 3), rel=1e-15)
    assert "impossible inertias, replaced by their mean moment, of links lower." in messages[0]
    _, messages = read(balance_inertia=True)
    assert len(messages) == 1


def test_masses_and_inertias_are_bounded(read):
    """As by MuJoCo's `boundmass` and `boundinertia`."""
    light = urdf.link("tip") + urdf.joint("spin", "continuous", "rail", "tip") + "</robot>"
    with pytest.raises(ValueError, match=r"`tip`: found 'no mass', .*bound_mass=1e-3"):
        read("</robot>", light)
    loaded, messages = read("</robot>", light, bound_mass=1e-3, bound_inertia=1e-6)
    tip = loaded.scene.bodies["tip"]
    assert float(tip.mass) == 1e-3
    assert tip.inertia == pytest.approx(np.full(3, 1e-6), rel=1e-14)
    assert "increased, of bodies tip." in messages[0]
    with pytest.raises(ValueError, match="Argument `bound_mass` must be"):
        read(bound_mass=-1.0)


def test_one_warning_lists_omitted_contents(read):
    _, (text,) = read()
    assert "not carried over: visual shapes of upper;" in text
    assert "inertia of the fixed links of base; <gazebo>." in text


def test_an_element_of_the_robot_does_not_hide_that_of_a_link(read):
    _, (text,) = read('<link name="stand"/>', '<link name="stand"><gazebo/></link>')
    assert "<gazebo> of stand" in text


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
def test_errors_have_locations(read, old, new, play, message):
    with pytest.raises(ValueError, match=message):
        read(old, new, play=play)


def test_backlash_is_added_to_a_hinge(read):
    given = {"backlash": "0.1 deg", "torsional_stiffness": "20 N m/mrad", "restitution": 0.3}
    loaded, _ = read(play={"elbow": {"backlash": "0.1 deg"}, "shoulder": given})
    joints = loaded.scene.joints
    hinge, elbow = joints["elbow"], joints["elbow backlash"]
    assert isinstance(hinge, cj.RevoluteJoint) and isinstance(elbow, cj.Backlash)
    assert elbow.play == pytest.approx(math.radians(0.1), rel=1e-15)
    assert (elbow.first, elbow.second) == (hinge.first, hinge.second)
    assert np.array_equal(elbow.axis_second, hinge.axis_second)

    def torque(backlash: cj.Backlash, angle: float) -> float:
        gap = Gap(backlash.radius * angle, 0.0)
        return float(backlash.radius * backlash.law.force(gap, 0.0))

    assert torque(joints["shoulder backlash"], 1e-3) == pytest.approx(20.0, rel=1e-12)
    assert joints["shoulder backlash"].law.restitution == 0.3
    assert torque(elbow, 0.1 * float(elbow.play)) == pytest.approx(10.0, rel=1e-12)  # the limit


def test_clearances_are_read_with_units(read):
    loaded, _ = read(play={"elbow": PLAY | {"clearance": "0.05 mm"}})
    assert loaded.scene.joints["elbow"].clearance == 0.05e-3


def test_long_chains_and_hostile_files_end_soon(tmp_path):
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

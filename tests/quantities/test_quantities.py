"""Quantities of an instant: closed forms, and `observe`."""

import math
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import clearjoint as cj
from clearjoint import quantities as q
from clearjoint.extend import Formulation, Instant, System, unpack
from clearjoint.mechanisms import CRANK_LENGTH, ROD_LENGTH

JOINT = Formulation(cj.JointCoordinates())
ABSOLUTE = Formulation(cj.AbsoluteCoordinates())
ANGLE, SPIN, LENGTH, MASS, GRAVITY = 2.5, 3.0, 0.8, 1.7, 9.81
BODY = cj.Body(1.0, (1.0, 1.0, 1.0))


def instant(scene, state):
    """The scene at a state, in joint coordinates, at time zero."""
    scene = unpack(scene)
    variables = JOINT.coordinates.encode(scene, unpack(state.bodies))
    return Instant(System(scene, JOINT), 0.0, variables, state.entry_speeds, {})


def turned(angle):
    """Euler parameters of a turn about Z."""
    return (math.cos(0.5 * angle), 0.0, 0.0, math.sin(0.5 * angle))


@pytest.fixture(scope="module")
def pendulum():
    """A rod hung in the origin, at an angle from X, that falls along -Y and spins about Z."""
    moment = MASS * LENGTH**2 / 12
    axis, end = (0, 0, 1), (-0.5 * LENGTH, 0, 0)
    pin = cj.RevoluteJoint("ground", "rod", (0, 0, 0), end, axis, axis)
    rod = cj.Body(MASS, (1e-3, moment, moment))
    out = np.array([math.cos(ANGLE), math.sin(ANGLE), 0.0])
    across = np.array([-out[1], out[0], 0.0])
    rod_state = cj.body_state(
        0.5 * LENGTH * out, turned(ANGLE), 0.5 * LENGTH * SPIN * across, (0, 0, SPIN)
    )
    scene = cj.Scene({"rod": rod}, {"pin": pin}, gravity=(0, -GRAVITY, 0))
    return instant(scene, cj.State({"rod": rod_state})), out, across


def vector(quantity, now, *arguments, **options):
    return [float(quantity(*arguments, c, **options)(now)) for c in "xyz"]


def test_point_of_a_spinning_pendulum(pendulum):
    now, out, across = pendulum
    place = 0.3
    arm, point = 0.5 * LENGTH + place, (place, 0, 0)
    fall = -1.5 * GRAVITY / LENGTH * math.cos(ANGLE)
    acceleration = arm * (fall * across - SPIN**2 * out)
    weight = np.array([0.0, -GRAVITY, 0.0])
    felt, measured = acceleration - weight, {"axes": "body", "gravity": True}
    for quantity, options, expected in (
        (q.PointPosition, {}, arm * out),
        (q.PointVelocity, {}, arm * SPIN * across),
        (q.PointAcceleration, {}, acceleration),
        (q.PointAcceleration, {"gravity": True}, felt),
        (q.PointAcceleration, measured, [felt @ out, felt @ across, 0.0]),
    ):
        found = vector(quantity, now, "rod", point, **options)
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)
    assert q.PointVelocity("rod", point)(now) == pytest.approx(arm * SPIN)
    size = np.linalg.norm(acceleration)
    assert q.PointAcceleration("rod", point, axes="body")(now) == pytest.approx(size)
    centre = 0.5 * LENGTH * (fall * across - SPIN**2 * out)
    push = MASS * (centre - weight)
    for body, expected in (("rod", push), ("ground", -push)):
        found = vector(q.Reaction, now, "pin", body)
        np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-10)
    assert q.Reaction("pin", "rod")(now) == pytest.approx(np.linalg.norm(push))


def test_rates_of_the_pendulum(pendulum):
    now, out, _ = pendulum
    fall = -1.5 * GRAVITY / LENGTH * math.cos(ANGLE)
    for rate in (q.AngularVelocity("rod", "z"), q.JointAngularVelocity("pin")):
        assert float(rate(now)) == pytest.approx(SPIN, rel=1e-12)
    for rate in (q.AngularAcceleration("rod", "z", "body"), q.JointAngularAcceleration("pin")):
        assert float(rate(now)) == pytest.approx(fall, rel=1e-12)
    assert float(q.AngularVelocity("ground", "x")(now)) == 0.0
    end = q.Distance("ground", (0, 1, 0), "rod", (0.5 * LENGTH, 0, 0))
    assert float(end(now)) == pytest.approx(np.linalg.norm(LENGTH * out - [0, 1, 0]), rel=1e-12)
    along = q.Distance("ground", (0, 1, 0), "rod", (0.5 * LENGTH, 0, 0), along=(0, -2, 0))
    assert float(along(now)) == pytest.approx(1.0 - LENGTH * out[1], rel=1e-12)
    assert float(q.Distance("rod", (1, 2, 3), "rod", (1, 2, 3))(now)) == pytest.approx(0.0)


def test_moment_of_a_fixed_joint_is_that_of_the_weight_beside_it():
    """About the joint's own point: a body that hangs level from a wall."""
    wall = cj.FixedJoint("ground", "beam", (0, 0, 0), (-0.4, 0.0, 0.0))
    beam = cj.Body(MASS, (1.0, 1.0, 1.0))
    scene = cj.Scene({"beam": beam}, {"wall": wall}, gravity=(0, -GRAVITY, 0))
    now = instant(scene, cj.State({"beam": cj.body_state((0.4, 0, 0))}))
    moment = 0.4 * MASS * GRAVITY
    for body, expected in (("beam", moment), ("ground", -moment)):
        found = vector(q.ReactionMoment, now, "wall", body)
        np.testing.assert_allclose(found, [0.0, 0.0, expected], rtol=0.0, atol=1e-9)
    assert q.ReactionMoment("wall", "beam", axes="body")(now) == pytest.approx(moment)


def test_reaction_of_a_clearance_joint_is_the_force_on_its_journal():
    """Mass times acceleration of the outer arms equals the forces of all joints and gravity."""
    scene, state = swinging(cj.frictions.RegularisedCoulomb(0.3, 1e-3))
    now, weight = instant(scene, state), np.array([float(x) for x in np.ravel(scene.gravity)])
    arm = scene.bodies["arm 2"]
    acceleration = np.array(vector(q.Acceleration, now, "arm 2"))
    forces = [vector(q.Reaction, now, joint, "arm 2") for joint in ("shoulder", "elbow")]
    balance = float(arm.mass) * (acceleration - weight)
    np.testing.assert_allclose(np.sum(forces, axis=0), balance, rtol=1e-8)
    on_ground = vector(q.Reaction, now, "shoulder", "ground")
    np.testing.assert_allclose(on_ground, -np.array(forces[0]), rtol=1e-12)
    assert np.linalg.norm(forces[0]) > float(q.ContactForce("shoulder")(now)) > 100.0


@pytest.mark.parametrize("seed", range(3))
def test_the_contact_force_of_a_joint_is_the_resultant_of_its_contacts(seed):
    """Without friction it is the reaction. A tilted journal touches at opposite sides too."""
    scene, state = cj.mechanisms.double_pendulum(law=cj.laws.Hertz(1e9))
    random = np.random.default_rng(seed)
    arm = state.bodies["arm 2"]
    direction = random.uniform(0.0, 2.0 * math.pi)
    position = arm.position + 0.6e-3 * np.array([math.cos(direction), math.sin(direction), 0.0])
    tilt = cj.rotation(axis=(1, 1, 0), angle=0.1 * random.normal())
    bodies = {**state.bodies, "arm 2": cj.body_state(position, tilt)}
    now = instant(scene, cj.State(bodies))
    bases = [float(q.ContactForce("shoulder", base)(now)) for base in "VW"]
    total = float(q.ContactForce("shoulder")(now))
    assert total == pytest.approx(float(q.Reaction("shoulder", "arm 2")(now)), rel=1e-12)
    assert max(bases) > 0.0 and total <= sum(bases) * (1.0 + 1e-12)


def test_angles_of_the_pendulum(pendulum):
    now, _, _ = pendulum
    assert q.JointAngle("pin")(now) == pytest.approx(ANGLE)
    assert q.Angle("rod", (0, 0, 2))(now) == pytest.approx(ANGLE)
    assert q.Angle("rod", (0, 0, -1))(now) == pytest.approx(-ANGLE)
    from_up = q.Angle("rod", (0, 0, 1), (0, 3, 0), axis=(1, 0, 0))
    assert from_up(now) == pytest.approx(ANGLE - 0.5 * math.pi)
    beyond = q.Angle("rod", (0, 0, 1), reference=(0, -1, 0), axis=(1, 0, 0))
    assert beyond(now) == pytest.approx(ANGLE + 0.5 * math.pi - 2.0 * math.pi)
    assert q.Angle.period == q.JointAngle.period == 2.0 * math.pi
    assert q.Position.period is None


def test_angle_about_a_slanted_axis_is_that_of_the_projection():
    about, direction, reference = np.random.default_rng(3).normal(size=(3, 3))
    turn = Rotation.from_rotvec([0.3, -1.2, 0.8])
    body = cj.body_state((0, 0, 0), turn.as_quat(scalar_first=True))
    scene = cj.Scene({"a": BODY})
    now = instant(scene, cj.State({"a": body}))
    found = float(q.Angle("a", about, reference, axis=direction)(now))
    unit = about / np.linalg.norm(about)
    flat = np.eye(3) - np.outer(unit, unit)
    back = Rotation.from_rotvec(found * unit).apply(flat @ reference)
    seen = flat @ turn.apply(direction)
    lengths = np.linalg.norm(back) * np.linalg.norm(seen)
    assert back @ seen == pytest.approx(lengths, rel=1e-12)


@pytest.mark.parametrize("enclosed", [20.0, 90.0 - 1e-14, 90.0 + 1e-14, 130.0, 165.0])
def test_joint_angle_counts_from_the_shortest_turn_between_the_axes(enclosed):
    """About an axis with different components in the two frames, which enclose any angle in degrees
    that is not nearly 180. The advance of a screw counts from there too."""
    axis, across = np.array([1.0, -2.0, -2.0]) / 3.0, np.array([2.0, 0.0, 1.0]) / math.sqrt(5.0)
    shortest, lead = Rotation.from_rotvec(across * math.radians(enclosed)), 0.3
    here = shortest.inv().apply(axis)
    points, axes = ((0, 0, 0), (0, 0, 0)), (2.0 * axis, 3.0 * here)
    joints = {
        "hinge": cj.CylindricalJoint("ground", "a", *points, *axes),
        "screw": cj.ScrewJoint("ground", "b", *points, *axes, lead=lead),
    }
    scene = cj.Scene(dict.fromkeys("ab", BODY), joints)
    for angle in (-0.4, 0.0, 1.9):
        turn = (Rotation.from_rotvec(angle * axis) * shortest).as_quat(scalar_first=True)
        advance = lead * angle / (2.0 * math.pi) * axis
        state = cj.State({"a": cj.body_state((0, 0, 0), turn), "b": cj.body_state(advance, turn)})
        np.testing.assert_allclose(cj.constraint_report(scene, state).values, 0.0, atol=1e-13)
        for name in joints:
            assert q.JointAngle(name)(instant(scene, state)) == pytest.approx(angle, abs=1e-12)
        scalars = unpack(state.bodies)
        again = JOINT.coordinates.decode(
            unpack(scene), JOINT.coordinates.encode(unpack(scene), scalars)
        )
        np.testing.assert_allclose(tuple(again["b"].position), advance, atol=1e-13)


@pytest.mark.parametrize("axis", [(1.0, 0.0, 1e-17), (0.0, 0.0, 1.0), (0.6, -0.8, 0.0)])
def test_joint_angle_is_zero_for_parallel_frames(axis):
    """For axes equal but for rounding, and for opposite ones."""
    points, along = ((0, 0, 0), (0, 0, 0)), np.array(axis)
    joints = {
        "equal": cj.RevoluteJoint("ground", "a", *points, along, along - [0, 0, 2e-17]),
        "opposite": cj.CylindricalJoint("ground", "b", *points, along, -along),
    }
    scene = cj.Scene(dict.fromkeys("ab", BODY), joints)
    scene = jax.tree.map(jnp.asarray, scene)  # so that nothing is structural
    state = cj.State({name: cj.body_state((0, 0, 0)) for name in scene.bodies})
    variables = ABSOLUTE.coordinates.encode(unpack(scene), unpack(state.bodies))
    now = Instant(System(unpack(scene), ABSOLUTE), 0.0, variables, {}, {})
    for name in scene.joints:
        assert q.JointAngle(name)(now) == pytest.approx(0.0, abs=1e-12)


def test_joint_angles_of_the_slider_crank():
    scene, state = cj.mechanisms.slider_crank(angle=1.0)
    rod = -math.asin(CRANK_LENGTH * math.sin(1.0) / ROD_LENGTH)
    now = instant(scene, state)
    expected = {"motor": 1.0, "crank bearing": 1.0, "crank pin": rod - 1.0, "slider pin": rod}
    found = {name: float(q.JointAngle(name)(now)) for name in expected}
    assert found == pytest.approx(expected, abs=1e-12)
    torque = cj.DriveTorque("ground", "crank", (0, 0, 1), 2.0)
    driven, _ = cj.mechanisms.slider_crank(angle=1.0, motor=torque)
    assert q.JointAngle("motor")(instant(driven, state)) == pytest.approx(1.0)


def swinging(friction):
    """The double pendulum in motion, its journal pressed 20 µm into the wall and sliding."""
    law = cj.laws.Hertz(cj.laws.RavnStiffness(207e9, 0.3))
    scene, _ = cj.mechanisms.double_pendulum(law=law, friction=friction)
    first = Rotation.from_rotvec([0.0, 2e-3, 0.9])
    second = first * Rotation.from_rotvec([0.7, 0.0, 0.0])
    spins = np.array([0.3, 0.2, 2.0]), np.array([-1.1, 0.0, 0.0])
    centre = first.apply([0.5, 0.0, 0.0]) + [3e-4, -4.3e-4, 1e-4]
    velocity = np.cross(first.apply(spins[0]), first.apply([0.5, 0, 0])) + [0.02, 0.01, 0.0]
    bodies = {"arm 2": cj.body_state(centre, first.as_quat(scalar_first=True), velocity, spins[0])}
    elbow = centre + first.apply([0.5, 0.0, 0.0])
    moving = velocity + np.cross(first.apply(spins[0]), first.apply([0.5, 0, 0]))
    spin = second.inv().apply(first.apply(spins[0])) + spins[1]
    arm = second.apply([0.0, 0.0, 0.5])
    moving += np.cross(second.apply(spin), arm)
    turn = second.as_quat(scalar_first=True)
    bodies["arm 3"] = cj.body_state(elbow + arm, turn, moving, spin)
    return scene, cj.State(bodies)


def test_values_are_those_of_observe():
    scene, state = swinging(cj.frictions.RegularisedCoulomb(0.3, 1e-3))
    now = instant(scene, state)
    row = jax.tree.map(lambda leaf: np.asarray(leaf)[None], state)
    solution = SimpleNamespace(formulation=JOINT, redundant_constraints=())
    seen = cj.observe(scene, solution, cj.results.Trajectory(np.zeros(1), row))  # pyright: ignore
    for arm in ("arm 2", "arm 3"):
        force = vector(q.Reaction, now, "elbow", arm)
        np.testing.assert_allclose(force, seen.reactions["elbow"][arm].force[0], rtol=1e-8)
        acceleration = vector(q.PointAcceleration, now, arm, (0, 0, 0))
        np.testing.assert_allclose(acceleration, seen.accelerations[arm].linear[0], rtol=1e-8)
    friction = seen.contacts["shoulder"]["V"].friction_force[0]
    found = q.FrictionForce("shoulder", "V")(now)
    assert found == pytest.approx(np.linalg.norm(friction), rel=1e-8)
    assert found > 100.0


def test_friction_is_zero_where_there_is_none():
    assert q.FrictionForce("shoulder", "V")(instant(*swinging(None))) == 0.0


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: q.Position("a", "X"), r"`component` must be one of \('x', 'y', 'z'\).*'X'"),
        (lambda: q.PointPosition("a", (0, 0), "x"), r"`point` must be an array of shape \(3,\)"),
        (lambda: q.PointAcceleration("a", (0, 0, 0), "x", "local"), r"`axes` must be.*'local'"),
        (lambda: q.Angle("a", (0, 0, 0)), "`about` must be a vector of non-zero length"),
        (lambda: q.Angle("a", (0, 0, 1), axis=(0, 0, 2)), "`axis` must be .* not parallel"),
        (
            lambda: q.Angle("a", (0, 0, 1), reference=(0, 0, 2), axis=(1, 0, 0)),
            "`reference` must be .* not parallel",
        ),
        (lambda: q.Eccentricity("pin", "v"), "`base` must be one of .*'v'"),
        (lambda: q.PointPosition("a", "here", "x"), "`point` must be a number.*'here'"),
        (lambda: q.Angle("a", None), "`about` must be a number.*None"),
        (lambda: q.PointAcceleration("a", (0, 0, 0), gravity="no"), "`gravity` must be.*'no'"),
    ],
)
def test_bad_arguments_are_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


@pytest.mark.parametrize(
    ("quantity", "message"),
    [
        (q.Position("arm", "x"), r"`body` must be one of the scene's \['arm 2', 'arm 3', 'ground'"),
        (q.Acceleration("ground"), r"`body` must be one of the scene's \['arm 2', 'arm 3'\].*grou"),
        (q.ContactForce("elbow"), r"`joint` must be one of the scene's \['shoulder'\].*'elbow'"),
        (q.Penetration("shoulder", "U"), r"`contact` must be one of the scene's \['V', 'W'\]"),
        (q.Penetration("shoulder", None), r"`contact` must be .*\['V', 'W'\], but is None"),
        (q.PenetrationRate("shoulder", None), r"`contact` must be .*'W'\], but is None"),
        (q.FrictionForce("shoulder", None), r"`contact` must be .*'W'\], but is None"),
        (q.ContactForce("elbow", None), r"`joint` must be one of the scene's \['shoulder'\]"),
        (q.ContactForce("shoulder", "U"), r"`contact` must be one of the scene's \['V', 'W'\]"),
        (q.JournalOffset("elbow", "x"), r"`joint` must be one of the scene's \['shoulder'\]"),
        (q.ReactionMoment("shoulder", "arm 2"), r"`joint` must be one of the scene's \['elbow'\]"),
        (q.Reaction("hip", "arm 2"), r"`joint` must be .*\['elbow', 'shoulder'\].*'hip'"),
        (q.Distance("arm", (0, 0, 0), "arm 2", (0, 0, 0)), r"`first` must be .*'ground'"),
        (q.Reaction("elbow", "ground"), r"`body` must be one of the scene's \['arm 2', 'arm 3'\]"),
        (q.Multiplier("hinge", "angle"), r"`joint` must be .*\['elbow', 'shoulder'\]"),
        (q.JointAngle("hip"), r"`joint` must be .*\['elbow', 'shoulder'\].*'hip'"),
    ],
)
def test_unknown_names_are_refused(quantity, message):
    scene, _ = cj.mechanisms.double_pendulum()
    with pytest.raises(ValueError, match=message):
        quantity.check(scene)
    q.ContactForce("shoulder", None).check(scene)


def test_an_instant_of_a_late_run_has_the_same_time_after_a_transformation():
    """The time since the origin of the run, which is added to the origin once."""
    scene, state = unpack(cj.mechanisms.double_pendulum())
    system = System(scene, Formulation(), origin=jnp.asarray(100.0))
    now = Instant(system, jnp.asarray(0.5), system.encode(state.bodies), {}, {})
    assert float(jax.tree.map(lambda leaf: leaf, now).time) == float(now.time) == 100.5


def test_a_row_without_a_multiplier_is_refused():
    pivot = cj.SphericalJoint("ground", "ball", (0, 0, 0), (0, 0, 0))
    scene = cj.Scene({"ball": BODY}, {"pivot": pivot})
    scene, state = unpack((scene, cj.State({"ball": cj.body_state((0, 0, 0))})))
    system = System(scene, Formulation(), origin=jnp.asarray(0.0))
    now = Instant(system, jnp.asarray(0.0), system.encode(state.bodies), {}, {})
    with pytest.raises(ValueError, match=r"`row` must be .*'pivot'.* is 'translation x': take Re"):
        q.Multiplier("pivot", "translation x")(now)


def test_units_are_si():
    units = {"Position": "m", "Velocity": "m/s", "Acceleration": "m/s^2", "Angle": "rad"}
    units |= {"Force": "N", "Torque": "N m", "Moment": "N m", "Speed": "m/s", "Current": "A"}
    units |= {"AngularVelocity": "rad/s", "AngularAcceleration": "rad/s^2"}
    for end, unit in units.items():
        kinds = [kind for name, kind in vars(q).items() if name.endswith(end)]
        kinds = [kind for kind in kinds if "Angular" in end or "Angular" not in kind.__name__]
        assert kinds and {kind.unit for kind in kinds} == {unit}, end
    assert q.Multiplier("motor", "angle").unit is None


def test_speed_of_a_pendulum_let_go_is_that_of_its_energy(pendulum):
    """From rest on the level: w^2 = 3 g sin(angle)/length, below it."""
    now, _, _ = pendulum
    angles = -np.linspace(0.1, 3.0, 7)
    speeds = np.sqrt(-3.0 * GRAVITY * np.sin(angles) / LENGTH)
    for angle, speed in zip(angles, speeds, strict=True):
        out = np.array([math.cos(angle), math.sin(angle), 0.0])
        velocity = -0.5 * LENGTH * speed * np.array([-out[1], out[0], 0.0])
        turn = cj.body_state(0.5 * LENGTH * out, turned(angle), velocity, (0, 0, -speed))
        then = instant(now.scene, cj.State({"rod": turn}))
        assert float(q.JointAngle("pin")(then)) == pytest.approx(angle, abs=1e-12)
        assert float(q.JointAngularVelocity("pin")(then)) == pytest.approx(-speed, rel=1e-12)


def test_point_of_the_ground_stands_still(pendulum):
    now, _, _ = pendulum
    assert vector(q.PointPosition, now, "ground", (1, 2, 3)) == [1.0, 2.0, 3.0]
    assert vector(q.PointVelocity, now, "ground", (1, 2, 3)) == [0.0, 0.0, 0.0]


def test_angle_of_a_horizontal_body_axis_with_the_components_of_the_fixed_axis():
    tilt = Rotation.from_euler("y", 90.0, degrees=True)  # turns the body's z axis to the global x
    turn = Rotation.from_rotvec((0.0, 0.0, 0.3)) * tilt
    scene = cj.Scene({"arm": BODY})
    body = cj.body_state((0, 0, 0), turn.as_quat(scalar_first=True))
    angle = q.Angle("arm", about=(0, 0, 1), reference=(1, 0, 0), axis=(0, 0, 1))
    assert angle(instant(scene, cj.State({"arm": body}))) == pytest.approx(0.3)

"""Bad inputs: each raises a `ValueError` that names the argument, value, expectation and remedy."""

import contextlib
import functools
import re

import jax
import numpy as np
import pytest

import clearjoint as cj
from clearjoint import (
    AppliedLoad,
    Baumgarte,
    Body,
    BodyState,
    ClearanceJoint,
    DriveTorque,
    EndPlay,
    FixedJoint,
    InlineJoint,
    PrescribedRotation,
    PrismaticJoint,
    RevoluteJoint,
    Scene,
    SphericalJoint,
    SpringDamper,
    State,
    assemble,
    body_state,
    simulate,
)
from clearjoint.frictions import Ambrosio, RegularisedCoulomb
from clearjoint.laws import (
    Flores2011,
    Hertz,
    HuntCrossley,
    LankaraniNikravesh,
    RavnStiffness,
)

NAN = float("nan")
BODY = Body(1.0, (1.0, 1.0, 1.0))
BODIES = {"rod": BODY}
ZERO, AXIS = (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)
pin = functools.partial(
    ClearanceJoint, "ground", "rod", bearing_radius=0.01, journal_length=0.02, law=Hertz(1e9)
)
revolute = functools.partial(RevoluteJoint, "ground", "rod", ZERO, ZERO)
spring = functools.partial(SpringDamper, "ground", "rod", ZERO, ZERO)

CONSTRUCTION = {
    "mass zero": (lambda: Body(0.0, (1, 1, 1)), "mass", "0.0", "positive", "give the mass in kg"),
    "mass negative": (lambda: Body(-2, (1, 1, 1)), "mass", "-2.0", "positive", "kg"),
    "mass NaN": (lambda: Body(NAN, (1, 1, 1)), "mass", "nan", "finite", "replace the NaN"),
    "mass of two": (lambda: Body((1, 2), (1, 1, 1)), "mass", "[1.0, 2.0]", "()", "single number"),
    "inertia NaN": (lambda: Body(1, (1, NAN, 1)), "inertia", "nan", "finite", "replace the NaN"),
    "inertia shape": (lambda: Body(1, (1, 1)), "inertia", "[1.0, 1.0]", "(3,) or (3, 3)", "give"),
    "inertia negative": (
        lambda: Body(1, (1, -1, 1)),
        "inertia",
        "-1.0",
        "positive definite",
        "give every body",
    ),
    "triangle inequality": (
        lambda: Body(1, (1, 1, 2.1)),
        "inertia",
        "2.1",
        "exceeds the sum",
        "check the order",
    ),
    "triangle inequality of a matrix": (
        lambda: Body(1, np.diag([0.1, 3, 1])),
        "inertia",
        "3.0",
        "exceeds the sum",
        "units",
    ),
    "inertia not symmetric": (
        lambda: Body(1, np.eye(3) + [[0, 0.1, 0]] * 3),
        "inertia",
        "0.1",
        "symmetric",
        "average it",
    ),
    "no bodies": (lambda: Scene({}), "bodies", "{}", "at least one body", "pass {name: Body"),
    "body named ground": (
        lambda: Scene({"ground": BODY}),
        "bodies",
        "'ground'",
        "name of the fixed",
        "rename",
    ),
    "body without a name": (lambda: Scene({"": BODY}), "bodies", "''", "non-empty", "name every"),
    "body of another kind": (
        lambda: Scene({"rod": 1.0}),
        "bodies['rod']",
        "'float'",
        "one of Body",
        "pass an element",
    ),
    "joint among the forces": (
        lambda: Scene(BODIES, forces={"pin": revolute(AXIS, AXIS)}),
        "forces['pin']",
        "'RevoluteJoint'",
        "one of AbstractForce",
        "pass an element",
    ),
    "unknown body of a joint": (
        lambda: Scene(BODIES, {"pin": SphericalJoint("rod", "crank", ZERO, ZERO)}),
        "joints['pin']",
        "'crank'",
        "known bodies ['ground', 'rod']",
        "correct the name",
    ),
    "unknown body of a load": (
        lambda: Scene(BODIES, forces={"push": AppliedLoad("crank")}),
        "forces['push']",
        "'crank'",
        "known bodies",
        "add the body",
    ),
    "shared name": (
        lambda: Scene(BODIES, {"x": revolute(AXIS, AXIS)}, {"x": spring(1.0)}),
        "forces",
        "['x']",
        "other names",
        "rename",
    ),
    "gravity of two": (lambda: Scene(BODIES, gravity=(0, 9)), "gravity", "9.0", "(3,)", "m/s^2"),
    "joint with itself": (
        lambda: RevoluteJoint("rod", "rod", ZERO, ZERO, AXIS, AXIS),
        "second",
        "'rod'",
        "another body",
        "name two bodies",
    ),
    "joint of a number": (
        lambda: SphericalJoint(1, "rod", ZERO, ZERO),
        "first",
        "1",
        "name of a body",
        "pass",
    ),
    "axis of no length": (
        lambda: revolute(ZERO, AXIS),
        "axis_first",
        "[0.0, 0.0, 0.0]",
        "non-zero length",
        "give a direction",
    ),
    "second axis of no length": (
        lambda: revolute(AXIS, ZERO),
        "axis_second",
        "[0.0, 0.0, 0.0]",
        "non-zero",
        "direction",
    ),
    "point of two": (
        lambda: SphericalJoint("ground", "rod", (1, 2), ZERO),
        "point_first",
        "[1.0, 2.0]",
        "(3,)",
        "three coordinates in m",
    ),
    "slide along nothing": (
        lambda: PrismaticJoint("ground", "rod", ZERO, ZERO, ZERO),
        "axis",
        "[0.0, 0.0, 0.0]",
        "non-zero length",
        "give a direction",
    ),
    "line along nothing": (
        lambda: InlineJoint("ground", "rod", ZERO, ZERO, ZERO),
        "axis",
        "[0.0, 0.0, 0.0]",
        "non-zero length",
        "give a direction",
    ),
    "slide turned by no rotation": (
        lambda: PrismaticJoint("ground", "rod", ZERO, ZERO, AXIS, (1, 1, 0, 0)),
        "orientation",
        "[1.0, 1.0, 0.0, 0.0]",
        "unit norm",
        "divide them",
    ),
    "driver of one body": (
        lambda: PrescribedRotation("rod", "rod", AXIS, 1.0),
        "second",
        "'rod'",
        "another body",
        "name two bodies",
    ),
    "driver about nothing": (
        lambda: PrescribedRotation("ground", "rod", ZERO, 1.0),
        "axis",
        "[0.0, 0.0, 0.0]",
        "non-zero length",
        "give a direction",
    ),
    "speed of a driver that is none": (
        lambda: PrescribedRotation("ground", "rod", AXIS, NAN),
        "speed",
        "nan",
        "finite",
        "replace the NaN",
    ),
    "angles instead of one": (
        lambda: PrescribedRotation("ground", "rod", AXIS, 1.0, (0.0, 1.0)),
        "initial_angle",
        "[0.0, 1.0]",
        "()",
        "rad",
    ),
    "torque with components": (
        lambda: DriveTorque("ground", "rod", AXIS, (0, 0, 1)),
        "torque",
        "[0.0, 0.0, 1.0]",
        "()",
        "N m",
    ),
    "drive turned by no rotation": (
        lambda: DriveTorque("ground", "rod", AXIS, 1.0, (1, 1, 0, 0)),
        "orientation",
        "[1.0, 1.0, 0.0, 0.0]",
        "unit norm",
        "divide them",
    ),
    "orientation not of unit norm": (
        lambda: FixedJoint("ground", "rod", ZERO, ZERO, (1, 1, 0, 0)),
        "orientation",
        "[1.0, 1.0, 0.0, 0.0]",
        "unit norm",
        "divide them",
    ),
    "negative stiffness of a spring": (
        lambda: spring(-1.0),
        "stiffness",
        "-1.0",
        "zero or positive",
        "SI units",
    ),
    "journal as large as the bearing": (
        lambda: pin(journal_radius=0.01),
        "journal_radius",
        "0.01",
        "smaller than the bearing's",
        "RevoluteJoint",
    ),
    "journal larger than the bearing": (
        lambda: pin(journal_radius=0.011),
        "journal_radius",
        "0.011",
        "smaller than",
        "swap",
    ),
    "clearance zero": (lambda: pin(clearance=0.0), "clearance", "0.0", "positive", "in m"),
    "clearance beyond the bearing": (
        lambda: pin(clearance=0.5),
        "clearance",
        "0.5",
        "smaller than the bearing's radius 0.01",
        "check the units",
    ),
    "neither radius nor clearance": (
        lambda: pin(),
        "clearance",
        "None",
        "if and only if `journal_radius` is not",
        "one of the",
    ),
    "both radius and clearance": (
        lambda: pin(journal_radius=0.009, clearance=0.001),
        "clearance",
        "0.001",
        "if and only if",
        "pass one of the two",
    ),
    "bearing axis of no length": (
        lambda: pin(clearance=1e-4, bearing_axis=ZERO),
        "bearing_axis",
        "[0.0, 0.0, 0.0]",
        "non-zero length",
        "direction",
    ),
    "journal axis of no length": (
        lambda: pin(clearance=1e-4, journal_axis=ZERO),
        "journal_axis",
        "[0.0, 0.0, 0.0]",
        "non-zero length",
        "direction",
    ),
    "journal length negative": (
        lambda: pin(clearance=1e-4, journal_length=-1),
        "journal_length",
        "-1.0",
        "positive",
        "m",
    ),
    "law of another kind": (
        lambda: pin(clearance=1e-4, law=1e9),
        "law",
        "1000000000.0",
        "AbstractContactLaw",
        "pass",
    ),
    "friction of another kind": (
        lambda: pin(clearance=1e-4, friction=0.1),
        "friction",
        "0.1",
        "AbstractFriction",
        "pass",
    ),
    "shoulder with Ravn's stiffness": (
        lambda: EndPlay(0.01, Hertz(RavnStiffness(2e11, 0.3))),
        "law",
        "RavnStiffness",
        "explicit stiffness",
        "N/m^n",
    ),
    "play negative": (lambda: EndPlay(-0.01, Hertz(1)), "play", "-0.01", "zero or positive", "m"),
    "restitution above one": (
        lambda: LankaraniNikravesh(1.1, 1e9),
        "restitution",
        "1.1",
        "in [0.0, 1.0]",
        "1 is elastic",
    ),
    "restitution negative": (
        lambda: HuntCrossley(-0.1, 1e9),
        "restitution",
        "-0.1",
        "in [0.0, 1.0]",
        "0 is plastic",
    ),
    "Flores 2011 with zero": (
        lambda: Flores2011(0.0, 1e9),
        "restitution",
        "0.0",
        "positive for this law",
        "small value",
    ),
    "stiffness negative": (lambda: Hertz(-1e9), "stiffness", "-1", "positive", "give K"),
    "exponent below one": (lambda: Hertz(1e9, 0.5), "exponent", "0.5", "at least 1", "1.5"),
    "smoothing zero": (lambda: Hertz(1e9, smoothing=0.0), "smoothing", "0.0", "positive", "None"),
    "entry speed floor zero": (
        lambda: HuntCrossley(0.9, 1e9, entry_speed_floor=0),
        "entry_speed_floor",
        "0.0",
        "positive",
        "e.g. 1e-6",
    ),
    "Poisson's ratio": (
        lambda: RavnStiffness(2e11, 0.6),
        "poisson_ratio",
        "0.6",
        "[-1.0, 0.5]",
        "give nu",
    ),
    "Young's modulus": (lambda: RavnStiffness(0, 0.3), "young_modulus", "0.0", "positive", "Pa"),
    "friction negative": (
        lambda: RegularisedCoulomb(-0.1),
        "coefficient",
        "-0.1",
        "zero or positive",
        "give mu",
    ),
    "Ambrosio's speeds": (
        lambda: Ambrosio(0.1, 1e-3, 1e-4),
        "upper_speed",
        "0.0001",
        "above lower_speed = 0.001",
        "give v1 > v0",
    ),
    "Baumgarte negative": (lambda: Baumgarte(-5.0), "alpha", "-5.0", "zero or positive", "1/s"),
    "Euler parameters": (
        lambda: body_state(ZERO, (1, 1, 0, 0)),
        "orientation",
        "[1.0, 1.0, 0.0, 0.0]",
        "unit norm",
        "divide",
    ),
    "position NaN": (lambda: body_state((NAN, 0, 0)), "position", "nan", "finite", "replace"),
    "velocity of two": (
        lambda: body_state(ZERO, velocity=(1, 2)),
        "velocity",
        "[1.0, 2.0]",
        "(3,)",
        "three numbers",
    ),
}

SCENE = Scene(BODIES)
STATE = State({"rod": body_state(ZERO)})
HELD = Scene(BODIES, {"ball": SphericalJoint("ground", "rod", ZERO, (0.5, 0.0, 0.0))})
APART = State({"rod": body_state((-0.25, 0, 0))})
DRIVEN = State({"rod": body_state((-0.5, 0, 0), velocity=(0, 0.2, 0))})
LONG, SHORT = (
    State({"rod": BodyState(*(np.array(row) for row in (ZERO, (norm, 0, 0, 0), ZERO, ZERO)))})
    for norm in (1.2, 0.8)
)
INFINITE = State({"rod": BodyState(*(np.full(n, np.inf) for n in (3, 4, 3, 3)))})


def run(*, scene=SCENE, state=STATE, end_time=1.0, **options):
    return lambda: simulate(scene, state, end_time, **options)


def saved(times):
    return lambda: simulate(SCENE, STATE, 1.0, save=cj.Saving(times))


RUN = {
    "end before the start": (run(end_time=-1.0), "end_time", "-1.0", "after start_time", "in s"),
    "end at the start": (
        run(start_time=1.0),
        "end_time",
        "1.0",
        "finite and after start_time = 1",
        "in s",
    ),
    "end infinite": (run(end_time=np.inf), "end_time", "inf", "finite", "give times in s"),
    "saves unsorted": (saved([0.2, 0.1]), "times", "[0.2, 0.1]", "rising", "sort"),
    "saves NaN": (saved([0.2, NAN]), "times", "nan", "finite times", "sort"),
    "saves none": (saved([]), "times", "[]", "one-dimensional", "sort"),
    "saves in a table": (saved([[0.1]]), "times", "[[0.1]]", "one-dimensional", "sort"),
    "saves before the start": (
        saved([-0.1, 0.5]),
        "times",
        "-0.1",
        "between start_time = 0",
        "leave out",
    ),
    "saves after the end": (
        saved([0.1, 1.5]),
        "times",
        "1.5",
        "end_time = 1.0",
        "leave out the times outside",
    ),
    "tolerance negative": (
        lambda: cj.Settings(rtol=-1e-6),
        "rtol",
        "-1e-06",
        "zero or positive",
        "such as 1e-6",
    ),
    "absolute tolerance NaN": (lambda: cj.Settings(atol=NAN), "atol", "nan", "finite", "replace"),
    "first step zero": (
        lambda: cj.Settings(first_step=0.0),
        "first_step",
        "0.0",
        "positive",
        "in s",
    ),
    "landing tolerance negative": (
        lambda: cj.Settings(landing_tolerance=-1e-9),
        "landing_tolerance",
        "-1e-09",
        "positive",
        "in m",
    ),
    "state of another kind": (run(state=STATE.bodies), "state", "'dict'", "a State", "pass State("),
    "missing body": (
        run(state=State({})),
        "state",
        "[]",
        "the scene's bodies ['rod']",
        "give each body",
    ),
    "additional body": (
        run(state=State({**STATE.bodies, "crank": STATE.bodies["rod"]})),
        "state",
        "['crank', 'rod']",
        "the scene's bodies ['rod']",
        "one state",
    ),
    "state with long Euler parameters": (
        run(state=LONG),
        "state.bodies['rod'].orientation",
        "[1.2, 0.0, 0.0, 0.0]",
        "about unit norm",
        "body_state(...)",
    ),
    "state with short Euler parameters": (
        run(state=SHORT),
        "state.bodies['rod'].orientation",
        "[0.8, 0.0, 0.0, 0.0]",
        "about unit norm",
        "body_state(...)",
    ),
    "state infinite": (
        run(state=INFINITE),
        "state.bodies['rod'].position",
        "inf",
        "finite",
        "replace",
    ),
    "state apart": (
        run(scene=HELD, state=APART),
        "state",
        "-0.25",
        "'ball: translation x' at most 1e-06",
        "call assemble",
    ),
    "state with other velocity": (
        run(scene=HELD, state=DRIVEN),
        "state",
        "-0.2",
        "velocities",
        "'ball: translation y'",
        "assemble",
    ),
    "parameter changed to nonsense": (
        run(scene=jax.tree.map(lambda leaf: -leaf, SCENE)),
        "mass",
        "-1.0",
        "positive",
        "kg",
    ),
}


@pytest.mark.parametrize("case", CONSTRUCTION | RUN)
def test_bad_input_is_refused_with_a_message_that_helps(case):
    make, *words = (CONSTRUCTION | RUN)[case]
    with pytest.raises(ValueError) as caught:
        make()
    message = str(caught.value)
    assert re.fullmatch(r"Argument `.+` must be .+, but is .+: .+\.", message, re.DOTALL), message
    assert [word for word in words if word not in message] == [], message


def test_values_that_are_not_numbers_are_refused():
    with pytest.raises(
        ValueError, match="`mass` must be a number.*'heavy': pass a float, .* in kg"
    ):
        Body("heavy", (1.0, 1.0, 1.0))


@contextlib.contextmanager
def single_precision():
    jax.config.update("jax_enable_x64", False)
    try:
        yield
    finally:
        jax.config.update("jax_enable_x64", True)


def test_single_precision_is_refused_unless_asked_for():
    with single_precision(), pytest.raises(ValueError) as caught:
        simulate(SCENE, STATE, 1.0)
    for word in ("32-bit", "penetrations", "clearjoint.configure()", "allow_float32=True"):
        assert word in str(caught.value)


def test_assembly_that_cannot_succeed_names_the_worst_constraint():
    """Two points of the rod that are 1 m apart shall meet two of the ground that are 3 m apart."""
    ends = {"left": ((-1.5, 0, 0), (-0.5, 0, 0)), "right": ((1.5, 0, 0), (0.5, 0, 0))}
    joints = {name: SphericalJoint("ground", "rod", *ends[name]) for name in ends}
    with pytest.raises(ValueError, match=r"(?s)`state`.*constraint '(left|right): .*better guess"):
        assemble(Scene(BODIES, joints), STATE)


def test_values_under_a_transformation_pass():
    """Checks need values; a traced one has none yet."""
    masses = jax.vmap(lambda mass: Body(mass, (1.0, 1.0, 1.0)).mass)(np.array([1.0, -1.0]))
    np.testing.assert_array_equal(masses, [1.0, -1.0])


def test_distances_of_points_are_not_checked_from_bodies_with_traced_numbers():
    spring = cj.SpringDamper("ground", "ball", (0, 0, 0), (1e3, 0, 0), stiffness=100.0)

    def mass_of(mass):
        body = cj.Body(mass, (1e-3, 1e-3, 1e-3))
        return cj.Scene({"ball": body}, forces={"spring": spring}).bodies["ball"].mass

    assert jax.eval_shape(mass_of, 1.0).shape == ()
    with pytest.warns(cj.UnusualValueWarning, match="from the centre of mass"):
        mass_of(1.0)

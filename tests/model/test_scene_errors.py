"""Bad inputs: each raises a `ValueError` that names the argument, value, expectation and remedy.

Typical mistakes of new users are in tests/test_first_contact.py.
"""

import contextlib
import functools
import math
import re

import jax
import numpy as np
import pytest

import clearjoint as cj
from clearjoint import frictions, laws

NAN = float("nan")
BODY = cj.Body(1.0, (1.0, 1.0, 1.0))
BODIES = {"rod": BODY}
ZERO, AXIS = (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)
NO_LENGTH = " ... non-zero length ... [0.0, 0.0, 0.0] ... give a direction"
NO_ROTATION = " ... unit norm ... [1.0, 1.0, 0.0, 0.0] ... divide them"
NOT_A_NUMBER = " ... finite ... nan ... replace the NaN"
pin = functools.partial(
    cj.ClearanceJoint,
    "ground",
    "rod",
    bearing_radius=0.01,
    journal_length=0.02,
    law=laws.Hertz(1e9),
)
BETWEEN = "ground", "rod", ZERO, ZERO
revolute = functools.partial(cj.RevoluteJoint, *BETWEEN)
driver = functools.partial(cj.PrescribedRotation, "ground", "rod")
spring = functools.partial(cj.SpringDamper, *BETWEEN)

CONSTRUCTION = [
    (lambda: cj.Body(0.0, (1, 1, 1)), "`mass` ... positive ... 0.0 ... give the mass in kg"),
    (lambda: cj.Body((1, 2), (1, 1, 1)), "`mass` ... () ... [1.0, 2.0] ... single number"),
    (lambda: cj.Body(1, (1, NAN, 1)), "`inertia`" + NOT_A_NUMBER),
    (lambda: cj.Body(1, (1, 1)), "`inertia` ... (3,) or (3, 3) ... [1.0, 1.0] ... give"),
    (lambda: cj.Body(1, (1, -1, 1)), "`inertia` ... positive definite ... -1.0 ... every body"),
    (lambda: cj.Body(1, (1, 1, 2.1)), "`inertia` ... exceeds the sum ... 2.1 ... check the order"),
    (lambda: cj.Body(1, np.diag([0.1, 3, 1])), "`inertia` ... exceeds the sum ... 3.0 ... units"),
    (lambda: cj.Scene({}), "`bodies` ... at least one body ... {} ... pass {name: Body"),
    (lambda: cj.Scene({"ground": BODY}), "`bodies` ... name of the fixed ... 'ground' ... rename"),
    (lambda: cj.Scene({"": BODY}), "`bodies` ... non-empty ... '' ... name every"),
    (
        lambda: cj.Scene({"rod": 1.0}),
        "`bodies['rod']` ... one of Body ... 'float' ... pass an element",
    ),
    (
        lambda: cj.Scene(BODIES, {"x": revolute(AXIS, AXIS)}, {"x": spring(1.0)}),
        "`forces` ... other names ... ['x'] ... rename",
    ),
    (
        lambda: cj.RevoluteJoint("rod", "rod", ZERO, ZERO, AXIS, AXIS),
        "`second` ... another body ... 'rod' ... name two bodies",
    ),
    (lambda: cj.SphericalJoint(1, "rod", ZERO, ZERO), "`first` ... name of a body ... 1 ... pass"),
    (lambda: revolute(ZERO, AXIS), "`axis_first`" + NO_LENGTH),
    (lambda: revolute(AXIS, ZERO), "`axis_second`" + NO_LENGTH),
    (lambda: cj.PrismaticJoint(*BETWEEN, AXIS, (1, 1, 0, 0)), "`orientation`" + NO_ROTATION),
    (lambda: driver(ZERO, 1.0), "`axis`" + NO_LENGTH),
    (lambda: driver(AXIS, NAN), "`speed`" + NOT_A_NUMBER),
    (lambda: spring(-1.0), "`stiffness` ... zero or positive ... -1.0 ... SI units"),
    (
        lambda: pin(journal_radius=0.01),
        "`journal_radius` ... smaller than the bearing's ... 0.01 ... RevoluteJoint",
    ),
    (lambda: pin(clearance=0.0), "`clearance` ... positive ... 0.0 ... in m"),
    (
        lambda: pin(clearance=0.5),
        "`clearance` ... smaller than the bearing's radius 0.01 ... 0.5 ... check the units",
    ),
    (
        lambda: pin(),
        "`clearance` ... if and only if `journal_radius` is not ... None ... one of the",
    ),
    (
        lambda: pin(journal_radius=0.009, clearance=0.001),
        "`clearance` ... if and only if ... 0.001 ... pass one of the two",
    ),
    (lambda: pin(clearance=1e-4, bearing_axis=ZERO), "`bearing_axis`" + NO_LENGTH),
    (lambda: pin(clearance=1e-4, journal_axis=ZERO), "`journal_axis`" + NO_LENGTH),
    (
        lambda: pin(clearance=1e-4, journal_length=-1),
        "`journal_length` ... positive ... -1.0 ... m",
    ),
    (
        lambda: cj.EndPlay(0.01, laws.Hertz(laws.RavnStiffness(2e11, 0.3))),
        "`law` ... explicit stiffness ... RavnStiffness ... N/m^n",
    ),
    (lambda: cj.EndPlay(-0.01, laws.Hertz(1e9)), "`play` ... zero or positive ... -0.01 ... m"),
    (
        lambda: laws.LankaraniNikravesh(1.1, 1e9),
        "`restitution` ... in [0.0, 1.0] ... 1.1 ... 1 is elastic",
    ),
    (lambda: laws.Hertz(-1e9), "`stiffness` ... positive ... -1 ... give K"),
    (lambda: laws.Hertz(1e9, 0.5), "`exponent` ... at least 1 ... 0.5 ... 1.5"),
    (lambda: laws.Hertz(1e9, smoothing=0.0), "`smoothing` ... positive ... 0.0 ... None"),
    (
        lambda: laws.HuntCrossley(0.9, 1e9, entry_speed_floor=0),
        "`entry_speed_floor` ... positive ... 0.0 ... e.g. 1e-6",
    ),
    (lambda: laws.RavnStiffness(2e11, 0.6), "`poisson_ratio` ... [-1.0, 0.5] ... 0.6 ... give nu"),
    (lambda: laws.RavnStiffness(0, 0.3), "`young_modulus` ... positive ... 0.0 ... Pa"),
    (
        lambda: frictions.RegularisedCoulomb(-0.1),
        "`coefficient` ... zero or positive ... -0.1 ... give mu",
    ),
    (
        lambda: frictions.Ambrosio(0.1, 1e-3, 1e-4),
        "`upper_speed` ... above lower_speed = 0.001 ... 0.0001 ... give v1 > v0",
    ),
    (lambda: cj.Baumgarte(-5.0), "`alpha` ... zero or positive ... -5.0 ... 1/s"),
    (lambda: cj.body_state(ZERO, (1, 1, 0, 0)), "`orientation`" + NO_ROTATION),
    (lambda: cj.body_state((NAN, 0, 0)), "`position`" + NOT_A_NUMBER),
]

SCENE = cj.Scene(BODIES)
STATE = cj.State({"rod": cj.body_state(ZERO)})
HELD = cj.Scene(BODIES, {"ball": cj.SphericalJoint("ground", "rod", ZERO, (0.5, 0.0, 0.0))})
APART = cj.State({"rod": cj.body_state((-0.25, 0, 0))})
DRIVEN = cj.State({"rod": cj.body_state((-0.5, 0, 0), velocity=(0, 0.2, 0))})
INFINITE = cj.State({"rod": cj.BodyState(*(np.full(n, np.inf) for n in (3, 4, 3, 3)))})


def run(*, scene=SCENE, state=STATE, end_time=1.0, **options):
    return lambda: cj.simulate(scene, state, end_time, **options)


def saved(times):
    return lambda: cj.simulate(SCENE, STATE, 1.0, save=cj.Saving(times))


RUN = [
    (run(end_time=-1.0), "`end_time` ... after start_time ... -1.0 ... in s"),
    (run(start_time=1.0), "`end_time` ... finite and after start_time = 1 ... 1.0 ... in s"),
    (run(end_time=np.inf), "`end_time` ... finite ... inf ... give times in s"),
    (saved([-0.1, 0.5]), "`times` ... between start_time = 0 ... -0.1 ... leave out"),
    (saved([0.1, 1.5]), "`times` ... end_time = 1.0 ... 1.5 ... leave out the times outside"),
    (run(state=STATE.bodies), "`state` ... a State ... 'dict' ... pass State("),
    (run(state=cj.State({})), "`state` ... the scene's bodies ['rod'] ... [] ... give each body"),
    (
        run(state=cj.State({**STATE.bodies, "crank": STATE.bodies["rod"]})),
        "`state` ... the scene's bodies ['rod'] ... ['crank', 'rod'] ... one state",
    ),
    *(
        (
            run(state=cj.State({"rod": cj.BodyState(*map(np.array, (ZERO, euler, ZERO, ZERO)))})),
            f"`state.bodies['rod'].orientation` ... about unit norm ... {[*euler]}"
            " ... body_state(...)",
        )
        for euler in ((1.2, 0.0, 0.0, 0.0), (0.8, 0.0, 0.0, 0.0))
    ),
    (run(state=INFINITE), "`state.bodies['rod'].position` ... finite ... inf ... replace"),
    (
        run(scene=HELD, state=APART),
        "`state` ... 'ball: translation x' at most 1e-06 ... -0.25 ... call assemble",
    ),
    (
        run(scene=HELD, state=DRIVEN),
        "`state` ... velocities ... 'ball: translation y' ... -0.2 ... assemble",
    ),
    (run(scene=jax.tree.map(lambda leaf: -leaf, SCENE)), "`mass` ... positive ... -1.0 ... kg"),
]


GEARBOX = cj.Backlash("ground", "rod", play=0.01, torsional_stiffness=1e4)
GEARED = cj.Scene(BODIES, {"hinge": revolute(AXIS, AXIS), "box": GEARBOX})
LOOP, LOOP_STATE = cj.mechanisms.four_bar({"crank pin": 1e-4})
BOLD, BOLD_STATE = cj.mechanisms.double_pendulum(friction=frictions.Dahl(0.1))


def pushed(force):
    return cj.Scene(BODIES, forces={"push": cj.AppliedLoad("rod", force=(force, 0.0, 0.0))})


class Forgetful(cj.extend.AbstractSampledForce):
    """Returns only one of the numbers in its memory."""

    def body_names(self):
        return ("rod",)

    def instants(self):
        return {"sample": cj.extend.Periodic(0.01)}

    def initial_memory(self, motions, t):
        return {"a": 0.0, "b": 0.0}

    def updated_memory(self, name, memory, motions, t):
        return {"a": 0.0}

    def held_wrenches(self, memory, motions, t):
        return {}


class Astray(cj.extend.AbstractForce):
    """Acts on a body that the scene does not have."""

    def body_names(self):
        return ("rod",)

    def wrenches(self, motions, t):
        return {"lever": cj.extend.NO_WRENCH}


def assembled(**options):
    return cj.assemble(LOOP, LOOP_STATE, **options)


def report(scene=LOOP, state=LOOP_STATE, **options):
    return cj.constraint_report(scene, state, **options)


def mechanism(name, **options):
    return getattr(cj.mechanisms, name)(**options)


def still(**options):
    motion = {"position": ZERO, "orientation": (1, 0, 0, 0), "velocity": ZERO, "spin": ZERO}
    return cj.testing.moving(**{**motion, **options})


# Values of another kind than the documented one, for which a text or a bare number stands.
WRONG_KINDS = [
    (lambda: cj.Body.box("wide", mass=1.0), "`lengths` ... numbers ... 'wide' ... in m"),
    (lambda: cj.Body.rod("1 m", mass=1.0), "`length` ... numbers ... '1 m' ... in m"),
    (lambda: cj.rotation(AXIS, "30 deg"), "`angle` ... numbers ... '30 deg' ... in rad"),
    (
        lambda: cj.DriveTorque("ground", "rod", AXIS, "2 N m"),
        "`torque` ... numbers ... '2 N m' ... in N m",
    ),
    (
        lambda: cj.AppliedLoad("rod", torque=("big", 0, 0)),
        "`torque` ... numbers ... 'big' ... in N m",
    ),
    (
        lambda: cj.Motor("ground", "rod", AXIS, "up", 1.0, 1.0),
        "`target` ... number ... 'up' ... rad",
    ),
    (
        lambda: cj.Servo("ground", "rod", AXIS, 0.0, 100.0, 1.0, encoder="link"),
        "`encoder` ... Encoder ... 'link' ... pass Encoder",
    ),
    (lambda: laws.Hertz(1e9, exponent="1.5"), "`exponent` ... numbers ... '1.5' ... float"),
    (
        lambda: laws.HuntCrossley(0.5, 1e9, exponent=None),
        "`exponent` ... numbers ... None ... float",
    ),
    (lambda: pin(clearance=1e-4, bearing_profile="oval"), "`bearing_profile` ... AbstractProfile"),
    (lambda: pin(clearance=1e-4, journal_profile=1e-6), "`journal_profile` ... AbstractProfile"),
    (
        lambda: cj.Body(1.0, (1.0, 1.0, 1.0), is_massless="no"),
        "`is_massless` ... True or False ... 'no' ... bool",
    ),
    (
        lambda: cj.GearJoint("ground", "a", "b", AXIS, AXIS, 17, 51, internal="no"),
        "`internal` ... True or False ... 'no' ... bool",
    ),
    (lambda: cj.carried_journal(pin(clearance=1e-4), (0, -1), 1.0), "`joint` ... LubricatedJoint"),
    (
        lambda: cj.Stop("ground", "rod", normal=AXIS, law=laws.Hertz(1e9), end_point_second=ZERO),
        "`end_point_second` ... another point ... [0.0, 0.0, 0.0] ... leave it out",
    ),
    (
        lambda: cj.Peak(lambda instant: 0.0, "m", until="1 s"),
        "`until` ... number ... '1 s' ... in s",
    ),
    (
        lambda: cj.assemble(GEARED, STATE, resting=["box"]),
        "`resting` ... names of clearance joints [] ... 'box' ... leave out",
    ),
    (lambda: assembled(resting=None), "`resting` ... list of names ... None ... pass"),
    (lambda: assembled(moving="no"), "`moving` ... True or False ... 'no' ... bool"),
    (lambda: assembled(centred="pin"), "`centred` ... True or False ... 'pin' ... bool"),
    (lambda: assembled(t=NAN), "`t`" + NOT_A_NUMBER),
    (lambda: assembled(t="now"), "`t` ... number ... 'now' ... float"),
    (lambda: report(scene=3), "`scene` ... a Scene ... 'int' ... pass one"),
    (lambda: report(state=STATE), "`state` ... scene's bodies ... ['rod'] ... give each body"),
    (lambda: report(coordinates="joint"), "`coordinates` ... 'str' ... JointCoordinates()"),
    (lambda: report().columns(["rod"]), "`bodies` ... names of ... 'rod' ... correct"),
    (lambda: mechanism("four_bar", lengths=(1, 2, 3)), "`lengths` ... (4,) ... give 4"),
    (lambda: mechanism("four_bar", masses=(1, 2)), "`masses` ... (3,) ... give 3"),
    (lambda: mechanism("four_bar", angle=None), "`angle` ... number ... None ... float"),
    (lambda: mechanism("robot_arm", angles=(0, 0)), "`angles` ... (3,) ... one for each motor"),
    (lambda: mechanism("gear_pair", teeth=(20,)), "`teeth` ... (2,) ... the wheel"),
    (lambda: mechanism("gear_pair", module=0.0), "`module` ... positive ... 0.0 ... 3e-3 m"),
    (
        lambda: mechanism("guided_slider_crank", speed="fast"),
        "`speed` ... number ... 'fast' ... rad/s",
    ),
    (
        lambda: cj.State(BOLD_STATE.bodies, memory={"servo": 1.0}),
        "`memory['servo']` ... dictionary",
    ),
    (lambda: cj.State(BOLD_STATE.bodies, entry_speeds=[1.0]), "`entry_speeds` ... dictionary"),
    (lambda: cj.testing.check_law(1e9), "`law` ... AbstractContactLaw ... subclass"),
    (
        lambda: cj.testing.check_friction(frictions.Dahl(0.1)),
        "`friction` ... AbstractFriction ... Dahl ... subclass",
    ),
    (lambda: cj.testing.check_film(0.02), "`film` ... AbstractFilm ... 0.02 ... subclass"),
    (
        lambda: cj.testing.check_constraint(revolute(AXIS, AXIS), {}),
        "`motions` ... 'ground' ... add",
    ),
    (lambda: cj.testing.check_force(spring(1.0), {}), "`motions` ... 'ground' ... add it"),
    (
        lambda: cj.testing.check_contact_joint(pin(clearance=1e-4), {}),
        "`motions` ... 'rod' ... add it",
    ),
    (lambda: still(orientation=(0, 0, 0, 0)), "`orientation` ... other than zero ... pass (1, 0"),
    (lambda: still(position=(0, 0)), "`position` ... (3,) ... pass 3 numbers"),
]


def bold(**parts):
    return cj.simulate(BOLD, cj.State(BOLD_STATE.bodies, **parts), 1e-4)


class Rubbing(cj.extend.AbstractContactJoint):
    """Friction by which a rod in a ball joint resists its rotation."""

    friction: cj.extend.AbstractFriction

    def pair(self):
        return "ground", "rod"

    def laws(self):
        return {"face": laws.Hertz(1e9)}

    def contacts(self, motions):
        origin, slip = cj.extend.ZERO, motions["rod"].direction(motions["rod"].spin)
        gap = cj.extend.Gap(1e-6, 0.0)
        return {"face": cj.extend.Contact(gap, origin, origin, origin, slip, lever=1.0)}

    def friction_force(self, name, contact, normal_force):
        return self.friction.force(normal_force, contact.slip)


def rubbed(rubbing):
    scene = cj.Scene(BODIES, {"ball": cj.SphericalJoint(*BETWEEN), "rubbing": rubbing})
    return lambda: cj.simulate_nonsmooth(scene, STATE, 0.1, step=1e-3)


SLIDING = frictions.RegularisedCoulomb(0.1)
WRONG_KINDS_IN_RUNS = [
    (
        rubbed(Rubbing(SLIDING)),
        "`scene.joints['rubbing']` ... not friction ... 'Rubbing' ... leave",
    ),
    (
        rubbed(cj.JointFriction("ground", "rod", SLIDING, 1.0, radius=1.0)),
        "`scene.joints['rubbing']` ... not friction of an ideal ... 'JointFriction' ... simulate()",
    ),
    (
        lambda: bold(bristles={"shoulder": {"X": ZERO}}),
        "state.bristles['shoulder'] ... one of ['V', 'W']",
    ),
    (lambda: bold(bristles={"shoulder": {"V": (0, 0)}}), "`state.bristles` ... (3,) ... give each"),
    (lambda: bold(entry_speeds={"shoulder": {"V": [1, 2]}}), "`state.entry_speeds` ... ()"),
    (
        run(scene=pushed(lambda t: math.sin(t))),
        "`function` ... JAX can trace ... jax.numpy",
    ),
    (run(scene=pushed(lambda t: 1.0 if t < 0.5 else 0.0)), "`function` ... JAX can trace"),
    (run(scene=pushed(lambda t: np.sin(t))), "`function` ... JAX can trace ... jax.numpy"),
    (
        run(scene=cj.Scene(BODIES, forces={"memory": Forgetful()})),
        "Forgetful.updated_memory` ... ['a', 'b'] ... ['a'] ... return {**memory",
    ),
    (
        run(scene=cj.Scene(BODIES, forces={"load": Astray()})),
        "`wrenches` ... on bodies ['rod'] ... 'lever' ... `body_names`",
    ),
]
BAD_INPUT = [*CONSTRUCTION, *RUN, *WRONG_KINDS, *WRONG_KINDS_IN_RUNS]


@pytest.mark.parametrize(("make", "words"), BAD_INPUT, ids=[words for _, words in BAD_INPUT])
def test_bad_input_is_refused_with_a_message_that_helps(make, words):
    """Dots stand for any text, as in doctests."""
    pattern = ".*".join(map(re.escape, words.split(" ... ")))
    with pytest.raises(ValueError, match=f"(?s){pattern}") as caught:
        make()
    assert re.fullmatch(r"(?s)Argument `.+` must be .+, but is .+: .+\.", str(caught.value))


@contextlib.contextmanager
def single_precision():
    jax.config.update("jax_enable_x64", False)
    try:
        yield
    finally:
        jax.config.update("jax_enable_x64", True)


def test_single_precision_is_refused_unless_asked_for():
    with single_precision(), pytest.raises(ValueError) as caught:
        cj.simulate(SCENE, STATE, 1.0)
    for word in ("32-bit", "penetrations", "clearjoint.configure()", "allow_float32=True"):
        assert word in str(caught.value)


def test_assembly_that_cannot_succeed_names_the_worst_constraint():
    """Two points of the rod that are 1 m apart shall meet two of the ground that are 3 m apart."""
    ends = {"left": ((-1.5, 0, 0), (-0.5, 0, 0)), "right": ((1.5, 0, 0), (0.5, 0, 0))}
    joints = {name: cj.SphericalJoint("ground", "rod", *ends[name]) for name in ends}
    with pytest.raises(ValueError, match=r"(?s)`state`.*constraint '(left|right): .*better guess"):
        cj.assemble(cj.Scene(BODIES, joints), STATE)


def test_values_under_a_transformation_pass():
    """Checks need values; a traced one has none yet."""
    masses = jax.vmap(lambda mass: cj.Body(mass, (1.0, 1.0, 1.0)).mass)(np.array([1.0, -1.0]))
    np.testing.assert_array_equal(masses, [1.0, -1.0])


def test_distances_of_points_are_not_checked_from_bodies_with_traced_numbers():
    spring = cj.SpringDamper("ground", "ball", (0, 0, 0), (1e3, 0, 0), stiffness=100.0)

    def mass_of(mass):
        body = cj.Body(mass, (1e-3, 1e-3, 1e-3))
        return cj.Scene({"ball": body}, forces={"spring": spring}).bodies["ball"].mass

    assert jax.eval_shape(mass_of, 1.0).shape == ()
    with pytest.warns(cj.UnusualValueWarning, match="from the centre of mass"):
        mass_of(1.0)

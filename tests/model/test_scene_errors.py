"""Bad inputs: each raises a `ValueError` that names the argument, value, expectation and remedy.

Typical mistakes of new users are in tests/test_first_contact.py.
"""

import contextlib
import functools
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


BAD_INPUT = [*CONSTRUCTION, *RUN]


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

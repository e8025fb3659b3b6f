"""A scene's program holds only what the scene requires: jaxprs with and without each feature."""

from collections import Counter

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import clearjoint as cj
from clearjoint._dynamics import system as dynamics
from clearjoint._dynamics.bristles import initial_bristles
from clearjoint._dynamics.contact_events import uses_entry_speed
from clearjoint._math.vectors import fold_constants
from clearjoint._simulation.run.host_run import begin
from clearjoint._simulation.step.discontinuities import may_have_undeclared_jump
from clearjoint._simulation.step.landing import Landing
from clearjoint._simulation.step.method import Scheme
from clearjoint._simulation.step.step_state import Method, Variables
from clearjoint._simulation.step.stepping import attempt, start
from clearjoint._simulation.step.trial_step import term_of
from clearjoint.extend import Formulation, System, unpack
from clearjoint.frictions import Dahl, RegularisedCoulomb
from clearjoint.laws import Hertz, LankaraniNikravesh
from tests.support.one_body import ORIGIN, Z, bearing, hinge
from tests.support.programs import primitives

BODY = cj.Body(1.0, (1.0, 1.0, 1.0))
STATE = cj.State({"rod": cj.body_state(ORIGIN)})
BASES = {"pin": {"V": np.zeros(()), "W": np.zeros(())}}


def scene(joint=None, **options):
    return cj.Scene({"rod": BODY}, {} if joint is None else {"pin": joint}, **options)


def pin(law, **options):
    return bearing(law, "rod", **options)


DAMPED, ELASTIC = LankaraniNikravesh(0.9, 1e9), Hertz(1e9)
FREE = scene()
FORCED = pin(ELASTIC)
ROUGH = pin(ELASTIC, friction=RegularisedCoulomb(0.1))
BRISTLED = pin(ELASTIC, friction=Dahl(0.1))
BALL = cj.SphericalJoint("ground", "rod", ORIGIN, (0.5, 0.0, 0.0))
DRIVER = cj.PrescribedRotation("ground", "rod", Z, 3.0)
HINGE = hinge("ground", "rod", point_second=(0.5, 0.0, 0.0))


def operations(of, entry_speeds=None, **formulation):
    """Primitives of the equations of motion of a scene in absolute coordinates."""

    def rates(scene, state, entry_speeds):
        absolute = Formulation(cj.AbsoluteCoordinates(), **formulation)
        bristles = initial_bristles(unpack(scene), {})
        system = System(unpack(scene), absolute)
        return system.rates(unpack(state.bodies), entry_speeds, 0.0, bristles=bristles)

    return primitives(jax.make_jaxpr(rates)(of, STATE, entry_speeds or {}).jaxpr)


def test_free_body_solves_no_constraints(monkeypatch):
    """It divides by its mass, its three moments and the norm of its Euler parameters only."""
    monkeypatch.setattr(dynamics, "ConstraintEquations", None)
    free = operations(FREE)
    assert free["div"] == 5
    assert free["max"] == free["select_n"] == free["sqrt"] == free["tanh"] == 0
    bodies, formulation = unpack(STATE.bodies), Formulation(cj.AbsoluteCoordinates())
    assert System(unpack(FREE), formulation).dynamics(bodies, {}, 0.0).multipliers == {}
    with pytest.raises(TypeError):
        operations(scene(BALL))


def test_constraints_cost_one_division_each():
    free, ball = operations(FREE), operations(scene(BALL), stabilisation=cj.Unstabilised())
    assert ball["div"] == free["div"] + 3


ADDED = {
    "gravity": (FREE, scene(gravity=(0, -9.81, 0)), {}),
    "load": (FREE, scene(forces={"push": cj.AppliedLoad("rod", (1, 0, 0))}), {}),
    "ball": (FREE, scene(BALL), {}),
    "two more rows": (scene(BALL), scene(HINGE), {}),
    "clearance joint": (FREE, scene(FORCED), {}),
    "damping": (scene(FORCED), scene(pin(DAMPED)), BASES),
    "friction": (scene(FORCED), scene(ROUGH), {}),
    "bristles": (scene(FORCED), scene(BRISTLED), {}),
    "smoothing": (scene(FORCED), scene(pin(Hertz(1e9, smoothing=1e-6))), {}),
    "contact along the length": (scene(FORCED), scene(pin(ELASTIC, line_points=3)), {}),
    "end play": (scene(FORCED), scene(pin(ELASTIC, axial=cj.EndPlay(0.01, ELASTIC))), {}),
    "thrust faces": (
        scene(pin(ELASTIC, axial=cj.EndPlay(0.01, ELASTIC))),
        scene(pin(ELASTIC, axial=cj.EndPlay(0.01, ELASTIC, RegularisedCoulomb(0.1), 0.012))),
        {},
    ),
    "axial constraint": (scene(FORCED), scene(pin(ELASTIC, axial=cj.FixedAxially())), {}),
}


@pytest.mark.parametrize("feature", ADDED)
def test_feature_only_adds_operations(feature):
    without, with_it, entry_speeds = ADDED[feature]
    fewer, more = operations(without), operations(with_it, entry_speeds)
    assert fewer - more == Counter()
    assert more.total() > fewer.total()


@pytest.mark.parametrize(
    ("less", "more"),
    [
        ({}, {"ledger": True}),
        ({}, {"redundant": True}),
        ({"stabilisation": cj.Unstabilised()}, {"stabilisation": cj.Baumgarte()}),
    ],
    ids=["ledger", "redundant", "stabilisation"],
)
def test_choice_only_adds_operations(less, more):
    fewer, others = operations(scene(HINGE), **less), operations(scene(HINGE), **more)
    assert fewer - others == Counter() and others.total() > fewer.total()


def test_operations_of_friction_and_damping_are_there_only_with_them():
    """Friction's tanh once, also with the ledger; of damping, the clamp of the force and the floor
    of the entry speed."""
    assert operations(scene(FORCED))["tanh"] == operations(scene(FORCED))["max"] == 0
    rough, booked = (operations(scene(ROUGH), ledger=ledger)["tanh"] for ledger in (False, True))
    assert rough == booked > 0
    assert operations(scene(pin(DAMPED)), BASES)["max"] == 4


def test_ledger_of_a_free_body_is_empty():
    assert operations(FREE, ledger=True) == operations(FREE)


def test_power_of_the_ledger_is_only_what_the_scene_can_have():
    def booked(of, entry_speeds):
        formulation = Formulation(cj.AbsoluteCoordinates(), ledger=True)
        system = System(unpack(of), formulation)
        return set(system.rates(unpack(STATE.bodies), entry_speeds, 0.0)[1])

    assert booked(scene(BALL), {}) == {"stabilisation"}
    assert booked(scene(DRIVER), {}) == {"stabilisation", "supplied"}
    assert booked(scene(pin(DAMPED)), BASES) == {"normal damping"}
    assert booked(scene(ROUGH), {}) == {"normal damping", "friction"}


def scheme():
    controller = diffrax.PIDController(rtol=1e-6, atol=1e-9)
    return Scheme(Method(diffrax.Tsit5(), controller, Landing(1e-12)), Formulation())


def tried(of, step):
    """A step of a run."""
    return attempt(scheme().method, scheme().system(unpack(of)), step, 1.0).step


def started(of):
    """The run before its first step, in shapes only."""
    numbers = [np.float64(t) for t in (0.0, 1.0, 1e-6)]
    return jax.eval_shape(lambda of, state: begin(scheme(), of, state, *numbers, {})[0], of, STATE)


def attempted(of):
    """Primitives of a step of a run."""
    return primitives(jax.make_jaxpr(tried)(of, started(of)).jaxpr)


def test_scene_without_memory_has_none_in_its_state():
    assert not uses_entry_speed(scene(FORCED)) and uses_entry_speed(scene(pin(DAMPED)))
    assert started(scene(FORCED)).entry_speeds == {}
    shouldered = pin(DAMPED, axial=cj.EndPlay(0.01, ELASTIC))
    for joint in (pin(DAMPED), shouldered):
        entry_speeds = started(scene(joint)).entry_speeds
        assert {name: set(family) for name, family in entry_speeds.items()} == {"pin": {"V", "W"}}


def test_bristles_are_in_the_state_of_their_contacts_alone():
    """Shoulders have no friction, and other laws no bristles."""
    assert started(scene(ROUGH)).y.bristles == {}
    axial = cj.EndPlay(0.01, ELASTIC)
    bristles = started(scene(pin(ELASTIC, friction=Dahl(0.1), axial=axial))).y.bristles
    assert {name: set(family) for name, family in bristles.items()} == {"pin": {"V", "W"}}


class Jumping(Hertz):
    """Hertz's force, which isn't said to begin at zero."""

    force_jumps = True


class Switched(cj.AppliedLoad):
    """A load that declares a breakpoint."""

    def breakpoints(self):
        return 0.5


@pytest.mark.slow
def test_step_without_memory_finds_no_second_rates():
    """Only what begins with a contact is decided by a conditional of the step, beside that of
    landing, which looks for a contact's begin or end only where there may be one."""
    free, forced, damped = (
        attempted(of)["cond"] for of in (FREE, scene(FORCED), scene(pin(DAMPED)))
    )
    assert (forced, damped) == (free + 1, free + 2)


def test_jumps_and_breakpoints_are_looked_for_only_where_there_may_be_some():
    """What follows of them is decided by one more conditional of the step each."""

    def pushed(kind):
        return attempted(scene(forces={"push": kind("rod", (1, 0, 0))}))

    for fewer, more in (
        (attempted(scene(FORCED)), attempted(scene(pin(Jumping(1e9))))),
        (pushed(cj.AppliedLoad), pushed(Switched)),
    ):
        assert fewer - more == Counter()
        assert more["cond"] == fewer["cond"] + 1
    # Where only the slope of a force jumps, derivatives alone are corrected.
    linear = attempted(scene(pin(Hertz(1e9, exponent=1.0))))
    assert linear["cond"] == attempted(scene(FORCED))["cond"]


class Gate(cj.AppliedLoad):
    """A load of an own class that compares a place."""

    def wrenches(self, motions, t):
        loads = super().wrenches(motions, t)
        open_ = motions["rod"].position.x > 0.0
        return {name: jax.tree.map(lambda part: part * open_, load) for name, load in loads.items()}


def test_unseen_jumps_are_looked_for_only_where_a_class_of_ones_own_decides_by_the_motion():
    def pushed(kind):
        return scene(forces={"push": kind("rod", (1, 0, 0))})

    for of in (FREE, scene(pin(DAMPED)), pushed(cj.AppliedLoad), pushed(Switched)):
        assert not may_have_undeclared_jump(unpack(of))
    for of in (pushed(Gate), scene(pin(Jumping(1e9)))):
        assert may_have_undeclared_jump(unpack(of))


def test_step_without_derivatives_does_not_ask_since_when_contacts_exist():
    assert started(scene(pin(DAMPED))).proposal.time_since_onset is None


def test_without_an_onset_at_the_start_the_latest_one_is_long_past():
    method, system = scheme().method, scheme().system(unpack(scene(pin(DAMPED))))
    y = Variables(system.encode(unpack(STATE.bodies)), {})
    times = (jnp.asarray(t) for t in (0.0, 1.0, 1e-6))
    step = start(method, term_of(method), system, *times, y, {}, derivatives=True)
    assert not bool(step.proposal.begins_contact)
    assert float(step.proposal.time_since_onset) == np.inf


def test_ground_is_not_in_the_state():
    step = started(scene(FORCED))
    assert set(step.y.motion) == {"rod"}
    assert len(jax.tree.leaves(step.y)) == 13
    assert len(jax.tree.leaves(started(FREE).contact_gaps)) == 0


def test_a_tree_solves_no_constraints(monkeypatch):
    """Neither stabilisation nor projection nor multipliers are traced."""
    monkeypatch.setattr(dynamics, "ConstraintEquations", None)
    scene, state = cj.mechanisms.double_pendulum()
    scene, bodies = unpack(fold_constants(scene)), unpack(state.bodies)
    system = System(scene, Formulation(cj.JointCoordinates(), cj.Projection()))
    variables, entry_speeds = system.encode(bodies), {"shoulder": {"V": 0.1, "W": 0.1}}
    assert system.dynamics(variables, entry_speeds, 0.0).multipliers == {}
    assert not system.is_constrained(0.0)
    absolute = System(scene, Formulation(cj.AbsoluteCoordinates()))
    assert absolute.is_constrained(0.0)
    assert system.project(variables, 0.0) is variables

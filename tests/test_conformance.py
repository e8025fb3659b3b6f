"""The conformance checks accept all laws and joints of the package and refuse broken ones."""

import warnings
from dataclasses import fields, replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import clearjoint as cj
from clearjoint.extend import AbstractDampedLaw, AbstractHertzianLaw, optional_quantity, quantity
from clearjoint.testing import (
    check_bristles,
    check_constraint,
    check_contact_joint,
    check_force,
    check_friction,
    check_law,
    moving,
)
from studies.catalogue import frictions
from tests.support.dropped_rod import dropped_rod
from tests.support.elements import FIRST, SECOND, THIRD, elements
from tests.support.laws import contact_laws
from tests.support.many_states import states
from tests.support.slow import slow, slow_but
from tests.support.symmetry_transformations import with_fields

STEEL = cj.laws.RavnStiffness(207e9, 0.3)


class GonthierLaw(AbstractDampedLaw):
    """A user-defined law with one method: chi = (1 - c^2)/c."""

    restitution: Any = quantity("1")
    stiffness: cj.extend.AbstractStiffness
    exponent: float = eqx.field(default=1.5, static=True)
    entry_speed_floor: Any = quantity("m/s", default=1e-6)
    smoothing: Any = optional_quantity("m")

    def damping_factor(self) -> Any:
        return (1 - self.restitution**2) / self.restitution


def test_third_party_law_conforms_and_runs():
    law = GonthierLaw(0.8, STEEL)
    check_law(law)
    scene, state = dropped_rod()
    scene = eqx.tree_at(lambda s: s.joints["pin"].law, scene, law)
    solution = cj.simulate(scene, state, 0.012, save=cj.Saving(impacts=True))
    assert len(solution.impacts) == 2


class Pulling(AbstractHertzianLaw):
    """Adhesive by mistake: the force turns negative at separation."""

    stiffness: cj.extend.AbstractStiffness
    exponent: float = eqx.field(default=1.5, static=True)
    smoothing: Any = optional_quantity("m")
    uses_entry_speed = True

    def damping_factor(self) -> Any:
        return 0.5

    def force(self, gap, entry_speed):
        return self.elastic_force(gap) * (1 + 0.5 * gap.rate / entry_speed)


class SpikedDerivative(Pulling):
    """A derivative that is infinite at the onset."""

    uses_entry_speed = False

    def force(self, gap, entry_speed):
        return self.elastic_force(gap)

    def elastic_force(self, gap):
        return jnp.sqrt(jnp.maximum(gap.depth, 0.0))

    def stored_energy(self, gap):
        return 2 / 3 * jnp.maximum(gap.depth, 0.0) ** 1.5


class Generating(Pulling):
    """Damping of the wrong sign."""

    def force(self, gap, entry_speed):
        return self.elastic_force(gap) * jnp.maximum(1 - 0.5 * gap.rate / entry_speed, 0.0)


class Frozen(Pulling):
    """Damping whose derivatives are cut off."""

    def force(self, gap, entry_speed):
        damped = jax.lax.stop_gradient(jnp.maximum(1 + 0.5 * gap.rate / entry_speed, 0.0))
        return self.elastic_force(gap) * damped


class Cut(Pulling):
    """A spring whose derivative by the depth is cut off."""

    uses_entry_speed = False

    def force(self, gap, entry_speed):
        return jax.lax.stop_gradient(self.elastic_force(gap))


class Blind(Pulling):
    """Damping that ignores an unknown entry speed."""

    def force(self, gap, entry_speed):
        entry_speed = jnp.minimum(entry_speed, 100.0)
        return self.elastic_force(gap) * jnp.maximum(1 + 0.5 * gap.rate / entry_speed, 0.0)


with warnings.catch_warnings(action="ignore"):
    LAWS = [
        *contact_laws(),
        cj.laws.LankaraniNikravesh(0.0, 1e8, exponent=1.0),
        cj.laws.LankaraniNikravesh(0.9, STEEL, smoothing=1e-7),
        cj.laws.Flores2011(0.2, STEEL, exponent=2.0),
        *(cj.laws.ExactRestitution(restitution, STEEL) for restitution in (0.01, 1.0)),
    ]


@pytest.mark.slow
@pytest.mark.parametrize("law", LAWS, ids=lambda law: type(law).__name__)
def test_laws_conform(law):
    """Without a warning but that of a jump where contact begins, which the law declares."""
    with warnings.catch_warnings(record=True, action="always") as caught:
        check_law(law)
    jumps = ["where contact begins or ends" in str(warning.message) for warning in caught]
    assert all(jumps) and (law.force_jumps or not jumps)


class Buffer(cj.extend.AbstractContactLaw):
    """A spring with a damper beside it (Kelvin-Voigt), clamped at zero: it jumps at the onset."""

    stiffness: Any = quantity("N/m")
    damping: Any = quantity("N s/m")
    preload: Any = quantity("N", default=0.0)
    ahead: Any = quantity("m", default=0.0)
    uses_entry_speed = False

    def onset_offset(self):
        return self.ahead

    def force(self, gap, entry_speed):
        pushed = self.elastic_force(gap) + self.damping * gap.rate
        return jnp.where(gap.depth + self.ahead > 0.0, jnp.maximum(pushed, 0.0), 0.0)

    def elastic_force(self, gap):
        return self.stiffness * jnp.maximum(gap.depth, 0.0)

    def stored_energy(self, gap):
        return 0.5 * self.stiffness * jnp.maximum(gap.depth, 0.0) ** 2


class DeniedBuffer(Buffer):
    """A law with a wrong declaration."""

    force_jumps = False


class Pushing(Buffer):
    """A preload, which jumps at the separation too."""

    def elastic_force(self, gap):
        return super().elastic_force(gap) + jnp.where(gap.depth > 0.0, self.preload, 0.0)

    def stored_energy(self, gap):
        stored = super().stored_energy(gap) + self.preload * gap.depth
        return jnp.where(gap.depth > 0.0, stored, 0.0)


class Stepped(Pulling):
    """Stiffer in compression beyond a depth: a jump inside the contact."""

    uses_entry_speed = False

    def force(self, gap, entry_speed):
        harder = (gap.depth > 3e-7) & (gap.rate > 0.0)
        return self.elastic_force(gap) * jnp.where(harder, 1.2, 1.0)


class Bilinear(Stepped):
    """Softer in restitution: a jump where the rate changes its sign."""

    def force(self, gap, entry_speed):
        return self.elastic_force(gap) * jnp.where(gap.rate > 0.0, 1.2, 1.0)


@pytest.mark.parametrize(
    ("law", "jump"),
    [
        (Buffer(1e8, 50.0), "by 50 N where contact begins or ends, at a rate of 1 m/s"),
        slow(Buffer(1e8, 50.0, ahead=1e-7), "by 50 N where contact begins or ends"),
        slow(Buffer(1e8, 1e-3), "by 0.001 N where contact begins or ends"),
        (Pushing(1e8, 0.0, 20.0), "by 20 N where contact begins or ends"),
    ],
)
def test_laws_that_jump_at_the_onset_cause_a_warning(law, jump):
    with pytest.warns(UserWarning, match=jump):
        check_law(law)


@pytest.mark.parametrize(
    ("law", "complaint"),
    [
        (Pulling(STEEL), "negative"),
        (Generating(STEEL), "creates energy"),
        (SpikedDerivative(STEEL), "derivative"),
        (Frozen(STEEL), "derivative by the rate does not agree"),
        (Cut(STEEL), "derivative by the depth does not agree"),
        (Blind(STEEL), "unknown entry speed"),
        (Stepped(STEEL), "inside the contact, at a depth of 3e-07 m"),
        slow(Bilinear(STEEL), "with the rate, at .* m/s"),
        (DeniedBuffer(1e8, 50.0), "by 50 N .* declares `force_jumps = False`"),
    ],
)
def test_broken_laws_are_refused(law, complaint):
    with pytest.raises(AssertionError, match=complaint):
        check_law(law)


@pytest.mark.parametrize("name", slow_but(["Stribeck"], frictions.LAWS))
def test_friction_conforms(name):
    check_friction(frictions.LAWS[name][0])


@pytest.mark.parametrize("name", slow_but(["ElastoPlastic"], frictions.BRISTLES))
def test_bristles_conform(name):
    check_bristles(frictions.BRISTLES[name][0])


class Creeping(cj.frictions.Dahl):
    def rate(self, deflection, slip):
        return slip - deflection * 1e3


class Endless(cj.frictions.Dahl):
    def rate(self, deflection, slip):
        return slip


class Owing(cj.frictions.Dahl):
    def stored_energy(self, deflection):
        return -super().stored_energy(deflection)


class Sticky(cj.extend.AbstractFriction):
    def ratio(self, slip_speed):
        return jnp.where(slip_speed < 2e-3, slip_speed, 0.1)


class Dry(cj.extend.AbstractFriction):
    def ratio(self, slip_speed):
        return 0.1 + 0.0 * slip_speed


@pytest.mark.parametrize(
    ("check", "friction", "complaint"),
    [
        (check_friction, Sticky(), "jumps by 0.098 at 0.002 m/s"),
        (check_friction, Dry(), "jump"),
        (check_bristles, Creeping(0.1), "creeps"),
        (check_bristles, Endless(0.1), "shrink"),
        (check_bristles, Owing(0.1), "stored_energy"),
    ],
)
def test_broken_frictions_are_refused(check, friction, complaint):
    with pytest.raises(AssertionError, match=complaint):
        check(friction)


MOTIONS = {
    FIRST: moving((0.1, 0.2, 0.3), (0.9, 0.1, -0.3, 0.2), (0.5, -0.4, 0.3), (1.0, 2.0, -0.5)),
    SECOND: moving((-0.3, 0.1, 0.5), (0.4, 0.5, 0.2, -0.6), (-0.2, 0.7, 0.1), (-0.8, 0.3, 1.1)),
    THIRD: moving((0.2, 0.4, -0.1), (0.7, -0.3, 0.5, 0.1), (0.3, 0.2, -0.6), (0.4, -0.9, 0.7)),
}


def elements_of(kind: type) -> dict[str, Any]:
    """The elements of a kind, of each class, by the names of their cases; with long axes."""
    found = {}
    for name, case in elements().items():
        element = (case.scene.joints | case.scene.forces)["element"]
        if isinstance(element, kind):
            values = {field.name: getattr(element, field.name) for field in fields(element)}
            axes = [key for key in values if "axis" in key and values[key] is not None]
            longer = {key: (k + 1.7) * values[key] for k, key in enumerate(axes)}
            found[name] = with_fields(element, **longer)
    return found


class Rod(cj.extend.AbstractConstraint):
    """A massless rod between two centres of mass, by the differentiated residual."""

    length: Any = quantity("m")

    def body_names(self):
        return FIRST, SECOND

    def rows(self, motions, t):
        def residual(first, second):
            apart = first[0] - second[0]
            return (0.5 * (apart.dot(apart) - self.length**2),)

        return cj.extend.rows_from_residual(
            (FIRST, SECOND), ("length",), residual, motions[FIRST], motions[SECOND]
        )


class Swing(cj.extend.AbstractRotationDriver):
    """A user-defined driver."""

    first: str = eqx.field(default=FIRST, static=True)
    second: str = eqx.field(default=SECOND, static=True)
    axis: Any = quantity("1", default=(1.0, -2.0, 0.5))
    orientation: Any = quantity("1", default=(0.5, 0.5, 0.5, -0.5))

    def angle(self, t):
        return 0.4 + 2.0 * t + 0.7 * jnp.sin(3.0 * t + 0.5)


ENDS = FIRST, SECOND, (0.1, 0.2, 0.3), (0.3, -0.1, 0.2)
HINGE = cj.RevoluteJoint(*ENDS, (1, 2, 3), (0, -1, 1))
SLIDER = cj.PrismaticJoint(SECOND, THIRD, (0.1, 0.2, 0.3), (0.3, -0.1, 0.2), (1, 2, 3))
JOINTS = elements_of(cj.extend.AbstractConstraint) | {
    "user-defined driver": Swing(),
    "user-defined rod": Rod(1.0),
    "polynomial of a slider": cj.JointCoupling(HINGE, SLIDER, cj.Polynomial((0.1, -0.7, 0.4))),
    "function of a hinge": cj.JointCoupling(SLIDER, HINGE, jnp.cos),
    "function of time": cj.PrescribedTranslation(*ENDS, (1, 2, 3), jnp.cos),
}


@pytest.mark.parametrize("name", JOINTS)
def test_joints_conform(name):
    check_constraint(JOINTS[name], MOTIONS)


class Forgetful(Swing):
    """A driver without its dependence on time in one part of a row."""

    forgotten: str = eqx.field(default="", static=True)

    def rows(self, motions, t):
        row = super().rows(motions, t)["angle"]
        part = self.relative_angle(motions).bias if self.forgotten == "bias" else 0.0
        return {"angle": replace(row, **{self.forgotten: part})}


class Careless(Rod):
    def rows(self, motions, t):
        return {"length": replace(super().rows(motions, t)["length"], bias=0.0)}


class Renamed(Rod):
    sign: float = eqx.field(default=1.0, static=True)

    def rows(self, motions, t):
        row = super().rows(motions, t)["length"]
        return {"length" if self.sign * t <= 0.0 else "distance": row}


@pytest.mark.parametrize(
    ("joint", "complaint"),
    [
        (Forgetful(forgotten="time_rate"), "time rate"),
        (Forgetful(forgotten="bias"), "bias"),
        (Careless(1.0), "bias"),
        (Renamed(1.0), "names of the rows change"),
        (Renamed(1.0, -1.0), "names of the rows change"),
    ],
)
def test_broken_joints_are_refused(joint, complaint):
    with pytest.raises(AssertionError, match=complaint):
        check_constraint(joint, MOTIONS)


CONTACTS = {
    name: joint
    for name, joint in elements_of(cj.extend.AbstractContactJoint).items()
    if not isinstance(joint, cj.JointFriction)
}
BRISTLES = cj.frictions.Dahl(0.1)
CASES = CONTACTS | {
    f"{name} with bristles": replace(joint, friction=BRISTLES)
    for name, joint in CONTACTS.items()
    if isinstance(getattr(joint, "friction", None), cj.extend.AbstractFriction)
}
APART = cj.Stop, cj.BallOnBall, cj.GearBacklash
"""Joints whose points on both bodies cannot coincide."""


@pytest.mark.parametrize("name", slow_but(["bearing with collars"], CASES))
def test_contact_joints_conform(name):
    """In a random state that satisfies the constraints of the joint's case."""
    case, joint = elements()[name.removesuffix(" with bristles")], CASES[name]
    drawn = states(case, np.random.default_rng(3)).bodies
    motions = {body: moving(*(part[0] for part in jax.tree.leaves(drawn[body]))) for body in drawn}
    check_contact_joint(joint, motions, together=not isinstance(joint, APART))


class Floor(cj.extend.AbstractContactJoint):
    """A floor that stands on one body, under the centre of another."""

    law: cj.extend.AbstractContactLaw = cj.laws.Hertz(1e9)
    friction: cj.extend.AbstractFriction = cj.frictions.RegularisedCoulomb(0.1)

    def pair(self):
        return FIRST, SECOND

    def laws(self):
        return {"floor": self.law}

    def contacts(self, motions):
        floor, ball = motions[FIRST], motions[SECOND]
        down = floor.direction(cj.extend.Vector(0.0, 0.0, -1.0))
        under = floor.components(ball.position - floor.position)
        sliding = ball.velocity - floor.velocity_at(under)
        rate = sliding.dot(down)
        gap, slip = cj.extend.Gap(-under.z, rate), sliding - down * rate
        return {"floor": cj.extend.Contact(gap, down, under, cj.extend.ZERO, slip)}

    def friction_force(self, name, contact, normal_force):
        return self.friction.force(normal_force, contact.slip)


def test_contact_joints_of_a_third_party_conform():
    check_contact_joint(Floor(), MOTIONS)


class Changed(Floor):
    """The floor with a mistake in its contact."""

    change: Any = eqx.field(default=lambda contact: contact, static=True)

    def contacts(self, motions):
        return {"floor": self.change(super().contacts(motions)["floor"])}


def tilted(contact):
    return replace(contact, normal=contact.normal * 1.1)


def slow_gap(contact):
    return replace(contact, gap=replace(contact.gap, rate=0.9 * contact.gap.rate))


def apart(contact):
    return replace(contact, arm_second=cj.extend.Vector(0.01, 0.02, 0.0))


def dragging(contact):
    return replace(contact, slip=contact.slip * -1.0)


def uneven(contact):
    factor = cj.extend.Slope(2.0 + contact.arm_first.x, 0.0)
    return replace(contact, gap=replace(contact.gap, factor=factor))


class Unaware(Floor):
    def contacts(self, motions):
        return {"floor": replace(super().contacts(motions)["floor"], slip=None)}

    def friction_force(self, name, contact, normal_force):
        return contact.arm_first.cross(contact.normal) * (-0.1 * normal_force)


class Rooted(Floor):
    def friction_force(self, name, contact, normal_force):
        speed = jnp.sqrt(contact.slip.dot(contact.slip))
        return contact.slip * (-0.1 * normal_force * speed)


class Unlike(Floor):
    def contacts(self, motions):
        contact = super().contacts(motions)["floor"]
        added = jax.lax.stop_gradient(self.law.stiffness.stiffness) * 1e-12
        gap = replace(contact.gap, depth=contact.gap.depth + added)
        return {"floor": replace(contact, gap=gap)}


@pytest.mark.parametrize(
    ("joint", "complaint"),
    [
        (Changed(change=tilted), "not a unit vector"),
        (Changed(change=slow_gap), "not the time derivative of its penetration"),
        (Changed(change=apart), "leaves a moment"),
        (Changed(change=uneven), "rate of its factor is not the time derivative"),
        (Changed(change=dragging), "not the tangential velocity"),
        (Unaware(), "its slip is None"),
        (Rooted(), "derivative of its forces is not finite"),
        (Unlike(), "`law.stiffness.stiffness` does not agree with differences"),
    ],
)
def test_broken_contact_joints_are_refused(joint, complaint):
    with pytest.raises(AssertionError, match=f"'floor': .*{complaint}"):
        check_contact_joint(joint, MOTIONS)


def test_bristles_between_faces_that_resist_rotation_are_refused():
    """A bristle law has no moment about the normal."""

    class Faces(Floor):
        def contacts(self, motions):
            return {"floor": replace(super().contacts(motions)["floor"], face_radius=0.01)}

        def bristle_laws(self):
            return {"floor": cj.frictions.LuGre(0.2, 0.1, stribeck_speed=0.01)}

    with pytest.raises(ValueError, match=r"`bristle_laws` must be .*`face_radius`.*\['floor'\]"):
        check_contact_joint(Faces(), MOTIONS)


SERVO = cj.Servo(FIRST, SECOND, (1.0, 2.0, 3.0), 2.0, 100.0, 5.0, 0.3, delay=0.01)
FORCES = elements_of(cj.extend.AbstractForce) | {"servo without limits": SERVO}
FAST = "load", "spring", "bushing", "torsional spring", "motor", "servo", "servo without limits"


@pytest.mark.parametrize("name", slow_but(FAST, FORCES))
def test_forces_conform(name):
    check_force(FORCES[name], MOTIONS)


class OneSided(cj.SpringDamper):
    def wrenches(self, motions, t):
        pushed = super().wrenches(motions, t)
        return pushed | {FIRST: pushed[SECOND]}


class Unbooked(cj.SpringDamper):
    def supplied_power(self, motions, t):
        return 0.0


class Straight(cj.extend.AbstractForce):
    """A force along a velocity, whose direction has no derivative at rest."""

    size: Any = quantity("N")

    def body_names(self):
        return (FIRST,)

    def wrenches(self, motions, t):
        motion = motions[FIRST]
        speed = jnp.sqrt(motion.velocity.dot(motion.velocity))
        backwards = motion.velocity * (-self.size / jnp.maximum(speed, 1e-9))
        return {FIRST: motion.wrench(backwards, cj.extend.ZERO)}


class OfTheFirstLane(Straight):
    def wrenches(self, motions, t):
        shape = jnp.shape(motions[FIRST].spin.x)
        factor = 1.0 if isinstance(motions[FIRST].spin.x, jax.core.Tracer) and not shape else 2.0
        force = cj.extend.Vector(self.size * factor, 0.0, 0.0)
        return {FIRST: motions[FIRST].wrench(force, cj.extend.ZERO)}


SPRING = *ENDS, 50.0, 0.4, 0.3


@pytest.mark.parametrize(
    ("force", "complaint"),
    [
        (OneSided(*SPRING), "equal and opposite"),
        (Unbooked(*SPRING), "energy does not balance"),
        (Straight(2.0), "derivative of the force is not finite"),
        (Straight(jnp.nan), "force is not finite"),
        slow(OfTheFirstLane(2.0), "under vmap"),
    ],
)
def test_broken_forces_are_refused(force, complaint):
    with pytest.raises(AssertionError, match=complaint):
        check_force(force, MOTIONS)


def test_a_journal_near_the_centre_of_its_bearing_conforms():
    """Its offset of 22 um is small beside the sizes of the parts and their coordinates."""
    law, near = cj.laws.Hertz(1e9), ((2e-5, 1e-5, 3e-5), (1, 1e-3, 2e-3, 0.3))
    sizes = {"bearing_radius": 10e-3, "clearance": 0.1e-3, "journal_length": 20e-3}
    pin = cj.ClearanceJoint("ground", "rod", **sizes, law=law)
    check_contact_joint(pin, {"rod": moving(*near, (0.1, 0.2, 0.3), (3, 2, 1))})

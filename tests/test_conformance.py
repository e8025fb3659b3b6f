"""The conformance checks accept all laws and joints of the package and refuse broken ones."""

import warnings
from dataclasses import replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import pytest

import clearjoint as cj
from clearjoint.extend import (
    AbstractDampedLaw,
    AbstractHertzianLaw,
    Row,
    optional_quantity,
    quantity,
)
from clearjoint.testing import (
    check_bristles,
    check_constraint,
    check_contact_joint,
    check_force,
    check_friction,
    check_law,
    moving,
)
from tests.support.dropped_rod import dropped_rod

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


LAWS = (
    cj.laws.LankaraniNikravesh(0.0, 1e8, exponent=1.0),
    cj.laws.Hertz(STEEL),
    cj.laws.LankaraniNikravesh(0.9, STEEL),
    cj.laws.LankaraniNikravesh(0.9, STEEL, smoothing=1e-7),
    cj.laws.HuntCrossley(0.5, STEEL),
    cj.laws.Flores2011(0.2, STEEL, exponent=2.0),
    cj.laws.MemorylessHuntCrossley(0.8, STEEL, 0.1),
)


@pytest.mark.slow
@pytest.mark.parametrize("law", LAWS)
def test_laws_conform(law):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_law(law)


@pytest.mark.parametrize(
    ("law", "complaint"),
    [
        (Pulling, "negative"),
        (Generating, "creates energy"),
        (SpikedDerivative, "derivative"),
        (Frozen, "derivative by the rate does not agree"),
        (Cut, "derivative by the depth does not agree"),
        (Blind, "unknown entry speed"),
    ],
)
def test_broken_laws_are_refused(law, complaint):
    with pytest.raises(AssertionError, match=complaint):
        check_law(law(STEEL))


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
        *(
            pytest.param(law, jump, marks=pytest.mark.slow)
            for law, jump in (
                (Buffer(1e8, 50.0, ahead=1e-7), "by 50 N where contact begins or ends"),
                (Buffer(1e8, 1e-3), "by 0.001 N where contact begins or ends"),
            )
        ),
        (Pushing(1e8, 0.0, 20.0), "by 20 N where contact begins or ends"),
    ],
)
def test_laws_that_jump_at_the_onset_cause_a_warning(law, jump):
    with pytest.warns(UserWarning, match=jump):
        check_law(law)


def test_an_undeclared_jump_is_refused():
    with pytest.raises(AssertionError, match="by 50 N .* declares `force_jumps = False`"):
        check_law(DeniedBuffer(1e8, 50.0))


@pytest.mark.parametrize(
    ("law", "complaint"),
    [
        (Stepped, "inside the contact, at a depth of 3e-07 m"),
        pytest.param(Bilinear, "with the rate, at .* m/s", marks=pytest.mark.slow),
    ],
)
def test_jumps_inside_the_contact_are_refused(law, complaint):
    with pytest.raises(AssertionError, match=complaint):
        check_law(law(STEEL))


@pytest.mark.parametrize(
    "friction",
    [
        cj.frictions.Stribeck(0.15, 0.1, stribeck_speed=1e-2),
        *(
            pytest.param(friction, marks=pytest.mark.slow)
            for friction in (
                cj.frictions.LinearCoulomb(0.1),
                cj.frictions.RegularisedCoulomb(0.1),
                cj.frictions.Threlfall(0.1),
                cj.frictions.Ambrosio(0.1),
                cj.frictions.Stribeck(0.15, 0.1, stribeck_speed=1e-2, exponent=1.0),
                cj.frictions.BengisuAkay(0.15, 0.1),
                cj.frictions.BrownMcPhee(0.15, 0.1),
            )
        ),
    ],
)
def test_friction_conforms(friction):
    check_friction(friction)


@pytest.mark.parametrize(
    "friction",
    [
        pytest.param(cj.frictions.Dahl(0.1), marks=pytest.mark.slow),
        pytest.param(
            cj.frictions.LuGre(0.15, 0.1, stribeck_speed=1e-2, damping=100.0, viscosity=0.1),
            marks=pytest.mark.slow,
        ),
        cj.frictions.ElastoPlastic(0.15, 0.1, stribeck_speed=1e-2, elastic_deflection=5e-7),
    ],
)
def test_bristles_conform(friction):
    check_bristles(friction)


class Creeping(cj.frictions.Dahl):
    def rate(self, deflection, slip):
        return slip - deflection * 1e3


class Endless(cj.frictions.Dahl):
    def rate(self, deflection, slip):
        return slip


class Owing(cj.frictions.Dahl):
    def stored_energy(self, deflection):
        return -super().stored_energy(deflection)


WRONG_BRISTLES = [(Creeping, "creeps"), (Endless, "shrink"), (Owing, "stored_energy")]


@pytest.mark.parametrize(("kind", "complaint"), WRONG_BRISTLES)
def test_broken_bristle_laws_are_refused(kind, complaint):
    with pytest.raises(AssertionError, match=complaint):
        check_bristles(kind(0.1))


def test_friction_with_a_step_is_refused():
    class Sticky(cj.extend.AbstractFriction):
        def ratio(self, slip_speed):
            return jnp.where(slip_speed < 2e-3, slip_speed, 0.1)

    with pytest.raises(AssertionError, match=r"jumps by 0.098 at 0.002 m/s"):
        check_friction(Sticky())


def test_jumping_friction_is_refused():
    class Dry(cj.extend.AbstractFriction):
        def ratio(self, slip_speed):
            return 0.1 + 0.0 * slip_speed

    with pytest.raises(AssertionError, match="jump"):
        check_friction(Dry())


MOTIONS = {
    "a": moving((0.1, 0.2, 0.3), (0.9, 0.1, -0.3, 0.2), (0.5, -0.4, 0.3), (1.0, 2.0, -0.5)),
    "b": moving((-0.3, 0.1, 0.5), (0.4, 0.5, 0.2, -0.6), (-0.2, 0.7, 0.1), (-0.8, 0.3, 1.1)),
    "c": moving((0.2, 0.4, -0.1), (0.7, -0.3, 0.5, 0.1), (0.3, 0.2, -0.6), (0.4, -0.9, 0.7)),
}
SPLINE = cj.Spline.through([-1.0, -0.1, 0.2, 1.0], [0.3, -0.2, 0.5, 0.1])


class Rod(cj.extend.AbstractConstraint):
    """A massless rod between two centres of mass, by the differentiated residual."""

    length: Any = quantity("m")

    def body_names(self):
        return "a", "b"

    def rows(self, motions, t):
        def residual(first, second):
            apart = first[0] - second[0]
            return (0.5 * (apart.dot(apart) - self.length**2),)

        return cj.extend.rows_from_residual(
            ("a", "b"), ("length",), residual, motions["a"], motions["b"]
        )


class Swing(cj.extend.AbstractRotationDriver):
    """A user-defined driver."""

    first: str = eqx.field(default="a", static=True)
    second: str = eqx.field(default="b", static=True)
    axis: Any = quantity("1", default=(1.0, -2.0, 0.5))
    orientation: Any = quantity("1", default=(0.5, 0.5, 0.5, -0.5))

    def angle(self, t):
        return 0.4 + 2.0 * t + 0.7 * jnp.sin(3.0 * t + 0.5)


HINGE = cj.RevoluteJoint("a", "b", (0.1, 0.2, 0.3), (0.3, -0.1, 0.2), (1, 2, 3), (0, -1, 1))
SLIDER = cj.PrismaticJoint("b", "c", (0.1, 0.2, 0.3), (0.3, -0.1, 0.2), (1, 2, 3))


@pytest.mark.parametrize(
    "joint",
    [
        cj.PrescribedRotation("a", "b", (1.0, -2.0, 0.5), speed=-3.0, initial_angle=20.0),
        Swing(),
        cj.InlineJoint("a", "b", (0.1, 0.2, 0.3), (0.3, -0.1, 0.2), (1, 2, 3)),
        cj.CylindricalJoint("a", "b", (0.1, 0.2, 0.3), (0.3, -0.1, 0.2), (1, 2, 3), (0, -1, 1)),
        cj.PrismaticJoint("a", "b", (0.1, 0.2, 0.3), (0.3, -0.1, 0.2), (1, 2, 3)),
        cj.SphericalJoint("a", "b", (0.1, 0.2, 0.3), (0.3, -0.1, 0.2)),
        cj.RevoluteJoint("a", "b", (0.1, 0.2, 0.3), (0.3, -0.1, 0.2), (1, 2, 3), (0, -1, 1)),
        cj.FixedJoint("a", "b", (0.1, 0.2, 0.3), (0.3, -0.1, 0.2), (0.5, 0.5, 0.5, -0.5)),
        Rod(1.0),
        cj.DistanceJoint("a", "b", (0.1, 0.2, 0.3), (0.3, -0.1, 0.2), length=0.7),
        cj.GearJoint("a", "b", "c", (1, 2, 3), (0, -1, 1), 17, 51, offset=0.2),
        cj.GearJoint("a", "b", "c", (1, 2, 3), (0, -1, 1), 17, 51, internal=True),
        cj.PlanarJoint("a", "b", (0.1, 0.2, 0.3), (0.3, -0.1, 0.2), (1, 2, 3), (0, -1, 1)),
        cj.PrescribedAngle("a", "b", (1, 2, 3), SPLINE, (0.5, 0.5, 0.5, -0.5)),
        cj.PrescribedTranslation("a", "b", (0.1, 0, 0), (0, 0.2, 0), (1, 2, 3), jnp.cos),
        cj.ScrewJoint("a", "b", (0.1, 0.2, 0.3), (0.3, -0.1, 0.2), (1, 2, 3), (0, -1, 1), -0.9),
        cj.UniversalJoint("a", "b", (0.1, 0.2, 0.3), (0.3, -0.1, 0.2), (1, 2, 3), (0, -1, 1)),
        cj.JointCoupling(HINGE, SLIDER, cj.Polynomial((0.1, -0.7, 0.4))),
        cj.JointCoupling(SLIDER, HINGE, jnp.cos),
    ],
)
def test_joints_conform(joint):
    check_constraint(joint, MOTIONS)


@pytest.mark.parametrize("forgotten", ["time_rate", "bias"])
def test_forgotten_time_dependence_is_refused(forgotten):
    class Forgetful(Swing):
        def rows(self, motions, t):
            row = super().rows(motions, t)["angle"]
            bias = super().relative_angle(motions).bias if forgotten == "bias" else row.bias
            time_rate = 0.0 if forgotten == "time_rate" else row.time_rate
            return {"angle": Row(row.value, row.jacobian, bias, time_rate)}

    with pytest.raises(AssertionError, match=forgotten.replace("_", " ")):
        check_constraint(Forgetful(), MOTIONS)


def test_wrong_bias_is_refused():
    class Careless(Rod):
        def rows(self, motions, t):
            row = super().rows(motions, t)["length"]
            return {"length": Row(row.value, row.jacobian, 0.0)}

    with pytest.raises(AssertionError, match="bias"):
        check_constraint(Careless(1.0), MOTIONS)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_rows_whose_names_change_are_refused(sign):
    class Renamed(Rod):
        def rows(self, motions, t):
            row = super().rows(motions, t)["length"]
            return {"length" if sign * t <= 0.0 else "distance": row}

    with pytest.raises(AssertionError, match="names of the rows change"):
        check_constraint(Renamed(1.0), MOTIONS)


def pin(**options):
    return cj.ClearanceJoint(
        "a",
        "b",
        bearing_point=(0.1, -0.2, 0.3),
        bearing_axis=(0.3, -0.5, 1.0),
        journal_point=(0.2, 0.1, -0.1),
        journal_axis=(0.2, 0.7, -0.4),
        bearing_radius=10e-3,
        clearance=0.5e-3,
        journal_length=20e-3,
        law=cj.laws.LankaraniNikravesh(0.9, STEEL),
        **options,
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    "joint",
    [
        pin(
            friction=cj.frictions.RegularisedCoulomb(0.1),
            axial=cj.EndPlay(1e-3, cj.laws.Hertz(1e9), cj.frictions.LinearCoulomb(0.2), 12e-3),
        ),
        pin(friction=cj.frictions.RegularisedCoulomb(0.1), line_points=3),
        pin(),
        pin(friction=cj.frictions.Dahl(0.1)),
    ],
    ids=["friction and end play", "along its length", "frictionless", "bristles"],
)
def test_contact_joints_conform(joint):
    check_contact_joint(joint, MOTIONS)


class Floor(cj.extend.AbstractContactJoint):
    """A floor that stands on one body, under the centre of another."""

    law: cj.extend.AbstractContactLaw = cj.laws.Hertz(1e9)
    friction: cj.extend.AbstractFriction = cj.frictions.RegularisedCoulomb(0.1)

    def pair(self):
        return "a", "b"

    def laws(self):
        return {"floor": self.law}

    def contacts(self, motions):
        floor, ball = motions["a"], motions["b"]
        down = floor.direction(cj.extend.Vector(0.0, 0.0, -1.0))
        under, centre = (
            floor.components(ball.position - floor.position),
            cj.extend.Vector(0.0, 0.0, 0.0),
        )
        sliding = ball.velocity - floor.velocity_at(under)
        rate = sliding.dot(down)
        return {
            "floor": cj.extend.Contact(
                cj.extend.Gap(-under.z, rate), down, under, centre, sliding - down * rate
            )
        }

    def friction_force(self, name, contact, normal_force):
        return self.friction.force(normal_force, contact.slip)


def test_contact_joints_of_a_third_party_conform():
    check_contact_joint(Floor(), MOTIONS)


class Tilted(Floor):
    def changed(self, contact):
        return replace(contact, normal=contact.normal * 1.1)


class Slow(Floor):
    def changed(self, contact):
        return replace(contact, gap=replace(contact.gap, rate=0.9 * contact.gap.rate))


class Apart(Floor):
    def changed(self, contact):
        return replace(contact, arm_second=cj.extend.Vector(0.01, 0.02, 0.0))


class Dragging(Floor):
    def changed(self, contact):
        return replace(contact, slip=contact.slip * -1.0)


class Unaware(Floor):
    def changed(self, contact):
        return replace(contact, slip=None)

    def friction_force(self, name, contact, normal_force):
        return contact.arm_first.cross(contact.normal) * (-0.1 * normal_force)


class Rooted(Floor):
    def changed(self, contact):
        return contact

    def friction_force(self, name, contact, normal_force):
        speed = jnp.sqrt(contact.slip.dot(contact.slip))
        return contact.slip * (-0.1 * normal_force * speed)


class Unlike(Floor):
    def changed(self, contact):
        depth = contact.gap.depth + jax.lax.stop_gradient(self.law.stiffness.stiffness) * 1e-12
        return replace(contact, gap=replace(contact.gap, depth=depth))


@pytest.mark.parametrize(
    ("kind", "complaint"),
    [
        (Tilted, "not a unit vector"),
        (Slow, "not the time derivative of its penetration"),
        (Apart, "leaves a moment"),
        (Dragging, "not the tangential velocity"),
        (Unaware, "its slip is None"),
        (Rooted, "derivative of its forces is not finite"),
        (Unlike, "`law.stiffness.stiffness` does not agree with differences"),
    ],
)
def test_broken_contact_joints_are_refused(kind, complaint):
    class Broken(kind):
        def contacts(self, motions):
            return {"floor": self.changed(super().contacts(motions)["floor"])}

    with pytest.raises(AssertionError, match=f"'floor': .*{complaint}"):
        check_contact_joint(Broken(), MOTIONS)


def test_bristles_between_faces_that_resist_rotation_are_refused():
    """A bristle law has no moment about the normal."""

    class Faces(Floor):
        def contacts(self, motions):
            return {"floor": replace(super().contacts(motions)["floor"], face_radius=0.01)}

        def bristle_laws(self):
            return {"floor": cj.frictions.LuGre(0.2, 0.1, stribeck_speed=0.01)}

    with pytest.raises(ValueError, match=r"`bristle_laws` must be .*`face_radius`.*\['floor'\]"):
        check_contact_joint(Faces(), MOTIONS)


@pytest.mark.parametrize(
    "force",
    [
        cj.AppliedLoad("a", (1.0, -2.0, 3.0), (0.1, 0.2, -0.3), (0.3, 0.2, 0.1)),
        cj.SpringDamper("a", "b", (0.1, 0.2, 0.3), (0.3, -0.1, 0.2), 50.0, 0.4, 0.3),
        pytest.param(cj.DriveTorque("a", "b", (1.0, 2.0, 3.0), torque=2.0), marks=pytest.mark.slow),
        cj.TorsionalSpring("a", "b", (1.0, 2.0, 3.0), 5.0, damping=0.2, rest_angle=0.4),
        pytest.param(
            cj.Motor("a", "b", (1.0, 2.0, 3.0), SPLINE, 5.0, derivative=0.3),
            marks=pytest.mark.slow,
        ),
        cj.Motor("a", "b", (1.0, 2.0, 3.0), 2.0, 5.0, derivative=0.3, torque_limit=1.0),
        cj.Servo("a", "b", (1.0, 2.0, 3.0), 2.0, 100.0, 5.0, 0.3, delay=0.01),
    ],
)
def test_forces_conform(force):
    check_force(force, MOTIONS)


class OneSided(cj.SpringDamper):
    def wrenches(self, motions, t):
        pushed = super().wrenches(motions, t)
        return pushed | {"a": pushed["b"]}


class Unbooked(cj.SpringDamper):
    def supplied_power(self, motions, t):
        return 0.0


class Straight(cj.extend.AbstractForce):
    """A force along a velocity, whose direction has no derivative at rest."""

    size: Any = quantity("N")

    def body_names(self):
        return ("a",)

    def wrenches(self, motions, t):
        motion = motions["a"]
        speed = jnp.sqrt(motion.velocity.dot(motion.velocity))
        backwards = motion.velocity * (-self.size / jnp.maximum(speed, 1e-9))
        return {"a": motion.wrench(backwards, cj.extend.Vector(0.0, 0.0, 0.0))}


class OfTheFirstLane(Straight):
    def wrenches(self, motions, t):
        shape = jnp.shape(motions["a"].spin.x)
        factor = 1.0 if isinstance(motions["a"].spin.x, jax.core.Tracer) and not shape else 2.0
        force = cj.extend.Vector(self.size * factor, 0.0, 0.0)
        return {"a": motions["a"].wrench(force, cj.extend.Vector(0.0, 0.0, 0.0))}


SPRING = ("a", "b", (0.1, 0.2, 0.3), (0.3, -0.1, 0.2), 50.0, 0.4, 0.3)


@pytest.mark.parametrize(
    ("force", "complaint"),
    [
        (OneSided(*SPRING), "equal and opposite"),
        (Unbooked(*SPRING), "energy does not balance"),
        (Straight(2.0), "derivative of the force is not finite"),
        (Straight(jnp.nan), "force is not finite"),
        pytest.param(OfTheFirstLane(2.0), "under vmap", marks=pytest.mark.slow),
    ],
)
def test_broken_forces_are_refused(force, complaint):
    with pytest.raises(AssertionError, match=complaint):
        check_force(force, MOTIONS)

"""The conformance kit accepts every law and joint of ours and refuses broken ones."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import pytest

import clearjoint as cj
from clearjoint.contact import AbstractDampedLaw, AbstractHertzianLaw
from clearjoint.fields import optional_quantity, quantity
from clearjoint.joints.base import Row
from clearjoint.testing import check_constraint, check_friction, check_law, moving

STEEL = cj.RavnStiffness(207e9, 0.3)


@pytest.mark.parametrize(
    "law",
    [
        cj.Hertz(STEEL),
        cj.HuntCrossley(0.5, STEEL),
        cj.LankaraniNikravesh(0.9, STEEL),
        cj.LankaraniNikravesh(0.0, 1e8, exponent=1.0),
        cj.Flores2011(0.2, STEEL, exponent=2.0),
        cj.MemorylessHuntCrossley(0.8, STEEL, 0.1),
        cj.LankaraniNikravesh(0.9, STEEL, smoothing=1e-7),
    ],
)
def test_laws_conform(law):
    check_law(law)


class GonthierLaw(AbstractDampedLaw):
    """chi = (1 - c^2)/c: a law by a third party, which writes the fields and one method."""

    restitution: Any = quantity("1")
    stiffness: cj.AbstractStiffness
    exponent: float = eqx.field(default=1.5, static=True)
    entry_speed_floor: Any = quantity("m/s", default=1e-6)
    smoothing: Any = optional_quantity("m")

    def damping_factor(self) -> Any:
        return (1 - self.restitution**2) / self.restitution


def test_third_party_law_conforms_and_runs():
    law = GonthierLaw(0.8, STEEL)
    check_law(law)
    scene, state = cj.double_pendulum(law=law)
    solution = cj.simulate(scene, state, 0.012, record_impacts=True)
    assert len(solution.impacts) == 2


class Pulling(AbstractHertzianLaw):
    """Adhesive by mistake: the force turns negative at separation."""

    stiffness: cj.AbstractStiffness
    exponent: float = eqx.field(default=1.5, static=True)
    smoothing: Any = optional_quantity("m")
    has_memory = True

    def damping_factor(self) -> Any:
        return 0.5

    def force(self, gap, entry_speed):
        return self.elastic_force(gap) * (1 + 0.5 * gap.rate / entry_speed)


class SpikedDerivative(Pulling):
    """A derivative that is infinite at the onset."""

    has_memory = False

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


@pytest.mark.parametrize(
    ("law", "complaint"),
    [(Pulling, "negative"), (Generating, "creates energy"), (SpikedDerivative, "derivative")],
)
def test_broken_laws_are_refused(law, complaint):
    with pytest.raises(AssertionError, match=complaint):
        check_law(law(STEEL))


@pytest.mark.parametrize("friction", [cj.RegularisedCoulomb(0.1), cj.Ambrosio(0.1)])
def test_friction_conforms(friction):
    check_friction(friction)


def test_jumping_friction_is_refused():
    class Dry(cj.AbstractFriction):
        def ratio(self, slip_speed):
            return 0.1 + 0.0 * slip_speed

    with pytest.raises(AssertionError, match="jump"):
        check_friction(Dry())


MOTIONS = {
    "a": moving((0.1, 0.2, 0.3), (0.9, 0.1, -0.3, 0.2), (0.5, -0.4, 0.3), (1.0, 2.0, -0.5)),
    "b": moving((-0.3, 0.1, 0.5), (0.4, 0.5, 0.2, -0.6), (-0.2, 0.7, 0.1), (-0.8, 0.3, 1.1)),
}


class Rod(cj.AbstractConstraint):
    """A massless rod between two centres of mass, by the differentiated residual."""

    length: Any = quantity("m")

    def body_names(self):
        return "a", "b"

    def rows(self, motions, t):
        def residual(first, second):
            apart = first[0] - second[0]
            return (0.5 * (apart.dot(apart) - self.length**2),)

        return cj.rows_from_residual(("a", "b"), ("length",), residual, motions["a"], motions["b"])


class Swing(cj.AbstractRotationDriver):
    """A driver by a third party, who writes the fields and the angle."""

    first: str = eqx.field(default="a", static=True)
    second: str = eqx.field(default="b", static=True)
    axis: Any = quantity("1", default=(1.0, -2.0, 0.5))
    orientation: Any = quantity("1", default=(0.5, 0.5, 0.5, -0.5))

    def angle(self, t):
        return 0.4 + 2.0 * t + 0.7 * jnp.sin(3.0 * t + 0.5)


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
    ],
)
def test_joints_conform(joint):
    check_constraint(joint, MOTIONS)


@pytest.mark.parametrize("forgotten", ["time_rate", "bias"])
def test_forgotten_time_dependence_is_refused(forgotten):
    class Forgetful(Swing):
        def rows(self, motions, t):
            row = super().rows(motions, t)["angle"]
            bias = super().turn(motions).bias if forgotten == "bias" else row.bias
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

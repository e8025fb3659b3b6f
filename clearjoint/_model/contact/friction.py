"""Friction laws of contacts, as functions of the slip speed, or with the deflection of bristles."""

import abc
import operator
from typing import TypeAlias

import equinox as eqx
import jax.numpy as jnp
from typing_extensions import override

from ..._fields.checks import require_numbers
from ..._fields.objects import AbstractConverting, quantity
from ..._fields.types import Single
from ..._math.smoothing import norm_and_direction, positive_power, value_and_slope
from ..._math.vectors import Scalar, Vector


class AbstractFriction(AbstractConverting):
    """Base class of friction laws without bristles, for contacts that slide most of the time.

    The force opposes the slip and is the normal force times a ratio mu(v) of the slip speed v, m/s.
    The ratio must vanish at zero speed, so that the force and its derivatives are finite there; a
    loaded contact therefore creeps instead of sticking. Use an `AbstractBristleFriction` where
    sticking matters.

    ```python
    import clearjoint as cj
    import jax.numpy as jnp
    from clearjoint.testing import check_friction

    class Fading(cj.extend.AbstractFriction):
        slow: float
        fast: float
        fading_speed: float  # m/s
        regularisation_speed: float = 1e-3  # m/s

        def ratio(self, slip_speed):
            excess = (self.slow - self.fast) / (1.0 + (slip_speed / self.fading_speed) ** 2)
            return (self.fast + excess) * jnp.tanh(slip_speed / self.regularisation_speed)

    check_friction(Fading(slow=0.15, fast=0.1, fading_speed=0.01))
    ```
    """

    @abc.abstractmethod
    def ratio(self, slip_speed: Scalar) -> Scalar:
        """Return the ratio of friction to normal force at a slip speed, m/s; zero at zero speed."""

    def force(self, normal_force: Scalar, slip: Vector) -> Vector:
        """Return the friction force on the second body, N. `slip` is the tangential velocity of the
        second body relative to the first, m/s."""
        speed, _ = norm_and_direction(slip)
        rests = speed == 0.0
        _, slope = value_and_slope(self.ratio, jnp.zeros_like(speed))
        # At zero speed the quotient is replaced by its limit, which keeps the derivatives correct.
        per_speed = jnp.where(rests, slope, self.ratio(speed) / jnp.where(rests, 1.0, speed))
        return slip * (-normal_force * per_speed)


class AbstractRegularisedFriction(AbstractFriction):
    """Base class of Coulomb friction, `coefficient` mu, regularised at low speed. At a smaller
    `regularisation_speed` v_d, surfaces creep less, but the equations of motion are stiffer."""

    coefficient: Single = quantity("1", positive=True, zero=True, remedy="give mu")
    regularisation_speed: Single = quantity(
        "m/s", default=1e-3, positive=True, remedy="give v_d in m/s"
    )


class RegularisedCoulomb(AbstractRegularisedFriction):
    r"""Coulomb friction that is smooth around zero speed; v_d is the `regularisation_speed`.

    $$\mu(v) = \mu \tanh\frac{v}{v_d}$$

    >>> print(f"{cj.frictions.RegularisedCoulomb(0.1).ratio(1e-3):.4f}")  # 0.1 tanh(1)
    0.0762
    """

    @override
    def ratio(self, slip_speed: Scalar) -> Scalar:
        return self.coefficient * jnp.tanh(slip_speed / self.regularisation_speed)


class LinearCoulomb(AbstractRegularisedFriction):
    r"""Coulomb friction that is linear below v_d, the `regularisation_speed`.

    $$\mu(v) = \mu \min\left(\frac{v}{v_d}, 1\right)$$

    >>> print(f"{cj.frictions.LinearCoulomb(0.1, 1e-3).ratio(0.5e-3):.4f}")
    0.0500
    """

    @override
    def ratio(self, slip_speed: Scalar) -> Scalar:
        return self.coefficient * jnp.minimum(slip_speed / self.regularisation_speed, 1.0)


class Threlfall(AbstractRegularisedFriction):
    r"""Coulomb friction that rises exponentially up to the speed v_d (A. G. Threlfall 1978).

    $$\mu(v) = \mu \left(1 - e^{-3 \min(v / v_d, 1)}\right)$$

    Above v_d, the `regularisation_speed`, mu(v) is 0.9502 mu. With 0.95 mu, which is often printed,
    the law would jump at v_d.

    >>> print(f"{cj.frictions.Threlfall(0.1).ratio(0.5):.4f}")  # 0.1 (1 - exp(-3))
    0.0950
    """

    @override
    def ratio(self, slip_speed: Scalar) -> Scalar:
        rise = jnp.minimum(slip_speed / self.regularisation_speed, 1.0)
        return -self.coefficient * jnp.expm1(-3.0 * rise)


class Ambrosio(AbstractFriction):
    r"""Friction that rises linearly from 0 at v0 to mu at v1 (J. Ambrosio 2003).

    $$\mu(v) = \mu\, \frac{v - v_0}{v_1 - v_0}, \quad v_0 \le v \le v_1$$

    Below v0 the ratio mu(v) is zero, and above v1 it is mu. `lower_speed` and `upper_speed` are v0
    and v1 > v0, m/s; 1e-4 and 1e-3 by default.

    >>> friction = cj.frictions.Ambrosio(0.1, lower_speed=1e-4, upper_speed=1e-3)
    >>> print(f"{friction.ratio(0.55e-3):.4f}")  # half-way
    0.0500
    """

    coefficient: Single = quantity("1", positive=True, zero=True, remedy="give mu")
    lower_speed: Single = quantity(
        "m/s", default=1e-4, positive=True, zero=True, remedy="give v0 in m/s"
    )
    upper_speed: Single = quantity("m/s", default=1e-3, shape=())

    @override
    def _check_together(self) -> None:
        speeds, remedy = (self.upper_speed, self.lower_speed), "give v1 > v0 in m/s"
        require_numbers(operator.gt, "upper_speed", speeds, "above lower_speed = {1}", remedy)

    @override
    def ratio(self, slip_speed: Scalar) -> Scalar:
        rise = (slip_speed - self.lower_speed) / (self.upper_speed - self.lower_speed)
        # The derivative at v0 is that above v0. With `jnp.maximum` it would be the mean of both
        # sides, which is wrong for v0 = 0, where there are no lower speeds.
        return self.coefficient * jnp.minimum(jnp.where(rise < 0.0, 0.0, rise), 1.0)


def require_breakaway(breakaway: Single, kinetic: Single) -> None:
    expected, remedy = "at least kinetic = {1}", "give mu_S >= mu_C"
    require_numbers(operator.ge, "breakaway", (breakaway, kinetic), expected, remedy)


class AbstractFallingFriction(AbstractFriction):
    """Base class of friction whose ratio to the normal force falls as the slip speed rises.
    `breakaway` is mu_S, the maximum of this ratio, which some laws reach only approximately, and
    `kinetic` mu_C <= mu_S, its limit at high speed."""

    breakaway: Single = quantity("1", positive=True, zero=True, remedy="give mu_S")
    kinetic: Single = quantity("1", positive=True, zero=True, remedy="give mu_C")

    @override
    def _check_together(self) -> None:
        require_breakaway(self.breakaway, self.kinetic)


class Stribeck(AbstractFallingFriction):
    r"""Friction with Stribeck's curve, regularised at low speed (B. Armstrong-Helouvry 1991).

    $$\mu(v) = \left(\mu_C + (\mu_S - \mu_C) e^{-(v / v_S)^\delta}\right) \tanh\frac{v}{v_d}$$

    The viscous term k v that is often added is left out, since it doesn't depend on the normal
    force. Add a damper to the scene for it.

    **Arguments:** `breakaway`, `kinetic`: mu_S and mu_C. `stribeck_speed`: v_S, m/s. `exponent`:
    delta, at least 1; 2 by default. `regularisation_speed`: v_d, m/s; 1e-4 by default. The maximum
    of mu(v) is close to mu_S only if v_d is well below v_S.

    >>> friction = cj.frictions.Stribeck(breakaway=0.2, kinetic=0.1, stribeck_speed=0.01)
    >>> print(f"{friction.ratio(0.01):.4f}")  # 0.1 + 0.1 exp(-1)
    0.1368
    """

    stribeck_speed: Single = quantity("m/s", positive=True, remedy="give v_S in m/s")
    exponent: Single = quantity("1", default=2.0, positive=True, remedy="give delta, 2 say")
    regularisation_speed: Single = quantity(
        "m/s", default=1e-4, positive=True, remedy="give v_d in m/s"
    )

    @override
    def _check_together(self) -> None:
        super()._check_together()
        remedy = "give delta >= 1; below, the slope at rest is infinite"
        values = (self.exponent,)
        require_numbers(lambda delta: delta >= 1.0, "exponent", values, "at least 1", remedy)

    @override
    def ratio(self, slip_speed: Scalar) -> Scalar:
        fade = jnp.exp(-positive_power(slip_speed / self.stribeck_speed, self.exponent))
        curve = self.kinetic + (self.breakaway - self.kinetic) * fade
        return curve * jnp.tanh(slip_speed / self.regularisation_speed)


class BengisuAkay(AbstractFallingFriction):
    r"""Friction that rises to mu_S at v0 and then decays (M. T. Bengisu, A. Akay 1994).

    $$\mu(v) = \mu_C + (\mu_S - \mu_C) e^{-\xi (v - v_0)}, \quad v \ge v_0$$

    Below v0, mu(v) is the parabola mu_S (1 - (1 - v/v0)^2). The curve has a kink at v0, the
    `breakaway_speed`, m/s, 1e-3 by default. `decay` is xi, s/m, 100 by default.

    >>> friction = cj.frictions.BengisuAkay(breakaway=0.2, kinetic=0.1, breakaway_speed=1e-3)
    >>> print(f"{friction.ratio(1e-3):.4f}, {friction.ratio(1.0):.4f}")
    0.2000, 0.1000
    """

    breakaway_speed: Single = quantity("m/s", default=1e-3, positive=True, remedy="give v0 in m/s")
    decay: Single = quantity("s/m", default=100.0, positive=True, remedy="give xi in s/m")

    @override
    def ratio(self, slip_speed: Scalar) -> Scalar:
        x = jnp.minimum(slip_speed / self.breakaway_speed, 1.0)
        beyond = jnp.maximum(slip_speed - self.breakaway_speed, 0.0)
        fall = (self.breakaway - self.kinetic) * jnp.expm1(-self.decay * beyond)
        return self.breakaway * x * (2.0 - x) + fall


class BrownMcPhee(AbstractFallingFriction):
    r"""Friction that rises to about mu_S and then falls, smooth (P. Brown, J. McPhee 2016).

    $$\mu(v) = \mu_C \tanh\frac{4 v}{v_t} + (\mu_S - \mu_C) \frac{v / v_t}{\left(\frac{1}{4} (v /
    v_t)^2 + \frac{3}{4}\right)^2}$$

    **Arguments:** `breakaway`, `kinetic`: mu_S and mu_C. `transition_speed`: v_t, m/s, positive, at
    which the second term has its maximum; 1e-3 by default.

    >>> friction = cj.frictions.BrownMcPhee(breakaway=0.2, kinetic=0.1, transition_speed=1e-3)
    >>> print(f"{friction.ratio(1e-3):.4f}, {friction.ratio(1.0):.4f}")
    0.1999, 0.1000
    """

    transition_speed: Single = quantity(
        "m/s", default=1e-3, positive=True, remedy="give v_t in m/s"
    )

    @override
    def ratio(self, slip_speed: Scalar) -> Scalar:
        x = slip_speed / self.transition_speed
        peak = (self.breakaway - self.kinetic) * x / (0.25 * x**2 + 0.75) ** 2
        return self.kinetic * jnp.tanh(4.0 * x) + peak


class AbstractBristleFriction(AbstractConverting):
    """Base class of bristle laws, with which contacts stick.

    Bristles stand for the elastic deflection of the surfaces: a constant load below the breakaway
    force deflects them and causes no further motion. The deflection z is a state of the contact,
    integrated with the motion: a vector in m that is zero at the onset, stored in the axes of the
    contact's first body. Only the component of z perpendicular to the normal acts. Friction is the
    normal force times a vector `ratio`. The rate of z must be zero without slip, so that a sticking
    contact doesn't drift.

    In the formulas of the laws, v is the slip, m/s, the tangential velocity of the second body
    relative to the first; F_t is the friction force and F_n the normal force.

    ```python
    import clearjoint as cj
    from clearjoint.testing import check_bristles

    class Springs(cj.extend.AbstractBristleFriction):
        coefficient: float
        stiffness: float  # 1/m

        def rate(self, deflection, slip):
            speed, _ = cj.extend.norm_and_direction(slip)
            size, _ = cj.extend.norm_and_direction(deflection)
            used = size * self.stiffness / self.coefficient
            return slip - deflection * (speed * used * self.stiffness / self.coefficient)

        def ratio(self, deflection, rate, slip):
            return deflection * self.stiffness

        def sliding_ratio(self, slip_speed):
            return self.coefficient

        def full_deflection(self):
            return self.coefficient / self.stiffness

    check_bristles(Springs(0.1, 1e5))
    ```
    """

    @abc.abstractmethod
    def rate(self, deflection: Vector, slip: Vector) -> Vector:
        """Return the rate of the deflection, m/s; all vectors are in the same axes."""

    @abc.abstractmethod
    def ratio(self, deflection: Vector, rate: Vector, slip: Vector) -> Vector:
        """Return the vector of friction over normal force, along the slip in steady sliding. The
        friction force on the second body is minus this vector times the normal force. `rate` is
        that of the deflection, m/s."""

    @abc.abstractmethod
    def sliding_ratio(self, slip_speed: Scalar) -> Scalar:
        """Return friction over normal force at a steady slip speed, m/s, without viscous part."""

    @abc.abstractmethod
    def full_deflection(self) -> Scalar:
        """Return the approximate deflection in steady sliding, m: the scale to which the step size
        control relates the error of the deflection."""

    def stored_energy(self, deflection: Vector) -> Scalar:
        """Return the bristles' recoverable energy over the normal force, m; zero by default."""
        return 0.0

    def force(self, normal_force: Scalar, slip: Vector) -> Vector:
        """Return the friction force on the second body in steady sliding, N, without a viscous
        part. It serves where deflections are not integrated, as for rigid contacts."""
        speed, direction = norm_and_direction(slip)
        return direction * (-normal_force * self.sliding_ratio(speed))


FrictionLaw: TypeAlias = AbstractFriction | AbstractBristleFriction
"""Law of the friction in a joint, without or with bristles."""


class Dahl(AbstractBristleFriction):
    r"""Bristles without damping (P. R. Dahl 1968, with the exponent one).

    $$\dot z = v - \frac{\sigma_0 |v|}{\mu} z, \quad \frac{F_t}{F_n} = \sigma_0 z$$

    `coefficient` is mu, friction over normal force in sliding, and `stiffness` sigma0, 1/m, bristle
    stiffness over normal force, 1e5 by default.

    >>> friction = cj.frictions.Dahl(0.1, stiffness=1e5)
    >>> print(f"{friction.full_deflection():.1e} m")  # mu/sigma0
    1.0e-06 m
    """

    coefficient: Single = quantity("1", positive=True, remedy="give mu")
    stiffness: Single = quantity("1/m", default=1e5, positive=True, remedy="give sigma0 in 1/m")

    @override
    def rate(self, deflection: Vector, slip: Vector) -> Vector:
        speed, _ = norm_and_direction(slip)
        return slip - deflection * (self.stiffness * speed / self.coefficient)

    @override
    def ratio(self, deflection: Vector, rate: Vector, slip: Vector) -> Vector:
        return deflection * self.stiffness

    @override
    def sliding_ratio(self, slip_speed: Scalar) -> Scalar:
        return self.coefficient

    @override
    def stored_energy(self, deflection: Vector) -> Scalar:
        return 0.5 * self.stiffness * deflection.dot(deflection)

    @override
    def full_deflection(self) -> Scalar:
        return self.coefficient / self.stiffness


class AbstractDampedBristles(AbstractBristleFriction):
    """Base class of damped bristles whose friction in steady sliding follows Stribeck's curve.
    Formulas and arguments are those of `LuGre`."""

    stiffness: eqx.AbstractVar[Single]
    damping: eqx.AbstractVar[Single]
    viscosity: eqx.AbstractVar[Single]
    breakaway: Single = quantity("1", positive=True, remedy="give mu_S")
    kinetic: Single = quantity("1", positive=True, remedy="give mu_C")
    stribeck_speed: Single = quantity("m/s", positive=True, remedy="give v_S in m/s")

    @override
    def _check_together(self) -> None:
        require_breakaway(self.breakaway, self.kinetic)

    @override
    def ratio(self, deflection: Vector, rate: Vector, slip: Vector) -> Vector:
        return deflection * self.stiffness + rate * self.damping + slip * self.viscosity

    @override
    def stored_energy(self, deflection: Vector) -> Scalar:
        return 0.5 * self.stiffness * deflection.dot(deflection)

    @override
    def sliding_ratio(self, slip_speed: Scalar) -> Scalar:
        fade = jnp.exp(-((slip_speed / self.stribeck_speed) ** 2))
        return self.kinetic + (self.breakaway - self.kinetic) * fade

    @override
    def full_deflection(self) -> Scalar:
        return self.kinetic / self.stiffness


class LuGre(AbstractDampedBristles):
    r"""Damped bristles with a Stribeck curve (C. Canudas de Wit et al. 1995).

    $$\dot z = v - \frac{\sigma_0 |v|}{g(v)} z, \quad g = \mu_C + (\mu_S - \mu_C) e^{-(v /
    v_S)^2}, \quad \frac{F_t}{F_n} = \sigma_0 z + \sigma_1 \dot z + \sigma_2 v$$

    The law is passive only if sigma2 is at least sigma1 (mu_S - mu_C)/mu_C (N. Barabanov, R. Ortega
    2000). With a smaller sigma2, bristles may release more energy than they received, at speeds |v|
    with sigma1 |v| > 4 g(v).

    **Arguments:** `breakaway`, `kinetic`: mu_S and mu_C <= mu_S. `stribeck_speed`: v_S, m/s.
    `stiffness`, `damping`, `viscosity`: sigma0 (1/m), sigma1 (s/m) and sigma2 (s/m), all over
    normal force; 1e5, 0 and 0 by default.

    >>> friction = cj.frictions.LuGre(breakaway=0.2, kinetic=0.1, stribeck_speed=0.01)
    >>> print(f"{friction.sliding_ratio(0.01):.4f}")  # 0.1 + 0.1 exp(-1)
    0.1368
    """

    stiffness: Single = quantity("1/m", default=1e5, positive=True, remedy="give sigma0 in 1/m")
    damping: Single = quantity("s/m", default=0.0, positive=True, zero=True)
    viscosity: Single = quantity("s/m", default=0.0, positive=True, zero=True)

    @override
    def rate(self, deflection: Vector, slip: Vector) -> Vector:
        speed, _ = norm_and_direction(slip)
        return slip - deflection * (self.stiffness * speed / self.sliding_ratio(speed))


class ElastoPlastic(AbstractDampedBristles):
    r"""The LuGre law with elastic bristles up to a deflection z_ba (P. Dupont et al. 2002).

    $$\dot z = v - \alpha(z, v) \frac{\sigma_0 |v|}{g(v)} z$$

    The factor alpha is 0 for |z| <= z_ba and 1 for |z| >= g(v)/sigma0; between these deflections it
    rises as half a period of a cosine. It is multiplied by the cosine of the angle between slip and
    deflection, or by 0 where this is negative, so that bristles relax elastically. Choose this law
    where an oscillating load must not cause a drift: below z_ba there is none.

    **Arguments:** those of `LuGre`, and `elastic_deflection`: z_ba, m, below mu_C/sigma0.

    >>> friction = cj.frictions.ElastoPlastic(0.2, 0.1, 0.01, elastic_deflection=5e-7)
    >>> still = friction.rate(extend.Vector(4e-7, 0.0, 0.0), extend.Vector(1e-3, 0.0, 0.0))
    >>> print(f"{still.x:.1e}")  # m/s: below 0.5 um all of the slip is elastic
    1.0e-03
    """

    elastic_deflection: Single = quantity("m", positive=True, remedy="give z_ba in m")
    stiffness: Single = quantity("1/m", default=1e5, positive=True, remedy="give sigma0 in 1/m")
    damping: Single = quantity("s/m", default=0.0, positive=True, zero=True)
    viscosity: Single = quantity("s/m", default=0.0, positive=True, zero=True)

    @override
    def _check_together(self) -> None:
        super()._check_together()
        values = self.elastic_deflection, self.full_deflection()
        expected = "below kinetic/stiffness = {1} m"
        remedy = "give z_ba in m, half of that for example"
        require_numbers(operator.lt, "elastic_deflection", values, expected, remedy)

    @override
    def rate(self, deflection: Vector, slip: Vector) -> Vector:
        speed, along = norm_and_direction(slip)
        size, direction = norm_and_direction(deflection)
        in_sliding = self.sliding_ratio(speed) / self.stiffness
        fraction = (size - self.elastic_deflection) / (in_sliding - self.elastic_deflection)
        alpha = 0.5 - 0.5 * jnp.cos(jnp.pi * jnp.clip(fraction, 0.0, 1.0))
        # Relaxing bristles, deflected against the slip, are elastic.
        forwards = jnp.maximum(direction.dot(along), 0.0)
        return slip - deflection * (alpha * forwards * speed / in_sliding)

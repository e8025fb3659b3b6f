"""Bristle laws: friction that comes from the deflection of the surfaces' asperities, a state.

A bristle law sticks: a load below breakaway deflects the bristles and then moves nothing, where an
algebraic law (`.friction`) creeps. All numbers are per unit of normal force, so that friction
begins and ends with the contact, however the normal force changes in between.
"""

import abc

import equinox as eqx
import jax.numpy as jnp

from ...fields.checks import as_shown, checkable, require
from ...fields.conversion import AbstractConverting
from ...fields.declarations import quantity
from ...fields.types import Single
from ...math.smoothing import norm_and_direction
from ...math.vectors import Scalar, Vector
from .stribeck import require_breakaway


class AbstractBristleFriction(AbstractConverting):
    """Tangential force by the deflection of bristles, which is integrated with the motion.

    A subclass gives the deflection's rate, friction over normal force, and two numbers about it.
    The rate must vanish with the slip, so that what sticks stays. A deflection is a vector in m,
    zero when a contact begins; it is kept in the axes of the contact's first body, and only its
    part across the normal acts.

    ```python
    import clearjoint as cj
    import jax.numpy as jnp
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
    scene, state = cj.mechanisms.double_pendulum(friction=Springs(0.1, 1e5))
    ```
    """

    @abc.abstractmethod
    def rate(self, deflection: Vector, slip: Vector) -> Vector:
        """Rate of the deflection, m/s, at a deflection in m and a slip velocity in m/s."""

    @abc.abstractmethod
    def ratio(self, deflection: Vector, rate: Vector, slip: Vector) -> Vector:
        """Friction over normal force, in the direction that it resists; `rate` is the deflection's,
        m/s."""

    @abc.abstractmethod
    def sliding_ratio(self, slip_speed: Scalar) -> Scalar:
        """Dry friction over normal force after a long slip at a speed in m/s."""

    @abc.abstractmethod
    def full_deflection(self) -> Scalar:
        """About the deflection at which bristles slide, m: errors of deflections are judged against
        it."""

    def stored_energy(self, deflection: Vector) -> Scalar:
        """Energy over normal force, m, that bristles of a deflection in m would give back; zero by
        default, which counts all that friction takes as dissipated."""
        del deflection
        return 0.0

    def force(self, normal_force: Scalar, slip: Vector) -> Vector:
        """Tangential force in N of a long slip (m/s), for runs without the bristles' motion."""
        speed, direction = norm_and_direction(slip)
        return direction * (-normal_force * self.sliding_ratio(speed))


class Dahl(AbstractBristleFriction):
    r"""dz/dt = v - sigma0 |v| z/mu, friction sigma0 z (P. R. Dahl 1968, of exponent one).

    $$\dot z = v - \frac{\sigma_0 |v|}{\mu} z, \quad \frac{F_t}{F_n} = \sigma_0 z$$

    **Arguments:** `coefficient` mu; `stiffness` sigma0, 1/m, of the bristles over the normal force.

    >>> friction = cj.frictions.Dahl(0.1, stiffness=1e5)
    >>> print(f"{friction.full_deflection():.1e} m")  # mu/sigma0
    1.0e-06 m
    """

    coefficient: Single = quantity("1", positive=True, remedy="give mu")
    stiffness: Single = quantity("1/m", default=1e5, positive=True, remedy="give sigma0 in 1/m")

    def rate(self, deflection: Vector, slip: Vector) -> Vector:
        """v - sigma0 |v| z/mu."""
        speed, _ = norm_and_direction(slip)
        return slip - deflection * (self.stiffness * speed / self.coefficient)

    def ratio(self, deflection: Vector, rate: Vector, slip: Vector) -> Vector:
        """sigma0 z."""
        del rate, slip
        return deflection * self.stiffness

    def sliding_ratio(self, slip_speed: Scalar) -> Scalar:
        """mu, whatever the speed."""
        del slip_speed
        return self.coefficient

    def stored_energy(self, deflection: Vector) -> Scalar:
        """sigma0 z^2/2."""
        return 0.5 * self.stiffness * deflection.dot(deflection)

    def full_deflection(self) -> Scalar:
        """mu/sigma0."""
        return self.coefficient / self.stiffness


class AbstractDampedBristles(AbstractBristleFriction):
    """Bristles with damping that slide at Stribeck's curve: friction sigma0 z + sigma1 dz/dt."""

    breakaway: eqx.AbstractVar[Single]
    kinetic: eqx.AbstractVar[Single]
    stribeck_speed: eqx.AbstractVar[Single]
    stiffness: eqx.AbstractVar[Single]
    damping: eqx.AbstractVar[Single]
    viscosity: eqx.AbstractVar[Single]

    def _check_together(self) -> None:
        require_breakaway(self.breakaway, self.kinetic)

    def ratio(self, deflection: Vector, rate: Vector, slip: Vector) -> Vector:
        """sigma0 z + sigma1 dz/dt + sigma2 v."""
        return deflection * self.stiffness + rate * self.damping + slip * self.viscosity

    def stored_energy(self, deflection: Vector) -> Scalar:
        """sigma0 z^2/2."""
        return 0.5 * self.stiffness * deflection.dot(deflection)

    def sliding_ratio(self, slip_speed: Scalar) -> Scalar:
        """g(v) = mu_C + (mu_S - mu_C) exp(-(v/v_S)^2)."""
        fade = jnp.exp(-((slip_speed / self.stribeck_speed) ** 2))
        return self.kinetic + (self.breakaway - self.kinetic) * fade

    def full_deflection(self) -> Scalar:
        """mu_C/sigma0."""
        return self.kinetic / self.stiffness


class LuGre(AbstractDampedBristles):
    r"""dz/dt = v - sigma0 |v| z/g(v), friction sigma0 z + sigma1 dz/dt + sigma2 v, with
    g = mu_C + (mu_S - mu_C) exp(-(v/v_S)^2) (C. Canudas de Wit and others 1995).

    $$\dot z = v - \frac{\sigma_0 |v|}{g(v)} z, \quad g = \mu_C + (\mu_S - \mu_C) e^{-(v /
    v_S)^2}, \quad \frac{F_t}{F_n} = \sigma_0 z + \sigma_1 \dot z + \sigma_2 v$$

    **Arguments:** `breakaway` mu_S and `kinetic` mu_C, the former at least the latter;
    `stribeck_speed` v_S, m/s; all over the normal force: `stiffness` sigma0, 1/m, `damping` sigma1,
    s/m, and `viscosity` sigma2, s/m. Where sigma1 |v| exceeds 4 g(v) the bristles may give
    out more than they took in (N. Barabanov, R. Ortega 2000).

    >>> friction = cj.frictions.LuGre(breakaway=0.2, kinetic=0.1, stribeck_speed=0.01)
    >>> print(f"{friction.sliding_ratio(0.01):.4f}")  # 0.1 + 0.1 exp(-1)
    0.1368
    """

    breakaway: Single = quantity("1", positive=True, remedy="give mu_S")
    kinetic: Single = quantity("1", positive=True, remedy="give mu_C")
    stribeck_speed: Single = quantity("m/s", positive=True, remedy="give v_S in m/s")
    stiffness: Single = quantity("1/m", default=1e5, positive=True, remedy="give sigma0 in 1/m")
    damping: Single = quantity("s/m", default=0.0, positive=True, zero=True)
    viscosity: Single = quantity("s/m", default=0.0, positive=True, zero=True)

    def rate(self, deflection: Vector, slip: Vector) -> Vector:
        """v - sigma0 |v| z/g(v)."""
        speed, _ = norm_and_direction(slip)
        return slip - deflection * (self.stiffness * speed / self.sliding_ratio(speed))


class ElastoPlastic(AbstractDampedBristles):
    r"""LuGre's law whose bristles are elastic up to a deflection z_ba (P. Dupont and others 2002).

    $$\dot z = v - \alpha(z) \frac{\sigma_0 |v|}{g(v)} z$$

    dz/dt = v - alpha sigma0 |v| z/g(v): alpha is 0 up to |z| = z_ba and where bristles relax, 1
    from g(v)/sigma0 on, and half a sine in between. Below z_ba nothing drifts, however the load
    swings. In a plane, alpha has the cosine of slip and deflection as a factor.

    **Arguments:** as those of `LuGre`, and `elastic_deflection` z_ba, m, below mu_C/sigma0.

    >>> friction = cj.frictions.ElastoPlastic(0.2, 0.1, 0.01, elastic_deflection=5e-7)
    >>> still = friction.rate(extend.Vector(4e-7, 0.0, 0.0), extend.Vector(1e-3, 0.0, 0.0))
    >>> print(f"{still.x:.1e}")  # m/s: below 0.5 um all of the slip is elastic
    1.0e-03
    """

    breakaway: Single = quantity("1", positive=True, remedy="give mu_S")
    kinetic: Single = quantity("1", positive=True, remedy="give mu_C")
    stribeck_speed: Single = quantity("m/s", positive=True, remedy="give v_S in m/s")
    elastic_deflection: Single = quantity("m", positive=True, remedy="give z_ba in m")
    stiffness: Single = quantity("1/m", default=1e5, positive=True, remedy="give sigma0 in 1/m")
    damping: Single = quantity("s/m", default=0.0, positive=True, zero=True)
    viscosity: Single = quantity("s/m", default=0.0, positive=True, zero=True)

    def _check_together(self) -> None:
        super()._check_together()
        known = checkable(self.elastic_deflection, self.full_deflection())
        if known is not None:
            elastic, full = known
            require(
                elastic < full,
                "elastic_deflection",
                elastic,
                f"below kinetic/stiffness = {as_shown(full)} m",
                "give z_ba in m, half of that for example",
            )

    def rate(self, deflection: Vector, slip: Vector) -> Vector:
        """v - alpha(z, v) sigma0 |v| z/g(v)."""
        speed, along = norm_and_direction(slip)
        size, direction = norm_and_direction(deflection)
        full = self.sliding_ratio(speed) / self.stiffness
        place = (size - self.elastic_deflection) / (full - self.elastic_deflection)
        share = 0.5 - 0.5 * jnp.cos(jnp.pi * jnp.clip(place, 0.0, 1.0))
        forwards = jnp.maximum(direction.dot(along), 0.0)
        return slip - deflection * (share * forwards * speed / full)

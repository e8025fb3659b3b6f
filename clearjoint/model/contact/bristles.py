"""Bristle friction laws: friction from the deflection of the surfaces' asperities, the "bristles".

The deflection is an additional state of a contact, integrated with the motion. Such a law models
sticking: a load below the breakaway force deflects the bristles and then causes no motion. A law of
`.friction`, which depends on the slip speed alone, creeps instead. All coefficients are over the
normal force, so that friction starts and ends with the contact.
"""

import abc
import operator
from typing import TypeAlias

import equinox as eqx
import jax.numpy as jnp

from ...fields.checks import require_numbers
from ...fields.conversion import AbstractConverting
from ...fields.declarations import quantity
from ...fields.types import Single
from ...math.smoothing import norm_and_direction
from ...math.vectors import Scalar, Vector
from .friction import AbstractFriction, require_breakaway


class AbstractBristleFriction(AbstractConverting):
    """Base class of bristle laws: friction from a deflection that is integrated with the motion.

    A subclass defines the rate of the deflection, the ratio of friction to normal force, and, for
    steady sliding, this ratio and the size of the deflection. The rate must vanish with the slip,
    so that a sticking contact doesn't drift. The deflection is a vector in m that is zero at the
    onset of contact. It is stored in the axes of the contact's first body, and only its component
    perpendicular to the normal acts.

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
        """Return the rate of the deflection, m/s.

        **Arguments:** `deflection`: m. `slip`: tangential velocity of the surfaces, m/s.
        """

    @abc.abstractmethod
    def ratio(self, deflection: Vector, rate: Vector, slip: Vector) -> Vector:
        """Return the vector of friction over normal force, in the direction of the slip.

        The friction force on the second body is minus this vector times the normal force.

        **Arguments:** `deflection`: m. `rate`: of the deflection, m/s. `slip`: tangential velocity
        of the second body relative to the first, m/s.
        """

    @abc.abstractmethod
    def sliding_ratio(self, slip_speed: Scalar) -> Scalar:
        """Return the ratio of friction to normal force in steady sliding at a speed, m/s, without
        a viscous part."""

    @abc.abstractmethod
    def full_deflection(self) -> Scalar:
        """Return the approximate size of the deflection in steady sliding, m.

        The solver's error control compares errors of deflections with this number.
        """

    def stored_energy(self, deflection: Vector) -> Scalar:
        """Return the recoverable energy of the bristles over the normal force, m; zero by default.

        With zero, a run counts all work of friction as dissipated. `deflection` is in m.
        """
        return 0.0

    def force(self, normal_force: Scalar, slip: Vector) -> Vector:
        """Return the friction force on the second body in steady sliding, N.

        It is used where deflections are not integrated, such as for rigid contacts.

        **Arguments:** `normal_force`: N. `slip`: velocity of the second body relative to the first,
        m/s.
        """
        speed, direction = norm_and_direction(slip)
        return direction * (-normal_force * self.sliding_ratio(speed))


FrictionLaw: TypeAlias = AbstractFriction | AbstractBristleFriction
"""Law of the friction in a joint, without or with bristles."""


class Dahl(AbstractBristleFriction):
    r"""Bristles without damping (P. R. Dahl 1968, with the exponent one).

    $$\dot z = v - \frac{\sigma_0 |v|}{\mu} z, \quad \frac{F_t}{F_n} = \sigma_0 z$$

    Here z is the deflection, v the slip, F_t friction and F_n the normal force.

    **Arguments:**

    - `coefficient`: mu, friction over normal force in sliding.
    - `stiffness`: sigma0, 1/m, bristle stiffness over normal force; 1e5 by default.

    **Raises:** `ValueError` if a value is not positive.

    >>> friction = cj.frictions.Dahl(0.1, stiffness=1e5)
    >>> print(f"{friction.full_deflection():.1e} m")  # mu/sigma0
    1.0e-06 m
    """

    coefficient: Single = quantity("1", positive=True, remedy="give mu")
    stiffness: Single = quantity("1/m", default=1e5, positive=True, remedy="give sigma0 in 1/m")

    def rate(self, deflection: Vector, slip: Vector) -> Vector:
        """Return v - sigma0 |v| z/mu, m/s."""
        speed, _ = norm_and_direction(slip)
        return slip - deflection * (self.stiffness * speed / self.coefficient)

    def ratio(self, deflection: Vector, rate: Vector, slip: Vector) -> Vector:
        """Return sigma0 z."""
        return deflection * self.stiffness

    def sliding_ratio(self, slip_speed: Scalar) -> Scalar:
        """Return mu at every speed."""
        return self.coefficient

    def stored_energy(self, deflection: Vector) -> Scalar:
        """Return sigma0 z^2/2, m."""
        return 0.5 * self.stiffness * deflection.dot(deflection)

    def full_deflection(self) -> Scalar:
        """Return mu/sigma0, m."""
        return self.coefficient / self.stiffness


class AbstractDampedBristles(AbstractBristleFriction):
    """Base class of damped bristles whose friction in steady sliding follows Stribeck's curve.

    Friction over normal force is sigma0 z + sigma1 dz/dt + sigma2 v, with the deflection z, m, and
    the slip v, m/s. In steady sliding its dry part, without sigma2 v, falls from `breakaway` to
    `kinetic` around the `stribeck_speed`, m/s. `stiffness` is sigma0, 1/m, `damping` sigma1 and
    `viscosity` sigma2, s/m.

    **Raises:** `ValueError` if `breakaway`, `kinetic` or `stribeck_speed` is not positive, or
    `breakaway` is below `kinetic`.
    """

    stiffness: eqx.AbstractVar[Single]
    damping: eqx.AbstractVar[Single]
    viscosity: eqx.AbstractVar[Single]
    breakaway: Single = quantity("1", positive=True, remedy="give mu_S")
    kinetic: Single = quantity("1", positive=True, remedy="give mu_C")
    stribeck_speed: Single = quantity("m/s", positive=True, remedy="give v_S in m/s")

    def _check_together(self) -> None:
        require_breakaway(self.breakaway, self.kinetic)

    def ratio(self, deflection: Vector, rate: Vector, slip: Vector) -> Vector:
        """Return sigma0 z + sigma1 dz/dt + sigma2 v."""
        return deflection * self.stiffness + rate * self.damping + slip * self.viscosity

    def stored_energy(self, deflection: Vector) -> Scalar:
        """Return sigma0 z^2/2, m."""
        return 0.5 * self.stiffness * deflection.dot(deflection)

    def sliding_ratio(self, slip_speed: Scalar) -> Scalar:
        """Return g(v) = mu_C + (mu_S - mu_C) exp(-(v/v_S)^2) for the speed v, m/s.

        mu_S is `breakaway`, mu_C `kinetic` and v_S the `stribeck_speed`.
        """
        fade = jnp.exp(-((slip_speed / self.stribeck_speed) ** 2))
        return self.kinetic + (self.breakaway - self.kinetic) * fade

    def full_deflection(self) -> Scalar:
        """Return mu_C/sigma0, m."""
        return self.kinetic / self.stiffness


class LuGre(AbstractDampedBristles):
    r"""Damped bristles with a Stribeck curve (C. Canudas de Wit et al. 1995).

    $$\dot z = v - \frac{\sigma_0 |v|}{g(v)} z, \quad g = \mu_C + (\mu_S - \mu_C) e^{-(v /
    v_S)^2}, \quad \frac{F_t}{F_n} = \sigma_0 z + \sigma_1 \dot z + \sigma_2 v$$

    Here z is the deflection, v the slip, F_t friction and F_n the normal force. For
    sigma1 |v| > 4 g(v) the law isn't passive: bristles may release more energy than they received
    (N. Barabanov, R. Ortega 2000).

    **Arguments:**

    - `breakaway`, `kinetic`: mu_S and mu_C, with mu_S >= mu_C.
    - `stribeck_speed`: v_S, m/s.
    - `stiffness`, `damping`, `viscosity`: sigma0 (1/m), sigma1 (s/m) and sigma2 (s/m), all over
      normal force; 1e5, 0 and 0 by default.

    **Raises:** `ValueError` if `damping` or `viscosity` is negative, another value isn't positive,
    or mu_S is below mu_C.

    >>> friction = cj.frictions.LuGre(breakaway=0.2, kinetic=0.1, stribeck_speed=0.01)
    >>> print(f"{friction.sliding_ratio(0.01):.4f}")  # 0.1 + 0.1 exp(-1)
    0.1368
    """

    stiffness: Single = quantity("1/m", default=1e5, positive=True, remedy="give sigma0 in 1/m")
    damping: Single = quantity("s/m", default=0.0, positive=True, zero=True)
    viscosity: Single = quantity("s/m", default=0.0, positive=True, zero=True)

    def rate(self, deflection: Vector, slip: Vector) -> Vector:
        """Return v - sigma0 |v| z/g(v), m/s."""
        speed, _ = norm_and_direction(slip)
        return slip - deflection * (self.stiffness * speed / self.sliding_ratio(speed))


class ElastoPlastic(AbstractDampedBristles):
    r"""The LuGre law with elastic bristles up to a deflection z_ba (P. Dupont et al. 2002).

    $$\dot z = v - \alpha(z) \frac{\sigma_0 |v|}{g(v)} z$$

    Here z is the deflection, v the slip, and g(v) friction over normal force in steady sliding, as
    in `LuGre`. The factor alpha is 0 for |z| <= z_ba and for bristles that relax, and 1 for
    |z| >= g(v)/sigma0; between these deflections it rises as half a period of a cosine. Below z_ba
    an oscillating load causes no drift. In two dimensions alpha is multiplied by the cosine of the
    angle between slip and deflection, if this is positive.

    **Arguments:**

    - `breakaway`, `kinetic`: mu_S and mu_C, with mu_S >= mu_C.
    - `stribeck_speed`: v_S in g(v), m/s.
    - `elastic_deflection`: z_ba, m, below mu_C/sigma0.
    - `stiffness`, `damping`, `viscosity`: sigma0 (1/m), sigma1 (s/m) and sigma2 (s/m), all over
      normal force; 1e5, 0 and 0 by default.

    **Raises:** `ValueError` if `damping` or `viscosity` is negative, another value isn't positive,
    mu_S is below mu_C, or z_ba is too large.

    >>> friction = cj.frictions.ElastoPlastic(0.2, 0.1, 0.01, elastic_deflection=5e-7)
    >>> still = friction.rate(extend.Vector(4e-7, 0.0, 0.0), extend.Vector(1e-3, 0.0, 0.0))
    >>> print(f"{still.x:.1e}")  # m/s: below 0.5 um all of the slip is elastic
    1.0e-03
    """

    elastic_deflection: Single = quantity("m", positive=True, remedy="give z_ba in m")
    stiffness: Single = quantity("1/m", default=1e5, positive=True, remedy="give sigma0 in 1/m")
    damping: Single = quantity("s/m", default=0.0, positive=True, zero=True)
    viscosity: Single = quantity("s/m", default=0.0, positive=True, zero=True)

    def _check_together(self) -> None:
        super()._check_together()
        values = self.elastic_deflection, self.full_deflection()
        expected = "below kinetic/stiffness = {1} m"
        remedy = "give z_ba in m, half of that for example"
        require_numbers(operator.lt, "elastic_deflection", values, expected, remedy)

    def rate(self, deflection: Vector, slip: Vector) -> Vector:
        """Return v - alpha(z, v) sigma0 |v| z/g(v), m/s."""
        speed, along = norm_and_direction(slip)
        size, direction = norm_and_direction(deflection)
        full = self.sliding_ratio(speed) / self.stiffness
        fraction = (size - self.elastic_deflection) / (full - self.elastic_deflection)
        alpha = 0.5 - 0.5 * jnp.cos(jnp.pi * jnp.clip(fraction, 0.0, 1.0))
        # Relaxing bristles, deflected against the slip, are elastic.
        forwards = jnp.maximum(direction.dot(along), 0.0)
        return slip - deflection * (alpha * forwards * speed / full)

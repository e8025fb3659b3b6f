"""Friction laws of contacts, as functions of the slip speed, or with the deflection of bristles.

In both kinds of law the friction is proportional to the normal force, so that it starts and ends
with the contact.

Laws of the slip speed give the ratio mu(v) of friction to normal force for the speed v, m/s. They
regularise the jump of Coulomb friction at zero speed, so that a contact creeps under a tangential
load.

Bristle laws model sticking. The deflection of the bristles is an additional state of a contact,
integrated with the motion: a load below the breakaway force deflects them and then causes no
motion.
"""

import abc
import operator
from typing import TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp

from ..._fields.checks import require_numbers
from ..._fields.objects import AbstractConverting, quantity
from ..._fields.types import Single
from ..._math.smoothing import norm_and_direction, positive_power
from ..._math.vectors import Scalar, Vector


class AbstractFriction(AbstractConverting):
    """Base class of friction laws without bristles: a force against the slip, proportional to the
    normal force. Laws with bristles derive from `AbstractBristleFriction`.

    A subclass defines the ratio of friction to normal force as a function of the slip speed. The
    ratio must vanish at zero speed, so that the force and its derivatives are finite there.

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

    friction = Fading(slow=0.15, fast=0.1, fading_speed=0.01)
    check_friction(friction)
    scene, state = cj.mechanisms.double_pendulum(friction=friction)
    ```
    """

    @abc.abstractmethod
    def ratio(self, slip_speed: Scalar) -> Scalar:
        """Return the ratio of friction to normal force at a slip speed, m/s; zero at zero speed."""

    def force(self, normal_force: Scalar, slip: Vector) -> Vector:
        """Return the friction force on the second body, N; it opposes the slip.

        **Arguments:** `normal_force`: N. `slip`: tangential velocity of the second body relative to
        the first, m/s.
        """
        speed, _ = norm_and_direction(slip)
        rests = speed == 0.0
        _, slope = jax.jvp(self.ratio, (jnp.zeros_like(speed),), (jnp.ones_like(speed),))
        # At zero speed the quotient is replaced by its limit, which keeps the derivatives correct.
        per_speed = jnp.where(rests, slope, self.ratio(speed) / jnp.where(rests, 1.0, speed))
        return slip * (-normal_force * per_speed)


class AbstractRegularisedFriction(AbstractFriction):
    """Base class of Coulomb friction that is regularised at low speed.

    Well above the `regularisation_speed`, m/s, the ratio of friction to normal force is constant:
    the `coefficient` mu, or a fixed fraction of it.

    **Raises:** `ValueError` if mu is negative or the speed is not positive.
    """

    coefficient: Single = quantity("1", positive=True, zero=True, remedy="give mu")
    regularisation_speed: Single = quantity(
        "m/s", default=1e-3, positive=True, remedy="give v_d in m/s"
    )


class RegularisedCoulomb(AbstractRegularisedFriction):
    r"""Coulomb friction mu tanh(v/v_d), smoothed around zero speed; a loaded contact creeps.

    $$\mu(v) = \mu \tanh\frac{v}{v_d}$$

    **Arguments:** `coefficient`: mu. `regularisation_speed`: v_d, m/s; 1e-3 by default.

    **Raises:** `ValueError` if mu is negative or v_d is not positive.

    >>> friction = cj.frictions.RegularisedCoulomb(0.1, regularisation_speed=1e-3)
    >>> print(f"{friction.ratio(1e-3):.4f}")  # 0.1 tanh(1)
    0.0762
    """

    def ratio(self, slip_speed: Scalar) -> Scalar:
        """Return mu tanh(v/v_d)."""
        return self.coefficient * jnp.tanh(slip_speed / self.regularisation_speed)


class LinearCoulomb(AbstractRegularisedFriction):
    r"""Coulomb friction mu min(v/v_d, 1), linear below the speed v_d; a loaded contact creeps.

    $$\mu(v) = \mu \min\left(\frac{v}{v_d}, 1\right)$$

    **Arguments:** `coefficient`: mu. `regularisation_speed`: v_d, m/s; 1e-3 by default.

    **Raises:** `ValueError` if mu is negative or v_d is not positive.

    >>> friction = cj.frictions.LinearCoulomb(0.1, regularisation_speed=1e-3)
    >>> print(f"{friction.ratio(0.5e-3):.4f}")
    0.0500
    """

    def ratio(self, slip_speed: Scalar) -> Scalar:
        """Return mu min(v/v_d, 1)."""
        return self.coefficient * jnp.minimum(slip_speed / self.regularisation_speed, 1.0)


class Threlfall(AbstractRegularisedFriction):
    r"""Coulomb friction that rises as mu (1 - exp(-3 v/v_d)) up to v_d (A. G. Threlfall 1978).

    $$\mu(v) = \mu \left(1 - e^{-3 \min(v / v_d, 1)}\right)$$

    Above the speed v_d it has the constant value (1 - exp(-3)) mu = 0.9502 mu. With the value
    0.95 mu, which is often printed, the law would jump at v_d. A loaded contact creeps.

    **Arguments:** `coefficient`: mu. `regularisation_speed`: v_d, m/s; 1e-3 by default.

    **Raises:** `ValueError` if mu is negative or v_d is not positive.

    >>> friction = cj.frictions.Threlfall(0.1, regularisation_speed=1e-3)
    >>> print(f"{friction.ratio(0.5):.4f}")  # 0.1 (1 - exp(-3))
    0.0950
    """

    def ratio(self, slip_speed: Scalar) -> Scalar:
        """Return mu (1 - exp(-3 min(v/v_d, 1)))."""
        rise = jnp.minimum(slip_speed / self.regularisation_speed, 1.0)
        return -self.coefficient * jnp.expm1(-3.0 * rise)


class Ambrosio(AbstractFriction):
    r"""Friction that rises linearly from 0 at v0 to mu at v1 (J. Ambrosio 2003).

    $$\mu(v) = \mu\, \frac{v - v_0}{v_1 - v_0}, \quad v_0 \le v \le v_1$$

    Below v0 the ratio mu(v) is zero, and above v1 it is mu.

    **Arguments:** `coefficient`: mu. `lower_speed`, `upper_speed`: v0 and v1, m/s; 1e-4 and 1e-3 by
    default.

    **Raises:** `ValueError` if mu or v0 is negative, or v1 is not above v0.

    >>> friction = cj.frictions.Ambrosio(0.1, lower_speed=1e-4, upper_speed=1e-3)
    >>> print(f"{friction.ratio(0.55e-3):.4f}")  # half-way
    0.0500
    """

    coefficient: Single = quantity("1", positive=True, zero=True, remedy="give mu")
    lower_speed: Single = quantity(
        "m/s", default=1e-4, positive=True, zero=True, remedy="give v0 in m/s"
    )
    upper_speed: Single = quantity("m/s", default=1e-3, shape=())

    def _check_together(self) -> None:
        speeds, remedy = (self.upper_speed, self.lower_speed), "give v1 > v0 in m/s"
        require_numbers(operator.gt, "upper_speed", speeds, "above lower_speed = {1}", remedy)

    def ratio(self, slip_speed: Scalar) -> Scalar:
        """Return mu c_d(v), where c_d is 0 up to v0, rises linearly to 1 at v1, and stays 1."""
        rise = (slip_speed - self.lower_speed) / (self.upper_speed - self.lower_speed)
        # The derivative at v0 is that above v0. With `jnp.maximum` it would be the mean of both
        # sides, which is wrong for v0 = 0, where there are no lower speeds.
        return self.coefficient * jnp.minimum(jnp.where(rise < 0.0, 0.0, rise), 1.0)


def require_breakaway(breakaway: Single, kinetic: Single) -> None:
    """Raise a ``ValueError`` if the breakaway coefficient is smaller than the kinetic one."""
    expected, remedy = "at least kinetic = {1}", "give mu_S >= mu_C"
    require_numbers(operator.ge, "breakaway", (breakaway, kinetic), expected, remedy)


class AbstractFallingFriction(AbstractFriction):
    """Base class of friction that falls with the slip speed from a maximum to a lower limit.

    `breakaway` is mu_S, the maximum of the ratio of friction to normal force, which some laws reach
    only approximately. `kinetic` is mu_C, the limit of this ratio at high speed.

    **Raises:** `ValueError` if mu_S or mu_C is negative, or mu_S is below mu_C.
    """

    breakaway: Single = quantity("1", positive=True, zero=True, remedy="give mu_S")
    kinetic: Single = quantity("1", positive=True, zero=True, remedy="give mu_C")

    def _check_together(self) -> None:
        require_breakaway(self.breakaway, self.kinetic)


class Stribeck(AbstractFallingFriction):
    r"""Friction with Stribeck's curve, regularised at low speed (B. Armstrong-Helouvry 1991).

    $$\mu(v) = \left(\mu_C + (\mu_S - \mu_C) e^{-(v / v_S)^\delta}\right) \tanh\frac{v}{v_d}$$

    The viscous term k v that is often added is left out, since it doesn't depend on the normal
    force. Add a damper to the scene for it.

    **Arguments:**

    - `breakaway`, `kinetic`: mu_S and mu_C, with mu_S >= mu_C.
    - `stribeck_speed`: v_S, m/s, positive.
    - `exponent`: delta, at least 1; 2 by default.
    - `regularisation_speed`: v_d, m/s, positive; 1e-4 by default. The maximum of mu(v) is close to
      mu_S only if v_d is well below v_S.

    **Raises:** `ValueError` if a value is outside its range, or mu_S is below mu_C.

    >>> friction = cj.frictions.Stribeck(breakaway=0.2, kinetic=0.1, stribeck_speed=0.01)
    >>> print(f"{friction.ratio(0.01):.4f}")  # 0.1 + 0.1 exp(-1)
    0.1368
    """

    stribeck_speed: Single = quantity("m/s", positive=True, remedy="give v_S in m/s")
    exponent: Single = quantity("1", default=2.0, positive=True, remedy="give delta, 2 say")
    regularisation_speed: Single = quantity(
        "m/s", default=1e-4, positive=True, remedy="give v_d in m/s"
    )

    def _check_together(self) -> None:
        super()._check_together()
        remedy = "give delta >= 1; below, the slope at rest is infinite"
        values = (self.exponent,)
        require_numbers(lambda delta: delta >= 1.0, "exponent", values, "at least 1", remedy)

    def ratio(self, slip_speed: Scalar) -> Scalar:
        """Return the ratio of friction to normal force at a slip speed, m/s."""
        fade = jnp.exp(-positive_power(slip_speed / self.stribeck_speed, self.exponent))
        curve = self.kinetic + (self.breakaway - self.kinetic) * fade
        return curve * jnp.tanh(slip_speed / self.regularisation_speed)


class BengisuAkay(AbstractFallingFriction):
    r"""Friction that rises to mu_S at v0 and then decays (M. T. Bengisu, A. Akay 1994).

    $$\mu(v) = \mu_C + (\mu_S - \mu_C) e^{-\xi (v - v_0)}, \quad v \ge v_0$$

    Below v0, mu(v) is the parabola mu_S (1 - (1 - v/v0)^2). The curve is continuous, with a kink at
    v0.

    **Arguments:**

    - `breakaway`, `kinetic`: mu_S and mu_C, with mu_S >= mu_C.
    - `breakaway_speed`: v0, m/s, positive; 1e-3 by default.
    - `decay`: xi, s/m, positive; 100 by default.

    **Raises:** `ValueError` if a value is outside its range, or mu_S is below mu_C.

    >>> friction = cj.frictions.BengisuAkay(breakaway=0.2, kinetic=0.1, breakaway_speed=1e-3)
    >>> print(f"{friction.ratio(1e-3):.4f}, {friction.ratio(1.0):.4f}")
    0.2000, 0.1000
    """

    breakaway_speed: Single = quantity("m/s", default=1e-3, positive=True, remedy="give v0 in m/s")
    decay: Single = quantity("s/m", default=100.0, positive=True, remedy="give xi in s/m")

    def ratio(self, slip_speed: Scalar) -> Scalar:
        """Return the ratio of friction to normal force at a slip speed, m/s."""
        x = jnp.minimum(slip_speed / self.breakaway_speed, 1.0)
        beyond = jnp.maximum(slip_speed - self.breakaway_speed, 0.0)
        fall = (self.breakaway - self.kinetic) * jnp.expm1(-self.decay * beyond)
        return self.breakaway * x * (2.0 - x) + fall


class BrownMcPhee(AbstractFallingFriction):
    r"""Friction that rises to about mu_S and then falls, smooth (P. Brown, J. McPhee 2016).

    $$\mu(v) = \mu_C \tanh\frac{4 v}{v_t} + (\mu_S - \mu_C) \frac{v / v_t}{\left(\frac{1}{4} (v /
    v_t)^2 + \frac{3}{4}\right)^2}$$

    The second term has its maximum mu_S - mu_C at v = v_t.

    **Arguments:**

    - `breakaway`, `kinetic`: mu_S and mu_C, with mu_S >= mu_C.
    - `transition_speed`: v_t, m/s, positive; 1e-3 by default.

    **Raises:** `ValueError` if a value is outside its range, or mu_S is below mu_C.

    >>> friction = cj.frictions.BrownMcPhee(breakaway=0.2, kinetic=0.1, transition_speed=1e-3)
    >>> print(f"{friction.ratio(1e-3):.4f}, {friction.ratio(1.0):.4f}")
    0.1999, 0.1000
    """

    transition_speed: Single = quantity(
        "m/s", default=1e-3, positive=True, remedy="give v_t in m/s"
    )

    def ratio(self, slip_speed: Scalar) -> Scalar:
        """Return the ratio of friction to normal force at a slip speed, m/s."""
        x = slip_speed / self.transition_speed
        peak = (self.breakaway - self.kinetic) * x / (0.25 * x**2 + 0.75) ** 2
        return self.kinetic * jnp.tanh(4.0 * x) + peak


class AbstractBristleFriction(AbstractConverting):
    """Base class of bristle laws: friction from a deflection that is integrated with the motion.

    A subclass defines `rate`, the rate of the deflection; `ratio`, the vector of friction over
    normal force; and, for steady sliding, the magnitudes of this vector, `sliding_ratio`, and of
    the deflection, `full_deflection`. The rate must be zero without slip, so that a sticking
    contact doesn't drift. The deflection is a vector in m that is zero at the onset of contact. It
    is stored in the axes of the contact's first body, and only its component perpendicular to the
    normal acts.

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

        All vectors are in the same axes.

        **Arguments:** `deflection`: m. `slip`: tangential velocity of the second body relative to
        the first, m/s.
        """

    @abc.abstractmethod
    def ratio(self, deflection: Vector, rate: Vector, slip: Vector) -> Vector:
        """Return the vector of friction over normal force.

        It points along the slip in steady sliding. The friction force on the second body is minus
        this vector times the normal force.

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

        A viscous part is left out, as in `sliding_ratio`. Without slip the force is zero. This
        method is used where deflections are not integrated, such as for rigid contacts.

        **Arguments:** `normal_force`: N. `slip`: tangential velocity of the second body relative to
        the first, m/s.
        """
        speed, direction = norm_and_direction(slip)
        return direction * (-normal_force * self.sliding_ratio(speed))


FrictionLaw: TypeAlias = AbstractFriction | AbstractBristleFriction
"""Law of the friction in a joint, without or with bristles."""


class Dahl(AbstractBristleFriction):
    r"""Bristles without damping (P. R. Dahl 1968, with the exponent one).

    $$\dot z = v - \frac{\sigma_0 |v|}{\mu} z, \quad \frac{F_t}{F_n} = \sigma_0 z$$

    Here z is the deflection, v the slip, F_t the friction force and F_n the normal force.

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
    the slip v, m/s. `stiffness` is sigma0, 1/m, `damping` sigma1, s/m, and `viscosity` sigma2, s/m.
    In steady sliding the dry part of the ratio, without sigma2 v, falls from `breakaway` to
    `kinetic` with the speed, around the `stribeck_speed`, m/s.

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

    Here z is the deflection, v the slip, F_t the friction force and F_n the normal force. The law
    is passive only if sigma2 is at least sigma1 (mu_S - mu_C)/mu_C (N. Barabanov, R. Ortega 2000).
    With a smaller sigma2, bristles may release more energy than they received, at speeds |v| with
    sigma1 |v| > 4 g(v).

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

    $$\dot z = v - \alpha(z, v) \frac{\sigma_0 |v|}{g(v)} z$$

    Here z is the deflection and v the slip. Friction over normal force is sigma0 z + sigma1 dz/dt +
    sigma2 v, and g(v) is its value in steady sliding without the viscous part sigma2 v; both are
    those of `LuGre`. The factor alpha is 0 for |z| <= z_ba and 1 for |z| >= g(v)/sigma0; between
    these deflections it rises as half a period of a cosine. It is 0 at any deflection if the slip
    is against the deflection, so that the bristles relax. Below z_ba an oscillating load causes no
    drift. In two dimensions alpha is also multiplied by the cosine of the angle between slip and
    deflection, or by 0 where the cosine is negative.

    **Arguments:**

    - `breakaway`, `kinetic`: mu_S and mu_C, with mu_S >= mu_C.
    - `stribeck_speed`: v_S in g(v), m/s.
    - `elastic_deflection`: z_ba, m, below mu_C/sigma0.
    - `stiffness`, `damping`, `viscosity`: sigma0 (1/m), sigma1 (s/m) and sigma2 (s/m), all over
      normal force; 1e5, 0 and 0 by default.

    **Raises:** `ValueError` if `damping` or `viscosity` is negative, another value isn't positive,
    mu_S is below mu_C, or z_ba is not below mu_C/sigma0.

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

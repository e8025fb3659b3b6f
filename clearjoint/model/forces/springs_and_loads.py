"""Springs, dampers and applied loads."""

import math

import equinox as eqx
from jaxtyping import PyTree

from ...fields.checks import require_point
from ...fields.declarations import quantity
from ...fields.types import Quadruple, Single, Triple
from ...math.functions import wrapped
from ...math.smoothing import norm_and_direction
from ...math.vectors import Scalar, Vector, pack, unpack
from ..bodies import Wrench
from ..drives.in_time import TripleInTime, breakpoints_of, triple_in_time, vector_at
from ..drives.rotation import AbstractDriveTorque
from ..joints.base import AbstractForce, Attachment, Motions
from ..joints.pairs import AbstractPairAtPoints
from ..pen import AbstractPen, Marker

SI = "give it in SI units"


class SpringDamper(AbstractPairAtPoints, AbstractForce):
    """A linear spring and damper between a point of one body and a point of another.

    The force is zero where the points coincide, because it has no direction there.

    **Arguments:**

    - `first`, `second`: names of the bodies.
    - `point_first`, `point_second`: (3,) m in body axes.
    - `stiffness`: N/m, not negative.
    - `damping`: N s/m, not negative; zero by default.
    - `free_length`: length without spring force, m, not negative; zero by default.

    **Raises:** `ValueError` if a value is outside its range.

    >>> spring = cj.SpringDamper("ground", "ball", (0, 0, 0), (0, 0, 0), stiffness=100.0)
    >>> ball = testing.moving((0.1, 0, 0), (1, 0, 0, 0), (0, 0, 0), (0, 0, 0))
    >>> ground = testing.moving((0, 0, 0), (1, 0, 0, 0), (0, 0, 0), (0, 0, 0))
    >>> wrenches = extend.unpack(spring).wrenches({"ground": ground, "ball": ball}, 0.0)
    >>> print(f"{wrenches['ball'].force.x:.1f} N")
    -10.0 N
    """

    stiffness: Single = quantity("N/m", positive=True, zero=True, remedy=SI)
    damping: Single = quantity("N s/m", default=0.0, positive=True, zero=True, remedy=SI)
    free_length: Single = quantity("m", default=0.0, positive=True, zero=True, remedy=SI)

    def _stretch(self, motions: Motions) -> tuple[Scalar, Scalar, Vector]:
        first, second = motions[self.first], motions[self.second]
        apart = second.point(self.point_second) - first.point(self.point_first)
        length, direction = norm_and_direction(apart)
        velocity = second.velocity_at(self.point_second) - first.velocity_at(self.point_first)
        return length - self.free_length, velocity.dot(direction), direction

    def wrenches(self, motions: Motions, t: Scalar) -> dict[str, Wrench]:
        """Return the wrenches on both bodies by name: opposite forces along the line between the
        points.
        """
        del t
        stretch, rate, direction = self._stretch(motions)
        force = direction * (self.stiffness * stretch + self.damping * rate)
        return {
            self.first: motions[self.first].wrench(force, self.point_first),
            self.second: motions[self.second].wrench(-force, self.point_second),
        }

    def stored_energy(self, motions: Motions, t: Scalar) -> Scalar:
        """Return the spring's energy, J: half the stiffness times the squared elongation."""
        del t
        return 0.5 * self.stiffness * self._stretch(motions)[0] ** 2

    def supplied_power(self, motions: Motions, t: Scalar) -> Scalar:
        """Return the damper's power, W, which is never positive."""
        del t
        return -self.damping * self._stretch(motions)[1] ** 2

    def draw(self, pen: AbstractPen) -> None:
        """Draw a spring."""
        pen.spring(*self.ends())


class TorsionalSpring(AbstractDriveTorque):
    """A linear torsional spring and damper about a common axis of two bodies.

    The angle from the rest position is taken within half a revolution. The torque jumps there,
    because the bodies' positions don't determine the number of revolutions.

    **Arguments:**

    - `first`, `second`: names of the bodies.
    - `axis`: of rotation, (3,) in the first body's axes, any length.
    - `orientation`: (4,) Euler parameters, scalar first, that transform components in the second
      body's frame to the first body's frame at angle zero; parallel frames by default.
    - `stiffness`: N m/rad. `damping`: N m s/rad. Neither is negative.
    - `rest_angle`: rad, of the unloaded spring.

    **Raises:** `ValueError` if a value is outside its range.

    >>> spring = cj.TorsionalSpring("ground", "lever", (0, 0, 1), stiffness=5.0, damping=0.1)
    >>> spring.body_names()
    ('ground', 'lever')
    """

    first: str = eqx.field(static=True)
    second: str = eqx.field(static=True)
    axis: Triple = quantity("1")
    stiffness: Single = quantity("N m/rad", shape=(), positive=True, zero=True, remedy=SI)
    damping: Single = quantity(
        "N m s/rad", shape=(), default=0.0, positive=True, zero=True, remedy=SI
    )
    rest_angle: Single = quantity("rad", shape=(), default=0.0)
    orientation: Quadruple = quantity("1", default=(1.0, 0.0, 0.0, 0.0))

    def torque_at(self, angle: Scalar, speed: Scalar, t: Scalar) -> Scalar:
        """Return the torque of the spring and the damper on the second body, N m.

        **Arguments:** `angle`: rad. `speed`: its rate, rad/s. `t`: not used.
        """
        del t
        return -(self.stiffness * self._twist(angle) + self.damping * speed)

    def stored_energy(self, motions: Motions, t: Scalar) -> Scalar:
        """Return the spring's energy, J: half the stiffness times the squared twist."""
        del t
        return 0.5 * self.stiffness * self._twist(self.relative_angle(motions).value) ** 2

    def supplied_power(self, motions: Motions, t: Scalar) -> Scalar:
        """Return the damper's power, W, which is never positive."""
        del t
        return -self.damping * self.speed(motions) ** 2

    def _twist(self, angle: Scalar) -> Scalar:
        return wrapped(angle - self.rest_angle, 2.0 * math.pi)


class AppliedLoad(AbstractForce):
    """A force and a torque on a body in global axes, constant or functions of time.

    For a load that depends on the motion subclass `AbstractForce`.

    ```python
    import clearjoint as cj
    import jax.numpy as jnp

    weight = cj.AppliedLoad("rod", force=(0.0, -20.0, 0.0), point=(0.1, 0.0, 0.0))
    kick = cj.PiecewiseConstant([0.0, 0.1, 0.12], [0.0, 500.0, 0.0])
    kicked = cj.AppliedLoad("rod", force=(kick, 0.0, 0.0))

    def unbalance(t):  # 40 N at 300 rad/s
        return 40.0 * jnp.cos(300.0 * t), 40.0 * jnp.sin(300.0 * t), 0.0

    shaken = cj.AppliedLoad("rod", force=unbalance)
    ```

    **Arguments:**

    - `body`: its name.
    - `force`: (3,) N. `torque`: (3,) N m. Each component is a number or a function of time as for
      `DriveTorque`. Instead of three components, a table with values (N, 3) or a Python function
      that returns three numbers may be passed.
    - `point`: where the force acts, (3,) m in body axes.

    **Raises:** `ValueError` if a component is neither a number nor a function of time, or their
    number is not three.

    >>> load = cj.AppliedLoad("arm", force=(0, -10, 0), point=(0.5, 0, 0))
    >>> still = testing.moving((0, 0, 0), (1, 0, 0, 0), (0, 0, 0), (0, 0, 0))
    >>> wrenches = extend.unpack(load).wrenches({"arm": still}, 0.0)
    >>> print(f"{wrenches['arm'].moment.z:.1f} N m")
    -5.0 N m
    """

    body: str = eqx.field(static=True)
    force: TripleInTime = triple_in_time("N", default=(0.0, 0.0, 0.0))
    torque: TripleInTime = triple_in_time("N m", default=(0.0, 0.0, 0.0))
    point: Triple = quantity("m", check=require_point, default=(0.0, 0.0, 0.0))

    def body_names(self) -> tuple[str, ...]:
        """Return the name of the body."""
        return (self.body,)

    def attachments(self) -> tuple[Attachment, ...]:
        """Return the point where the force acts, m in body axes."""
        return (("point", self.body, self.point),)

    def wrenches(self, motions: Motions, t: Scalar) -> dict[str, Wrench]:
        """Return the load at the time `t`, s, as a wrench on the body by its name."""
        motion = motions[self.body]
        force, torque = vector_at(self.force, t), vector_at(self.torque, t)
        return {self.body: motion.wrench(force, self.point) + motion.torque(torque)}

    def breakpoints(self) -> PyTree:
        """Return the breakpoints of the components that are functions of time, s."""
        return breakpoints_of(self.force, self.torque)

    def draw(self, pen: AbstractPen) -> None:
        """Draw an arrow for the force at time zero."""
        pen.load(Marker(self.body, self.point), pack(vector_at(unpack(self.force), 0.0)))

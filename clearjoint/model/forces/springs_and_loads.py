"""Springs, dampers and applied loads."""

import equinox as eqx
from jaxtyping import PyTree

from ...fields.checks import require_point
from ...fields.declarations import quantity
from ...fields.types import Single, Triple
from ...math.smoothing import norm_and_direction
from ...math.vectors import Scalar, Vector, pack, unpack
from ..bodies import Wrench
from ..drives.in_time import TripleInTime, breakpoints_of, triple_in_time, vector_at
from ..joints.base import AbstractForce, Attachment, Motions
from ..joints.pairs import AbstractPairAtPoints
from ..pen import AbstractPen, Marker

SI = "give it in SI units"


class SpringDamper(AbstractPairAtPoints, AbstractForce):
    """A linear spring and damper between a point of each of two bodies.

    **Arguments:** names; points (3,) m in body axes; `stiffness` N/m, `damping` N s/m, and
    `free_length` m, none of them negative. The force has no direction where the points coincide
    and is zero there.

    >>> spring = cj.SpringDamper("ground", "ball", (0, 0, 0), (0, 0, 0), stiffness=100.0)
    >>> ball = testing.moving((0.1, 0, 0), (1, 0, 0, 0), (0, 0, 0), (0, 0, 0))
    >>> ground = testing.moving((0, 0, 0), (1, 0, 0, 0), (0, 0, 0), (0, 0, 0))
    >>> wrenches = extend.unpack(spring).wrenches({"ground": ground, "ball": ball}, 0.0)
    >>> print(f"{wrenches['ball'].force.x:.1f} N")
    -10.0 N
    """

    first: str = eqx.field(static=True)
    second: str = eqx.field(static=True)
    point_first: Triple = quantity("m", check=require_point)
    point_second: Triple = quantity("m", check=require_point)
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
        """Equal and opposite forces along the line between the points."""
        del t
        stretch, rate, direction = self._stretch(motions)
        force = direction * (self.stiffness * stretch + self.damping * rate)
        return {
            self.first: motions[self.first].wrench(force, self.point_first),
            self.second: motions[self.second].wrench(-force, self.point_second),
        }

    def stored_energy(self, motions: Motions, t: Scalar) -> Scalar:
        """Half the stiffness times the squared stretch, J."""
        del t
        return 0.5 * self.stiffness * self._stretch(motions)[0] ** 2

    def supplied_power(self, motions: Motions, t: Scalar) -> Scalar:
        """Minus the damper's dissipation, W."""
        del t
        return -self.damping * self._stretch(motions)[1] ** 2

    def draw(self, pen: AbstractPen) -> None:
        """A spring."""
        pen.spring(*self.ends())


class AppliedLoad(AbstractForce):
    """A force and a torque on a body, given in global axes, constant or functions of time.

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
    - `force`: (3,) N, at `point`: (3,) m in body axes; `torque`: (3,) N m. Each component is a
      number or a function of time, as of `DriveTorque`; in place of the three may stand a table
      with values (N, 3), or a Python function of JAX's that gives three.

    A load that changes with the motion is a subclass of `AbstractForce`.

    **Raises:** `ValueError` for components that are neither, or not three.

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
        """Name of the body that it acts on."""
        return (self.body,)

    def attachments(self) -> tuple[Attachment, ...]:
        """Where the force acts."""
        return (("point", self.body, self.point),)

    def wrenches(self, motions: Motions, t: Scalar) -> dict[str, Wrench]:
        """The load carried to the centre of mass."""
        motion = motions[self.body]
        force, torque = vector_at(self.force, t), vector_at(self.torque, t)
        return {self.body: motion.wrench(force, self.point) + motion.torque(torque)}

    def breakpoints(self) -> PyTree:
        """Those of the components that are functions of time, s."""
        return breakpoints_of(self.force, self.torque)

    def draw(self, pen: AbstractPen) -> None:
        """An arrow, of the force at time zero."""
        pen.load(Marker(self.body, self.point), pack(vector_at(unpack(self.force), 0.0)))

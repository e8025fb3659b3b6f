"""Where a film carries a loaded journal, and how it answers small motions there."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import optimistix
from jaxtyping import Complex, Float

from ...compilation import Compiled
from ...fields.checks import require_positive, require_shape
from ...fields.conversion import on_device
from ...fields.types import ArrayLike
from ...math.vectors import UNIT_Z, Scalar, Vector, unpack
from ..film.laws import FilmGap
from .lubricated import LubricatedJoint

TOLERANCE = 1e-12
"""Of the equilibrium, in the coordinates in which it is sought and in parts of the load."""
NEARLY_CENTRED = 1e-3
"""Where the search starts: in the very middle a film need not be differentiable."""


class CarriedJournal(NamedTuple):
    """A journal at rest in its film, and the film linearised there.

    Components are along two directions across the axis that don't turn and make a right-handed
    frame with it. `offset`: (2,) m; `stiffness`: (2, 2) N/m, minus the derivative of the force by
    the offset; `damping`: (2, 2) N s/m, minus that by the offset's rate.

    >>> scene, _ = cj.mechanisms.rotor_in_bearing(film=cj.films.CaponeFilm(0.02))
    >>> carried = cj.carried_journal(scene.joints["bearing"], load=(0.0, -196.2), speed=200.0)
    >>> carried.stiffness.shape, bool(carried.damping[0, 0] > 0.0)
    ((2, 2), True)
    """

    offset: Float[jax.Array, "2"]
    stiffness: Float[jax.Array, "2 2"]
    damping: Float[jax.Array, "2 2"]

    def growth(self, mass: Scalar) -> Complex[jax.Array, "4"]:
        """Eigenvalues of small motions of a mass in kg that the film carries, 1/s, complex: stable
        if no real part is positive."""
        speeds = jnp.eye(2) / mass
        rates = jnp.block(
            [
                [jnp.zeros((2, 2)), jnp.eye(2)],
                [-speeds @ self.stiffness, -speeds @ self.damping],
            ]
        )
        return jnp.linalg.eigvals(rates)


def carried_journal(joint: LubricatedJoint, load: ArrayLike, speed: Scalar) -> CarriedJournal:
    """Where the film of a joint carries a load, and the film's stiffness and damping there.

    The bearing stands still, and the axes are parallel.

    ```python
    import clearjoint as cj

    scene, _ = cj.mechanisms.rotor_in_bearing(film=cj.films.CaponeFilm(0.02))
    carried = cj.carried_journal(scene.joints["bearing"], load=(0.0, -20.0 * 9.81), speed=200.0)
    is_stable = carried.growth(mass=20.0).real.max() < 0.0
    ```

    **Arguments:** `load`: (2,) N, on the journal. `speed`: rad/s, of the journal.

    **Raises:** `ValueError` for a load or a speed that is none, or a speed that is not positive.
    """
    require_shape("load", load, (2,), "give its components across the axis in N")
    require_positive("speed", speed, "give rad/s, with the axis such that it is positive")
    return _carried(joint, on_device(load), on_device(speed))


@Compiled
def _carried(joint: LubricatedJoint, load: jax.Array, speed: jax.Array) -> CarriedJournal:
    joint, rest = unpack(joint), jnp.zeros(2)
    clearance, size = joint.dry.clearance, jnp.linalg.norm(load)

    def inside(place: jax.Array) -> jax.Array:
        """The plane on what is inside of the clearance, m."""
        return place * (clearance / jnp.sqrt(1.0 + place @ place))

    def excess(place: jax.Array, _: None) -> jax.Array:
        return (_force(joint, speed, inside(place), rest) + load) / jnp.where(size > 0.0, size, 1.0)

    solver = optimistix.LevenbergMarquardt(rtol=TOLERANCE, atol=TOLERANCE)
    start = jnp.full(2, NEARLY_CENTRED)
    offset = inside(optimistix.root_find(excess, solver, start).value)
    stiffness, damping = jax.jacfwd(_force, argnums=(2, 3))(joint, speed, offset, rest)
    return CarriedJournal(offset, -stiffness, -damping)


def _force(
    joint: LubricatedJoint, speed: Scalar, offset: jax.Array, velocity: jax.Array
) -> jax.Array:
    """On the journal, (2,) N, for an offset in m and its rate in m/s, (2,)."""
    dry = joint.dry
    place = Vector(offset[0], offset[1], 0.0) * (1.0 / dry.clearance)
    moving = Vector(velocity[0], velocity[1], 0.0) * (1.0 / dry.clearance)
    rate = moving - UNIT_Z.cross(place) * (0.5 * speed)
    sizes = dry.bearing_radius, dry.clearance, dry.journal_length
    force = joint.film.force(FilmGap(UNIT_Z, place, rate, speed, *sizes))
    return jnp.stack([jnp.asarray(force.x), jnp.asarray(force.y)])

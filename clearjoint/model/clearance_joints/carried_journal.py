"""Equilibrium of a loaded journal in its lubricant film, and the film's stiffness and damping."""

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
from ..films import FilmGap
from .lubricated import LubricatedJoint

TOLERANCE = 1e-12
"""Relative tolerance of the equilibrium: residual force over load, and change of the offset over
the clearance."""
NEARLY_CENTRED = 1e-3
"""Start of the search for the equilibrium, eccentricity ratio in both directions.

It isn't zero, because the force of a film may not be differentiable for a centred journal.
"""


class CarriedJournal(NamedTuple):
    """Equilibrium of a journal in its film, and the film's linearised force near the equilibrium.

    Components refer to two fixed directions x and y across the bearing's axis z, which form a
    right-handed frame.

    - `offset`: (2,) m, from the bearing's axis to the journal's.
    - `stiffness`: (2, 2) N/m, minus the derivative of the film force by the offset.
    - `damping`: (2, 2) N s/m, minus the derivative of the film force by the offset's rate.

    >>> scene, _ = cj.mechanisms.rotor_in_bearing(film=cj.films.CaponeFilm(0.02))
    >>> carried = cj.carried_journal(scene.joints["bearing"], load=(0.0, -196.2), speed=200.0)
    >>> carried.stiffness.shape, bool(carried.damping[0, 0] > 0.0)
    ((2, 2), True)
    """

    offset: Float[jax.Array, "2"]
    stiffness: Float[jax.Array, "2 2"]
    damping: Float[jax.Array, "2 2"]

    def growth(self, mass: Scalar) -> Complex[jax.Array, "4"]:
        """Return the eigenvalues of small motions about the equilibrium, (4,) complex, 1/s.

        The equilibrium is stable if no eigenvalue has a positive real part.

        **Arguments:** `mass`: of the body that the journal carries, kg.
        """
        inverse_mass = jnp.eye(2) / mass
        rates = jnp.block(
            [
                [jnp.zeros((2, 2)), jnp.eye(2)],
                [-inverse_mass @ self.stiffness, -inverse_mass @ self.damping],
            ]
        )
        return jnp.linalg.eigvals(rates)


def carried_journal(joint: LubricatedJoint, load: ArrayLike, speed: Scalar) -> CarriedJournal:
    """Compute the equilibrium of a loaded journal in its film, and the film's stiffness and
    damping.

    The bearing is at rest and the axes are parallel.

    ```python
    import clearjoint as cj

    scene, _ = cj.mechanisms.rotor_in_bearing(film=cj.films.CaponeFilm(0.02))
    carried = cj.carried_journal(scene.joints["bearing"], load=(0.0, -20.0 * 9.81), speed=200.0)
    is_stable = carried.growth(mass=20.0).real.max() < 0.0
    ```

    **Arguments:**

    - `joint`: the lubricated joint.
    - `load`: (2,) N, external force on the journal along x and y, two directions across the axis
      z that form a right-handed frame.
    - `speed`: angular velocity of the journal about z, rad/s, positive.

    **Returns:** `CarriedJournal` with the offset, (2,) m, the stiffness, (2, 2) N/m, and the
    damping, (2, 2) N s/m, in the same directions as the load.

    **Raises:** `ValueError` if the load doesn't have the shape (2,) or the speed is not positive.
    """
    require_shape("load", load, (2,), "give its components across the axis in N")
    require_positive("speed", speed, "give rad/s, with the axis such that it is positive")
    return _solve_equilibrium(joint, on_device(load), on_device(speed))


@Compiled
def _solve_equilibrium(joint: LubricatedJoint, load: jax.Array, speed: jax.Array) -> CarriedJournal:
    joint, rest = unpack(joint), jnp.zeros(2)
    clearance, size = joint.dry.clearance, jnp.linalg.norm(load)

    # The search is unbounded, but a film's force exists only inside the clearance: this map keeps
    # each trial offset there.
    def offset_of(point: jax.Array) -> jax.Array:
        return point * (clearance / jnp.sqrt(1.0 + point @ point))

    def residual(point: jax.Array, _: None) -> jax.Array:
        force = _force(joint, speed, offset_of(point), rest)
        # Relative to the load, so that one tolerance suits all loads.
        return (force + load) / jnp.where(size > 0.0, size, 1.0)

    solver = optimistix.LevenbergMarquardt(rtol=TOLERANCE, atol=TOLERANCE)
    start = jnp.full(2, NEARLY_CENTRED)
    offset = offset_of(optimistix.root_find(residual, solver, start).value)
    stiffness, damping = jax.jacfwd(_force, argnums=(2, 3))(joint, speed, offset, rest)
    return CarriedJournal(offset, -stiffness, -damping)


def _force(
    joint: LubricatedJoint, speed: Scalar, offset: jax.Array, velocity: jax.Array
) -> jax.Array:
    """Return the film force on the journal, (2,) N.

    **Arguments:** `speed`: of the journal, rad/s. `offset`: (2,) m. `velocity`: its rate, (2,) m/s.
    """
    dry = joint.dry
    eccentricity = Vector(offset[0], offset[1], 0.0) * (1.0 / dry.clearance)
    own_rate = Vector(velocity[0], velocity[1], 0.0) * (1.0 / dry.clearance)
    # The film sees the motion relative to the mean rotation of both surfaces, half the speed.
    rate = own_rate - UNIT_Z.cross(eccentricity) * (0.5 * speed)
    sizes = dry.bearing_radius, dry.clearance, dry.journal_length
    force = joint.film.force(FilmGap(UNIT_Z, eccentricity, rate, speed, *sizes))
    return jnp.stack([jnp.asarray(force.x), jnp.asarray(force.y)])

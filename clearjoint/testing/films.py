"""Check user-defined film laws, which give the force of the lubricant in a bearing."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from .._math.vectors import UNIT_Z, Vector
from .._model.contact.laws import require_instance
from .._model.films import AbstractFilm, FilmGap
from .conformance import ensure, grid
from .continuity import jumps

RATIOS = (0.0, 1e-9, 1e-4, 0.1, 0.5, 0.9, 0.99)
"""Tested lengths of the offset, in radial clearances."""
SPEEDS = (0.0, 1e-6, 1.0, 300.0)
"""Tested lengths of the rate, 1/s."""
ANGLES = tuple(np.arange(12) * np.pi / 6.0)
"""Tested angles between the offset and its rate, rad."""
SMOOTH = ((0.4, 0.0, 3.0, -7.0), (0.7, 0.0, -2.0, 5.0))
"""States at which films are smooth: offset, x and y, and its rate, x and y, 1/s. There, derivatives
are compared with finite differences."""
STEP = 1e-6
"""Step of central differences, relative to the number that is changed."""
TOLERANCE = 1e-5
"""Largest error of the derivatives of the force by one number, relative to the larger of their
magnitudes; far above the errors of finite differences."""
Force = Callable[[AbstractFilm, jax.Array], jax.Array]
"""Force on the journal, x and y, from a film and a state (4,), the offset and its rate."""


def check_film(
    film: AbstractFilm,
    bearing_radius: float = 25e-3,
    clearance: float = 50e-6,
    length: float = 25e-3,
) -> None:
    """Check that a film law is consistent.

    The offset of the journal is the vector from the bearing's axis to the journal's centre, divided
    by the radial clearance. Its rate, 1/s, is its time derivative in axes that rotate with half the
    sum of the spins of bearing and journal. The check evaluates the film for offsets from zero to
    0.99, and various rates, in a bearing of the given radius, radial clearance and length, m. It
    demands that

    - the film supplies no energy, and exerts no force if the rate of the offset is zero;
    - the force and its derivatives by offset, rate and parameters of the film are finite, even at
      zero offset and zero rate; at two states where films are smooth, the derivatives by offset and
      rate agree with finite differences;
    - the force turns with offset and rate if these are turned about the axis, and its component
      along the offset doesn't jump when only the direction of the rate changes;
    - the drag torque is finite and doesn't drive the journal's spin relative to the bearing.

    >>> testing.check_film(cj.films.CaponeFilm(0.02))
    """
    require_instance("film", film, AbstractFilm)

    def force(film: AbstractFilm, state: jax.Array) -> jax.Array:
        offset, rate = Vector(state[0], state[1], 0.0), Vector(state[2], state[3], 0.0)
        # The bearing's axis is z, and the spin of the journal relative to the bearing is zero.
        gap = FilmGap(UNIT_Z, offset, rate, 0.0, bearing_radius, clearance, length)
        on_journal = film.force(gap)
        return jnp.stack([jnp.asarray(part, float) for part in (on_journal.x, on_journal.y)])

    # `jax.jacfwd` differentiates arrays, not Python numbers.
    film = jax.tree.map(jnp.asarray, film)
    states, forces_at, force_at = _states(), _at_all(force), eqx.filter_jit(force)
    forces, rates = forces_at(film, states), states[:, 2:]
    ensure(jnp.isfinite(forces), "The force is not finite everywhere.")
    size, speed = jnp.linalg.norm(forces, axis=1), jnp.linalg.norm(rates, axis=1)
    ensure((speed != 0.0) | (size == 0.0), "There is a force without motion.")
    # Single evaluations are slow, so that only each 50th state is tested.
    single = jnp.stack([force_at(film, state) for state in states[::50]])
    same = jnp.allclose(single, forces[::50])
    ensure(same, "The force under vmap differs from a single evaluation.")
    difference = jnp.abs(forces_at(film, _rotated(states)) - _rotated(forces))
    # The factor 1e-9, here and below, is for rounding errors.
    rotates = difference <= 1e-9 * size[:, None]
    ensure(rotates, "The force does not rotate with offset and rate.")
    _check_drag(film, bearing_radius, clearance, length)
    _check_slopes(force, film)
    _check_jumps(force, film)
    power = (forces * rates).sum(axis=1)  # divided by the clearance: rates are in 1/s, not in m/s
    ensure(power <= 1e-9 * size * speed, "The film supplies power: force . rate > 0.")


def _at_all(function: Callable[..., PyTree]) -> Callable[[AbstractFilm, jax.Array], PyTree]:
    """Compile a function of a film and one state into a function of a film and N states."""
    return eqx.filter_jit(eqx.filter_vmap(function, in_axes=(None, 0)))


def _states() -> jax.Array:
    """All combinations of `RATIOS`, `SPEEDS` and `ANGLES` as states (N, 4), offset and rate, turned
    by 0.3 rad: offsets along x would hide some mistakes."""
    ratio, speed, angle = grid(RATIOS, SPEEDS, ANGLES)
    columns = ratio, jnp.zeros_like(ratio), speed * jnp.cos(angle), speed * jnp.sin(angle)
    return _rotated(jnp.stack(columns, axis=1), 0.3)


def _rotated(rows: jax.Array, angle: float = 1.1) -> jax.Array:
    """Turn plane vectors, one in each row, (N, 2), or two, (N, 4), by an angle, rad. The default
    angle is arbitrary."""
    c, s = np.cos(angle), np.sin(angle)
    return (rows.reshape(len(rows), -1, 2) @ jnp.asarray([[c, s], [-s, c]])).reshape(rows.shape)


def _check_drag(film: AbstractFilm, *sizes: float) -> None:
    # All combinations of a spin relative to the bearing, rad/s, and a length of the offset; the
    # rate of the offset is arbitrary.
    spins, ratios = grid((-100.0, 0.0, 100.0), RATIOS)
    gap = FilmGap(UNIT_Z, Vector(ratios, 0.0, 0.0), Vector(1.0, 2.0, 0.0), spins, *sizes)
    drag = jnp.asarray(film.drag(gap))
    ensure(jnp.isfinite(drag), "The drag is not finite everywhere.")
    ensure(drag * spins <= 0.0, "The drag drives the spin.")


def _check_slopes(force: Force, film: AbstractFilm) -> None:
    # The states in `SMOOTH` have zeros, which would get steps of zero below, so they are turned.
    states, smooth = _states(), _rotated(jnp.asarray(SMOOTH), 0.3)
    slopes_at, forces_at = _at_all(jax.jacfwd(force, argnums=1)), _at_all(force)
    finite = jnp.isfinite(slopes_at(film, states))
    ensure(finite, "The derivative by offset or rate is not finite everywhere.")
    for leaf in jax.tree.leaves(_at_all(eqx.filter_jacfwd(force))(film, states)):
        finite = jnp.isfinite(leaf)
        ensure(finite, "The derivative by a parameter of the film is not finite everywhere.")
    for state, exact in zip(smooth, slopes_at(film, smooth), strict=True):
        steps = STEP * state  # one for each of the four numbers, which are changed one at a time
        ahead, behind = (forces_at(film, state + sign * jnp.diag(steps)) for sign in (1, -1))
        # Column k of `exact`, (2, 4), is the derivative by the k-th number, for which `ahead` and
        # `behind` have row k.
        error = jnp.abs((ahead - behind).T / (2.0 * steps) - exact)
        agrees = error <= TOLERANCE * jnp.abs(exact).max(axis=0)
        message = "The derivative by offset or rate does not agree with finite differences."
        ensure(agrees, message)


def _check_jumps(force: Force, film: AbstractFilm) -> None:
    """Check that the force along the offset does not jump while the rate makes a full turn."""
    # The offset is along x, and the length of the rate is one per second. For each ratio, `along`
    # returns the x component of the force when the rate is at an angle from x.
    ratios, forces_at = jnp.asarray([0.0, 1e-4, 0.1, 0.5, 0.9]), _at_all(force)

    def along(angle: jax.Array) -> jax.Array:
        columns = ratios, jnp.zeros_like(angle), jnp.cos(angle), jnp.sin(angle)
        return forces_at(film, jnp.stack(columns, axis=1))[:, 0]

    sizes, angles = jumps(along, jnp.zeros_like(ratios), jnp.full_like(ratios, 2.0 * np.pi))
    k = int(jnp.argmax(jnp.abs(sizes)))
    ensure(
        sizes[k] == 0.0,
        f"The force jumps by {sizes[k]:.3g} N with the direction of the rate, at {angles[k]:.3g} "
        f"rad from the offset and an eccentricity ratio of {ratios[k]:.3g}: smooth it.",
    )

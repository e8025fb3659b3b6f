"""What is checked of a scene, a state and JAX before a run is compiled."""

from collections.abc import Callable
from functools import reduce

import jax
import jax.numpy as jnp
from jaxtyping import PyTree

from ..dynamics.assembly import (
    check_names,
    require_assembled,
    require_certain,
    require_representable,
)
from ..dynamics.constraint_report import constraint_report
from ..dynamics.coordinates import AbstractCoordinates
from ..dynamics.journals import require_in_bearings
from ..fields.caching import cached_by_numbers
from ..fields.checks import concrete, conditions_of, recheck
from ..math.vectors import Condition, Scalar
from ..model.bodies import State
from ..model.scene import Scene


def check_precision(allow_float32: bool) -> None:
    """Check that JAX computes in 64 bits, unless single precision is allowed."""
    if not (jax.config.jax_enable_x64 or allow_float32):  # pyright: ignore
        raise ValueError(
            "JAX is set to 32-bit floats, in which penetrations of micrometres drown: call "
            "clearjoint.configure() first, or pass Settings(allow_float32=True)."
        )


def is_traced(tree: PyTree) -> bool:
    """Whether JAX traces any of these, or everything: under `jax.jit` numbers need not be traced
    for what is computed from them to be. Then no value can be checked."""
    return concrete(jax.device_put(0.0)) is None or any(
        concrete(leaf) is None for leaf in jax.tree.leaves(tree)
    )


def check_numbers(scene: Scene, state: State) -> None:
    """Check the numbers of a scene, and that a state is one of its."""
    _recheck(scene)
    check_names(scene, state)


def in_domain(check: Callable[[], None]) -> Condition | None:
    """Whether the numbers that JAX traces pass a check; ``None`` if it looks at none.

    Evaluated once, before the first step: the loop of steps is the same as without.
    """
    conditions = conditions_of(check)
    return reduce(jnp.logical_and, conditions) if conditions else None


def check_start(
    scene: Scene, state: State, start_time: Scalar, coordinates: AbstractCoordinates
) -> tuple[str, ...]:
    """Check the numbers of a run, and its state against the constraints; the names of those that
    are redundant."""
    check_numbers(scene, state)
    return check_structure(scene, state, start_time, coordinates)


def check_structure(
    scene: Scene, state: State, t: Scalar, coordinates: AbstractCoordinates
) -> tuple[str, ...]:
    """Check the state against the constraints; the names of those that are redundant."""
    if not scene.joints:
        return ()
    require_in_bearings(scene, state)
    return _redundant(scene, state, t, coordinates)


@cached_by_numbers
def _recheck(scene: Scene) -> None:
    recheck(scene)


@cached_by_numbers
def _redundant(
    scene: Scene, state: State, t: Scalar, coordinates: AbstractCoordinates
) -> tuple[str, ...]:
    report = constraint_report(scene, state, t, coordinates)
    require_assembled(report.names, report.values, report.rates)
    require_certain(report.uncertain)
    require_representable(scene, state, coordinates)
    return report.redundant

"""Forces that several studies observe."""

from collections.abc import Callable

import jax.numpy as jnp

import clearjoint as cj
from clearjoint.extend import Instant, Scalar


def largest_at_a_base(joint: str) -> Callable[[Instant], Scalar]:
    """Return the quantity "larger of the normal forces at the two bases of a clearance joint", N.

    `ContactForce(joint)` is the resultant, which is small while the bases press on opposite walls.
    """
    at_first, at_second = (cj.quantities.ContactForce(joint, base) for base in "VW")
    return lambda now: jnp.maximum(at_first(now), at_second(now))

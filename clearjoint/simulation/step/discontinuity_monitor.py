"""Forces of a user's own that jump where the motion decides.

Where a torque steps at an angle, the motion's derivatives have a term that depends on how the
instant moves (the saltation matrix, see `.jumps`). Contact laws have it; of another element nobody
says where it jumps, and the step beside the jump looks like any other. So of elements that may jump
each accepted step is looked at: what a smooth force changes by in a step follows from its slopes at
both ends, what jumps does not.
"""

from collections.abc import Iterator
from functools import reduce
from operator import or_

import equinox as eqx
import jax
import jax.numpy as jnp

from ...dynamics.contact_events import ContactGaps
from ...dynamics.system import System
from ...math.vectors import Condition, Scalar
from ...model.joints.base import AbstractContactJoint
from ...model.scene import Scene
from .discontinuity_analysis import may_jump_by_motion
from .saltation import any_changes
from .step_state import Method, Step
from .trial_step import Trial, term_of

OWN_MODULES = __name__.split(".")[0] + "."
STEEPEST = 4.0
"""How much more than its slopes at both ends say a smooth rate may change by in a step. It is the
mean of both, up to a third derivative that the tolerances keep small."""
SMALLEST, NEGLIGIBLE = 1e-3, 1e-9
"""Jumps that are told apart: parts of the rate that jumps, and of the largest of all rates."""


def may_have_undeclared_jump(scene: Scene) -> bool:
    """Whether a scene has an element, or part of one, of a class from outside this package, whose
    force compares numbers of the motion."""
    elements = [*scene.joints.values(), *scene.forces.values()]
    return any(
        isinstance(element, AbstractContactJoint) or may_jump_by_motion(element)
        for element in elements
        if any(not type(part).__module__.startswith(OWN_MODULES) for part in _modules(element))
    )


def has_undeclared_jump(
    method: Method, system: System, step: Step, trial: Trial, after: ContactGaps
) -> Condition:
    """Whether any rate of the motion jumps within a trial step that ends with the contacts `after`.

    Breakpoints are not passed in it, nor are contacts' begins; where one ends whose force jumps
    then, nothing is said.
    """
    term, fixed = term_of(method, step), (system, step.entry_speeds)

    def rates(t: Scalar, motion: object) -> object:
        y = eqx.tree_at(lambda y: y.motion, step.y, motion)
        return term.vf(t, y, fixed).motion

    start, end = step.y.motion, trial.outcome.y.motion
    change = trial.t1 - step.t, jax.tree.map(jnp.subtract, end, start)
    early, early_change = jax.jvp(rates, (step.t, start), change)
    late, late_change = jax.jvp(rates, (trial.t1, end), change)
    leaves = [jax.tree.leaves(tree) for tree in (early, late, early_change, late_change)]
    magnitudes = [jnp.maximum(jnp.abs(a), jnp.abs(b)) for a, b in zip(*leaves[:2], strict=True)]
    largest = reduce(jnp.maximum, [jnp.max(size) for size in magnitudes])
    jumps = [
        jnp.any(
            jnp.abs(b - a)
            > STEEPEST * (jnp.abs(da) + jnp.abs(db)) + SMALLEST * size + NEGLIGIBLE * largest
        )
        for a, b, da, db, size in zip(*leaves, magnitudes, strict=True)
    ]
    return reduce(or_, jumps) & ~any_changes(system.scene, step.contact_gaps, after)


def _modules(part: object) -> Iterator[eqx.Module]:
    """A module and those within it."""
    if isinstance(part, eqx.Module):
        yield part
        part = vars(part)
    if isinstance(part, dict):
        part = list(part.values())
    if isinstance(part, list | tuple):
        for inner in part:
            yield from _modules(inner)

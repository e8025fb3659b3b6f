"""Check the accepted steps of runs with derivatives for undeclared jumps of user-defined forces.

If a torque jumps at some angle, the instant of the jump depends on the parameters, and derivatives
of the motion have a term for the shift of this instant (see `.saltation`). Contact laws declare
such events. A user-defined element cannot declare them, and a step across its jump looks like any
other. Therefore each accepted step of a scene with an element that may jump is checked: if the
rates change by more than their slopes at both ends of the step allow, the run ends with the result
code `force_jumped`.
"""

from collections.abc import Iterator
from functools import reduce
from operator import or_

import equinox as eqx
import jax
import jax.numpy as jnp

from ...dynamics.system import System
from ...math.vectors import Condition, Scalar
from ...model.joints.base import AbstractContactJoint
from ...model.scene import Scene
from .discontinuity_analysis import may_jump_by_motion
from .saltation import any_changes
from .step_state import Method, Step
from .trial_step import Trial, term_of

PACKAGE = __name__.split(".")[0] + "."
"""Beginning of the names of this package's modules."""
STEEPEST = 4.0
"""Largest change of a smooth rate over a step, as a multiple of the sum of the changes that the
slopes at both ends of the step predict. The change of a smooth rate is about half of this sum. The
limit is eight times as large, so that a strongly curved rate is not taken for one that jumps."""
SMALLEST, NEGLIGIBLE = 1e-3, 1e-9
"""A jump is reported only if it exceeds `SMALLEST` times the rate that jumps plus `NEGLIGIBLE`
times the largest of all rates. The first term disregards small changes of smooth rates whose slopes
happen to vanish at both ends of the step. The second disregards rounding errors, which the mass
matrix spreads from the largest rate to all others."""


def may_have_undeclared_jump(scene: Scene) -> bool:
    """Return whether a scene has an element that may jump without declaring it.

    Such an element is of a class from outside this package, or contains a part of such a class, and
    it either compares numbers of the motion or is a contact joint. All contact joints count,
    because the search for comparisons covers their constraint rows but not their contact forces.
    """
    elements = [*scene.joints.values(), *scene.forces.values()]
    return any(
        isinstance(element, AbstractContactJoint) or may_jump_by_motion(element)
        for element in elements
        if any(not type(part).__module__.startswith(PACKAGE) for part in _modules(element))
    )


def has_undeclared_jump(method: Method, system: System, step: Step, trial: Trial) -> Condition:
    """Return whether any rate of the motion, the time derivative of a coordinate or velocity, jumps
    within a trial step.

    Steps end at breakpoints and at contact events, so these are not inside the step. The check is
    skipped if the step ends at the onset or the end of a contact whose force jumps there.

    **Arguments:** `step`: the state before the trial.
    """
    term, fixed = term_of(method, step), (system, step.entry_speeds)

    def rates(t: Scalar, motion: object) -> object:
        y = eqx.tree_at(lambda y: y.motion, step.y, motion)
        return term.vf(t, y, fixed).motion

    # Slopes are taken along the secant of the step, from its start to its end, at both ends. A
    # smooth rate changes by about the mean of both slopes.
    start, end = step.y.motion, trial.outcome.y.motion
    change = trial.t1 - step.t, jax.tree.map(jnp.subtract, end, start)
    early, early_change = jax.jvp(rates, (step.t, start), change)
    late, late_change = jax.jvp(rates, (trial.t1, end), change)
    leaves = [jax.tree.leaves(tree) for tree in (early, late, early_change, late_change)]
    magnitudes = [jnp.maximum(jnp.abs(a), jnp.abs(b)) for a, b in zip(*leaves[:2], strict=True)]
    # Rounding of the largest rate reaches all others through the mass matrix.
    largest = reduce(jnp.maximum, [jnp.max(size) for size in magnitudes])
    jumps = [
        jnp.any(
            jnp.abs(b - a)
            > STEEPEST * (jnp.abs(da) + jnp.abs(db)) + SMALLEST * size + NEGLIGIBLE * largest
        )
        for a, b, da, db, size in zip(*leaves, magnitudes, strict=True)
    ]
    return reduce(or_, jumps) & ~any_changes(system.scene, step.contact_gaps, trial.gaps)


def _modules(part: object) -> Iterator[eqx.Module]:
    """Yield all equinox modules in a PyTree, also those inside lists, dictionaries and other
    modules."""
    if isinstance(part, eqx.Module):
        yield part
        part = vars(part)
    if isinstance(part, dict):
        part = list(part.values())
    if isinstance(part, list | tuple):
        for inner in part:
            yield from _modules(inner)

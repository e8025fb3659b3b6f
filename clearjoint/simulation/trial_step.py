"""One trial of the solver: a step taken, and its derivatives, before anybody judges it."""

from typing import Any

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp

from ..dynamics.breakpoints import breakpoints, seen
from ..dynamics.contact_events import closed, has_memory
from ..dynamics.contact_forces import Memory
from ..dynamics.system import System
from ..math.groups import total
from ..math.vectors import Scalar
from ..model.scene import Scene
from .dense_output import corrected
from .jumps import contacts_jump
from .step_state import Method, Step, Variables, choose
from .systems import SystemFamily
from .unrolled_runge_kutta import UnrolledExplicit

REJECTED_ERROR = 1e30


def term_of(method: Method, step: Step | None = None) -> diffrax.ODETerm:
    """The rates of the variables, as diffrax takes them; the arguments are system and memory.

    Of a `step` that lands, those of its open and closed contacts.
    """
    lands = step is not None and method.landing is not None
    modes = closed(step.reaches) if step is not None and lands else None

    def field(t: Scalar, y: Variables, args: Any) -> Variables:
        system, memory = args
        t = seen(system.scene, t if step is None else step.t, t)
        rates = Variables(*system.rates(y.motion, memory, t, modes))
        return jax.tree.map(lambda rate: jnp.asarray(rate, dtype=t.dtype), rates)

    return diffrax.ODETerm(field)


class Taken(eqx.Module):
    """What a solver's step gives, or its derivatives along p parameters."""

    y: Variables
    error: Variables
    information: Any
    solver_state: Any


class Trial(eqx.Module):
    """A step as the solver took it, before it is accepted or not."""

    t1: Scalar
    taken: Taken
    tangents: Taken | None
    finite: Scalar
    solver_result: Any


def graded_step(method: Method, step: Step) -> Scalar | None:
    """Whether the step is one that begins a contact; ``None`` where there are none to begin at."""
    if method.landing is None or not step.reaches:
        return None
    return step.enters if isinstance(method.solver, UnrolledExplicit) else None


def tried(
    method: Method, system: System, step: Step, t1: Scalar, family: SystemFamily | None
) -> Trial:
    """The solver's step, projected if steps are, and settled. What is not finite stays where it
    was."""
    made_jump = step.jumped if may_jump(method, system.scene) else False
    graded = graded_step(method, step)
    options = {} if graded is None else {"graded": graded}

    def taken(system: System, y: Variables, memory: Memory, solver_state: Any) -> tuple[Taken, Any]:
        y1, error, information, solver_state, result = method.solver.step(
            term_of(method, step),
            step.t,
            t1,
            y,
            (system, memory),
            solver_state,
            made_jump,
            **options,
        )
        y1 = corrected(system, y1, seen(system.scene, step.t, t1))
        y1, solver_state = _settled(system, y1, solver_state)
        assert isinstance(error, Variables)
        return Taken(y1, error, information, solver_state), result

    start = step.y, step.memory, step.solver_state
    if family is None:
        found, result = taken(system, *start)
        finite, tangents = _all_finite((found.y, found.error)), None
    else:
        assert step.tangents is not None
        along = step.tangents.y, step.tangents.memory, step.tangents.solver_state
        found, result, tangents = family.pushed(taken, start, along)
        finite = _all_finite((found.y, found.error, tangents.y, tangents.error))
        tangents = _unless(finite, tangents, step.tangents.y)
    return Trial(t1, _unless(finite, found, step.y), tangents, finite, result)


def _settled(system: System, y: Variables, solver_state: Any) -> tuple[Variables, Any]:
    """The variables in numbers that don't drift in many steps, and what the solver keeps of their
    rates to match."""

    def matched(node: Any) -> Any:
        if not isinstance(node, Variables):
            return node
        return Variables(jax.jvp(system.settled, (y.motion,), (node.motion,))[1], node.work)

    kept = jax.tree.map(matched, solver_state, is_leaf=lambda node: isinstance(node, Variables))
    return Variables(system.settled(y.motion), y.work), kept


def _unless(finite: Scalar, taken: Taken, y: Variables) -> Taken:
    """What was taken if it is finite; else the given variables, with an error beyond all bounds."""
    error = jax.tree.map(lambda e: jnp.where(finite, e, REJECTED_ERROR), taken.error)
    return Taken(choose(finite, taken.y, y), error, taken.information, taken.solver_state)


def may_jump(method: Method, scene: Scene) -> bool:
    """Whether a new memory, or a force that jumps, may leave the last stage stale.

    Landing sets the memory where the force is still zero, so that it leaves it right.
    """
    if method.landing is None:
        return has_memory(scene) or bool(breakpoints(scene))
    return contacts_jump(scene) or bool(breakpoints(scene))


def _all_finite(tree: Any) -> Scalar:
    """One test for all leaves: adding zero times each lets any NaN or infinity through. Leaves of
    one shape are added element by element before the elements are."""
    sums: dict[Any, Scalar] = {}
    for leaf in jax.tree.leaves(tree):
        shape = jnp.shape(leaf)
        sums[shape] = sums.get(shape, 0.0) + leaf * 0.0
    return sum(map(total, sums.values())) == 0.0

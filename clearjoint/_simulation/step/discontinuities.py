"""Find undeclared discontinuities of elements, the joints and forces of a scene, in their traced
programs and in accepted steps of runs with derivatives.

If an element switches a force on where t > t_s, JAX's derivative of the comparison by t_s is zero.
The derivative of the motion then lacks a term, and no run would show it. Likewise if a force jumps
at some angle: the instant of the jump depends on the parameters (see `.saltation`).
"""

import math
from contextlib import suppress
from functools import reduce
from operator import or_

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.core import ShapedArray
from jax.extend.core import Jaxpr, Literal
from jax.interpreters import partial_eval
from jaxtyping import PyTree

from ..._compilation.xla import program_of
from ..._dynamics.breakpoints import one_sided_time
from ..._dynamics.coordinates import MotionVariables
from ..._dynamics.kinds import NOT_RENAMED, with_common_names
from ..._fields.checks import is_of_package, require
from ..._fields.objects import with_arrays
from ..._math.vectors import Condition, Matrix, Scalar, Vector, fold_constants, unpack
from ..._model.bodies import GROUND, Motion
from ..._model.drives.functions_of_time import AbstractFunctionOfTime
from ..._model.joints.base import (
    AbstractConstraint,
    AbstractContactJoint,
    AbstractElement,
    AbstractForce,
)
from ..._model.scene import Scene
from ..._native.functions import FlatArguments
from ..._native.lowering import inner_jaxprs
from ..._native.machine_code import RecentPrograms
from .saltation import any_changes
from .trial_step import Trial, term_of

JUMPING = frozenset(["ceil", "floor", "rem", "round", "sign"])
"""Names of JAX primitives whose result is a float that jumps where the argument passes some value.
Primitives whose result is not a float, such as comparisons, count as jumping too."""
_EXTREMES = {"max", "min", "clamp", "sort", "reduce_max", "reduce_min", "cummax", "cummin"}
KINKED = JUMPING | _EXTREMES | {"abs"}
"""Names of JAX primitives whose result is a float that has a jump or a kink."""
LOOPS = frozenset(["scan", "while"])
"""Names of JAX's primitives for loops."""
PURPOSE = "for derivatives to be right"
BREAKPOINTS = "`breakpoints` that returns the times in s at which it jumps or has a kink"
"""Parts of error messages."""


def require_declared(scene: Scene) -> None:
    """Check that elements that may change abruptly at some time declare their breakpoints: those
    that compare, round or clip a number that depends on time. Raise a `ValueError` that names the
    first such element, or function of time in it, whose class defines no method `breakpoints`."""
    elements = {"joints": scene.joints, "forces": scene.forces}
    for family, members in elements.items():
        for name, element in members.items():
            argument = f"scene.{family}[{name!r}]"
            # Functions of time are checked before the element that holds them, so that the message
            # names the function, whose class must be changed.
            expected = "a function smooth in time, or one that declares its breakpoints"
            remedy = (
                "take PiecewiseConstant or PiecewiseLinear, or a subclass of "
                f"AbstractFunctionOfTime with a method {BREAKPOINTS}"
            )
            for function in _undeclared_functions_of_time(element):
                smooth, kind = not compares_time(function), type(function).__name__
                require(smooth, argument, kind.strip("_"), f"{expected}, {PURPOSE}", remedy)
            # The class inherits `breakpoints`, which declares none.
            silent = type(element).breakpoints is AbstractElement.breakpoints
            smooth, kind = not silent or not compares_time(element), type(element)
            expected = f"smooth in time, or declare its breakpoints, {PURPOSE}"
            remedy = f"give its class a method {BREAKPOINTS}, or () if there are none"
            require(smooth, argument, kind.__name__, expected, remedy)


def _undeclared_functions_of_time(element: AbstractElement) -> list[AbstractFunctionOfTime]:
    parts = jax.tree.leaves(element, is_leaf=lambda part: isinstance(part, AbstractFunctionOfTime))
    functions = [part for part in parts if isinstance(part, AbstractFunctionOfTime)]
    silent = AbstractFunctionOfTime.breakpoints
    return [function for function in functions if type(function).breakpoints is silent]


_COMPARES: RecentPrograms[bool] = RecentPrograms()
"""Results of `compares_time`, by the structure of the part, to which components of vectors that are
exactly 0 or 1 belong. Results don't depend on other numbers of the part, which runs trace."""


def compares_time(part: AbstractFunctionOfTime | AbstractElement) -> bool:
    """Return whether a `part`, in packed form, may have a jump or a kink in time: a function of
    time, or the forces or constraint rates of an element."""
    if isinstance(part, AbstractElement):
        # Elements that differ only in names are traced once, with common names. If that fails, the
        # element is traced with its own names, so that an error message has these.
        with suppress(*NOT_RENAMED):
            return _recently_compared(with_common_names(part)[0])
    return _recently_compared(part)


def _recently_compared(part: AbstractFunctionOfTime | AbstractElement) -> bool:
    # Return the result of `compares_time` that `_COMPARES` has for a part of the same structure. If
    # it has none, search the program of this part, and add the result.
    flat = FlatArguments.of((fold_constants(with_arrays(part)),))
    # A part with numbers that JAX traces is searched at each call, and its result is not kept.
    compares = None if flat.traced else _COMPARES.recent(flat.key)
    if compares is None:
        unpacked = unpack(part)
        # The time is the first argument of each program. Comparisons of the motion, the second
        # argument of an element's program, do not count.
        if isinstance(unpacked, AbstractFunctionOfTime):
            program, chosen = program_of(unpacked, 0.0).jaxpr.jaxpr, [True]
        else:
            program, chosen = _program_of_element(unpacked), [True, False]
        compares = _depends_on_primitive(program, chosen, KINKED)
        if not flat.traced:
            _COMPARES.add(flat.key, compares)
    return compares


def _program_of_element(element: AbstractElement) -> Jaxpr:
    """Return the traced program of an element's forces or constraint rates. Its arguments are the
    time, and one number that stands for every component of the motion: for the search it does not
    matter on which component a comparison depends."""

    def outputs(t: Scalar, number: Scalar) -> PyTree[Scalar]:
        vector = Vector(number, number, number)
        motion = Motion(vector, Matrix(vector, vector, vector), vector, vector)
        motions = dict.fromkeys((*element.body_names(), GROUND), motion)
        if isinstance(element, AbstractForce):
            return element.wrenches(motions, t)
        assert isinstance(element, AbstractConstraint | AbstractContactJoint)
        # The equations of motion contain constraints by their rates, and not by their values.
        rows = element.rows(motions, t).values()
        return [(row.jacobian, row.bias, row.time_rate) for row in rows]

    return program_of(outputs, 0.0, 1.0).jaxpr.jaxpr


def _depends_on_primitive(program: Jaxpr, chosen: list[bool], primitives: frozenset[str]) -> bool:
    """Return whether a result of a program depends, through an operation that may jump or has a
    kink, on an argument that is `chosen`. Such operations are those named in `primitives`, and all
    whose result is not a float, such as comparisons."""
    # Variables that depend on a chosen argument.
    causes = {v for v, is_chosen in zip(program.invars, chosen, strict=True) if is_chosen}
    # Dead code is left out, such as comparisons in the value of a constraint, which is not used.
    needed, _ = partial_eval.dce_jaxpr(program, [True] * len(program.outvars))
    for equation in needed.eqns:
        depends = [not isinstance(v, Literal) and v in causes for v in equation.invars]
        if not any(depends):
            continue
        # Results that are not floats are those of comparisons, of conversions to whole numbers and
        # the like, which jump.
        real = all(
            isinstance(v.aval, ShapedArray) and jnp.issubdtype(v.aval.dtype, jnp.inexact)
            for v in equation.outvars
        )
        if equation.primitive.name in primitives or not real:
            return True
        # Programs in the parameters of the equation, such as the body of a loop.
        for inner in inner_jaxprs(equation):
            # Arguments correspond one to one for calls. For conditionals the assignment differs by
            # primitive, and in a loop a carried value may depend on the chosen arguments from the
            # second iteration on; all inner arguments then count as dependent.
            is_call = equation.primitive.name not in LOOPS and len(inner.invars) == len(depends)
            passed = depends if is_call else [True] * len(inner.invars)
            if _depends_on_primitive(inner, passed, primitives):
                return True
        causes.update(equation.outvars)
    return False


def changes_side(trial: Trial) -> Condition | None:
    """Return whether a force jumps in a trial step: one of the numbers `AbstractForce.deviations`,
    such as an angle in [-pi, pi], changes by more than pi; ``None`` if no force has any."""
    step, system = trial.step, trial.system

    def deviations(motion: MotionVariables, t: Scalar) -> list[Scalar]:
        # A function of time has at a breakpoint the value inside of the step.
        t = system.scene_time(one_sided_time(system, step.t, t))
        motions = system.motions(motion)
        forces = system.scene.forces.values()
        return [angle for force in forces for angle in force.deviations(motions, t)]

    before = deviations(step.y.motion, step.t)
    after = deviations(trial.outcome.y.motion, trial.t1)
    jumps = [jnp.abs(b - a) > math.pi for a, b in zip(before, after, strict=True)]
    return reduce(or_, jumps) if jumps else None


STEEPEST = 4.0
"""Largest change of a smooth rate over a step, divided by the sum of the two changes, in magnitude,
that the slopes at the start and end of the step predict. For a smooth rate this ratio is about 1/2.
The limit is eight times as large, so that a strongly curved rate is not taken for a jump."""
SMALLEST, NEGLIGIBLE = 1e-3, 1e-9
"""A jump is reported only if it exceeds `SMALLEST` times the rate that jumps plus `NEGLIGIBLE`
times the largest of all rates. The first term disregards small changes of smooth rates whose slopes
happen to vanish at both ends of the step. The second disregards rounding errors, which the mass
matrix spreads from the largest rate to all others."""


def may_have_undeclared_jump(scene: Scene) -> bool:
    """Return whether a scene has an element that may jump without declaring it. Such an element is
    of a class from outside this package, or contains a part of such a class, and it either compares
    or rounds numbers of the motion or is a contact joint. All contact joints count, because the
    search covers their constraint rows but not their contact forces."""

    def is_foreign(part: PyTree) -> bool:
        return isinstance(part, eqx.Module) and not is_of_package(type(part))

    return any(
        isinstance(element, AbstractContactJoint)
        or _depends_on_primitive(_program_of_element(element), [False, True], JUMPING)
        for element in [*scene.joints.values(), *scene.forces.values()]
        if any(map(is_foreign, jax.tree.leaves(element, is_leaf=is_foreign)))
    )


def has_undeclared_jump(trial: Trial) -> Condition:
    """Return whether any rate of the motion jumps within a trial step; ``False`` if the step ends
    at the onset or end of a contact where a force, or its slope, may jump."""
    step = trial.step
    term, fixed = term_of(trial.method, step), (trial.system, step.entry_speeds)

    def rates(t: Scalar, motion: object) -> object:
        y = eqx.tree_at(lambda y: y.motion, step.y, motion)
        return term.vf(t, y, fixed).motion

    # Slopes are taken along the secant of the step, from its start to its end, at both ends. Each
    # slope times the secant is a prediction of the change of the rate over the step. A smooth rate
    # changes by about the mean of both predictions.
    start, end = step.y.motion, trial.outcome.y.motion
    change = trial.t1 - step.t, jax.tree.map(jnp.subtract, end, start)
    early, early_change = jax.jvp(rates, (step.t, start), change)
    late, late_change = jax.jvp(rates, (trial.t1, end), change)
    leaves = [jax.tree.leaves(tree) for tree in (early, late, early_change, late_change)]
    magnitudes = [jnp.maximum(jnp.abs(a), jnp.abs(b)) for a, b in zip(*leaves[:2], strict=True)]
    # Rounding of the largest rate reaches all others through the mass matrix.
    largest = reduce(jnp.maximum, [jnp.max(size) for size in magnitudes])

    # The arguments are a rate at the start and end of the step, and its changes predicted there.
    def jumps(a: Scalar, b: Scalar, da: Scalar, db: Scalar, size: Scalar) -> Condition:
        smooth = STEEPEST * (jnp.abs(da) + jnp.abs(db))
        return jnp.any(jnp.abs(b - a) > smooth + SMALLEST * size + NEGLIGIBLE * largest)

    jumping = jnp.any(jnp.stack([jumps(*row) for row in zip(*leaves, magnitudes, strict=True)]))
    return jumping & ~any_changes(trial.system.scene, step.contact_gaps, trial.gaps)

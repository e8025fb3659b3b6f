"""Elements that decide: by time, at instants which they don't declare, or by the motion.

A force that is switched on at t_s is constant before and after: no derivative along t_s passes
through the comparison, and no run shows that it is missing. So the element's program is looked at:
whether it compares, rounds or clips anything that depends on time.
"""

import jax
import jax.numpy as jnp
from jax.core import AbstractValue, ShapedArray
from jax.extend.core import ClosedJaxpr, Jaxpr, JaxprEqn, Literal, Var
from jaxtyping import PyTree

from ...compilation import program_of
from ...fields.caching import cached_by_numbers
from ...fields.checks import require
from ...math.vectors import Matrix, Scalar, Vector, unpack
from ...model.bodies import GROUND, Motion
from ...model.drives.functions_of_time import AbstractFunctionOfTime
from ...model.joints.base import (
    AbstractConstraint,
    AbstractContactJoint,
    AbstractElement,
    AbstractForce,
)
from ...model.scene import Scene

JUMPING = frozenset(["ceil", "floor", "rem", "round", "sign"])
"""Primitives whose result jumps; besides those that make no real numbers, such as comparisons."""
KINKED = JUMPING | {"abs", "clamp", "max", "min", "sort"}
"""Primitives whose result has a jump or a kink."""


def require_declared(scene: Scene) -> None:
    """Check that every element that decides by time declares its breakpoints.

    **Raises:** `ValueError` that names the first one that doesn't.
    """
    elements = {"joints": scene.joints, "forces": scene.forces}
    for family, members in elements.items():
        for name, element in members.items():
            for function in _functions_of_time(element):
                require(
                    not _function_decides(function),
                    f"scene.{family}[{name!r}]",
                    type(function).__name__.strip("_"),
                    "a function smooth in time, or one that declares where it isn't, for "
                    "derivatives to be right",
                    "take PiecewiseConstant or PiecewiseLinear, or a subclass of "
                    "AbstractFunctionOfTime with a method `breakpoints` that returns the times in "
                    "s at which what it compares with time changes",
                )
            silent = type(element).breakpoints is AbstractElement.breakpoints
            require(
                not (silent and _decides_when_unpacked(element)),
                f"scene.{family}[{name!r}]",
                type(element).__name__,
                "smooth in time, or declare where it isn't, for derivatives to be right",
                "give its class a method `breakpoints` that returns the times in s at which what "
                "it compares with time changes, or () if nothing jumps or has a kink there",
            )


def _functions_of_time(element: AbstractElement) -> list[AbstractFunctionOfTime]:
    """The functions of time in an element that say nothing of breakpoints."""
    parts = jax.tree.leaves(element, is_leaf=lambda part: isinstance(part, AbstractFunctionOfTime))
    functions = [part for part in parts if isinstance(part, AbstractFunctionOfTime)]
    silent = AbstractFunctionOfTime.breakpoints
    return [function for function in functions if type(function).breakpoints is silent]


@cached_by_numbers
def _function_decides(function: AbstractFunctionOfTime) -> bool:
    """Whether what a function of time, in packed form, gives depends on a comparison with time."""
    program = program_of(unpack(function), 0.0)[0].jaxpr
    return _decides(_needed(program), {program.invars[0]}, KINKED)


@cached_by_numbers
def _decides_when_unpacked(element: AbstractElement) -> bool:
    """`decides_by_time` of an element in packed form."""
    return decides_by_time(unpack(element))


def decides_by_time(element: AbstractElement) -> bool:
    """Whether anything that an element (in scalar form) says depends on a comparison with time."""
    program = _program_of(element)
    return _decides(_needed(program), {program.invars[0]}, KINKED)


def may_jump_by_motion(element: AbstractElement) -> bool:
    """Whether anything that an element (in scalar form) says depends on a comparison of the
    motion's numbers; there it may jump, or have no more than a kink."""
    program = _program_of(element)
    return _decides(_needed(program), {program.invars[1]}, JUMPING)


def _program_of(element: AbstractElement) -> Jaxpr:
    """What an element says, of a time and of a number that stands for all those of the motion."""

    def statements(t: Scalar, number: Scalar) -> PyTree[Scalar]:
        vector = Vector(number, number, number)
        motion = Motion(vector, Matrix(vector, vector, vector), vector, vector)
        return _statements(element, dict.fromkeys((*element.body_names(), GROUND), motion), t)

    return program_of(statements, 0.0, 1.0)[0].jaxpr


def _statements(element: AbstractElement, motions: dict[str, Motion], t: Scalar) -> PyTree[Scalar]:
    """What the equations of motion take from an element; of a constraint's value, its rates."""
    if isinstance(element, AbstractForce):
        return element.wrenches(motions, t)
    assert isinstance(element, AbstractConstraint | AbstractContactJoint)
    rows = element.rows(motions, t).values()
    return [(row.jacobian, row.bias, row.time_rate) for row in rows]


def _needed(program: Jaxpr) -> list[JaxprEqn]:
    """The equations on which the results depend, in order."""
    wanted, needed = {v for v in program.outvars if not isinstance(v, Literal)}, []
    for equation in reversed(program.eqns):
        if not wanted.isdisjoint(equation.outvars):
            needed.append(equation)
            wanted.update(v for v in equation.invars if not isinstance(v, Literal))
    return needed[::-1]


def _decides(equations: list[JaxprEqn], causes: set[Var], deciding: frozenset[str]) -> bool:
    """Whether any equation decides by a variable that depends on one of `causes`, by one of the
    `deciding` primitives or by a comparison."""
    causes = set(causes)
    for equation in equations:
        which = [not isinstance(v, Literal) and v in causes for v in equation.invars]
        if not any(which):
            continue
        real = all(_is_real(v.aval) for v in equation.outvars)
        if equation.primitive.name in deciding or not real:
            return True
        for inner in _inner(equation):
            passed = which if len(inner.invars) == len(which) else [True] * len(inner.invars)
            inner_causes = {v for v, mine in zip(inner.invars, passed, strict=True) if mine}
            if _decides(_needed(inner), inner_causes, deciding):
                return True
        causes.update(equation.outvars)
    return False


def _is_real(value: AbstractValue) -> bool:
    return isinstance(value, ShapedArray) and jnp.issubdtype(value.dtype, jnp.inexact)


def _inner(equation: JaxprEqn) -> list[Jaxpr]:
    """The programs inside an equation, as of a loop."""
    leaves = jax.tree.leaves(equation.params, is_leaf=_is_program)
    return [p.jaxpr if isinstance(p, ClosedJaxpr) else p for p in leaves if _is_program(p)]


def _is_program(part: object) -> bool:
    return isinstance(part, Jaxpr | ClosedJaxpr)

"""A warning before the compilation of a scene's program that will take long.

A step holds the equations of motion once for each stage of the solver, unrolled into arithmetic on
scalars, and compiling takes time and memory with the number of their operations. A chain of 12
ideal revolute joints about parallel (about turning) axes has 2800 (6700) of them and took 53 s; one
of 24 has 11 000 (21 000) and took 264 s; one of 48 has 55 000 (83 000) and took more than 8 GB.
"""

import warnings
from collections.abc import Callable
from typing import TypeVar

import jax

Shapes = TypeVar("Shapes")

LARGE = 5_000
"""Operations of the equations of motion from which compiling takes half a minute and more."""
WITH_DERIVATIVES = 3
"""How many times as many operations a step has that carries derivatives."""


def shapes_of(equations: Callable[[], Shapes], derivatives: bool) -> Shapes:
    """`jax.eval_shape` of the equations of motion, which warns if they are large.

    It runs while a program is traced, so once for each that is compiled.
    """
    program, shapes = jax.make_jaxpr(equations, return_shape=True)()
    operations = len(program.jaxpr.eqns) * (WITH_DERIVATIVES if derivatives else 1)
    if operations > LARGE:
        warnings.warn(
            f"A step of this scene has some {operations} operations for each stage of the solver: "
            f"from {LARGE} on compiling takes half a minute and more, and from ten times as many "
            "more than 8 GB of memory. Long chains of ideal joints take fewer in "
            "AbsoluteCoordinates(), short closed loops in JointCoordinates(); and "
            "diffrax.Bosh3() has half the stages.",
            stacklevel=2,
        )
    return shapes

"""A warning before the compilation of a scene's program that will take long.

A step holds the equations of motion once for each stage of the solver, as arithmetic on scalars.
Compiling takes time and memory with the number of their operations. In native code, where a large
right-hand side is one function for all stages, the first answer of a chain of 12, 24 and 48 ideal
revolute joints about parallel axes (2800, 11 000 and 55 000 operations) took 2, 5 and 23 s of
processor time. XLA, which writes out all stages, took 53 and 264 s for the first two, and more than
8 GB for the last.
"""

import warnings
from collections.abc import Callable
from typing import TypeVar

import jax

Shapes = TypeVar("Shapes")

LARGE = 50_000
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
            f"from {LARGE} on compiling takes half a minute and more, and in jax.jit, vmap and "
            "grad, where XLA compiles, minutes and more than 8 GB of memory. Long chains of ideal "
            "joints take fewer in AbsoluteCoordinates(), short closed loops in "
            "JointCoordinates(); and diffrax.Bosh3() has half the stages.",
            stacklevel=2,
        )
    return shapes

"""Names of what a run carries from step to step without looking inside, and of what it returns.

What is returned is of NumPy, or of JAX inside a transformation."""

from typing import Any, TypeAlias

from jaxtyping import Bool, Float, Int, PyTree

from ...math.vectors import Scalar

SolverState: TypeAlias = PyTree[Scalar]
"""What a diffrax solver keeps from one step to the next."""
ControllerState: TypeAlias = PyTree[Scalar]
"""What a diffrax step-size controller keeps from one step to the next."""
DenseInformation: TypeAlias = dict[str, PyTree[Scalar]]
"""What a diffrax solver makes the dense output of a step of, by its names."""
SecondRates: TypeAlias = dict[str, dict[str, Scalar]]
"""Second derivatives of the depths of contacts by joint and contact, m/s^2."""
Flag: TypeAlias = Bool[Any, ""]
"""True or false, as diffrax says it."""
Numbers: TypeAlias = Float[Any, "*times"]
"""A number at each time, or at one if there are no `times`."""
Gradients: TypeAlias = Float[Any, "*times p"]
"""Derivatives along p parameters, of a number at each time."""
Integers: TypeAlias = Int[Any, "*times"]
"""A whole number at each time."""
Vectors: TypeAlias = Float[Any, "*times 3"]
"""Three components at each time."""

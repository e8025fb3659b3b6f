"""Names of what a run carries from step to step without looking inside."""

from typing import TypeAlias

from jaxtyping import PyTree

from ..math.vectors import Scalar

MotionVariables: TypeAlias = PyTree[Scalar]
"""The variables of a system's coordinates, or their rates."""
SolverState: TypeAlias = PyTree[Scalar]
"""What a diffrax solver keeps from one step to the next."""
ControllerState: TypeAlias = PyTree[Scalar]
"""What a diffrax step-size controller keeps from one step to the next."""
DenseInformation: TypeAlias = dict[str, PyTree[Scalar]]
"""What a diffrax solver makes the dense output of a step of, by its names."""
SecondRates: TypeAlias = dict[str, dict[str, Scalar]]
"""Second derivatives of the depths of contacts by joint and contact, m/s^2."""

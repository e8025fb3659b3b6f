"""Types of the numbers in fields, by name and shape.

Fields of bodies, joints, forces and states store arrays. In compiled programs, a `Vector` of three
scalars replaces an array of shape (3,), `EulerParameters` one of (4,), and a `Matrix` one of (3,
3). The types below stand for both forms; so they are based on `Any`.
"""

from typing import Any, TypeAlias

import numpy.typing
from jaxtyping import Float
from typing_extensions import TypeAliasType

ArrayLike = TypeAliasType("ArrayLike", numpy.typing.ArrayLike)
"""A number, a sequence of numbers or an array; a name that makes signatures short."""

Single: TypeAlias = Float[Any, ""]
Triple: TypeAlias = Float[Any, "3"]
Square: TypeAlias = Float[Any, "3 3"]
Column: TypeAlias = Float[Any, " N"]
"""One number for each of N rows of a table; an array in compiled programs too."""
TableRows: TypeAlias = Float[Any, " N *components"]
"""One or several numbers for each of N rows of a table; an array in compiled programs too."""
Quadruple: TypeAlias = Float[Any, "4"]
"""Euler parameters, the scalar part first."""

TripleLike: TypeAlias = ArrayLike
"""Three numbers as given by the user."""
QuadrupleLike: TypeAlias = ArrayLike

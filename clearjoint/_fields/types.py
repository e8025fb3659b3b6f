"""Types of the numbers in fields, by name and shape.

The fields of bodies, joints, forces and states store arrays. Inside of compiled programs, one of
shape (3,) is replaced by a `Vector` of three scalars, one of shape (4,) by `EulerParameters`, and
one of shape (3, 3) by a `Matrix`. The types below are used for both forms; so they are based on
`Any`.
"""

from typing import Any, TypeAlias

import numpy.typing
from jaxtyping import Float
from typing_extensions import TypeAliasType

ArrayLike = TypeAliasType("ArrayLike", numpy.typing.ArrayLike)
"""A number, a sequence of numbers or an array; an alias, so that signatures are short."""

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

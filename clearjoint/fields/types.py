"""Types of the numbers in fields, by name and shape.

A field stores arrays: of shape () for one number, (3,) for three and (4,) for four. Inside of
compiled programs, where elements compute, an array of shape (3,) is a `Vector` and one of shape
(4,) is `EulerParameters`. The types below are used for both forms; so they are based on `Any`.
"""

from typing import Any, TypeAlias

import numpy.typing
from jaxtyping import Float
from typing_extensions import TypeAliasType

ArrayLike = TypeAliasType("ArrayLike", numpy.typing.ArrayLike)
"""A number, a sequence of numbers or an array. Signatures show this name instead of the definition
in NumPy."""

Single: TypeAlias = Float[Any, ""]
"""One number, ()."""
Triple: TypeAlias = Float[Any, "3"]
"""The components of a point, a vector or an axis, (3,)."""
Square: TypeAlias = Float[Any, "3 3"]
"""A matrix of shape (3, 3), by rows."""
Column: TypeAlias = Float[Any, " N"]
"""One number for each of N rows of a table, (N,), which stays an array in scalar form."""
TableRows: TypeAlias = Float[Any, " N *components"]
"""One or several numbers for each of N rows of a table, which stays an array in scalar form."""
Quadruple: TypeAlias = Float[Any, "4"]
"""Euler parameters, (4,), the scalar part first."""

TripleLike: TypeAlias = ArrayLike
"""Three numbers as given by the user: any sequence or array of shape (3,), which is checked."""
QuadrupleLike: TypeAlias = ArrayLike
"""Four Euler parameters as given by the user, the scalar part first."""

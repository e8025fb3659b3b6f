"""Types of the numbers in fields, by name and shape.

The fields of bodies, joints, forces and states store arrays: of shape () for one number, (3,) for
three, (4,) for four and (3, 3) for a matrix. Inside of compiled programs, where joints and forces
are evaluated, the arrays are in scalar form: one of shape (3,) is replaced by a `Vector` of three
scalars, one of shape (4,) by `EulerParameters`, and one of shape (3, 3) by a `Matrix`. The types
below are used for both forms; so they are based on `Any`.
"""

from typing import Any, TypeAlias

import numpy.typing
from jaxtyping import Float
from typing_extensions import TypeAliasType

ArrayLike = TypeAliasType("ArrayLike", numpy.typing.ArrayLike)
"""A number, a sequence of numbers or an array.

It has a name of its own so that signatures show it instead of NumPy's long definition.
"""

Single: TypeAlias = Float[Any, ""]
"""One number, ()."""
Triple: TypeAlias = Float[Any, "3"]
"""The components of a point, a vector or an axis, (3,)."""
Square: TypeAlias = Float[Any, "3 3"]
"""A matrix of shape (3, 3), by rows."""
Column: TypeAlias = Float[Any, " N"]
"""One number for each of N rows of a table, (N,). It stays an array in compiled programs too."""
TableRows: TypeAlias = Float[Any, " N *components"]
"""One or several numbers for each of N rows of a table, (N,) or (N, K). It stays an array in
compiled programs too."""
Quadruple: TypeAlias = Float[Any, "4"]
"""Euler parameters, (4,), the scalar part first."""

TripleLike: TypeAlias = ArrayLike
"""Three numbers as given by the user: any sequence or array of shape (3,), which is checked."""
QuadrupleLike: TypeAlias = ArrayLike
"""Four Euler parameters as given by the user, the scalar part first."""

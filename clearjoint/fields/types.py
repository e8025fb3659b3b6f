"""Types of what fields hold: by name, with the shape.

A field has two forms, of which the second is never seen outside a compiled program: one number is
an array of shape (), three are an array of shape (3,), and a `Vector` where elements compute, four
are `EulerParameters` there. Both forms go by the name of the first, and `Any` stands for them. What
is given for a field becomes its first form when an element is made.
"""

from typing import Any, TypeAlias

import numpy.typing
from jaxtyping import Float
from typing_extensions import TypeAliasType

ArrayLike = TypeAliasType("ArrayLike", numpy.typing.ArrayLike)
"""A number, a sequence of numbers or an array. Signatures show it by its name, and not by the
definition of numpy's."""

Single: TypeAlias = Float[Any, ""]
"""One number."""
Triple: TypeAlias = Float[Any, "3"]
"""The components of a point, a vector or an axis."""
Square: TypeAlias = Float[Any, "3 3"]
"""A matrix, by rows."""
Column: TypeAlias = Float[Any, " N"]
"""A row of numbers of a table, which stays an array."""
TableRows: TypeAlias = Float[Any, " N *components"]
"""A number, or several, in each row of a table, which stays an array."""
Quadruple: TypeAlias = Float[Any, "4"]
"""Euler parameters, the scalar part first."""

TripleLike: TypeAlias = ArrayLike
"""Three numbers as they are given: any sequence or array of shape (3,). The element checks it."""
QuadrupleLike: TypeAlias = ArrayLike
"""Four Euler parameters as they are given, the scalar part first."""

"""Types of what fields hold: by name, with the shape.

They are of two forms, of which the second is never seen outside a compiled program: a number is
given as a float and kept as an array of shape (); three numbers are given as any sequence, kept as
an array of shape (3,), and a `Vector` where elements compute; four are `EulerParameters` there.
"""

from typing import Any, TypeAlias

from jaxtyping import Float

Single: TypeAlias = Float[Any, ""]
"""One number."""
Triple: TypeAlias = Float[Any, "3"]
"""The components of a point, a vector or an axis."""
Square: TypeAlias = Float[Any, "3 3"]
"""A matrix, by rows."""
Quadruple: TypeAlias = Float[Any, "4"]
"""Euler parameters, the scalar part first."""

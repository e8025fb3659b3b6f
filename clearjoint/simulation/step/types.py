"""Types of the arrays that a run returns: NumPy arrays, or JAX arrays inside a transformation."""

from typing import Any, TypeAlias

from jaxtyping import Float, Int

Numbers: TypeAlias = Float[Any, "*times"]
"""A number at each time; a single one if there is no axis of times."""
Gradients: TypeAlias = Float[Any, "*times p"]
"""Derivatives of a number at each time along p parameters."""
Integers: TypeAlias = Int[Any, "*times"]
"""A whole number at each time."""
Vectors: TypeAlias = Float[Any, "*times 3"]
"""Three components at each time."""

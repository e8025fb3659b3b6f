"""Types of the arrays that a run returns: NumPy arrays, or JAX arrays inside a transformation."""

from typing import Any, TypeAlias

import numpy as np
from jaxtyping import Bool, Float, Int

Numbers: TypeAlias = Float[Any, "*times"]
"""A number at each of N times, (N,); or at a single time, ()."""
Gradients: TypeAlias = Float[Any, "*times p"]
"""Derivatives of a number by p parameters at each of N times, (N, p); or at a single time, (p,)."""
Flags: TypeAlias = Bool[np.ndarray, "*times"]
"""Whether something is true at each of N times, (N,)."""
Integers: TypeAlias = Int[Any, "*times"]
"""A whole number at each of N times, (N,); or at a single time, ()."""
Vectors: TypeAlias = Float[Any, "*times 3"]
"""A vector at each of N times, (N, 3); or at a single time, (3,)."""

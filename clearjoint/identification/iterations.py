"""What a search tells of its iterations and of its end."""

from dataclasses import dataclass
from enum import Enum

import numpy as np
from jaxtyping import Float

NEARLY = 0.1
"""Gauss-Newton step in standard deviations. A search that finds no better point counts as converged
if the step left is shorter, since errors of the integration allow no more."""


class Ending(Enum):
    """How a search ended; the value is the message."""

    CONVERGED = "converged"
    STALLED = "no step improves the fit: the data may be rough there; fit growing windows first"
    EXHAUSTED = "the limit of iterations was reached"
    FAILED = "the best run that was found does not reach the last sample"


@dataclass(frozen=True)
class Iteration:
    """One run of a search.

    - `number`: from 0; `accepted`: whether it is the best so far.
    - `chi_squared`, `coordinates` (p,): of this run; `chi_squared` is infinite if a residual or a
      derivative is not finite.
    - `decrement`: length of the Gauss-Newton step from the best run so far, in standard deviations
      of the estimates.
    - `trust`: in the linear model. In a trust region: length of the step to this run over that of
      the Gauss-Newton step, in scaled coordinates. Where whole steps are taken: the part of a step
      that the search begins with.
    """

    number: int
    accepted: bool
    chi_squared: float
    coordinates: Float[np.ndarray, " p"]
    decrement: float
    trust: float

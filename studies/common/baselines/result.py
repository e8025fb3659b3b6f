"""What every baseline returns."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class BaselineRun:
    """The end of a run and what it cost.

    `r2`, `r3`: centres of mass of the arms at the end, (3,) m; `steps`: accepted steps;
    `right_hand_sides`: evaluations of the equations of motion, for an implicit method of their
    residual; `seconds`: wall time of the integration alone, without setting up.
    """

    r2: np.ndarray
    r3: np.ndarray
    steps: int
    right_hand_sides: int
    seconds: float

"""Result of a baseline."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class BaselineRun:
    """Final state and cost of a run.

    - `r2`, `r3`: final centres of mass of the arms, (3,) m.
    - `steps`: accepted steps.
    - `right_hand_sides`: evaluations of the equations of motion, or of their residual by an
      implicit method.
    - `seconds`: wall time of the integration without preparation.
    """

    r2: np.ndarray
    r3: np.ndarray
    steps: int
    right_hand_sides: int
    seconds: float

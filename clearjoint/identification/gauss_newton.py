"""Gauss-Newton with whole steps, for residuals of which some weigh far more than others.

Heavy residuals make the misfit a narrow curved valley. A whole step along the valley leaves its
bottom, by the curvature times the step's square, and the misfit rises a thousandfold; yet the next
steps come back to the bottom much farther on. A search whose misfit must fall with each step creeps
there. So here it may rise for some steps, if it then falls below the best: the watchdog of R. M.
Chamberlain, M. J. D. Powell et al., *Mathematical Programming Study* 16 (1982). If it does not, the
search goes back to the best point and starts with a quarter of the step. No search of optimistix
returns to an earlier point.
"""

from collections.abc import Callable
from typing import Generic, TypeVar

import numpy as np

from .levenberg_marquardt import NEARLY, Ending, Iteration, LinearisedMisfit, scales_of

PATIENCE = 6
"""Steps in a row after which the misfit must have fallen below the best."""
SHORTEST = 4.0**-4
"""Part of a step below which the search gives up."""
SINGULAR = 1e-13
"""Singular value over the largest below which the data don't see a direction."""
E = TypeVar("E", bound=LinearisedMisfit)


class _Place(Generic[E]):
    """A point of the search.

    - `model`: residuals and Jacobian there.
    - `misfit`: sum of the squared residuals.
    - `step`: (P,) the Gauss-Newton step from there; `length`: of the step, in standard deviations
      of the estimates.
    """

    def __init__(self, model: E):
        self.model = model
        self.misfit = float(model.residuals @ model.residuals)
        scales = scales_of(model.jacobian)
        step, *_ = np.linalg.lstsq(model.jacobian / scales, -model.residuals, rcond=SINGULAR)
        self.step = step / scales
        self.length = float(np.linalg.norm(model.jacobian @ self.step))


def search_in_whole_steps(
    evaluate: Callable[[np.ndarray], E],
    start: np.ndarray,
    tolerance: float,
    max_iterations: int,
    on_iteration: Callable[[Iteration], None],
) -> tuple[E, tuple[Iteration, ...], Ending]:
    """Search the least squares from a start (P,), and report every iteration.

    **Returns:** the best evaluation, all iterations, and how it ended.
    """
    best = now = _Place(evaluate(start))
    iterations: list[Iteration] = []
    part, since = 1.0, 0
    while True:
        accepted, at = now is best, now.model.coordinates
        iterations.append(Iteration(len(iterations), accepted, now.misfit, at, best.length, part))
        on_iteration(iterations[-1])
        if since == PATIENCE:
            now, part, since = best, 0.25 * part, 0
        if best.length < tolerance or (part < 1.0 and best.length < NEARLY):
            return best.model, tuple(iterations), Ending.CONVERGED
        if part < SHORTEST or len(iterations) >= max_iterations:
            ending = Ending.STALLED if part < SHORTEST else Ending.EXHAUSTED
            return best.model, tuple(iterations), ending
        step = part * now.step if since == 0 else now.step
        now, since = _Place(evaluate(now.model.coordinates + step)), since + 1
        if now.misfit < best.misfit:
            best, part, since = now, min(1.0, 4.0 * part), 0

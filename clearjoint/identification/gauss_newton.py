"""Gauss-Newton with whole steps, for residuals of which some weigh far more than others.

Heavy residuals make the misfit a narrow curved valley. A whole step along the valley leaves its
bottom, by the curvature times the step's square, and the misfit rises a thousandfold; yet the next
steps come back to the bottom much farther on. A search whose misfit must fall with each step creeps
there. So here it may rise for some steps, if it then falls below the best: the watchdog of R. M.
Chamberlain, M. J. D. Powell et al., *Mathematical Programming Study* 16 (1982). If it does not, the
search goes back to the best point and starts with a quarter of the step. No search of SciPy returns
to an earlier point.
"""

from collections.abc import Callable

import numpy as np

from .iterations import NEARLY, Ending, Iteration
from .place import E, Place

PATIENCE = 6
"""Steps in a row after which the misfit must have fallen below the best."""
SHORTEST = 4.0**-4
"""Part of a step below which the search gives up."""


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
    best = now = Place(evaluate(start))
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
        now, since = Place(evaluate(now.model.coordinates + step)), since + 1
        if now.misfit < best.misfit:
            best, part, since = now, min(1.0, 4.0 * part), 0

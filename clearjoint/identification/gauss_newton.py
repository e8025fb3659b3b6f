"""Gauss-Newton with whole steps, for residuals of which some weigh far more than others.

Heavy ones make the misfit a narrow curved valley. A whole step along it leaves it, by the curvature
times the step's square, and the misfit rises a thousandfold, though the next steps come back to
the bottom much farther on. Searches that only ever go down, by damping or along a line, creep
there. So the misfit may rise for some steps, if it then falls below the best: the watchdog of R. M.
Chamberlain, M. J. D. Powell et al., *Mathematical Programming Study* 16 (1982). If it does not, the
search goes back to the best and begins with a quarter of the step. No search of optimistix returns
to an earlier point, hence this.
"""

from collections.abc import Callable
from typing import Generic, TypeVar

import numpy as np

from .levenberg_marquardt import NEARLY, Ending, Evaluation, Iteration, scales_of

PATIENCE = 6
"""Steps in a row that need not fall below the best."""
SHORTEST = 4.0**-4
"""First part of a step below which none will do."""
SINGULAR = 1e-13
"""Singular value over the largest below which a direction is not seen at all."""
E = TypeVar("E", bound=Evaluation)


class _Place(Generic[E]):
    """An evaluation, its misfit, the Gauss-Newton step (P,) from it, and that step's length in
    standard deviations of what is estimated."""

    def __init__(self, found: E):
        self.found = found
        self.misfit = float(found.residuals @ found.residuals)
        scales = scales_of(found.jacobian)
        scaled, *_ = np.linalg.lstsq(found.jacobian / scales, -found.residuals, rcond=SINGULAR)
        self.step = scaled / scales
        self.length = float(np.linalg.norm(found.jacobian @ self.step))


def search(
    evaluate: Callable[[np.ndarray], E],
    start: np.ndarray,
    tolerance: float,
    max_iterations: int,
    tell: Callable[[Iteration], None],
) -> tuple[E, tuple[Iteration, ...], Ending]:
    """Search the least squares from a start (P,), and tell every iteration.

    **Returns:** the best evaluation, all iterations, and how it ended.
    """
    best = now = _Place(evaluate(start))
    iterations: list[Iteration] = []
    part, since = 1.0, 0
    while True:
        accepted, at = now is best, now.found.coordinates
        iterations.append(Iteration(len(iterations), accepted, now.misfit, at, best.length, part))
        tell(iterations[-1])
        if since == PATIENCE:
            now, part, since = best, 0.25 * part, 0
        if best.length < tolerance or (part < 1.0 and best.length < NEARLY):
            return best.found, tuple(iterations), Ending.CONVERGED
        if part < SHORTEST or len(iterations) >= max_iterations:
            ending = Ending.STALLED if part < SHORTEST else Ending.EXHAUSTED
            return best.found, tuple(iterations), ending
        taken = part * now.step if since == 0 else now.step
        now, since = _Place(evaluate(now.found.coordinates + taken)), since + 1
        if now.misfit < best.misfit:
            best, part, since = now, min(1.0, 4.0 * part), 0

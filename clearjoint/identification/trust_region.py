"""Least squares in a trust region, by SciPy, with the derivatives of the runs.

The trust region of `scipy.optimize.least_squares` is an ellipsoid in the coordinates, scaled by the
columns of the first Jacobian. Along a coordinate that the data hardly see it would be wide, so that
it is no wider there, at first, than about the stride of the coordinate's scale. SciPy takes the
first radius from its unknowns at the start, so these count from one step before it: that of Gauss
and Newton, each coordinate clipped to its stride.

The search ends when the Gauss-Newton step is a small part of the standard deviation of what is
estimated; SciPy's own tolerances, of the misfit and of the unknowns, know no such scale.
"""

from collections.abc import Callable
from contextlib import suppress
from typing import Generic

import numpy as np
from jaxtyping import Float

from .iterations import NEARLY, Ending, Iteration
from .place import E, Place

PATIENCE = 15
"""Rejected steps, each a quarter as long as the one before, after which no step will do."""
SHORT = 1e-3
"""Length of a step over the tolerance, in scaled coordinates, below which the search ends."""
ROUNDING = 1e-15
"""SciPy's own tolerances, so small that the search never ends by them before ours."""


def search_in_trust_region(
    evaluate: Callable[[Float[np.ndarray, " p"]], E],
    start: Float[np.ndarray, " p"],
    strides: Float[np.ndarray, " p"],
    tolerance: float,
    max_iterations: int,
    on_iteration: Callable[[Iteration], None],
) -> tuple[E, tuple[Iteration, ...], Ending]:
    """Search the least squares from a start (p,), and report every iteration.

    **Returns:** the best evaluation, all iterations, and how it ended.
    """
    from scipy.optimize import least_squares  # a tenth of every import, for this alone

    search = _Search(Place(evaluate(start)), strides, tolerance, max_iterations, on_iteration)
    with suppress(_Ended):
        search.add(search.best, 1.0)
        least_squares(
            lambda unknowns: search.residuals(unknowns, evaluate),
            search.first_unknowns,
            jac=lambda _: search.best.model.jacobian,  # pyright: ignore
            x_scale=1.0 / search.scales,
            ftol=ROUNDING,
            xtol=ROUNDING,
            gtol=ROUNDING,
            max_nfev=max_iterations + PATIENCE,
        )
    return search.best.model, tuple(search.iterations), search.ending()


class _Ended(Exception):  # noqa: N818 (no error)
    """Raised in the function that SciPy calls, to leave its search."""


class _Search(Generic[E]):
    """The runs so far. SciPy's unknowns are the coordinates less those of `origin`; the Jacobian
    that it asks for is always that of the best run."""

    def __init__(
        self,
        first: Place[E],
        strides: np.ndarray,
        tolerance: float,
        max_iterations: int,
        on_iteration: Callable[[Iteration], None],
    ):
        self.best = first
        self.tolerance, self.max_iterations = tolerance, max_iterations
        self.on_iteration = on_iteration
        self.iterations: list[Iteration] = []
        self.rejected = 0
        step = np.clip(first.step, -strides, strides)
        self.scales = np.maximum(first.scales, np.linalg.norm(step * first.scales) / strides)
        self.origin, self.first_unknowns = first.model.coordinates - step, step

    def residuals(self, unknowns: np.ndarray, evaluate: Callable[[np.ndarray], E]) -> np.ndarray:
        """Residuals (M,) of the run at SciPy's unknowns (p,): infinite, which SciPy turns back
        from, if the run has no finite model.

        **Raises:** `_Ended` if it was the last, or need not be made.
        """
        if np.array_equal(unknowns, self.first_unknowns):
            return self.best.model.residuals
        coordinates = self.origin + unknowns
        step = (coordinates - self.best.model.coordinates) * self.scales
        if np.abs(step).max() < SHORT * self.tolerance:
            raise _Ended
        now = Place(evaluate(coordinates))
        self.add(now, float(np.linalg.norm(step) / np.linalg.norm(self.best.step * self.scales)))
        residuals = now.model.residuals
        return residuals if np.isfinite(now.misfit) else np.full_like(residuals, np.inf)

    def add(self, now: Place[E], trust: float) -> None:
        """Add a run, and report it.

        **Raises:** `_Ended` if no further one is needed, allowed or possible.
        """
        accepted = now is self.best or now.misfit < self.best.misfit
        self.best, self.rejected = (now, 0) if accepted else (self.best, self.rejected + 1)
        number, at = len(self.iterations), now.model.coordinates
        self.iterations.append(Iteration(number, accepted, now.misfit, at, self.best.length, trust))
        self.on_iteration(self.iterations[-1])
        near = self.best.length < self.tolerance or not np.isfinite(self.best.misfit)
        if near or self.rejected == PATIENCE or number + 1 == self.max_iterations:
            raise _Ended

    def ending(self) -> Ending:
        """How the search ended."""
        if self.best.length < max(NEARLY, self.tolerance):
            return Ending.CONVERGED
        exhausted = len(self.iterations) == self.max_iterations
        return Ending.EXHAUSTED if exhausted else Ending.STALLED

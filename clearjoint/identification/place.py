"""A point of a search: its misfit, and the Gauss-Newton step from there."""

from typing import Generic, Protocol, TypeVar

import numpy as np
from jaxtyping import Float

SINGULAR = 1e-13
"""Singular value over the largest below which the data don't see a direction."""


class LinearisedMisfit(Protocol):
    """Residuals (M,) and Jacobian (M, p) at coordinates (p,)."""

    @property
    def coordinates(self) -> Float[np.ndarray, " p"]:
        """Coordinates of the parameters, (p,)."""
        ...

    @property
    def residuals(self) -> Float[np.ndarray, " M"]:
        """Prediction less measurement, (M,), in standard deviations of the noise."""
        ...

    @property
    def jacobian(self) -> Float[np.ndarray, "M p"]:
        """Derivatives of the residuals along the coordinates, (M, p)."""
        ...


E = TypeVar("E", bound=LinearisedMisfit)


class Place(Generic[E]):
    """A point of a search.

    - `model`: residuals and Jacobian there.
    - `misfit`: sum of the squared residuals; infinite, and no step leads from there, if a residual
      or a derivative is not finite.
    - `scales`: (p,) norms of the Jacobian's columns; see `scales_of`.
    - `step`: (p,) the Gauss-Newton step from there; `length`: of the step, in standard deviations
      of the estimates.
    """

    def __init__(self, model: E):
        self.model = model
        self.misfit, self.length = np.inf, np.inf
        self.step, self.scales = np.zeros((2, len(model.coordinates)))
        if np.isfinite(model.residuals).all() and np.isfinite(model.jacobian).all():
            self.misfit = float(model.residuals @ model.residuals)
            self.scales = scales_of(model.jacobian)
            scaled = model.jacobian / self.scales
            step, *_ = np.linalg.lstsq(scaled, -model.residuals, rcond=SINGULAR)
            self.step = step / self.scales
            self.length = float(np.linalg.norm(model.jacobian @ self.step))


def scales_of(jacobian: Float[np.ndarray, "M p"]) -> Float[np.ndarray, " p"]:
    """Norms (p,) of the columns of a Jacobian (M, p); of a column of zeros, the largest norm."""
    norms = np.linalg.norm(jacobian, axis=0)
    largest = norms.max() if norms.max() > 0.0 else 1.0
    return np.where(norms > SINGULAR * largest, norms, largest)

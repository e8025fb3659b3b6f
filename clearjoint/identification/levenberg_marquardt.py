"""Levenberg-Marquardt by optimistix, one step at a time.

The caller computes residuals and Jacobian at each point that optimistix proposes, and optimistix
sees their linear model in the place of the function. So a step is compiled once for each number of
parameters, apart from the runs (`clearjoint.simulation.run.sensitivities`).

Where this differs from `optimistix.LevenbergMarquardt`: coordinates are scaled by the columns of
the first Jacobian, so that damping means the same for all; the damping falls where the model did
well, not only where it was all but exact; no step goes further than the scales' strides; and it
ends when the Gauss-Newton step is a small part of the standard deviation of what is estimated.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Protocol, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Float, PyTree

from ..compilation import Compiled
from ..fields.conversion import on_device
from ..math.vectors import Scalar

PATIENCE = 15
"""Rejected steps, each a quarter as long as the one before, after which no step will do."""
SHORT = 1e-3
"""Length of a step over the tolerance, in scaled coordinates, below which the search ends."""
NEARLY = 0.1
"""Gauss-Newton step in standard deviations. A search that finds no better point counts as converged
if the step left is shorter, since errors of the integration allow no more."""
SINGULAR = 1e-12
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


class Ending(Enum):
    """How a search ended; the value is the message.

    >>> cj.results.Ending.CONVERGED.value
    'converged'
    """

    CONVERGED = "converged"
    STALLED = "no step improves the fit: the data may be rough there; fit growing windows first"
    EXHAUSTED = "the limit of iterations was reached"
    INTERRUPTED = "it was interrupted"
    FAILED = "the best run that was found does not reach the last sample"


@dataclass(frozen=True)
class Iteration:
    """One run of a search.

    - `number`: from 0; `accepted`: whether it is the best so far.
    - `chi_squared`, `coordinates` (p,): of this run.
    - `decrement`: length of the Gauss-Newton step from the best run so far, in standard deviations
      of the estimates.
    - `trust`: in the linear model: one over the damping of Levenberg and Marquardt; where whole
      steps are taken, the part of a step that the search begins with.

    >>> step = cj.results.Iteration(3, True, 101.2, np.zeros(2), decrement=0.1, trust=1.0)
    >>> step.accepted
    True
    """

    number: int
    accepted: bool
    chi_squared: float
    coordinates: np.ndarray
    decrement: float
    trust: float


class _Strides(optx.AbstractDescent):
    """A descent whose steps are clipped to the strides, (p,), so that a parameter that the data
    hardly see stays near while the others are still far off."""

    descent: optx.DampedNewtonDescent
    strides: jax.Array

    def init(self, y: jax.Array, f_info_struct: PyTree) -> PyTree:
        """The initial state of the inner descent."""
        return self.descent.init(y, f_info_struct)

    def query(self, y: jax.Array, f_info: PyTree, state: PyTree) -> PyTree:
        """The inner descent's state at a new point."""
        return self.descent.query(y, f_info, state)

    def step(self, step_size: jax.Array, state: PyTree) -> tuple[jax.Array, optx.RESULTS]:
        """The inner descent's step, each coordinate no farther than its stride."""
        step, result = self.descent.step(step_size, state)
        return jnp.clip(step, -self.strides, self.strides), result


class _LevenbergMarquardt(optx.AbstractGaussNewton):
    """Ends by the Gauss-Newton step, or where it gets no farther."""

    descent: _Strides
    tolerance: jax.Array
    search: optx.ClassicalTrustRegion = optx.ClassicalTrustRegion(high_cutoff=0.7)
    rtol: float = 0.0
    atol: float = 0.0
    norm: Callable[[PyTree], Scalar] = optx.max_norm
    verbose: Callable[..., None] = lambda **_: None

    def terminate(
        self,
        fn: Callable[..., PyTree],
        y: jax.Array,
        args: PyTree,
        options: dict[str, object],
        state: PyTree,
        tags: frozenset[object],
    ) -> tuple[jax.Array, optx.RESULTS]:
        """Whether to end: the Gauss-Newton step or the last step is short, or none is better."""
        near = decrement(state.f_info.residual, state.f_info.jac.as_matrix()) < self.tolerance
        short = jnp.max(jnp.abs(state.y_eval - y)) < SHORT * self.tolerance
        tired = state.num_steps_since_acceptance >= PATIENCE
        return near | short | tired, optx.RESULTS.successful


def decrement(residuals: jax.Array, jacobian: jax.Array) -> jax.Array:
    """Length of the Gauss-Newton step in standard deviations of the estimates: the norm of the
    residuals (M,), projected on the columns of the Jacobian (M, p)."""
    axes, sizes, _ = jnp.linalg.svd(jacobian, full_matrices=False)
    return jnp.linalg.norm(jnp.where(sizes > SINGULAR * sizes[0], residuals @ axes, 0.0))


_Model = tuple[jax.Array, jax.Array, jax.Array]
"""Coordinates (p,), residuals (M,) and Jacobian (M, p) there."""


def _residuals(y: jax.Array, model: _Model) -> tuple[jax.Array, None]:
    """Residuals of the linear model at coordinates `y`."""
    at, residuals, jacobian = model
    return residuals + jacobian @ (y - at), None


def _initial_state(solver: _LevenbergMarquardt, y: jax.Array, model: _Model) -> PyTree:
    rows = jax.eval_shape(lambda: model[1])
    return solver.init(_residuals, y, model, {}, rows, None, frozenset())


@Compiled
def _advance(
    y: jax.Array, arrays: PyTree, model: _Model, strides: jax.Array, tolerance: jax.Array
) -> tuple[jax.Array, PyTree, jax.Array, jax.Array]:
    """One step: the best coordinates so far, the arrays of the solver's state, whether to end, and
    the decrement. `arrays` of the state before, ``None`` at first."""
    solver = _LevenbergMarquardt(
        descent=_Strides(optx.DampedNewtonDescent(), strides), tolerance=tolerance
    )
    state = initial = _initial_state(solver, y, model)
    if arrays is not None:
        state = eqx.combine(arrays, eqx.filter(initial, eqx.is_array, True))
    y, state, _ = solver.step(_residuals, y, model, {}, state, frozenset())
    done, _ = solver.terminate(_residuals, y, model, {}, state, frozenset())
    length = decrement(state.f_info.residual, state.f_info.jac.as_matrix())
    return y, eqx.filter(state, eqx.is_array), done, length


def search_with_damping(
    evaluate: Callable[[Float[np.ndarray, " p"]], E],
    start: Float[np.ndarray, " p"],
    strides: Float[np.ndarray, " p"],
    tolerance: float,
    max_iterations: int,
    on_iteration: Callable[[Iteration], None],
) -> tuple[E, tuple[Iteration, ...], Ending]:
    """Search the least squares from a start (p,), and report every iteration.

    **Returns:** the best evaluation, all iterations, and how it ended: a `KeyboardInterrupt` after
    the first evaluation ends it too.
    """
    iterations: list[Iteration] = []
    best = now = evaluate(start)
    try:
        scales = scales_of(now.jacobian)
        y, arrays = on_device(start * scales), None
        limits = on_device(strides * scales), on_device(tolerance)
        while True:
            model = on_device(now.coordinates * scales), *_triangular(now, scales)
            y, arrays, done, length = _advance(y, arrays, model, *limits)
            accepted = int(arrays.num_steps_since_acceptance) == 0
            best = now if accepted else best
            iteration = Iteration(
                len(iterations),
                accepted,
                float(now.residuals @ now.residuals),
                now.coordinates,
                float(length),
                float(arrays.search_state.step_size),
            )
            iterations.append(iteration)
            on_iteration(iteration)
            if bool(done):
                near = iteration.decrement < max(NEARLY, tolerance)
                return best, tuple(iterations), Ending.CONVERGED if near else Ending.STALLED
            if len(iterations) == max_iterations:
                return best, tuple(iterations), Ending.EXHAUSTED
            now = evaluate(np.asarray(arrays.y_eval) / scales)
    except KeyboardInterrupt:
        return best, tuple(iterations), Ending.INTERRUPTED


def scales_of(jacobian: Float[np.ndarray, "M p"]) -> Float[np.ndarray, " p"]:
    """Norms (p,) of the columns of a Jacobian (M, p); of a column of zeros, the largest norm."""
    norms = np.linalg.norm(jacobian, axis=0)
    largest = norms.max() if norms.max() > 0.0 else 1.0
    return np.where(norms > SINGULAR * largest, norms, largest)


def _triangular(now: LinearisedMisfit, scales: np.ndarray) -> tuple[jax.Array, jax.Array]:
    """Residuals and Jacobian in scaled coordinates, p + 1 rows: rotated by the QR decomposition,
    which changes no length, so that one program serves data of all sizes."""
    table = np.column_stack([now.jacobian / scales, now.residuals])
    rows = np.zeros((table.shape[1], table.shape[1]))
    triangle = np.linalg.qr(table, mode="r")
    rows[: len(triangle)] = triangle
    return on_device(rows[:, -1]), on_device(rows[:, :-1])

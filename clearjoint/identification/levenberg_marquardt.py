"""Levenberg-Marquardt by optimistix, one step at a time.

The caller computes residuals and Jacobian wherever optimistix wants to look, and tells it both as
the straight line through them. So a step compiles once for a number of parameters, apart from the
run, which is compiled for everybody (`clearjoint.simulation.sensitivities`).

Where this differs from `optimistix.LevenbergMarquardt`: coordinates are scaled by the columns of
the first Jacobian, so that damping means the same for all; the damping falls where the model did
well, not only where it was all but exact; no step goes further than the scales' strides; and it
ends when the Gauss-Newton step is a small part of the standard deviation of what is estimated.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Any, Protocol, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx

PATIENCE = 15
"""Rejected steps, each a quarter as long as the one before, after which no step will do."""
SHORT = 1e-3
"""Step over the tolerance, in scaled coordinates, below which a step is none."""
NEARLY = 0.1
"""Gauss-Newton step in standard deviations below which a search that finds nothing better has
come as near as the integration's errors let it."""
SINGULAR = 1e-12
"""Singular value over the largest below which a direction is not seen at all."""


class Evaluation(Protocol):
    """Residuals (M,) and Jacobian (M, p) at coordinates (p,)."""

    @property
    def coordinates(self) -> np.ndarray:
        """Where."""
        ...

    @property
    def residuals(self) -> np.ndarray:
        """In standard deviations."""
        ...

    @property
    def jacobian(self) -> np.ndarray:
        """Along the coordinates."""
        ...


E = TypeVar("E", bound=Evaluation)


class Ending(Enum):
    """How a search ended; the value is the message."""

    CONVERGED = "converged"
    STALLED = "no step improves the fit: the data may be rough there; fit growing windows first"
    EXHAUSTED = "the limit of iterations was reached"
    FAILED = "the best run that was found does not reach the last sample"


@dataclass(frozen=True)
class Iteration:
    """One evaluation: its number, whether it was taken, chi squared, the coordinates (p,), the
    Gauss-Newton step from the best so far in standard deviations, and the trust in the model (one
    over the damping; for whole steps, the part that is taken)."""

    number: int
    accepted: bool
    chi_squared: float
    coordinates: np.ndarray
    decrement: float
    trust: float


class _Strides(optx.AbstractDescent):
    """A descent whose steps keep to the strides, (p,), so that what the data hardly see does not
    run away while the rest is still far off."""

    descent: optx.DampedNewtonDescent
    strides: Any

    def init(self, y: Any, f_info_struct: Any) -> Any:
        """That of the descent."""
        return self.descent.init(y, f_info_struct)

    def query(self, y: Any, f_info: Any, state: Any) -> Any:
        """That of the descent."""
        return self.descent.query(y, f_info, state)

    def step(self, step_size: Any, state: Any) -> Any:
        """The descent's step, each coordinate no farther than its stride."""
        step, result = self.descent.step(step_size, state)
        return jnp.clip(step, -self.strides, self.strides), result


class _LevenbergMarquardt(optx.AbstractGaussNewton):
    """Ends by the Gauss-Newton step, or where it gets no farther."""

    descent: _Strides
    tolerance: Any
    search: optx.ClassicalTrustRegion = optx.ClassicalTrustRegion(high_cutoff=0.7)
    rtol: float = 0.0
    atol: float = 0.0
    norm: Callable[..., Any] = optx.max_norm
    verbose: Callable[..., None] = lambda **_: None

    def terminate(
        self, fn: Any, y: Any, args: Any, options: Any, state: Any, tags: Any
    ) -> tuple[Any, optx.RESULTS]:
        """Whether nothing is left to gain."""
        near = decrement(state.f_info.residual, state.f_info.jac.as_matrix()) < self.tolerance
        short = jnp.max(jnp.abs(state.y_eval - y)) < SHORT * self.tolerance
        tired = state.num_steps_since_acceptance >= PATIENCE
        return near | short | tired, optx.RESULTS.successful


def decrement(residuals: Any, jacobian: Any) -> Any:
    """Length of the Gauss-Newton step in standard deviations of what is estimated: the norm of
    what the columns of the Jacobian (M, p) can explain of the residuals (M,)."""
    axes, sizes, _ = jnp.linalg.svd(jacobian, full_matrices=False)
    return jnp.linalg.norm(jnp.where(sizes > SINGULAR * sizes[0], residuals @ axes, 0.0))


def _line(y: Any, at: tuple[Any, Any, Any]) -> tuple[Any, None]:
    where, residuals, jacobian = at
    return residuals + jacobian @ (y - where), None


def _begun(solver: Any, y: Any, at: Any) -> Any:
    rows = jax.eval_shape(lambda: at[1])
    return solver.init(_line, y, at, {}, rows, None, frozenset())


@eqx.filter_jit
def _advance(y: Any, arrays: Any, at: Any, strides: Any, tolerance: Any) -> Any:
    """One step: the best so far, the state's arrays, whether to end, the decrement."""
    solver = _LevenbergMarquardt(_Strides(optx.DampedNewtonDescent(), strides), tolerance)
    begun = _begun(solver, y, at)
    state = begun
    if arrays is not None:
        state = eqx.combine(arrays, eqx.filter(begun, eqx.is_array, True))
    y, state, _ = solver.step(_line, y, at, {}, state, frozenset())
    done, _ = solver.terminate(_line, y, at, {}, state, frozenset())
    found = decrement(state.f_info.residual, state.f_info.jac.as_matrix())
    return y, eqx.filter(state, eqx.is_array), done, found


def search(
    evaluate: Callable[[np.ndarray], E],
    start: np.ndarray,
    strides: np.ndarray,
    tolerance: float,
    max_iterations: int,
    tell: Callable[[Iteration], None],
) -> tuple[E, tuple[Iteration, ...], Ending]:
    """Search the least squares from a start (p,), and tell every iteration.

    **Returns:** the best evaluation, all iterations, and how it ended.
    """
    best = now = evaluate(start)
    scales = scales_of(now.jacobian)
    y, arrays, iterations = jnp.asarray(start * scales), None, []
    limits = jnp.asarray(strides * scales), jnp.asarray(tolerance, float)
    while True:
        at = jnp.asarray(now.coordinates * scales), *_compressed(now, scales)
        y, arrays, done, found = _advance(y, arrays, at, *limits)
        accepted = int(arrays.num_steps_since_acceptance) == 0
        best = now if accepted else best
        iteration = Iteration(
            len(iterations),
            accepted,
            float(now.residuals @ now.residuals),
            now.coordinates,
            float(found),
            float(arrays.search_state.step_size),
        )
        iterations.append(iteration)
        tell(iteration)
        if bool(done):
            near = iteration.decrement < max(NEARLY, tolerance)
            return best, tuple(iterations), Ending.CONVERGED if near else Ending.STALLED
        if len(iterations) == max_iterations:
            return best, tuple(iterations), Ending.EXHAUSTED
        now = evaluate(np.asarray(arrays.y_eval) / scales)


def scales_of(jacobian: np.ndarray) -> np.ndarray:
    """Norms of the columns; of one that is zero, that of the largest."""
    norms = np.linalg.norm(jacobian, axis=0)
    largest = norms.max() if norms.max() > 0.0 else 1.0
    return np.where(norms > SINGULAR * largest, norms, largest)


def _compressed(now: Evaluation, scales: np.ndarray) -> tuple[Any, Any]:
    """Residuals and Jacobian in scaled coordinates with p + 1 rows: turned, which changes no
    length, so that a step's size does not depend on that of the data."""
    table = np.column_stack([now.jacobian / scales, now.residuals])
    rows = np.zeros((table.shape[1], table.shape[1]))
    turned = np.linalg.qr(table, mode="r")
    rows[: len(turned)] = turned
    return jnp.asarray(rows[:, -1]), jnp.asarray(rows[:, :-1])

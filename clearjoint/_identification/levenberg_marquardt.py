"""Levenberg-Marquardt search by optimistix, one step at a time.

A step is compiled once for each number of parameters, separately from the runs. In contrast to
`optimistix.LevenbergMarquardt`, coordinates are scaled by the column norms of the first Jacobian,
the damping decreases after a good, not only after an almost exact, prediction by the linear model,
no coordinate changes by more than the `max_step` of its scale in a step, and a step that increases
chi squared is never accepted.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from enum import Enum

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Float, PyTree
from typing_extensions import override

from .._compilation.xla import Compiled
from .._fields.objects import on_device
from .residuals import RunMisfit

PATIENCE = 15
"""Number of successive rejected steps, each with four times the damping, that end a search."""
SHORT = 1e-3
"""A search ends if every component of the next step, in scaled coordinates, whose unit is about a
standard deviation of an estimate, is smaller in magnitude than this fraction of the tolerance."""
NEARLY = 0.1
"""Gauss-Newton step, in standard deviations, below which a search that finds no better point counts
as converged, because integration errors prevent a higher accuracy."""
ROUGH, SLOW = 2.0, 5
"""A search also ends if the last `SLOW` iterations have together lowered chi squared by less than
`NEARLY` squared, at Gauss-Newton steps of less than `ROUGH` standard deviations. At a kink of chi
squared, as at the play of a light link at which a flank just touches or doesn't, a search would
otherwise go on until its limit of iterations, without a change of the estimates that matters."""
UNDETERMINED = 1e-12
"""The data don't determine a direction if its singular value of the Jacobian is below this multiple
of the largest one. If the norm of a column of the Jacobian is below this multiple of the largest
norm, its coordinate is scaled by the largest norm."""


class Ending(Enum):
    """Reason why a search ended; the value is a text.

    >>> cj.results.Ending.CONVERGED.value
    'converged'
    """

    CONVERGED = "converged"
    STALLED = "no step improves the fit: the misfit may be rough; fit growing windows first"
    EXHAUSTED = "the limit of iterations was reached"
    INTERRUPTED = "it was interrupted"
    FAILED = "the best run does not reach the last sample"


@dataclass(frozen=True)
class Iteration:
    """One run of a search, as passed to the function `progress` of `identify`.

    - `number`: number of the run in its search, from 0. Each growing window (argument `grow` of
      `identify`) is a search of its own, and so is each local search of the test of the covariance.
    - `accepted`: whether this run becomes the best so far, from which the search continues. Its chi
      squared must have decreased by at least 1 % of what the linear model predicts, or must not
      have increased if the model predicts no decrease; the first run is always accepted.
    - `chi_squared`: sum of the squared residuals of this run. In growing windows before the last,
      the residuals of a prior are included.
    - `coordinates`: (p,) values of the parameters in this run on their scales, such as logarithms.
    - `decrement`: length of the Gauss-Newton step from the best run so far, in standard deviations
      of the estimates.
    - `trust`: inverse of the Levenberg-Marquardt damping of the next step.

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


@dataclass(frozen=True)
class WindowSearch:
    """Result of a search that uses the samples up to `end_time`, s. `iterations` is empty if the
    user interrupted the first run."""

    end_time: float
    iterations: tuple[Iteration, ...]
    ending: Ending


@dataclass(frozen=True)
class Search:
    """Result of the search from one start.

    - `windows`: the successive searches in growing windows, the last in the whole record.
    - `best`: the run of the last accepted step or, after an interruption, a run over the whole
      record at the best coordinates.
    """

    start: Float[np.ndarray, " p"]
    windows: tuple[WindowSearch, ...]
    best: RunMisfit

    @property
    def ending(self) -> Ending:
        return self.windows[-1].ending

    @property
    def evaluations(self) -> int:
        """Number of iterations in all windows."""
        return sum(len(window.iterations) for window in self.windows)


def best_search(searches: Iterable[Search]) -> Search:
    """Return the search with the smallest chi squared; of equal ones, the first."""
    return min(searches, key=lambda search: search.best.chi_squared)


class _ClippedDescent(optx.DampedNewtonDescent):
    """Descent in which each component of a step is clipped to `limits`, (p,) scaled coordinates, so
    that a parameter that the data hardly determine doesn't run away while the other parameters are
    still far from their estimates."""

    limits: jax.Array = eqx.field(kw_only=True)

    @override
    def step(self, step_size: jax.Array, state: PyTree) -> tuple[jax.Array, optx.RESULTS]:
        step, result = super().step(step_size, state)
        return jnp.clip(step, -self.limits, self.limits), result


class _TrustRegion(optx.ClassicalTrustRegion):
    """Trust region that accepts no step that increases chi squared."""

    @override
    def predict_reduction(self, y_diff: jax.Array, f_info: PyTree) -> jax.Array:
        # Because a clipped step has another direction, the linear model may predict an increase for
        # it, and optimistix would then accept a step with up to 1 % of this increase.
        return jnp.minimum(super().predict_reduction(y_diff, f_info), 0.0)


def decrement(residuals: jax.Array, jacobian: jax.Array) -> jax.Array:
    """Return the length of the Gauss-Newton step in standard deviations of the estimates: the norm
    of the projection of the residuals on the space that the columns of the Jacobian span, without
    directions that the data don't determine."""
    axes, sizes, _ = jnp.linalg.svd(jacobian, full_matrices=False)
    return jnp.linalg.norm(jnp.where(sizes > UNDETERMINED * sizes[0], residuals @ axes, 0.0))


_Model = tuple[jax.Array, jax.Array, jax.Array]
"""Coordinates (p,), and residuals (M,) and Jacobian (M, p) at them."""


def _residuals(y: jax.Array, model: _Model) -> tuple[jax.Array, None]:
    """Return the linear model's residuals (M,) at `y`, and ``None`` for optimistix's `aux`."""
    at, residuals, jacobian = model
    return residuals + jacobian @ (y - at), None


@Compiled
def _advance(
    y: jax.Array, arrays: PyTree, model: _Model, limits: jax.Array, tolerance: jax.Array
) -> tuple[jax.Array, PyTree, jax.Array, jax.Array]:
    """Compute one step of the search, in scaled coordinates. `model`: linear model at the point
    evaluated last; `y`: best of the points before it; `arrays`: those of the solver's state, first
    ``None``; `limits`: largest changes in a step; `tolerance`: length of the Gauss-Newton step, in
    standard deviations (see `decrement`), below which the search ends.

    **Returns:** the best point, which may be the one evaluated last; the new arrays, of which
    `y_eval` is the next point to evaluate; whether the search ends; the best point's `decrement`.
    """
    # The damping decreases if chi squared has decreased by at least 0.7 times what the linear model
    # predicts. With optimistix' own cutoff of 0.99, it would decrease only after an almost exact
    # prediction.
    solver = eqx.tree_at(
        lambda solver: (solver.descent, solver.search),
        optx.LevenbergMarquardt(rtol=0.0, atol=0.0),
        (_ClippedDescent(limits=limits), _TrustRegion(high_cutoff=0.7)),
    )
    # optimistix needs the shape of the residuals, not their values, to make a state.
    residual_shape = jax.eval_shape(lambda: model[1])
    state = initial = solver.init(_residuals, y, model, {}, residual_shape, None, frozenset())
    # The state also contains functions, which cannot leave a compiled program. They are the same in
    # every state, so that only the arrays are passed from step to step.
    if arrays is not None:
        state = eqx.combine(arrays, eqx.filter(initial, eqx.is_array, inverse=True))
    y, state, _ = solver.step(_residuals, y, model, {}, state, frozenset())
    residuals, jacobian = state.f_info.residual, state.f_info.jac.as_matrix()
    # A coordinate that has run far towards infinity, such as the logarithm of a friction that is
    # zero, would always promise a step that is long in standard deviations, but no step that its
    # limit allows changes residuals or chi squared.
    changes = limits * jnp.linalg.norm(jacobian, axis=0)
    gains = 2.0 * limits * jnp.abs(residuals @ jacobian)
    is_idle = (changes < NEARLY) & (gains < NEARLY**2)
    length = decrement(residuals, jnp.where(is_idle, 0.0, jacobian))
    is_short = jnp.max(jnp.abs(state.y_eval - y)) < SHORT * tolerance
    is_stuck = state.num_steps_since_acceptance >= PATIENCE
    done = (length < tolerance) | is_short | is_stuck
    return y, eqx.filter(state, eqx.is_array), done, length


def search_with_damping(
    evaluate: Callable[[Float[np.ndarray, " p"]], RunMisfit],
    start: Float[np.ndarray, " p"],
    step_limits: Float[np.ndarray, " p"],
    tolerance: float,
    max_iterations: int,
    on_iteration: Callable[[Iteration], None],
) -> tuple[RunMisfit, tuple[Iteration, ...], Ending]:
    """Minimise the sum of squared residuals from a start, by the method of Levenberg and Marquardt.

    The search ends when the Gauss-Newton step is below `tolerance`, in standard deviations of the
    estimates. No coordinate changes by more than its entry of `step_limits` in a step. A
    `KeyboardInterrupt` ends the search; during the first evaluation it is not caught, because there
    is no result yet.

    **Returns:** the best evaluation, all iterations, and the reason why the search ended, which is
    never `Ending.FAILED`: the caller must check whether the best run reaches the last sample.
    """
    iterations: list[Iteration] = []
    lowest: list[float] = []
    best = latest = evaluate(start)
    try:
        # Each coordinate is scaled by the norm of its column of the Jacobian; that of a negligible
        # column is replaced by the largest norm, by which a division is safe.
        norms = np.linalg.norm(latest.jacobian, axis=0)
        largest = norms.max() if norms.max() > 0.0 else 1.0
        scales = np.where(norms > UNDETERMINED * largest, norms, largest)
        y, arrays = on_device(start * scales), None
        limits, end_at = on_device(step_limits * scales), on_device(tolerance)
        while True:
            # optimistix gets the linear model at the latest point, even if it rejects that point:
            # it reads the residuals there to decide. Its state, of which `arrays` are the arrays,
            # keeps the model of the best point.
            model = on_device(latest.coordinates * scales), *_triangular(latest, scales)
            y, arrays, done, length = _advance(y, arrays, model, limits, end_at)
            accepted = int(arrays.num_steps_since_acceptance) == 0
            best = latest if accepted else best
            # `length`, that of the Gauss-Newton step, is the iteration's `decrement`. The step size
            # of optimistix is the inverse of the damping.
            number, trust = len(iterations), float(arrays.search_state.step_size)
            iteration = Iteration(
                number, accepted, latest.chi_squared, latest.coordinates, float(length), trust
            )
            iterations.append(iteration)
            on_iteration(iteration)
            lowest.append(best.chi_squared)
            if bool(done) or _is_slow(iterations, lowest):
                # Rejected steps also end a search at a rough or imprecise chi squared, which is no
                # convergence.
                near = iteration.decrement < max(NEARLY, tolerance)
                return best, tuple(iterations), Ending.CONVERGED if near else Ending.STALLED
            if len(iterations) == max_iterations:
                return best, tuple(iterations), Ending.EXHAUSTED
            latest = evaluate(np.asarray(arrays.y_eval) / scales)
    except KeyboardInterrupt:
        return best, tuple(iterations), Ending.INTERRUPTED


def _is_slow(iterations: Sequence[Iteration], lowest: Sequence[float]) -> bool:
    """Return whether a search goes on without a change of the estimates that matters (see `SLOW`).
    `lowest` has the smallest chi squared so far after each iteration."""
    is_near = all(iteration.decrement < ROUGH for iteration in iterations[-SLOW:])
    return len(lowest) > SLOW and is_near and lowest[-1 - SLOW] - lowest[-1] < NEARLY**2


def _triangular(misfit: RunMisfit, scales: np.ndarray) -> tuple[jax.Array, jax.Array]:
    """Return p + 1 residuals and their Jacobian (p + 1, p), in scaled coordinates. Their linear
    model has the same sum of squares as that of the M residuals, so that one compiled program
    serves data of any size."""
    # A QR decomposition rotates the rows, which keeps the sum of squares. With fewer than p + 1
    # residuals, rows of zeros are added.
    table = np.column_stack([misfit.jacobian / scales, misfit.residuals])
    rows = np.zeros((table.shape[1], table.shape[1]))
    triangle = np.linalg.qr(table, mode="r")
    rows[: len(triangle)] = triangle
    return on_device(rows[:, -1]), on_device(rows[:, :-1])

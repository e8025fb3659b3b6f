"""Minimisation of a user's function of a motion's outputs, by the optimisers of optax."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Float, PyTree

from .._fields.checks import as_number, require, require_count
from .._fields.types import ArrayLike
from .._model.bodies import State
from .._model.scene import Scene
from .._native.lowering import LONGEST_PACKED
from .._parametrisation.parameter import AbstractScale, Parameter, coordinates_of
from .._parametrisation.parts import Part
from .._result_codes import RESULTS
from .._simulation.reductions.base import AbstractReduction
from .._simulation.results.solution import SimulationError
from .._simulation.run.predictor import Predictor, on_host, predictor
from .._simulation.step.settings import Settings
from ..quantities.base import Quantity
from .residuals import Experiment, experiment

if TYPE_CHECKING:
    import optax

Objective = Callable[[dict[str, jax.Array]], jax.Array]
"""Function that returns the number to minimise from the outputs by name: an array (N,) for each
quantity, and the result of each reduction."""
Coordinates = dict[str, PyTree]
"""Point of a search, by name: the coordinate of each `Parameter` on its scale, and the SI values
that each other `Part` selects, in the form of `Predictor.values`."""
HALVINGS = 12
"""Largest number of trials of a line search, each with half the step of the one before."""


@dataclass(frozen=True)
class Minimum:
    """Result of `minimise`: the parameters of the run with the smallest objective.

    - `estimates`: value of each parameter by name, SI: a number, or arrays in the form of
      `Predictor.values`.
    - `coordinates`: (p,) the same numbers in one array, those of `Parameter`s on their scales.
    - `objective`: smallest value of the objective.
    - `history`: (iterations,) objective before each iteration; shorter if the search ended early.
    - `result`: `RESULTS` code of the last run.

    >>> def lowest(outputs):
    ...     return outputs["x"][-1]
    >>> free = {"stiffness": stiffness}
    >>> cj.minimise(scene, state, lowest, free, {"x": x}, times, iterations=3).history.shape
    (3,)
    """

    estimates: dict[str, PyTree]
    coordinates: Float[np.ndarray, " p"]
    objective: float
    history: Float[np.ndarray, " iterations"]
    result: RESULTS


def minimise(
    scene: Scene,
    state: State,
    objective: Objective,
    parameters: Mapping[str, Part],
    outputs: Mapping[str, Quantity | AbstractReduction],
    times: ArrayLike | None = None,
    settings: Settings | None = None,
    *,
    optimiser: "optax.GradientTransformation | None" = None,
    iterations: int = 100,
    start_time: float = 0.0,
    end_time: float | None = None,
) -> Minimum:
    """Find parameters that minimise a function of a motion's outputs, by gradients.

    The gradients are exact derivatives of the motion: in forward mode, as by `sensitivities`, for
    up to 16 `Parameter`s, without reductions and `end_time`; otherwise in reverse mode, as by
    `predictor`. For sums of squares by few parameters use `identify`, which needs far fewer runs.

    **Arguments:**

    - `objective`: a finite, scalar function of the outputs by name that JAX can differentiate.
    - `parameters`: the free parameters by name, as in `predictor`. The search starts from the
      `value` of a `Parameter`, by default the number in the scene or its initial state.
    - `outputs`: functions of an `Instant` at each time, and reductions, by name, as in `predictor`.
    - `times`: (N,) times that do not decrease; only reductions need none.
    - `settings`: by default `clearjoint.presets.derivatives`.
    - `optimiser`: an optax optimiser of the parameters' coordinates on their scales. By default
      `optax.adam(0.05)` in forward mode, which changes each coordinate by about 0.05 in a step, and
      in reverse mode `optax.lbfgs` with a line search of at most 12 runs in an iteration.
    - `iterations`: largest number of iterations. The search ends earlier if a run fails, if its
      objective is not finite, or if an iteration leaves all parameters as they were.
    - `end_time`: s, by default the last of the times.

    **Raises:** `ValueError` for unsupported arguments, and if the first run fails or its objective
    is not finite.

    >>> def squares(outputs):
    ...     return jnp.sum((outputs["x"] - 0.1 * jnp.cos(12.0 * times)) ** 2)
    >>> minimum = cj.minimise(
    ...     scene, state, squares, {"stiffness": stiffness}, {"x": x}, times, iterations=60
    ... )
    >>> print(f"{minimum.estimates['stiffness']:.0f} N/m")  # 12^2
    144 N/m
    """
    import optax

    require_count("iterations", iterations, "allow one run")
    remedy = "pass the end of the run, s, or the times of quantities"
    known = end_time is not None or times is not None
    require(known, "end_time", None, "a time if there are no `times`", remedy)
    times = None if times is None else np.asarray(times, dtype=float)

    def scalar(outputs: dict[str, jax.Array]) -> jax.Array:
        value, remedy = as_number(objective(outputs), "objective"), "sum the terms, say"
        require(np.shape(value) == (), "objective", np.shape(value), "of shape ()", remedy)
        return jnp.asarray(value)

    # Forward mode serves quantities at `times`, whose last one is the end of the run. It has a
    # tangent for each parameter, of which `LONGEST_PACKED` are computed in one vector.
    scales = {n: p.scale for n, p in parameters.items() if isinstance(p, Parameter)}
    has_reductions = any(isinstance(output, AbstractReduction) for output in outputs.values())
    search: _Forward | _Reverse
    in_forward_mode = len(scales) == len(parameters) and not has_reductions and end_time is None
    if in_forward_mode and len(parameters) <= LONGEST_PACKED:
        runs = experiment(scene, state, parameters, outputs, times, start_time, settings)  # pyright: ignore
        at = coordinates_of(scene, state, parameters)  # pyright: ignore
        search = _Forward(runs, scalar, scales, times, at)  # pyright: ignore
        default = optax.adam(0.05)
    else:
        end = float(times[-1]) if end_time is None else end_time  # pyright: ignore
        arguments = parameters, outputs, times, settings
        made = predictor(scene, state, end, *arguments, start_time=start_time)
        search = _Reverse(made, scalar, scales)
        default = quasi_newton()
    return _descended(search, default if optimiser is None else optimiser, iterations)


def quasi_newton() -> "optax.GradientTransformationExtraArgs":
    """Return L-BFGS with a line search of at most `HALVINGS` runs in an iteration."""
    import optax

    # Each line search begins with the whole step, which has the length that the curvature suggests:
    # the factor of increase leads back to it even after the smallest fraction. By default, optax
    # begins with 1.5 times the fraction that the search before has taken, so that a first step that
    # was 1000 times too long shortened the next 17 steps.
    halving = optax.scale_by_backtracking_linesearch(
        HALVINGS, decrease_factor=0.5, increase_factor=2.0**HALVINGS
    )
    return optax.lbfgs(linesearch=halving)


def _descended(
    search: "_Forward | _Reverse", optimiser: "optax.GradientTransformation", iterations: int
) -> Minimum:
    import optax

    optimiser = optax.with_extra_args_support(optimiser)
    at = search.start()
    optimiser_state = optimiser.init(at)
    history: list[float] = []
    best, result = at, RESULTS.successful
    for _ in range(iterations):
        value, gradient, result = search.evaluated(at)
        if result != RESULTS.successful:
            break
        if not np.isfinite(value):
            # Later in a search, the best run so far is the result.
            expected = "finite in the first run"
            remedy = "start from other parameters, or change it"
            require(bool(history), "objective", float(value), expected, remedy)
            break
        history.append(float(value))
        best = at if float(value) <= min(history) else best
        # The line search of L-BFGS needs these arguments; other optimisers ignore them.
        further = {"value": value, "grad": gradient, "value_fn": search.value}
        # Python executes the loop of a line search. In a program of XLA, which has one thread
        # for each core, a run that needs XLA too would wait for ever on a machine with one core.
        with jax.disable_jit():
            step, optimiser_state = optimiser.update(gradient, optimiser_state, at, **further)
            moved: PyTree = optax.apply_updates(at, step)
        # Without a change, all further iterations would repeat this one.
        if np.array_equal(ravel_pytree(moved)[0], ravel_pytree(at)[0]):
            break
        at = moved
    # The history is empty only if the first run has failed.
    remedy = "start from parameters with which the scene runs to the last of the times"
    expected = "parameters for which the first run succeeds"
    require(bool(history), "parameters", RESULTS[result], expected, remedy)
    coordinates = np.asarray(ravel_pytree(best)[0])

    def as_float(value: PyTree) -> PyTree:
        return float(value) if isinstance(value, jax.Array) and value.ndim == 0 else value

    values = _values(search.scales, best)
    estimates = {name: as_float(value) for name, value in values.items()}
    return Minimum(estimates, coordinates, min(history), np.array(history), result)


@dataclass(frozen=True)
class _Forward:
    """Objective and gradient by runs in forward mode. `scales`: of all parameters, by name;
    `times`: at which outputs are sampled, s; `first`: coordinates, (p,), where a search starts."""

    runs: Experiment
    objective: Objective
    scales: dict[str, AbstractScale]
    times: np.ndarray
    first: np.ndarray

    @cached_property
    def gradient(self) -> Callable[..., tuple[jax.Array, dict[str, jax.Array]]]:
        return jax.jit(jax.value_and_grad(self.objective))

    def start(self) -> Coordinates:
        return dict(zip(self.scales, jnp.asarray(self.first), strict=True))

    def evaluated(self, at: Coordinates) -> tuple[float, Coordinates, RESULTS]:
        count, coordinates = len(self.times), jnp.stack([at[name] for name in self.scales])
        run = self.runs.run(coordinates, self.times[-1])
        # The times that pad `times` to the length of a compiled program are cut off.
        values = {name: row[:count] for name, row in run.values.items()}
        value, slopes = self.gradient(values)
        # Chain rule: the run gives the derivatives of the outputs by the coordinates, (N, p), and
        # JAX those of the objective by the outputs, (N,).
        along = sum(slopes[name] @ run.derivatives[name][:count] for name in values)
        slope = dict(zip(self.scales, jnp.asarray(along), strict=True))
        return float(value), slope, run.result

    def value(self, at: Coordinates) -> jax.Array:
        """Return the objective, or NaN if the run fails; a line search of optax calls this."""

        def of_run(at: Coordinates) -> np.ndarray:
            value, _, result = self.evaluated(at)
            return np.asarray(value if result == RESULTS.successful else np.nan, float)

        # `_descended` disables compilation for the loop of the line search, but not for runs.
        with jax.disable_jit(False):
            return on_host(of_run, jax.ShapeDtypeStruct((), float), at)


@dataclass(frozen=True)
class _Reverse:
    """Objective and gradient by runs in reverse mode, for any `Part`s. `scales` are those of the
    `Parameter`s among them, by name."""

    predictor: Predictor
    objective: Objective
    scales: dict[str, AbstractScale]

    def start(self) -> Coordinates:
        values = jax.tree.map(jnp.asarray, self.predictor.values)
        scales = self.scales.items()
        # A search moves coordinates of `Parameter`s, and values of other parts.
        return values | {n: jnp.asarray(scale.coordinate(values[n])) for n, scale in scales}

    def evaluated(self, at: Coordinates) -> tuple[float, Coordinates, RESULTS]:
        try:
            value, gradient = jax.value_and_grad(
                lambda at: self.objective(self.predictor(_values(self.scales, at)))
            )(at)
        except SimulationError as error:
            return np.nan, at, error.solution.result
        return value, gradient, RESULTS.successful  # pyright: ignore[reportReturnType]

    def value(self, at: Coordinates) -> jax.Array:
        """Return the objective, or NaN if the run fails; a line search of optax calls this."""
        with jax.disable_jit(False):
            return self.objective(self.predictor.or_nan(_values(self.scales, at)))


def _values(scales: Mapping[str, AbstractScale], at: Coordinates) -> Coordinates:
    return {**at, **{name: jnp.asarray(scale.value(at[name])) for name, scale in scales.items()}}

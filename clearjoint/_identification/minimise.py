"""Minimisation of a user's function of a motion's outputs, by the optimisers of optax."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from .._fields.checks import require, require_count
from .._fields.types import ArrayLike
from .._model.bodies import State
from .._model.scene import Scene
from .._parametrisation.parameter import Parameter, coordinates_of, values_at
from .._result_codes import RESULTS
from .._simulation.step.settings import Settings
from ..quantities.base import Quantity
from .residuals import experiment

if TYPE_CHECKING:
    import optax

Objective = Callable[[dict[str, jax.Array]], jax.Array]
"""Function that receives outputs by name, (N,) each, and returns the number to minimise, ()."""


@dataclass(frozen=True)
class Minimum:
    """Result of `minimise`: the parameters of the run with the smallest objective.

    - `estimates`: value of each parameter by name, SI.
    - `coordinates`: (p,) the same values on the parameters' scales.
    - `history`: (iterations,) objective of each run; shorter if a run failed or its objective was
      not finite, which ends the search.
    - `result`: `RESULTS` code of the last run.

    >>> def lowest(outputs):
    ...     return outputs["x"][-1]
    >>> free = {"stiffness": stiffness}
    >>> cj.minimise(scene, state, lowest, free, {"x": x}, times, iterations=3).history.shape
    (3,)
    """

    estimates: dict[str, float]
    coordinates: Float[np.ndarray, " p"]
    objective: float
    history: Float[np.ndarray, " iterations"]
    result: RESULTS


def minimise(
    scene: Scene,
    state: State,
    objective: Objective,
    parameters: Mapping[str, Parameter],
    outputs: Mapping[str, Quantity],
    times: ArrayLike,
    settings: Settings | None = None,
    *,
    optimiser: "optax.GradientTransformation | None" = None,
    iterations: int = 100,
    start_time: float = 0.0,
) -> Minimum:
    """Find parameters that minimise a function of a motion's outputs, by gradient descent.

    The gradient follows from runs with derivatives. For sums of squares use `identify`, which needs
    far fewer runs.

    **Arguments:**

    - `objective`: a function of the outputs by name, each (N,), that returns a finite number and
      that JAX can differentiate.
    - `parameters`: the free parameters by name; the search starts from the `value` of each
      parameter, by default the number in the scene or its initial state.
    - `outputs`: functions of an `Instant` by name, evaluated at `times`.
    - `times`: (N,) times that do not decrease. The run ends at the last of them.
    - `settings`: by default `clearjoint.presets.derivatives`.
    - `optimiser`: an optax optimiser of the parameters' coordinates on their scales; by default
      `optax.adam(0.05)`, which changes each coordinate by about 0.05 in a step.
    - `iterations`: number of runs. The search ends earlier if a run does not reach all times, or if
      its objective is not finite.

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
    optimiser = optax.adam(0.05) if optimiser is None else optimiser
    times = np.asarray(times, dtype=float)
    runs = experiment(scene, state, parameters, outputs, times, start_time, settings)
    gradient = jax.jit(jax.value_and_grad(objective))
    at = jnp.asarray(coordinates_of(scene, state, parameters))
    optimiser_state = optimiser.init(at)
    history: list[float] = []
    best, result = at, RESULTS.successful
    for _ in range(iterations):
        run = runs.run(at, times[-1])
        result = run.result
        if result != RESULTS.successful:
            break
        # The times that pad `times` to the length of a compiled program are cut off.
        values = {name: row[: len(times)] for name, row in run.values.items()}
        value, slopes = gradient(values)
        if not np.isfinite(value):
            expected, remedy = (
                "finite in the first run",
                "start from other parameters, or change it",
            )
            require(bool(history), "objective", float(value), expected, remedy)
            break
        history.append(float(value))
        best = at if float(value) <= min(history) else best
        # Chain rule: the run gives the derivatives of the outputs by the coordinates, and JAX those
        # of the objective by the outputs.
        along = sum(slopes[n] @ run.derivatives[n][: len(times)] for n in outputs)
        step, optimiser_state = optimiser.update(jnp.asarray(along), optimiser_state, at)
        at = jnp.asarray(optax.apply_updates(at, step))
    remedy = "start from parameters with which the scene runs to the last of the times"
    expected = "parameters for which the first run succeeds"
    require(bool(history), "parameters", RESULTS[result], expected, remedy)
    coordinates = np.asarray(best)
    estimates = values_at(parameters, coordinates)
    return Minimum(estimates, coordinates, min(history), np.array(history), result)

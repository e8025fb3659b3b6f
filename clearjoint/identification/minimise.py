"""Parameters that minimise any function of what is measured along a motion, by optax."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ..fields.checks import require, require_count
from ..fields.types import ArrayLike
from ..model.bodies import State
from ..model.scene import Scene
from ..parametrisation.parameter import Parameter, coordinates_of
from ..quantities.base import Quantity
from ..result_codes import RESULTS
from ..simulation.step.settings import Settings
from .residuals import experiment

if TYPE_CHECKING:
    import optax

Objective = Callable[[dict[str, jax.Array]], jax.Array]
"""From outputs by name, (N,) each, to the number to minimise."""


@dataclass(frozen=True)
class Minimum:
    """The parameters with the smallest objective of all runs.

    - `estimates`: their values by name; `coordinates`: (p,) on their scales.
    - `objective`: its value there; `history`: (iterations,) its values in all runs.
    - `result`: `RESULTS` code of the last run.

    >>> def lowest(outputs):
    ...     return outputs["x"][-1]
    >>> found = cj.minimise(
    ...     scene, state, lowest, {"stiffness": stiffness}, {"x": x}, times, iterations=3
    ... )
    >>> found.history.shape
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
    """Minimise an objective that is no sum of squares (for those, `identify` needs far fewer runs).

    **Arguments:**

    - `scene`, `state`, `settings`, `start_time` s: as in `identify`.
    - `objective`: a function of the outputs by name, each (N,), that JAX can differentiate.
    - `parameters`: what is free, by name; it starts from the scene's values.
    - `outputs`: functions of an `Instant` by name; `times`: (N,) s, rising, at which they are seen.
    - `optimiser`: of optax, for coordinates of the scales; `optax.adam(0.05)` unless given.
    - `iterations`: number of runs. It ends earlier at a run that does not reach all times.

    **Raises:** `ValueError` for arguments that no run can use, and if the first run fails.

    >>> def squares(outputs):
    ...     return jnp.sum((outputs["x"] - 0.1 * jnp.cos(12.0 * times)) ** 2)
    >>> found = cj.minimise(
    ...     scene, state, squares, {"stiffness": stiffness}, {"x": x}, times, iterations=60
    ... )
    >>> print(f"{found.estimates['stiffness']:.0f} N/m")  # 12^2
    144 N/m
    """
    import optax

    require_count("iterations", iterations, "allow one run")
    optimiser = optax.adam(0.05) if optimiser is None else optimiser
    times = np.asarray(times, dtype=float)
    runs = experiment(scene, state, parameters, outputs, times, start_time, settings)
    gradient = jax.jit(jax.value_and_grad(objective))
    at = jnp.asarray(coordinates_of(scene, state, parameters))
    entry_speeds = optimiser.init(at)
    history: list[float] = []
    best, result = at, RESULTS.successful
    for _ in range(iterations):
        run = runs.run(at, times[-1])
        result = run.result
        if result != RESULTS.successful:
            break
        values = {name: row[: len(times)] for name, row in run.values.items()}
        value, slopes = gradient(values)
        history.append(float(value))
        best = at if float(value) <= min(history) else best
        along = sum(slopes[n] @ run.derivatives[n][: len(times)] for n in outputs)
        step, entry_speeds = optimiser.update(jnp.asarray(along), entry_speeds, at)
        at = jnp.asarray(optax.apply_updates(at, step))
    remedy = "start from parameters with which the scene runs to the last of the times"
    require(bool(history), "parameters", RESULTS[result], "such that the first run works", remedy)
    coordinates = np.asarray(best)
    pairs = zip(parameters.items(), coordinates, strict=True)
    estimates = {name: float(parameter.scale.value(u)) for (name, parameter), u in pairs}
    return Minimum(estimates, coordinates, min(history), np.array(history), result)

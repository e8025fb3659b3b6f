"""What the searches of this study have in common: cost and check of a gradient, counts of runs."""

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import jax
import jax.numpy as jnp
import numpy as np
import optax

import clearjoint as cj
from clearjoint.extend import AbstractReduction, Quantity

Objective = Callable[[dict[str, jax.Array]], jax.Array]
REPEATS = 3
SETTINGS = replace(cj.presets.derivatives, max_steps=50_000)
"""With few steps, since a line search tries arrays with which a motion takes very many."""
TIGHT = replace(cj.presets.derivatives, rtol=1e-12)


@dataclass
class Counted:
    """An objective that counts the runs of which it was computed, each once."""

    objective: Objective
    values: set[float] = field(default_factory=set)

    def __call__(self, outputs: dict[str, jax.Array]) -> jax.Array:
        """Return the objective, and count the run."""
        value = self.objective(outputs)
        jax.debug.callback(lambda number: self.values.add(float(number)), value)
        return value

    @property
    def runs(self) -> int:
        """Return the number of runs so far: repeated ones, which a predictor keeps, don't count."""
        return len(self.values)


@dataclass(frozen=True)
class Search:
    """A search for a minimum and its gradients.

    - `history`: objective before each iteration; `runs`: number of runs; `seconds`: processor time
      with that of compilation, s.
    - `run`, `gradient`: processor time of a run without derivatives, and of the objective with its
      gradient, s.
    - `difference`: of entries of the first gradient from central differences, divided by the
      largest of these.
    """

    history: np.ndarray
    runs: int
    seconds: float
    run: float
    gradient: float
    difference: float


def search_table(searches: Mapping[str, Search]) -> list[tuple[str, ...]]:
    """Return the table of searches, by name, as text."""
    head = (
        "search", "objective, first; last", "iterations", "runs", "processor time, s", "run, s",
        "value and gradient, s", "gradient / run", "difference from central differences",
    )  # fmt: skip
    cells = [
        (
            name, f"{s.history[0]:.3g}; {s.history.min():.3g}", f"{len(s.history)}", f"{s.runs}",
            f"{s.seconds:.0f}", f"{s.run:.2g}", f"{s.gradient:.2g}", f"{s.gradient / s.run:.1f}",
            f"{s.difference:.0e}",
        )
        for name, s in searches.items()
    ]  # fmt: skip
    return [head, *cells]


@dataclass(frozen=True)
class Problem:
    """A motion of which an objective is minimised by the array that a path selects.

    `path` selects the array in the scene, `step` is the step of its central differences.
    """

    scene: cj.Scene
    state: cj.State
    path: Callable[[cj.Scene], object]
    outputs: dict[str, Quantity | AbstractReduction]
    times: np.ndarray
    objective: Objective
    step: float
    optimiser: optax.GradientTransformation | None = None

    def predictor(self, settings: cj.Settings = SETTINGS) -> cj.Predictor:
        """Return the outputs as a function of the array."""
        end, paths = float(self.times[-1]), {"array": self.path}
        return cj.predictor(self.scene, self.state, end, paths, self.outputs, self.times, settings)

    def searched(self, iterations: int, entries: Iterable[int]) -> tuple[np.ndarray, Search]:
        """Minimise, check some entries of the first gradient, and return the array of the minimum
        and the search."""
        counted, begun = Counted(self.objective), time.process_time()
        minimum = cj.minimise(
            self.scene, self.state, counted, {"array": self.path}, self.outputs, self.times,
            SETTINGS, optimiser=self.optimiser, iterations=iterations,
            end_time=float(self.times[-1]),
        )  # fmt: skip
        seconds = time.process_time() - begun
        costs, difference = self.cost(), self.difference(list(entries))
        search = Search(minimum.history, counted.runs, seconds, *costs, difference)
        return np.asarray(minimum.estimates["array"]), search

    def cost(self) -> tuple[float, float]:
        """Return the least processor time of a run without derivatives, and of the objective with
        its gradient, s."""
        predict, end = self.predictor(), float(self.times[-1])
        both = jax.value_and_grad(lambda values: self.objective(predict(values)))
        # Values that differ from those before, of which the predictor keeps the run.
        changes = iter(range(1, 1 + 2 * REPEATS))

        def gradient() -> None:
            change = next(changes) * self.step
            both(jax.tree.map(lambda array: array + change, predict.values))

        def run() -> None:
            cj.simulate(self.scene, self.state, end, cj.presets.derivatives, progress=False)

        return _least(run), _least(gradient)

    def difference(self, entries: Sequence[int]) -> float:
        """Return the largest difference of entries of the gradient from central differences of runs
        at a relative tolerance of 1e-12, divided by the largest entry."""
        predict, tight = self.predictor(), self.predictor(TIGHT)
        gradient = jax.grad(lambda values: self.objective(predict(values)))(predict.values)
        array, expected = jnp.asarray(predict.values["array"]), []
        for entry in entries:
            ends = (array.at[entry].add(sign * self.step) for sign in (1.0, -1.0))
            above, below = (float(self.objective(tight({"array": end}))) for end in ends)
            expected.append(0.5 * (above - below) / self.step)
        found = np.asarray(gradient["array"])[list(entries)]
        return float(np.abs(found - expected).max() / np.abs(expected).max())


def _least(function: Callable[[], None]) -> float:
    def once() -> float:
        begun = time.process_time()
        function()
        return time.process_time() - begun

    once()  # compiles
    return min(once() for _ in range(REPEATS))

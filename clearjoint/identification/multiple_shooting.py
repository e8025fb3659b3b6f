"""Multiple shooting: records too long for a single run.

Small errors of a guess grow from impact to impact, until the run meets other impacts than the data
tell of, and least squares lead astray. So the record is cut into windows, each short enough to be
followed, with starts of their own that are estimated too. What a window leads to and where the next
one starts may differ at first, and are then tied together ever more closely. H. G. Bock, *Recent
advances in parameter identification techniques for ODE* (1983).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..bodies import State
from ..estimands import Parameter, parametrised
from ..family import AbstractFamily
from ..fields import require
from ..integration import Integration
from ..measurements import Measurements
from ..reductions import Quantity
from ..results import RESULTS
from ..scene import Scene
from ..steps import Method
from .fit import Fit, Search, Window
from .levenberg_marquardt import Ending, search
from .residuals import Evaluated, Samples, samples
from .shooting_window import FreeStart, Shot, shot
from .starts import Guess, start_coordinates

CONTINUITY = (1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9)
"""Gaps between windows that count as one standard deviation, m, one after the other."""
RATE = 100.0
"""1/s: gaps in velocities that count as much, over those in positions."""
STRIDES = (1e-3, 1.0, 1.0)
"""The farthest that one iteration moves a window's start: m and rad, m/s and rad/s, and logarithms
of entry speeds."""
BEFORE_LAST = 0.1
"""Tolerance, in standard deviations, of what is not fitted for the last time."""


@dataclass(frozen=True)
class ShootingFit(Fit):
    """A fit by windows.

    - `boundaries`: (K,) s, where the windows meet.
    - `gaps`: (K, d) differences of the variables and entry speeds there, in m and rad, m/s and
      rad/s: what is left of them shows how far the pieces are one motion.
    """

    boundaries: np.ndarray
    gaps: np.ndarray


@dataclass(frozen=True)
class _Piece:
    """A window: its span, s, the times that are looked at, (T,), padded, and their samples."""

    start: float
    end: float
    times: jax.Array
    data: Samples
    count: int


@dataclass(frozen=True)
class _Evaluated:
    """Residuals and Jacobian of data and gaps, at the coordinates of all unknowns."""

    coordinates: np.ndarray
    residuals: np.ndarray
    jacobian: np.ndarray
    gaps: np.ndarray
    shots: list[Shot]


def identify_by_shots(
    scene: Scene,
    state: State,
    measurements: Measurements,
    parameters: Mapping[str, Parameter],
    boundaries: Sequence[float],
    *,
    start_time: float = 0.0,
    guess: Guess | None = None,
    continuity: Sequence[float] = CONTINUITY,
    integration: Integration | None = None,
    max_iterations: int = 50,
    tolerance: float = 1e-3,
) -> ShootingFit:
    """Estimate parameters and the states at the boundaries between windows.

    **Arguments:**

    - `scene`, `state`, `measurements`, `parameters`, `start_time`, `guess`, `integration`,
      `max_iterations`, `tolerance`: as in `identify`.
    - `boundaries`: rising times, s, inside the record, at which windows meet: shorter ones than the
      convergence horizon (see `horizon`), longer ones than it takes to see the state.
    - `continuity`: gaps in m that count as one standard deviation of a measurement, from loose to
      tight; those of velocities are a hundred times these in m/s.

    **Returns:** a `ShootingFit`; its covariance is that of the parameters with all starts estimated.

    **Raises:** `ValueError` for arguments that no fit can use.
    """
    problem = _Shooting(
        scene, state, measurements, parameters, boundaries, start_time, integration
    )
    row = start_coordinates(scene, state, parameters, guess, None)[0]
    at, strides = problem.begun(row), problem.strides()
    windows, best = [], None
    for stage, size in enumerate(continuity):
        last = stage == len(continuity) - 1
        iterations, ending = [], Ending.EXHAUSTED
        for iteration, best, ended in search(
            lambda at, size=size: problem.evaluate(at, size),
            at,
            strides,
            tolerance if last else BEFORE_LAST,
            max_iterations,
        ):
            iterations.append(iteration)
            ending = ended or ending
        assert best is not None
        at = best.coordinates
        windows.append(Window(float(problem.pieces[-1].end), tuple(iterations), ending))
    assert best is not None
    found = problem.condensed(best)
    whole = Search(row, tuple(windows), found)
    units = {n: p.variation.unit_in(scene, state) for n, p in parameters.items()}
    made = problem.base.made(found.coordinates)
    return ShootingFit(
        *made,
        dict(parameters),
        units,
        measurements,
        (whole,),
        whole,
        np.asarray(boundaries, float),
        best.gaps,
    )


class _Shooting:
    """The windows, and their residuals as functions of all unknowns in one row: the parameters',
    then those of each window's start but the first's."""

    def __init__(
        self,
        scene: Scene,
        state: State,
        measurements: Measurements,
        parameters: Mapping[str, Parameter],
        boundaries: Sequence[float],
        start_time: float,
        integration: Integration | None,
    ):
        integration = Integration() if integration is None else integration
        self.method: Method = integration.method(scene, state, start_time)
        self.base = parametrised(scene, state, parameters, np.zeros(len(parameters)))
        self.scales = [parameter.scale for parameter in parameters.values()]
        self.outputs: dict[str, Quantity] = {
            name: series.channel for name, series in measurements.series.items()
        }
        self.max_steps = integration.max_steps
        self.pieces = _pieces(measurements, boundaries, start_time)
        self.parameters = len(parameters)
        self._nominal: list[tuple[Any, Any]] = []

    def begun(self, row: np.ndarray) -> np.ndarray:
        """All unknowns where the windows of a guess (p,) follow each other without gaps, which
        becomes what later starts are counted from."""
        self._nominal = []
        for k in range(len(self.pieces) - 1):
            found = self._shot(k, np.concatenate([row, np.zeros(self._free(k))]))
            self._nominal.append(found.reached)
        return np.concatenate([row, *(np.zeros(self._free(k + 1)) for k in range(len(self._nominal)))])

    def _free(self, k: int) -> int:
        """Number of unknowns of a window's start."""
        if k == 0:
            return 0
        variables, memory = self._nominal[k - 1]
        return 2 * self._speeds(variables) + len(jax.tree.leaves(memory))

    def _speeds(self, variables: Any) -> int:
        coordinates = self.method.formulation.coordinates
        scene = self.base.scene(np.zeros(self.parameters))
        return len(coordinates.mechanics(scene, variables).projected({}))

    def _shot(self, k: int, values: np.ndarray) -> Shot:
        piece = self.pieces[k]
        family: AbstractFamily
        if k == 0:
            family = _looking_at(self.base, values)
        else:
            variables, memory = self._nominal[k - 1]
            family = FreeStart(
                jnp.asarray(values),
                self.base,
                self.method.formulation.coordinates,
                variables,
                memory,
            )
        span = piece.end - piece.start
        numbers = (jnp.asarray(x, float) for x in (piece.start, piece.end, 1e-6 * span))
        limit = jnp.asarray(self.max_steps)
        return shot(self.method, family, self.outputs, piece.times, *numbers, limit)

    def strides(self) -> np.ndarray:
        """The farthest that one iteration changes each unknown."""
        parts = [np.array([scale.stride for scale in self.scales])]
        for variables, memory in self._nominal:
            count = self._speeds(variables)
            entries = len(jax.tree.leaves(memory))
            parts += [np.full(c, s) for c, s in zip((count, count, entries), STRIDES, strict=True)]
        return np.concatenate(parts)

    def evaluate(self, at: np.ndarray, size: float) -> _Evaluated:
        """Run all windows; gaps of `size` m count as one standard deviation."""
        shots, places = [], self._places()
        for k, place in enumerate(places):
            shots.append(jax.device_get(self._shot(k, at[place])))
        rows = [self._of_data(k, shots[k], places[k], len(at)) for k in range(len(shots))]
        gaps = []
        for k in range(len(shots) - 1):
            value, along = self._of_gap(k, shots, places, len(at))
            gaps.append(value)
            weights = self._weights(shots[k + 1]) / size
            rows.append((weights * value, weights[:, None] * along))
        residuals, jacobian = (np.concatenate(part) for part in zip(*rows, strict=True))
        return _Evaluated(np.array(at), residuals, jacobian, np.array(gaps), shots)

    def _places(self) -> list[np.ndarray]:
        """Which unknowns are each window's."""
        own, first = np.arange(self.parameters), self.parameters
        places = [own]
        for k in range(1, len(self.pieces)):
            count = self._free(k)
            places.append(np.concatenate([own, np.arange(first, first + count)]))
            first += count
        return places

    def _of_data(
        self, k: int, found: Shot, place: np.ndarray, unknowns: int
    ) -> tuple[np.ndarray, np.ndarray]:
        data, names = self.pieces[k].data, list(self.outputs)
        fine = found.sampled.reached
        values = np.stack([np.where(fine, found.sampled.values[n], np.nan) for n in names])
        along = np.stack([found.sampled.derivatives[name] for name in names])
        along = np.where(fine[:, None], along, 0.0) * data.weights[..., None]
        jacobian = np.zeros((values.size, unknowns))
        jacobian[:, place] = along.reshape(values.size, -1)
        used = (data.weights > 0.0).ravel()
        return np.asarray(data.residuals(values)).ravel()[used], jacobian[used]

    def _of_gap(
        self, k: int, shots: list[Shot], places: list[np.ndarray], unknowns: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """Where a window leads less where the next one starts, and derivatives."""
        before, after = shots[k], shots[k + 1]
        along = np.zeros((len(before.end), unknowns))
        along[:, places[k]] += before.end_along
        along[:, places[k + 1]] -= after.start_along
        return before.end - after.start, along

    def _weights(self, found: Shot) -> np.ndarray:
        """One, or for what changes when the start is kicked, the part that a velocity counts."""
        entries = len(jax.tree.leaves(found.reached[1]))
        speeds = (found.start_along.shape[1] - self.parameters - entries) // 2
        kicks = found.start_along[:, self.parameters + speeds :]
        return np.where(np.abs(kicks).max(axis=1) > 0.0, 1.0 / RATE, 1.0)

    def condensed(self, best: _Evaluated) -> Evaluated:
        """What is left for the parameters (p,) once all starts are at their best."""
        parts = best.jacobian[:, : self.parameters], best.jacobian[:, self.parameters :]
        axes, sizes, _ = np.linalg.svd(parts[1] / _norms(parts[1]), full_matrices=False)
        axes = axes[:, sizes > 1e-12 * sizes[0]]
        residuals, jacobian = (part - axes @ (axes.T @ part) for part in (best.residuals, parts[0]))
        names = list(self.outputs)
        predicted = [
            np.stack([found.sampled.values[name][: piece.count] for name in names])
            for found, piece in zip(best.shots, self.pieces, strict=True)
        ]
        worst = max(best.shots, key=lambda found: found.sampled.result != RESULTS.successful)
        return Evaluated(
            best.coordinates[: self.parameters],
            residuals,
            jacobian,
            np.concatenate(predicted, axis=1),
            worst.sampled.result,
            float(best.shots[-1].sampled.time),
            sum(int(found.sampled.attempts) for found in best.shots),
        )


def _norms(jacobian: np.ndarray) -> np.ndarray:
    norms = np.linalg.norm(jacobian, axis=0)
    return np.where(norms > 0.0, norms, 1.0)


def _looking_at(base: Any, values: np.ndarray) -> Any:
    return type(base)(jnp.asarray(values), base.base, base.changes, base.scales, base.patterns)


def _pieces(
    measurements: Measurements, boundaries: Sequence[float], start_time: float
) -> list[_Piece]:
    """The windows, with equally many padded times."""
    times = measurements.times()
    cuts = np.array([start_time, *boundaries, times[-1]], float)
    require(
        len(boundaries) > 0 and bool((np.diff(cuts) > 0.0).all()),
        "boundaries",
        np.asarray(boundaries),
        f"rising times between {start_time} and {float(times[-1])}",
        "take identify() for a single run, or cut the record inside",
    )
    whole = samples(measurements, len(times))
    inside = [(times >= a) & (times < b) for a, b in zip(cuts[:-1], cuts[1:], strict=True)]
    inside[-1] |= times == times[-1]
    longest = max(int(mask.sum()) for mask in inside) + 1
    pieces = []
    for k, mask in enumerate(inside):
        count = int(mask.sum())
        padded = np.full(longest, cuts[k + 1])
        padded[:count] = times[mask]
        values, weights = (np.zeros((len(whole.periods), longest)) for _ in range(2))
        values[:, :count], weights[:, :count] = whole.values[:, mask], whole.weights[:, mask]
        data = Samples(values, weights, whole.periods)
        pieces.append(_Piece(cuts[k], cuts[k + 1], jnp.asarray(padded), data, count))
    return pieces

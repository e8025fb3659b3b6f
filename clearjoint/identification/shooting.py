"""The unknowns, residuals and gaps of multiple shooting."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..bodies import State
from ..estimands import Parameter, parametrised
from ..family import AbstractFamily
from ..integration import Integration
from ..measurements import Measurements
from ..quantities.joints import Penetration
from ..reductions import Quantity
from ..results import RESULTS
from ..scene import Scene
from ..steps import Method
from .levenberg_marquardt import SINGULAR, Iteration, search
from .record import Piece, Record
from .residuals import Evaluated
from .shooting_window import FreeStart, Shot, shot

RATE = 100.0
"""1/s: gaps in velocities that count as much, over those in positions."""
STRIDES = (1e-3, 1.0, 1.0)
"""The farthest that one iteration moves a window's start: m and rad, m/s and rad/s, and logarithms
of entry speeds."""
TIGHTER = 10.0**0.5
"""By how much less a gap between windows may be, from one round of the search to the next."""
BEFORE_LAST = 0.1
"""Tolerance, in standard deviations, of what is not fitted for the last time."""
FOLLOWING = 20
"""Iterations, at most, that bring a window's start to the data."""


@dataclass(frozen=True)
class AllEvaluated:
    """Residuals and Jacobian of data and gaps, at the coordinates of all unknowns."""

    coordinates: np.ndarray
    residuals: np.ndarray
    jacobian: np.ndarray
    gaps: np.ndarray
    shots: list[Shot]


class Shooting:
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
        self.watched: dict[str, Quantity] = {
            f"{joint} {contact}": Penetration(joint, contact)
            for joint, family in scene.laws().items()
            for contact in family
        }
        self._record = Record(measurements, boundaries, start_time)
        self.pieces: list[Piece] = []
        self.parameters = len(parameters)
        self.samples = self._record.data.count
        self._nominal: list[tuple[Any, Any]] = []

    def sizes(self, at: np.ndarray, smallest: float) -> list[float]:
        """Gaps that count as one standard deviation, m: from those there are to the smallest."""
        found = self.evaluate(at, 1.0)
        weighted = found.gaps * [self._weights(after) for after in found.shots[1:]]
        size, sizes = float(np.sqrt(np.mean(weighted**2))), []
        while size > smallest:
            sizes.append(size)
            size /= TIGHTER
        return [*sizes, smallest]

    def followed(self, row: np.ndarray) -> np.ndarray:
        """All unknowns where each window, at the parameters of a guess (p,), follows the data from
        about where the one before leads."""
        cuts = self._record.cuts
        self._nominal, self.pieces = [], [self._record.piece(cuts[0], cuts[1])]
        unknowns, found = [row], self._alone(0, row)
        for k, end in enumerate(cuts[2:], 1):
            boundary = self._in_flight(k - 1, found.shots[0])
            self.pieces[-1] = self._record.piece(self.pieces[-1].start, boundary)
            own = unknowns[-1] if k > 1 else np.zeros(0)
            before = self._alone(k - 1, np.concatenate([row, own])).shots[0]
            self._nominal.append(before.reached)
            self.pieces.append(self._record.piece(boundary, end))
            free = self._free(k)
            strides = self.strides()[-free:]
            found, _, _ = search(
                partial(self._held, k, row, strides),
                np.zeros(free),
                strides,
                BEFORE_LAST,
                FOLLOWING,
                _say_nothing,
            )
            unknowns.append(found.coordinates)
        return np.concatenate(unknowns)

    def _in_flight(self, k: int, found: Shot) -> float:
        """The sample in the later half of a window at which all contacts are farthest open."""
        piece = self.pieces[k]
        if not self.watched:
            return piece.end
        deepest = np.max([found.sampled.values[name] for name in self.watched], axis=0)
        times = np.asarray(piece.times)
        later = (times > 0.5 * (piece.start + piece.end)) & (times < piece.end)
        fine = later & found.sampled.reached
        return float(times[np.argmin(np.where(fine, deepest, np.inf))]) if fine.any() else piece.end

    def _alone(self, k: int, values: np.ndarray) -> AllEvaluated:
        """One window's data, at all of its unknowns."""
        found = jax.device_get(self._shot(k, values))
        residuals, jacobian = self._of_data(k, found, np.arange(len(values)), len(values))
        return AllEvaluated(values, residuals, jacobian, np.zeros((0, 0)), [found])

    def _held(self, k: int, row: np.ndarray, sizes: np.ndarray, at: np.ndarray) -> AllEvaluated:
        """One window's data at its start's unknowns, which are held near zero to within `sizes`."""
        found = self._alone(k, np.concatenate([row, at]))
        return AllEvaluated(
            at,
            np.concatenate([found.residuals, at / sizes]),
            np.concatenate([found.jacobian[:, self.parameters :], np.diag(1.0 / sizes)]),
            found.gaps,
            found.shots,
        )

    def of_parameters(self, one: Iteration) -> Iteration:
        """The iteration without the starts' unknowns."""
        return replace(one, coordinates=one.coordinates[: self.parameters])

    def _free(self, k: int) -> int:
        """Number of unknowns of a window's start."""
        if k == 0:
            return 0
        _, memory = self._nominal[k - 1]
        return 2 * self._speeds + len(jax.tree.leaves(memory))

    @cached_property
    def _speeds(self) -> int:
        """Number of speeds of the system."""
        coordinates = self.method.formulation.coordinates
        scene, (variables, _) = self.base.scene(np.zeros(self.parameters)), self._nominal[0]
        return len(coordinates.mechanics(scene, variables).projected({}))

    def _shot(self, k: int, values: np.ndarray) -> Shot:
        piece = self.pieces[k]
        family: AbstractFamily
        if k == 0:
            family = self.base.at(values)
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
        outputs = self.outputs | self.watched
        return shot(self.method, family, outputs, piece.times, *numbers, limit)

    def strides(self) -> np.ndarray:
        """The farthest that one iteration changes each unknown."""
        parts = [np.array([scale.stride for scale in self.scales])]
        count = self._speeds
        for _, memory in self._nominal:
            entries = len(jax.tree.leaves(memory))
            parts += [np.full(c, s) for c, s in zip((count, count, entries), STRIDES, strict=True)]
        return np.concatenate(parts)

    def evaluate(self, at: np.ndarray, size: float) -> AllEvaluated:
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
        return AllEvaluated(np.array(at), residuals, jacobian, np.array(gaps), shots)

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
        return np.asarray(before.end - after.start), along

    def _weights(self, found: Shot) -> np.ndarray:
        """One, or for what changes when the start is kicked, the part that a velocity counts."""
        kicks = found.start_along[:, self.parameters + self._speeds :]
        return np.where(np.abs(kicks).max(axis=1) > 0.0, 1.0 / RATE, 1.0)

    def condensed(self, best: AllEvaluated) -> Evaluated:
        """What is left for the parameters (p,) once all starts are at their best."""
        parts = best.jacobian[:, : self.parameters], best.jacobian[:, self.parameters :]
        axes, sizes, _ = np.linalg.svd(parts[1] / _norms(parts[1]), full_matrices=False)
        axes = axes[:, sizes > SINGULAR * sizes[0]]
        residuals = best.residuals - axes @ (axes.T @ best.residuals)
        jacobian = parts[0] - axes @ (axes.T @ parts[0])
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


def _say_nothing(iteration: Iteration) -> None:
    del iteration


def _norms(jacobian: np.ndarray) -> np.ndarray:
    norms = np.linalg.norm(jacobian, axis=0)
    return np.where(norms > 0.0, norms, 1.0)

"""The unknowns, residuals and gaps of multiple shooting."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ...measurements.series import Measurements
from ...model.bodies import State
from ...model.scene import Scene
from ...parametrisation.parameter import Parameter, check_parameters
from ...parametrisation.parametrised_scene import AbstractFamily, parametrised
from ...quantities.joints import Penetration
from ...results import RESULTS
from ...simulation.batch.reductions import Quantity
from ...simulation.method import Scheme
from ...simulation.run_ends import default_first_step
from ...simulation.settings import Integration
from ..levenberg_marquardt import SINGULAR, Iteration
from ..residuals import Evaluated
from .record import Piece, Record
from .window import FreeStart, Shot, shot

RATE = 100.0
"""1/s: gaps in velocities that count as much, over those in positions."""


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
        check_parameters(parameters)
        integration = Integration() if integration is None else integration
        self.scheme: Scheme = integration.scheme(scene, state, start_time)
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
        self._nominal: list[tuple[Any, Any]] = []
        self._speeds = self._free = 0

    @property
    def ends(self) -> np.ndarray:
        """Times, s, that the last window reaches for, one after the other."""
        return self._record.cuts[1:]

    @property
    def reached(self) -> tuple[float, float]:
        """Where the last window begins and, so far, ends, s."""
        return self.pieces[-1].start, self.pieces[-1].end

    @property
    def count(self) -> int:
        """Number of samples in all windows."""
        return sum(piece.data.count for piece in self.pieces)

    def begin(self, row: np.ndarray) -> np.ndarray:
        """All unknowns, those of the parameters (p,) given: the first window is there."""
        start, end = self._record.cuts[:2]
        self._nominal, self.pieces = [], [self._record.piece(start, end)]
        variables, memory = jax.device_get(self._shot(0, row)).reached
        mechanics = self.scheme.formulation.coordinates.mechanics(self.base.scene(row), variables)
        self._speeds = len(mechanics.projected({}))
        self._free = 2 * self._speeds + len(jax.tree.leaves(memory))
        return np.concatenate([row, np.zeros(self._free * (len(self.ends) - 1))])

    def extend(self, end: float) -> None:
        """The last window reaches for a later end, s."""
        self.pieces[-1] = self._record.piece(self.pieces[-1].start, end)

    def add(self, best: AllEvaluated) -> None:
        """A further window, as yet without samples, that begins in flight where the one before
        leads."""
        boundary, k = self._in_flight(best.shots[-1]), len(self.pieces) - 1
        self.extend(boundary)
        led = jax.device_get(self._shot(k, best.coordinates[self._places()[k]]))
        self._nominal.append(led.reached)
        self.pieces.append(self._record.piece(boundary, boundary))

    def _in_flight(self, found: Shot) -> float:
        """The sample in the later half of the last window at which all contacts are farthest
        open."""
        piece = self.pieces[-1]
        if not self.watched:
            return piece.end
        deepest = np.max([found.sampled.values[name] for name in self.watched], axis=0)
        times = np.asarray(piece.times)
        later = (times > 0.5 * (piece.start + piece.end)) & (times < piece.end)
        fine = later & found.sampled.reached
        return float(times[np.argmin(np.where(fine, deepest, np.inf))]) if fine.any() else piece.end

    def of_parameters(self, one: Iteration) -> Iteration:
        """The iteration without the starts' unknowns."""
        return replace(one, coordinates=one.coordinates[: self.parameters])

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
                self.scheme.formulation.coordinates,
                variables,
                memory,
            )
        first_step = default_first_step(piece.start, piece.end)
        numbers = (jnp.asarray(x, float) for x in (piece.start, piece.end, first_step))
        limit = jnp.asarray(self.max_steps)
        outputs = self.outputs | self.watched
        return shot(self.scheme, family, outputs, piece.times, *numbers, limit)

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
        own, count = np.arange(self.parameters), self._free
        firsts = self.parameters + count * np.arange(len(self.pieces) - 1)
        return [own, *(np.concatenate([own, first + np.arange(count)]) for first in firsts)]

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


def _norms(jacobian: np.ndarray) -> np.ndarray:
    norms = np.linalg.norm(jacobian, axis=0)
    return np.where(norms > 0.0, norms, 1.0)

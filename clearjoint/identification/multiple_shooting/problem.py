"""The least-squares problem of multiple shooting: its unknowns, residuals and gaps."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import jax
import numpy as np
from jaxtyping import Float, PyTree

from ...dynamics.contact_forces import Memory
from ...fields.conversion import on_device
from ...measurements.series import Measurements
from ...model.bodies import State
from ...model.scene import Scene
from ...parametrisation.parameter import Parameter, check_parameters
from ...parametrisation.parametrised_scene import AbstractFamily, parametrised
from ...quantities.base import Quantity
from ...quantities.joints import Penetration
from ...results import RESULTS
from ...simulation import presets
from ...simulation.derivative_runs import derivative_scheme
from ...simulation.method import Scheme
from ...simulation.settings import Settings, settings_or
from ..levenberg_marquardt import SINGULAR, Iteration
from ..residuals import RunMisfit
from .record import DividedRecord, Piece
from .window import FreeStart, WindowRun, run_window

RATE = 100.0
"""Gap in a velocity over the gap in a position that counts as much, 1/s."""


@dataclass(frozen=True)
class WindowsMisfit:
    """Residuals of the samples and of the gaps, and their Jacobian, from one run of each window.

    - `coordinates`: all unknowns, those of the parameters and of the windows' starts.
    - `residuals`: in standard deviations; `jacobian`: their derivatives along the unknowns.
    - `gaps`: (K, d) differences between the end of each window and the start of the next.
    - `runs`: of the windows.
    """

    coordinates: Float[np.ndarray, " P"]
    residuals: Float[np.ndarray, " M"]
    jacobian: Float[np.ndarray, "M P"]
    gaps: Float[np.ndarray, "K d"]
    runs: list[WindowRun]


class Shooting:
    """The windows so far, and their residuals as functions of all unknowns.

    The unknowns are in one row (P,): the coordinates of the parameters, then those of the start of
    each window but the first, whose start is the initial state.
    """

    def __init__(
        self,
        scene: Scene,
        state: State,
        measurements: Measurements,
        parameters: Mapping[str, Parameter],
        boundaries: Sequence[float],
        start_time: float,
        settings: Settings | None,
    ):
        check_parameters(parameters)
        self.settings = settings_or(settings, presets.identification)
        self.scheme: Scheme = derivative_scheme(scene, state, self.settings, start_time)
        self.base = parametrised(scene, state, parameters, np.zeros(len(parameters)))
        self.scales = [parameter.scale for parameter in parameters.values()]
        self.outputs: dict[str, Quantity] = {
            name: series.channel for name, series in measurements.series.items()
        }
        self.watched: dict[str, Quantity] = {
            f"{joint} {contact}": Penetration(joint, contact)
            for joint, laws in scene.laws().items()
            for contact in laws
        }
        self._record = DividedRecord(measurements, boundaries, start_time)
        self.pieces: list[Piece] = []
        self.parameters = len(parameters)
        self._nominal: list[tuple[PyTree, Memory]] = []
        self._speeds = self._free = 0

    @property
    def ends(self) -> np.ndarray:
        """The ends of all windows as the user cut them, s: the last window is extended to each in
        turn."""
        return self._record.cuts[1:]

    @property
    def last_span(self) -> tuple[float, float]:
        """Start and present end of the last window, s."""
        return self.pieces[-1].start, self.pieces[-1].end

    @property
    def count(self) -> int:
        """Number of samples in all windows."""
        return sum(piece.data.count for piece in self.pieces)

    def begin(self, row: np.ndarray) -> np.ndarray:
        """Make the first window; the unknowns (P,) of all windows, from those of the parameters
        (p,)."""
        start, end = self._record.cuts[:2]
        self._nominal, self.pieces = [], [self._record.piece(start, end)]
        variables, memory = jax.device_get(self._run(0, row)).final
        mechanics = self.scheme.formulation.coordinates.mechanics(self.base.scene(row), variables)
        self._speeds = len(mechanics.projected({}))
        self._free = 2 * self._speeds + len(jax.tree.leaves(memory))
        return np.concatenate([row, np.zeros(self._free * (len(self.ends) - 1))])

    def extend(self, end: float) -> None:
        """Move the end of the last window to a later time, s."""
        self.pieces[-1] = self._record.piece(self.pieces[-1].start, end)

    def add(self, best: WindowsMisfit) -> None:
        """Begin a further window, still without samples, at an instant in flight near the end of
        the last one, from the state that its best run has there."""
        boundary, k = self._in_flight(best.runs[-1]), len(self.pieces) - 1
        self.extend(boundary)
        run = jax.device_get(self._run(k, best.coordinates[self._places()[k]]))
        self._nominal.append(run.final)
        self.pieces.append(self._record.piece(boundary, boundary))

    def _in_flight(self, run: WindowRun) -> float:
        """The sample in the later half of the last window at which all contacts are farthest
        open, s."""
        piece = self.pieces[-1]
        if not self.watched:
            return piece.end
        deepest = np.max([run.sampled.values[name] for name in self.watched], axis=0)
        times = np.asarray(piece.times)
        later = (times > 0.5 * (piece.start + piece.end)) & (times < piece.end)
        fine = later & run.sampled.reached
        return float(times[np.argmin(np.where(fine, deepest, np.inf))]) if fine.any() else piece.end

    def without_starts(self, one: Iteration) -> Iteration:
        """An iteration with the coordinates of the parameters alone."""
        return replace(one, coordinates=one.coordinates[: self.parameters])

    def _run(self, k: int, values: np.ndarray) -> WindowRun:
        """The run of window k at the values of its unknowns."""
        piece = self.pieces[k]
        family: AbstractFamily
        if k == 0:
            family = self.base.at(values)
        else:
            variables, memory = self._nominal[k - 1]
            family = FreeStart(
                on_device(values),
                self.base,
                self.scheme.formulation.coordinates,
                variables,
                memory,
            )
        first_step = self.settings.length_of_first_step(piece.start, piece.end)
        start, end, step = (on_device(x) for x in (piece.start, piece.end, first_step))
        limit = on_device(self.settings.max_steps, int)
        outputs = self.outputs | self.watched
        return run_window(self.scheme, family, outputs, piece.times, start, end, step, limit)

    def misfit(self, at: np.ndarray, size: float) -> WindowsMisfit:
        """Run all windows at unknowns (P,); gaps of `size` m count as one standard deviation."""
        runs, places = [], self._places()
        for k, place in enumerate(places):
            runs.append(jax.device_get(self._run(k, at[place])))
        rows = [self._of_data(k, runs[k], places[k], len(at)) for k in range(len(runs))]
        gaps = []
        for k in range(len(runs) - 1):
            value, along = self._of_gap(k, runs, places, len(at))
            gaps.append(value)
            weights = self._weights(runs[k + 1]) / size
            rows.append((weights * value, weights[:, None] * along))
        residuals, jacobian = (np.concatenate(part) for part in zip(*rows, strict=True))
        rows_of_gaps = np.reshape(gaps, (len(gaps), len(runs[0].end)))
        return WindowsMisfit(np.array(at), residuals, jacobian, rows_of_gaps, runs)

    def _places(self) -> list[np.ndarray]:
        """For each window the indices of its unknowns among all."""
        own, count = np.arange(self.parameters), self._free
        firsts = self.parameters + count * np.arange(len(self.pieces) - 1)
        return [own, *(np.concatenate([own, first + np.arange(count)]) for first in firsts)]

    def _of_data(
        self, k: int, run: WindowRun, place: np.ndarray, unknowns: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """Residuals of a window's samples, and their derivatives along all unknowns."""
        data, names = self.pieces[k].data, list(self.outputs)
        fine = run.sampled.reached
        values = np.stack([np.where(fine, run.sampled.values[n], np.nan) for n in names])
        along = np.stack([run.sampled.derivatives[name] for name in names])
        along = np.where(fine[:, None], along, 0.0) * data.weights[..., None]
        jacobian = np.zeros((values.size, unknowns))
        jacobian[:, place] = along.reshape(values.size, -1)
        used = (data.weights > 0.0).ravel()
        return np.asarray(data.residuals(values)).ravel()[used], jacobian[used]

    def _of_gap(
        self, k: int, runs: list[WindowRun], places: list[np.ndarray], unknowns: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """The end of window k less the start of the next, and its derivatives along all
        unknowns."""
        before, after = runs[k], runs[k + 1]
        along = np.zeros((len(before.end), unknowns))
        along[:, places[k]] += before.end_along
        along[:, places[k + 1]] -= after.start_along
        return np.asarray(before.end - after.start), along

    def _weights(self, run: WindowRun) -> np.ndarray:
        """Weights (d,) of a gap's components: one for positions, and less for velocities and entry
        speeds, which are those that change with the speeds of the start."""
        kicks = run.start_along[:, self.parameters + self._speeds :]
        return np.where(np.abs(kicks).max(axis=1) > 0.0, 1.0 / RATE, 1.0)

    def of_parameters(self, best: WindowsMisfit) -> RunMisfit:
        """The misfit as a function of the parameters (p,) alone: for each of their values, the
        starts are those that fit best."""
        parts = best.jacobian[:, : self.parameters], best.jacobian[:, self.parameters :]
        axes, sizes, _ = np.linalg.svd(parts[1] / _norms(parts[1]), full_matrices=False)
        axes = axes[:, sizes > SINGULAR * sizes[0]]
        residuals = best.residuals - axes @ (axes.T @ best.residuals)
        jacobian = parts[0] - axes @ (axes.T @ parts[0])
        names = list(self.outputs)
        predicted = [
            np.stack([run.sampled.values[name][: piece.count] for name in names])
            for run, piece in zip(best.runs, self.pieces, strict=True)
        ]
        worst = max(best.runs, key=lambda run: run.sampled.result != RESULTS.successful)
        return RunMisfit(
            best.coordinates[: self.parameters],
            residuals,
            jacobian,
            np.concatenate(predicted, axis=1),
            worst.sampled.result,
            float(best.runs[-1].sampled.time),
            sum(int(run.sampled.attempts) for run in best.runs),
        )


def _norms(jacobian: np.ndarray) -> np.ndarray:
    norms = np.linalg.norm(jacobian, axis=0)
    return np.where(norms > 0.0, norms, 1.0)

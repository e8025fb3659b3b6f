"""Runs that are compared with measurements: searches by runs with derivatives, and curves of chi
squared over the record, for many values of the parameters, by runs without derivatives that are
computed side by side (`clearjoint._simulation.lanes.scheduler`)."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, PyTree

from .._compilation.xla import Compiled
from .._fields.checks import require, require_type
from .._math.vectors import fold_constants
from .._measurements.series import Measurements
from .._model.bodies import State
from .._model.scene import Scene
from .._parametrisation.parameter import Parameter, free_parameters, step_limits
from .._parametrisation.readings import readings_of_runs, units_of
from .._result_codes import RESULTS
from .._simulation.lanes.lane import SAVED, Common, Task
from .._simulation.lanes.scheduler import Batch, Ended
from .._simulation.step.settings import Settings
from .levenberg_marquardt import Ending, Iteration, Search, WindowSearch, search_with_damping
from .points import Point, Points
from .residuals import UNREACHED, Experiment, RunMisfit, Samples, experiment, run_misfit, samples

OnFitIteration = Callable[[int, Iteration], None]
"""Function ``f(samples, iteration)`` that is called after each run of a search, with the number of
samples in the window that is fitted."""
WINDOW_TOLERANCE = 0.1
"""Smallest `tolerance` in windows before the last, whose results are only starts for the next."""
TOGETHER = 64
"""Number of runs whose samples are compared with the data in one call of a compiled program."""


@dataclass(frozen=True)
class Comparison:
    """An experiment, and the samples with which its runs are compared, for fits, screenings,
    posteriors and the test of a fit's covariance.

    - `runs`: the experiment, which makes the runs.
    - `data`: the samples, at the times of `runs`: T sample times, followed by padding.
    - `parameters`, `units`: the free parameters, and the unit of each one's value, by name.
    """

    runs: Experiment
    data: Samples
    parameters: Mapping[str, Parameter] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    _batches: list[Batch] = field(default_factory=list, repr=False, compare=False)
    """The latest batch of lanes, if any, whose compiled programs the next one reuses, also with
    other measurements. A list, because the class is frozen."""

    def of(self, measurements: Measurements) -> "Comparison":
        """Return a copy with other `measurements`, of the same series at the same times."""
        return replace(self, data=samples(measurements, len(self.runs.base.times)))

    @property
    def times(self) -> Float[np.ndarray, " T"]:
        """Sample times, followed by copies of the last one as padding."""
        return np.asarray(self.runs.base.times)

    @property
    def count(self) -> int:
        """Number T of times up to the last sample, without the padding."""
        return int(np.flatnonzero(self.data.weights.any(axis=0))[-1]) + 1

    def time(self, count: float) -> float:
        """Return the `count`-th sample time, s, with `count` rounded up; for 0, the run's start."""
        times = int(np.ceil(count))
        return float(self.times[times - 1]) if times else float(self.runs.base.start_time)

    def chi_squared(
        self, coordinates: Points, count: int, smoothing: int = 1
    ) -> Float[np.ndarray, "n {count}+1"]:
        """Return chi squared of runs at n points: in column k, that of all samples up to the k-th
        of the first `count` sample times; column 0 is zero.

        Samples that a run does not reach have the residual `UNREACHED`, to which larger residuals
        are reduced. Each residual is replaced by the mean of `smoothing` successive residuals up to
        its time; residuals before the first time count as zero.
        """
        runs, coordinates = self.runs, self.runs.with_held(coordinates)
        instants, sample_indices = self._instants(coordinates, count)
        curves = np.zeros((len(coordinates), count + 1))
        # Predictions (S, T) of the lanes that have ended and are not in `curves` yet.
        waiting: dict[int, np.ndarray] = {}

        def compare_waiting() -> None:
            # Computes the curves of the lanes in `waiting`, which is empty then.
            lanes = list(waiting)
            rows = np.stack([waiting.pop(lane) for lane in lanes])
            # Always the same number of rows, so that one compiled program serves all calls.
            predictions = np.resize(rows, (TOGETHER, *rows.shape[1:]))
            # The lanes have computed exact quantities. Errors of sensors, such as a bias, are added
            # to these values here; delays are contained in `instants`.
            if runs.sensors.of_values:
                quantities = dict(zip(runs.names, np.moveaxis(predictions, 1, 0), strict=True))
                of_lanes = np.resize(coordinates[lanes], (TOGETHER, coordinates.shape[1]))
                elapsed = self.times - float(runs.base.start_time)
                readings = readings_of_runs(runs.sensors, quantities, elapsed, of_lanes)
                predictions = np.stack([np.asarray(readings[n]) for n in runs.names], axis=1)
            sums = np.asarray(_cumulated(self.data, predictions, smoothing))
            curves[lanes, 1:] = sums[: len(lanes), :count]

        def on_ended(ended: Ended) -> None:
            # Puts the predictions of lanes into `waiting`, NaN at times that a lane did not reach.
            # A lane has recorded `reached` instants, up to the time that it reached.
            rows, counts = ended.logs[SAVED]
            for k, (lane, reached) in enumerate(zip(ended.lanes.tolist(), counts, strict=True)):
                predicted = np.full((len(sample_indices), len(self.times)), np.nan)
                parts = zip(predicted, runs.names, sample_indices, strict=True)
                for row, name, indices in parts:
                    at = indices[lane if len(indices) > 1 else 0]  # One row serves all lanes.
                    row[: len(at)] = np.where(at < reached, rows[name][k, at], np.nan)
                # Lanes end in any order. They are compared in groups, because the predictions of
                # all lanes would take much memory.
                waiting[lane] = predicted
                if len(waiting) == TOGETHER:
                    compare_waiting()

        # A batch made by `with_tasks` reuses the compiled programs of the latest batch.
        tasks = self._tasks(coordinates, instants)
        batch = self._batches[0].with_tasks(tasks) if self._batches else Batch(self._common, tasks)
        self._batches[:] = [batch]
        batch.run(range(len(coordinates)), on_ended)
        if waiting:
            compare_waiting()
        return curves

    def search(
        self,
        start: Point,
        ends: Sequence[float],
        tolerance: float,
        max_iterations: int,
        on_iteration: OnFitIteration,
    ) -> Search:
        """Search from the point `start` in the window up to the first of the rising times `ends`,
        s, and in each further window from the result of the one before. `tolerance` and
        `max_iterations` are those of `search_with_damping`. After Ctrl-C, the search has
        `Ending.INTERRUPTED` and the best run so far; a `KeyboardInterrupt` is raised only if the
        first run has not ended."""
        max_changes, windows, at = step_limits(self.parameters), [], start
        best: RunMisfit | None = None
        for end in ends:
            # After few impacts errors of the parameters have grown little, so that a search in a
            # short window converges from farther away than in the whole record.
            part, last = self.data.until(self.times, end), end == ends[-1]
            misfit = partial(run_misfit, self.runs, part, end)
            try:
                best, iterations, ending = search_with_damping(
                    # Without a prior, a parameter that the window hardly determines could leave its
                    # range here.
                    misfit if last else partial(_with_prior, misfit, at, max_changes),
                    at,
                    max_changes,
                    tolerance if last else max(tolerance, WINDOW_TOLERANCE),
                    max_iterations,
                    partial(on_iteration, part.count),
                )
            except KeyboardInterrupt:
                # The user has interrupted the first run of the window, where `search_with_damping`
                # does not catch it. The result of the window before is kept. Its predictions end
                # with that window, so `last` is set to false, and a run over the whole record
                # follows below.
                if best is None:
                    raise
                iterations, ending, last = (), Ending.INTERRUPTED, False
            # Samples that a failed run did not reach have constant residuals, on which a search may
            # converge.
            if best.result != RESULTS.successful and ending is not Ending.INTERRUPTED:
                ending = Ending.FAILED
            windows.append(WindowSearch(end, iterations, ending))
            at = best.coordinates
            if ending is Ending.INTERRUPTED:
                if not last:  # A fit needs predictions for all samples.
                    best = run_misfit(self.runs, self.data, ends[-1], at)
                break
        assert best is not None
        return Search(start, tuple(windows), best)

    def _tasks(self, coordinates: np.ndarray, instants: np.ndarray) -> Task:
        lanes = len(coordinates)
        # Numbers of lanes are rounded up to a power of two: few compiled programs serve all calls.
        rows = max(TOGETHER, 1 << (lanes - 1).bit_length())
        filled = np.resize(coordinates, (rows, coordinates.shape[1]))
        of_rows = jax.device_get(_scenes_and_states(self.runs, self._varied, filled))
        varied, states = jax.tree.map(lambda leaf: leaf[:lanes], of_rows)
        # A run ends at its last instant; an infinite one is padding.
        ends = np.where(np.isfinite(instants), instants, -np.inf).max(axis=1)
        first_steps = np.full(lanes, float(self.runs.base.first_step))
        return Task(varied, states, ends, first_steps, instants)

    def _instants(self, coordinates: np.ndarray, count: int) -> tuple[np.ndarray, list[np.ndarray]]:
        """Return the rising times (n, K), s, at which n runs are recorded, padded with infinity,
        and, for each series, the indices among these times of its first `count` sample times:
        (n, count), or (1, count) if the indices are the same in all runs.

        A series with a delay is compared at its sample times minus the delay of the run; times
        before the start of the run are replaced by the start.
        """
        runs, lanes, undelayed = self.runs, len(coordinates), self.times[:count]
        if not runs.sensors.delays:
            times = self.times.copy()
            times[count:] = np.inf  # Never reached: nothing is recorded for padding.
            return np.tile(times, (lanes, 1)), [np.arange(count)[None]] * len(runs.names)
        # Delay of each series in each run, s, by name.
        delay_of = dict.fromkeys(runs.names, np.zeros(lanes))
        for parameter_index, names in runs.sensors.delays:
            delay = np.asarray(runs.sensors.value(parameter_index, jnp.asarray(coordinates)))
            delay_of |= dict.fromkeys(names, delay)
        # Before the start there is only the initial state.
        start = float(runs.base.start_time)
        times_of = {n: np.maximum(undelayed - d[:, None], start) for n, d in delay_of.items()}
        # All series with the same delay have the same delayed times: `names[0]` stands for them.
        delayed = np.concatenate([times_of[names[0]] for _, names in runs.sensors.delays], axis=1)
        all_times = np.concatenate([np.tile(undelayed, (lanes, 1)), delayed], axis=1)
        instants = np.full((lanes, len(self.times) * (1 + len(runs.sensors.delays))), np.inf)
        sample_indices = [np.zeros((lanes, count), int) for _ in runs.names]
        for lane, of_lane in enumerate(all_times):
            # A lane records rising times, each once: those of all series are merged.
            rising = np.unique(of_lane)
            instants[lane, : len(rising)] = rising
            for indices, name in zip(sample_indices, runs.names, strict=True):
                indices[lane] = np.searchsorted(rising, times_of[name][lane])
        return instants, sample_indices

    @cached_property
    def _varied(self) -> PyTree[bool]:
        return self.runs.base.family.varied()

    @cached_property
    def _common(self) -> Common:
        runs = self.runs
        # The lanes record the outputs at given times, but no reductions, such as peak values, no
        # crossings of sections and no impacts.
        return Common(
            runs.base.scheme,
            fold_constants(runs.base.family.base[0], self._varied),
            runs.base.start_time,
            runs.base.max_steps,
            saves=True,
            channels={SAVED: dict(runs.base.outputs)},
        )


def _with_prior(
    misfit: Callable[[np.ndarray], RunMisfit], centre: Point, deviations: Point, at: Point
) -> RunMisfit:
    """Return the misfit at the point `at`, with the residuals of a normal prior appended:
    (at - centre)/deviations, which are zero where a deviation is infinite."""
    plain = misfit(at)
    residuals = np.append(plain.residuals, (at - centre) / deviations)
    jacobian = np.vstack([plain.jacobian, np.diag(1.0 / deviations)])
    return replace(plain, residuals=residuals, jacobian=jacobian)


def check_sets(scene: Scene, measurements: Sequence[Measurements]) -> None:
    remedy = "pass at least one set of measurements"
    require_type("measurements", measurements, Sequence, "a list of Measurements", remedy)
    require(len(measurements) > 0, "measurements", len(measurements), "not empty", remedy)
    remedy = 'pass cj.Measurements({"probe": cj.Series(...)})'
    for measured in measurements:
        require_type("measurements", measured, Measurements, "Measurements", remedy)
    first_set = measurements[0]
    first_set.check(scene)
    for k, measured in enumerate(measurements):
        # One compiled program serves series of equal names, in equal order, quantities and times.
        same = list(measured.series) == list(first_set.series) and all(
            series.channel == first_set[name].channel
            and np.array_equal(series.times, first_set[name].times)
            for name, series in measured.series.items()
        )
        expected = "measurements of the same channels and times as the first"
        require(same, f"measurements[{k}]", list(measured.series), expected, "fit them separately")


def comparison(
    scene: Scene,
    state: State,
    measurements: Measurements,
    parameters: Mapping[str, Parameter],
    start_time: float,
    settings: Settings,
) -> Comparison:
    times, series = measurements.times(), measurements.series
    expected = f"no later than the first sample, at {times[0]} s"
    remedy = "start earlier, or leave samples out by measurements.between(...)"
    require(bool(start_time <= times[0]), "start_time", start_time, expected, remedy)
    outputs = {name: s.channel for name, s in series.items()}
    runs = experiment(scene, state, parameters, outputs, times, start_time, settings)
    free = free_parameters(parameters)
    units = units_of(free, scene, state, {name: s.unit for name, s in series.items()})
    return Comparison(runs, samples(measurements, len(runs.base.times)), free, units)


@Compiled
def _scenes_and_states(
    runs: Experiment, varied: PyTree[bool], coordinates: Float[np.ndarray | jax.Array, "n p"]
) -> tuple[PyTree, State]:
    """Return scenes and initial states at n points, each in one PyTree with a first axis of n. In
    the scenes, leaves that are not `varied` are ``None``."""
    scenes, states = jax.vmap(runs.base.family.scene_and_state)(coordinates)
    return eqx.filter(scenes, varied), states


@Compiled
def _cumulated(data: Samples, predicted: np.ndarray, smoothing: int) -> jax.Array:
    """Return chi squared of n runs up to each time, (n, T), from predictions (n, S, T) of S series,
    NaN after a run's end. Each residual is replaced by the mean of the last `smoothing` ones."""
    # Clipped, so that no residual is larger than that of a sample that a run did not reach.
    residuals = jnp.clip(jax.vmap(data.residuals)(predicted), -UNREACHED, UNREACHED)
    # Means of successive residuals, by differences of their cumulative sum.
    if smoothing > 1:
        sums = jnp.cumsum(jnp.pad(residuals, ((0, 0), (0, 0), (smoothing, 0))), axis=2)
        residuals = (sums[..., smoothing:] - sums[..., :-smoothing]) / smoothing
    return jnp.cumsum((residuals**2).sum(axis=1), axis=1)

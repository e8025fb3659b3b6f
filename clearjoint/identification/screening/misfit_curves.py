"""Runs at many parameters without derivatives, side by side: chi squared over the record.

Such a run costs a small part of one with derivatives, since lanes run side by side
(`clearjoint.simulation.lanes.scheduler`). Of each only the chi squared over time is kept.
"""

from dataclasses import dataclass
from functools import cached_property

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, PyTree

from ...compilation import Compiled
from ...math.vectors import fold_constants
from ...model.bodies import State
from ...simulation.lanes.lane import Plan
from ...simulation.lanes.scheduler import Batch, Ended
from ...simulation.lanes.tasks import Common, Task
from ..residuals import UNREACHED, Experiment, Samples

LOG = "samples"
TOGETHER = 64
"""Runs whose samples are compared with the data at once."""


@dataclass(frozen=True)
class SideBySide:
    """Runs of an experiment and the samples that they are compared with."""

    runs: Experiment
    data: Samples

    @property
    def times(self) -> Float[np.ndarray, " T"]:
        """Times of the samples, (T,) s; after the last one it is repeated."""
        return np.asarray(self.runs.times)

    @property
    def count(self) -> int:
        """Number of times to the last sample."""
        return int(np.flatnonzero(self.data.weights.any(axis=0))[-1]) + 1

    def time(self, count: float) -> float:
        """s, at the last of a number of times that has begun; of none, the start."""
        whole = int(np.ceil(count))
        return float(self.times[whole - 1]) if whole else float(self.runs.start_time)

    def chi_squared(
        self, coordinates: Float[np.ndarray, "n p"], count: int, smoothing: int = 1
    ) -> Float[np.ndarray, "n {count}+1"]:
        """Chi squared (n, count + 1) of the first 0, 1, ..., count times at coordinates (n, p).

        Samples that a run does not reach count `UNREACHED`. With `smoothing`, it is that of the
        residuals' means over so many times, each of which counts as a part of one, since they share
        their samples.
        """
        curves = np.zeros((len(coordinates), count + 1))
        instants, where = self._instants(coordinates, count)
        waiting: dict[int, np.ndarray] = {}

        def take() -> None:
            lanes = list(waiting)
            rows = np.stack([waiting.pop(lane) for lane in lanes])
            filled = np.resize(rows, (TOGETHER, *rows.shape[1:]))
            columns = np.asarray(_cumulated(self.data, filled, smoothing))
            curves[lanes, 1:] = columns[: len(lanes), :count]

        def on_ended(ended: Ended) -> None:
            rows, counts = ended.logs[LOG]
            for k, (lane, reached) in enumerate(zip(ended.lanes.tolist(), counts, strict=True)):
                predicted = np.full((len(where), len(self.times)), np.nan)
                for row, name, places in zip(predicted, self.runs.names, where, strict=True):
                    at = places[lane if len(places) > 1 else 0]
                    row[: len(at)] = np.where(at < reached, rows[name][k, at], np.nan)
                waiting[lane] = predicted
                if len(waiting) == TOGETHER:
                    take()

        batch = Batch(self._common, self._tasks(coordinates, instants))
        batch.run(range(len(coordinates)), on_ended)
        if waiting:
            take()
        return curves

    def _tasks(self, coordinates: np.ndarray, instants: np.ndarray) -> Task:
        varied, states = jax.device_get(_scenes_and_states(self.runs, self._varied, coordinates))
        lanes = len(coordinates)
        return Task(
            varied,
            states,
            np.where(np.isfinite(instants), instants, -np.inf).max(axis=1),
            np.full(lanes, float(self.runs.first_step)),
            instants,
        )

    def _instants(self, coordinates: np.ndarray, count: int) -> tuple[np.ndarray, list[np.ndarray]]:
        """Times (n, K) at which the runs are recorded, s, infinite behind the last; and for each
        series where the times of its samples are among these, (n, count), or (1, count) for all."""
        runs, lanes, own = self.runs, len(coordinates), self.times[:count]
        if not runs.delays:
            times = self.times.copy()
            times[count:] = np.inf  # never come to, so that nothing is recorded for padding
            return np.tile(times, (lanes, 1)), [np.arange(count)[None]] * len(runs.names)
        shift = dict.fromkeys(runs.names, np.zeros(lanes))
        for number, names in runs.delays:
            shift |= dict.fromkeys(names, np.asarray(runs.delay(number, jnp.asarray(coordinates))))
        start = float(runs.start_time)
        queries = {n: np.maximum(own - d[:, None], start) for n, d in shift.items()}
        several = np.concatenate([queries[names[0]] for _, names in runs.delays], axis=1)
        every = np.concatenate([np.tile(own, (lanes, 1)), several], axis=1)
        instants = np.full((lanes, len(self.times) * (1 + len(runs.delays))), np.inf)
        where = [np.zeros((lanes, count), int) for _ in runs.names]
        for lane, row in enumerate(every):
            rising = np.unique(row)
            instants[lane, : len(rising)] = rising
            for places, name in zip(where, runs.names, strict=True):
                places[lane] = np.searchsorted(rising, queries[name][lane])
        return instants, where

    @cached_property
    def _varied(self) -> PyTree[bool]:
        return self.runs.family.varied()

    @cached_property
    def _common(self) -> Common:
        runs = self.runs
        plan = Plan(runs.scheme, {}, {}, True, runs.max_steps)
        folded_scene = fold_constants(runs.family.base[0], self._varied)
        return Common(plan, folded_scene, runs.start_time, {}, {LOG: runs.outputs}, LOG)


@Compiled
def _scenes_and_states(
    runs: Experiment, varied: PyTree[bool], coordinates: Float[np.ndarray | jax.Array, "n p"]
) -> tuple[PyTree, State]:
    """What varies of the scenes, and the initial states, with lanes in front."""
    scenes, states = jax.vmap(runs.family.scene_and_state)(coordinates)
    return eqx.filter(scenes, varied), states


@Compiled
def _cumulated(data: Samples, predicted: np.ndarray, smoothing: int) -> jax.Array:
    """Chi squared (n, T) up to each time of predictions (n, S, T), by residuals or their means."""
    residuals = jnp.clip(jax.vmap(data.residuals)(predicted), -UNREACHED, UNREACHED)
    if smoothing > 1:
        sums = jnp.cumsum(jnp.pad(residuals, ((0, 0), (0, 0), (smoothing, 0))), axis=2)
        residuals = (sums[..., smoothing:] - sums[..., :-smoothing]) / smoothing
    return jnp.cumsum((residuals**2).sum(axis=1), axis=1)

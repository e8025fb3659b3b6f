"""Longest record that a fit by a single run can use.

Small differences grow from impact to impact. This growth makes parameters visible in data, but it
limits a fit in two ways. First, a wrong guess leads to another sequence of impacts, whose misfit
leads to wrong parameters. Later, integration errors grow until the run differs from the true motion
for its parameters.
"""

import warnings
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ..fields.checks import require, require_positive
from ..model.bodies import State
from ..model.scene import Scene
from ..parametrisation.parameter import Parameter, coordinates_of
from ..simulation.run.sensitivities import Sensitivities, sensitivities
from ..simulation.step import presets
from ..simulation.step.settings import Settings, settings_or
from . import descent_paths
from . import error_growth as growth
from .analysis import Identifiability, identifiability_from
from .sensors import Sensor, Sensors, as_sensors, outputs_of, times_of
from .text_tables import aligned, number

LOOSER = 10.0
"""Tolerance of the run that estimates the error of the main run, relative to the main run's. A
smaller tolerance than the main run's might be below rounding errors."""
PATH_POINTS = 4
"""Number of points between the truth and a wrong guess, including the guess, at which the slope of
the misfit is computed."""
DERIVATIVE_ERROR = 0.1
"""Relative error of derivatives from which on a fit can't use them."""


@dataclass(frozen=True)
class FitHorizon:
    """Longest record that a fit by a single run can use, and the accuracy of longer records.

    - `times`: (T,) s, times of the samples.
    - `growth`: (T, p + 1) m, root mean square displacement of the bodies' points per unit of each
      parameter's coordinate; the last column is for the perturbation of the initial velocity, per
      m/s.
    - `rate`: 1/s, rate of exponential growth of this last column since the first contact.
    - `error`: (T,) bound of the integration error in units of the noise, the largest of all
      outputs: the difference from a run with ten times the tolerance.
    - `derivative_error`: (T,) relative bound of the error of the derivatives over the record up to
      each time, the largest of all parameters.
    - `numerical`: s, first time at which `error` exceeds 1 or `derivative_error` exceeds 0.1.
    - `guesses`: wrong guesses, with the records for which a fit from them fails.
    - `information`: accuracy that the data allow over time.

    `numerical`, `convergence` and `single_shot` are infinite if their limit is not reached within
    the record.

    >>> probe = cj.Sensor(x, times, noise=1e-4)
    >>> limits = cj.fit_horizon(
    ...     scene,
    ...     state,
    ...     {"stiffness": stiffness},
    ...     {"probe": probe},
    ...     uncertainty={"stiffness": np.log(1.5)},
    ... )
    >>> limits.growth.shape
    (30, 2)
    """

    times: Float[np.ndarray, " T"]
    growth: Float[np.ndarray, "T directions"]
    rate: float
    error: Float[np.ndarray, " T"]
    derivative_error: Float[np.ndarray, " T"]
    numerical: float
    guesses: tuple[descent_paths.WrongGuess, ...]
    information: Identifiability

    @property
    def convergence(self) -> float:
        """End of the shortest record, s, for which a fit from one of the guesses may fail.

        Infinite if fits from all guesses converge for every record.
        """
        return min(guess.since for guess in self.guesses)

    @property
    def single_shot(self) -> float:
        """End of the longest record, s, that a fit by a single run can use.

        The smaller one of `numerical` and `convergence`; infinite if the whole record can be used.
        """
        return min(self.numerical, self.convergence)

    def warn_if_beyond(self, time: float) -> None:
        """Warn, with a `UserWarning`, if a record is too long for a fit by a single run.

        The warning names each limit that the record exceeds, in ms, and suggests fitting windows
        that grow from the smaller limit.

        **Arguments:** `time`: s, time of the record's last sample.
        """
        if time > self.single_shot:
            reasons = []
            if time > self.convergence:
                reasons.append(
                    f"from {1e3 * self.convergence:.4g} ms on, fits from guesses with this "
                    "uncertainty may end in a wrong minimum"
                )
            if time > self.numerical:
                reasons.append(
                    f"from {1e3 * self.numerical:.4g} ms on, integration errors exceed the noise "
                    "or make the derivatives useless"
                )
            warnings.warn(
                f"The record ends at {1e3 * time:.4g} ms and is too long for a fit by a single "
                f"run: {'; '.join(reasons)}. Fit windows that grow from "
                f"{1e3 * self.single_shot:.4g} ms: identify(..., grow=[...]).",
                UserWarning,
                stacklevel=2,
            )

    def __str__(self) -> str:
        """Return limits, guesses, and standard deviations by length of the record, as text."""
        end = float(self.times[-1])
        limits = [
            f"A run of {1e3 * end:g} ms; small differences of velocity grow at a rate of "
            f"{self.rate:.3g} 1/s after the first contact.",
            f"Integration and derivatives are accurate {_until(self.numerical)} (the error at the "
            f"end is {self.error[-1]:.2g} times the noise, that of derivatives "
            f"{100.0 * self.derivative_error[-1]:.2g} %).",
            f"Fits from all guesses converge {_until(self.convergence)}.",
        ]
        guesses = [("offsets of", *self.information.labels, "converges")]
        for guess in self.guesses:
            guesses.append(("", *(f"{x:+.3g}" for x in guess.offsets), _until(guess.since)))
        return "\n".join([*limits, "", *aligned(guesses), "", *self._deviations_by_length()])

    def _deviations_by_length(self) -> list[str]:
        """Return the lines of a table of the parameters' standard deviations.

        The table has a row for the whole record, and a row for the record up to each limit that is
        reached.
        """
        deviations = self.information.over_time()
        lengths = {float(self.times[-1])}
        lengths |= {t for t in (self.convergence, self.numerical) if np.isfinite(t)}
        rows = [("record", *self.information.labels)]
        for length in sorted(lengths):
            at = int(np.searchsorted(self.times, length))
            rows.append((f"{1e3 * length:.4g} ms", *(number(x) for x in deviations[at])))
        return ["Standard deviations that data can reach, by length of the record:", *aligned(rows)]


def _until(time: float) -> str:
    return "to the end" if np.isinf(time) else f"up to {1e3 * time:.4g} ms"


def fit_horizon(
    scene: Scene,
    state: State,
    parameters: Mapping[str, Parameter],
    sensors: Sensors,
    settings: Settings | None = None,
    *,
    uncertainty: Mapping[str, float],
    start_time: float = 0.0,
) -> FitHorizon:
    """Compute the longest record of a motion that a fit by a single run can use.

    Two runs, one of them with ten times the tolerance, estimate the integration error. For each
    wrong guess four more runs follow the path to the truth. There are two guesses for each
    parameter and, with several parameters, eight (for two, four) with all of them wrong.

    **Arguments:**

    - `scene`, `state`, `parameters`, `sensors`, `settings`, `start_time`: as in
      `identifiability`; the run ends at the last sample.
    - `uncertainty`: largest error of a first guess by parameter, in the scale's coordinate: log(5)
      for a factor of five on a `Log` scale.

    **Returns:** a `FitHorizon`, whose `single_shot` is the end of that record, s.

    **Raises:** `ValueError` for unsupported arguments; `SimulationError` if the run with the
    parameters' values fails.

    >>> probe = cj.Sensor(x, times, noise=1e-4)
    >>> limits = cj.fit_horizon(
    ...     scene,
    ...     state,
    ...     {"stiffness": stiffness},
    ...     {"probe": probe},
    ...     uncertainty={"stiffness": np.log(1.5)},
    ... )
    >>> limits.single_shot
    inf
    """
    settings = settings_or(settings, presets.derivatives)
    looser = settings.looser(LOOSER)
    names, keys = sorted(parameters), sorted(uncertainty)
    require(names == keys, "uncertainty", keys, f"one for each of {names}", "name all of them")
    for name in parameters:
        remedy = "give the possible error of the guess"
        require_positive(f"uncertainty[{name!r}]", uncertainty[name], remedy)
    spread = np.array([float(uncertainty[name]) for name in parameters])
    runs = _PerturbedRuns(scene, state, dict(parameters), as_sensors(sensors, scene), start_time)
    truth = coordinates_of(scene, state, parameters)
    true_run = runs.run(truth, settings, throw=True)
    errors = _errors(runs, true_run, runs.run(truth, looser, throw=True))
    times = true_run.times
    sizes = growth.sizes(true_run.derivatives, growth.points(scene))
    # Differences grow exponentially only through impacts: the rate is fitted from the first contact
    # on.
    touching = np.any([true_run.values[name] > 0.0 for name in growth.penetrations(scene)], axis=0)
    onset = _first(times, touching)
    guesses = descent_paths.offsets(spread)
    return FitHorizon(
        times,
        sizes,
        growth.rate(times, sizes[:, -1], onset if np.isfinite(onset) else start_time),
        *errors,
        _first(times, (errors[0] > 1.0) | (errors[1] > DERIVATIVE_ERROR)),
        tuple(_wrong_guess(runs, truth, true_run, offsets, settings) for offsets in guesses),
        identifiability_from(true_run, runs.parameters, truth, runs.sensors, settings),
    )


@dataclass(frozen=True)
class _PerturbedRuns:
    """A scene that can be run with different values of its p parameters.

    Runs differ only in numbers, so that all of them use the same compiled program.

    - `scene`, `state`: the scene and its initial state.
    - `parameters`: the parameters by name, in the order of the coordinates.
    - `sensors`: sensors by name; a run ends at the last of their times.
    - `start_time`: s.
    """

    scene: Scene
    state: State
    parameters: dict[str, Parameter]
    sensors: dict[str, Sensor]
    start_time: float

    def run(self, coordinates: np.ndarray, settings: Settings, *, throw: bool) -> Sensitivities:
        """Run the scene, with derivatives, at coordinates (p,) of the parameters.

        **Arguments:** `throw`: whether to raise an error if the run fails; otherwise the result
        ends where the run failed.

        **Returns:** the channels of the sensors, coordinates of points of the bodies, m, and
        penetrations of the contacts, m, at the T times of the sensors. Their derivatives are
        (T, p + 1), with respect to the coordinates and, in the last column, to the perturbation of
        the initial velocity, per m/s.
        """
        # Only the parameters' values change, which are arguments of the compiled program.
        values = zip(self.parameters.items(), coordinates, strict=True)
        perturbed = {
            name: Parameter(p.variation, p.scale, value=float(p.scale.value(u)))
            for (name, p), u in values
        }
        times, scene = times_of(self.sensors), self.scene
        return sensitivities(
            scene,
            self.state,
            float(times[-1]),
            perturbed | {growth.DISTURBANCE: growth.disturbance(scene)},
            outputs_of(self.sensors) | growth.points(scene) | growth.penetrations(scene),
            times,
            settings,
            start_time=self.start_time,
            throw=throw,
        )

    def weights(self, times: np.ndarray) -> dict[str, np.ndarray]:
        """Return weights (T,) of each channel by name, for times (T,), s.

        A weight is the inverse of the noise, in the inverse of the channel's unit; it is zero at
        times without a sample.
        """
        weights = {}
        for name, sensor in self.sensors.items():
            weight = np.zeros(len(times))
            weight[np.searchsorted(times, sensor.times)] = 1.0 / sensor.noise
            weights |= dict.fromkeys(outputs_of({name: sensor}), weight)
        return weights


def _errors(
    runs: _PerturbedRuns, run: Sensitivities, loose: Sensitivities
) -> tuple[np.ndarray, np.ndarray]:
    """Return bounds (T,) of the errors of a run's values and derivatives.

    The error of the values is in units of the noise, the error of the derivatives is relative.

    **Arguments:** `loose`: the same run with a larger tolerance, whose errors are much larger.
    """
    weights = runs.weights(run.times)
    values = [np.abs(run.values[n] - loose.values[n]) * w for n, w in weights.items()]
    # Errors of derivatives are compared with the derivatives of the whole record so far, because a
    # fit uses their sum over all samples.
    p = len(runs.parameters)
    differences, size = np.zeros((2, len(run.times), p))
    for name, weight in weights.items():
        weighted = run.derivatives[name][:, :p] * weight[:, None]
        differences += (loose.derivatives[name][:, :p] * weight[:, None] - weighted) ** 2
        size += weighted**2
    total, error = np.cumsum(size, axis=0), np.cumsum(differences, axis=0)
    relative = np.sqrt(error / np.where(total > 0.0, total, 1.0))
    return np.max(values, axis=0), relative.max(axis=1)


def _wrong_guess(
    runs: _PerturbedRuns,
    truth: np.ndarray,
    true_run: Sensitivities,
    offsets: np.ndarray,
    settings: Settings,
) -> descent_paths.WrongGuess:
    """Return a wrong guess and the records with which a fit from it fails.

    **Arguments:**

    - `truth`: (p,) coordinates of the parameters, with which `true_run` was computed.
    - `offsets`: (p,) guess less truth, in coordinates.
    """
    weights, times = runs.weights(true_run.times), true_run.times
    true_values = {name: true_run.values[name] * weight for name, weight in weights.items()}
    blocked = np.zeros(len(times), bool)
    # A record is blocked if the misfit rises at any of the points between the truth and the guess.
    for fraction in np.linspace(0.0, 1.0, PATH_POINTS + 1)[1:]:
        run = runs.run(truth + fraction * offsets, settings, throw=False)
        n = len(run.times)
        values = {name: run.values[name] * weight[:n] for name, weight in weights.items()}
        along = {
            name: (run.derivatives[name][:, : len(offsets)] @ offsets) * weight[:n]
            for name, weight in weights.items()
        }
        blocked |= descent_paths.blocked(true_values, values, along, len(times))
    return descent_paths.WrongGuess(offsets, blocked, _first(times, blocked))


def _first(times: np.ndarray, where: np.ndarray) -> float:
    """Return the first of the times (T,) at which `where` (T,) is true; infinite without one."""
    return float(times[np.argmax(where)]) if where.any() else np.inf

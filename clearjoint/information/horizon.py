"""How long a record may be for a fit by a single run.

Small differences grow from impact to impact. That makes parameters visible in data, but ends a fit
as well: first because a wrong guess leads to another sequence of impacts, whose misfit leads to
wrong parameters, and later because errors of the integration grow until the run is no longer the
motion at its own parameters.
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
from ..simulation.run.sensitivities import Sensitivities
from ..simulation.step import presets
from ..simulation.step.settings import Settings, settings_or
from . import descent_paths
from . import error_growth as growth
from .analysis import Identifiability
from .perturbed_runs import PerturbedRuns
from .sensors import Sensors, as_sensors
from .text_tables import aligned, number

LOOSER = 10.0
"""Tolerance of the run that is compared with the run proper to know its error, over the tolerance
of that. A tighter run might be beyond what rounding allows."""
PLACES = 4
"""Places of a path at which the slope of the misfit is computed, the guess among them."""
DERIVATIVE_ERROR = 0.1
"""Relative error of the derivatives from which on they no longer lead a fit."""


@dataclass(frozen=True)
class FitHorizon:
    """How long a record may be for a fit by a single run, and what longer records would be worth.

    - `times`: (T,) s, those of the samples.
    - `growth`: (T, p + 1) m, root mean square displacement of the bodies' points per unit of each
      parameter's coordinate; the last column is that by the disturbance of the initial velocity,
      per m/s.
    - `rate`: 1/s, of the exponential growth of this last column since the first contact.
    - `error`: (T,) a bound of the error of the integration, in units of the noise, the largest of
      all outputs: the difference from a run with ten times the tolerance.
    - `derivative_error`: (T,) such a bound of the derivatives over the record so far, relative, the
      largest of all parameters.
    - `numerical`: s, the first time at which `error` exceeds one or `derivative_error` a tenth.
    - `guesses`: wrong guesses, each with the records that it can't be fitted with.
    - `information`: what the data tell over time.

    `numerical`, `convergence` and `single_shot` are infinite if nothing of the kind happens within
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
        """End of the shortest record, s, with which a fit may not find its way from one of the
        guesses to the truth."""
        return min(guess.since for guess in self.guesses)

    @property
    def single_shot(self) -> float:
        """End of the longest record, s, that a fit by a single run can use: the earlier of
        `numerical` and `convergence`."""
        return min(self.numerical, self.convergence)

    def warn_if_beyond(self, time: float) -> None:
        """Warn, with a `UserWarning`, if a record is too long for a fit by a single run.

        **Arguments:** `time`: s, that of the record's last sample.
        """
        if time > self.single_shot:
            reasons = []
            if time > self.convergence:
                reasons.append(
                    f"from {1e3 * self.convergence:.4g} ms on, guesses as uncertain as these may "
                    "end in a wrong minimum"
                )
            if time > self.numerical:
                reasons.append(
                    f"from {1e3 * self.numerical:.4g} ms on, the error of the integration exceeds "
                    "the noise or spoils the derivatives"
                )
            warnings.warn(
                f"The record ends at {1e3 * time:.4g} ms, beyond what a fit by a single run can "
                f"use: {'; '.join(reasons)}. Fit windows that grow from "
                f"{1e3 * min(self.single_shot, time):.4g} ms: identify(..., grow=[...]).",
                UserWarning,
                stacklevel=2,
            )

    def __str__(self) -> str:
        """The limits, the guesses and the standard deviations by length of the record, as text."""
        return "\n".join([*self._limits(), "", *self._guesses(), "", *self._trade()])

    def _limits(self) -> list[str]:
        end = float(self.times[-1])
        return [
            f"A run of {1e3 * end:g} ms; small differences of velocity grow by {self.rate:.3g} 1/s "
            "since the first contact.",
            f"Integration and derivatives good enough: {_until(self.numerical)} (error at the end "
            f"{self.error[-1]:.2g} times the noise, of derivatives "
            f"{100.0 * self.derivative_error[-1]:.2g} %).",
            f"All guesses find their way: {_until(self.convergence)}.",
        ]

    def _guesses(self) -> list[str]:
        labels = self.information.labels
        rows = [("offsets of", *labels, "finds its way")]
        for guess in self.guesses:
            rows.append(("", *(f"{x:+.3g}" for x in guess.offsets), _until(guess.since)))
        return aligned(rows)

    def _trade(self) -> list[str]:
        """Standard deviations from records as long as the limits, and from the whole one."""
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
    """How long a record of the motion at these parameters may be for a fit by a single run.

    It makes two runs, one of them ten times looser, and `PLACES` shorter ones for each wrong
    guess: two for each parameter, and with several of them eight (of two, four) for all at once.

    **Arguments:**

    - `scene`, `state`, `parameters`, `sensors`, `settings`, `start_time`: as in
      `identifiability`; the run ends with the last sample.
    - `uncertainty`: by parameter, how far a first guess may be off, in the scale's coordinate: of a
      `Log` scale log(5) for a factor of five.

    **Raises:** `ValueError` for arguments that no run can use; `SimulationError` if the run at the
    parameters' own values fails.

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
    spread = _in_order(uncertainty, parameters)
    runs = PerturbedRuns(scene, state, dict(parameters), as_sensors(sensors, scene), start_time)
    truth = coordinates_of(scene, state, parameters)
    true_run = runs.run(truth, settings, throw=True)
    errors = _errors(runs, true_run, runs.run(truth, looser, throw=True))
    times = true_run.times
    sizes = growth.sizes(true_run.derivatives, growth.points(scene))
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
        runs.information(true_run, truth, settings),
    )


def _in_order(
    uncertainty: Mapping[str, float], parameters: Mapping[str, Parameter]
) -> Float[np.ndarray, " p"]:
    """Uncertainties (p,) in the order of the parameters, one for each."""
    names, keys = sorted(parameters), sorted(uncertainty)
    require(names == keys, "uncertainty", keys, f"one of each of {names}", "name all of them")
    for name in parameters:
        require_positive(f"uncertainty[{name!r}]", uncertainty[name], "tell how far off a guess is")
    return np.array([float(uncertainty[name]) for name in parameters])


def _errors(
    runs: PerturbedRuns, run: Sensitivities, loose: Sensitivities
) -> tuple[np.ndarray, np.ndarray]:
    """Bounds of the errors of a run's values, (T,) in units of noise, and of its derivatives, (T,)
    relative: differences from a looser run."""
    weights = runs.weights(run.times)
    values = [np.abs(run.values[n] - loose.values[n]) * w for n, w in weights.items()]
    p = len(runs.parameters)
    differences, size = np.zeros((2, len(run.times), p))
    for name, weight in weights.items():
        own = run.derivatives[name][:, :p] * weight[:, None]
        differences += (loose.derivatives[name][:, :p] * weight[:, None] - own) ** 2
        size += own**2
    total, wrong = np.cumsum(size, axis=0), np.cumsum(differences, axis=0)
    relative = np.sqrt(wrong / np.where(total > 0.0, total, 1.0))
    return np.max(values, axis=0), relative.max(axis=1)


def _wrong_guess(
    runs: PerturbedRuns,
    truth: np.ndarray,
    true_run: Sensitivities,
    offsets: np.ndarray,
    settings: Settings,
) -> descent_paths.WrongGuess:
    """The guess at these offsets from the truth, and the records that block its path to it."""
    weights, times = runs.weights(true_run.times), true_run.times
    true_values = {name: true_run.values[name] * weight for name, weight in weights.items()}
    blocked = np.zeros(len(times), bool)
    for share in np.linspace(0.0, 1.0, PLACES + 1)[1:]:
        there = runs.run(truth + share * offsets, settings, throw=False)
        n = len(there.times)
        values = {name: there.values[name] * weight[:n] for name, weight in weights.items()}
        along = {
            name: (there.derivatives[name][:, : len(offsets)] @ offsets) * weight[:n]
            for name, weight in weights.items()
        }
        blocked |= descent_paths.blocked(true_values, values, along, len(times))
    return descent_paths.WrongGuess(offsets, blocked, _first(times, blocked))


def _first(times: np.ndarray, where: np.ndarray) -> float:
    """The first of the times (T,) at which `where` (T,) is true; infinite if it never is."""
    return float(times[np.argmax(where)]) if where.any() else np.inf

"""For how long a single run can be fitted: where rounding, and wrong guesses, end it.

The growth of small differences that makes parameters visible in data ends a fit as well: first
because a guess leads to another sequence of impacts, whose data attract it to wrong parameters, and
later because the run no longer follows the motion of its own parameters.
"""

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from ..fields.checks import require, require_positive
from ..model.bodies import State
from ..model.scene import Scene
from ..parametrisation.parameter import Parameter, coordinates_of
from ..simulation.sensitivities import Sensitivities
from ..simulation.settings import Integration
from . import descent_paths as ways
from . import error_growth as growth
from .analysis import Identifiability
from .perturbed_runs import Shots
from .sensors import Sensors, as_sensors
from .text_tables import aligned, number

LOOSER = 10.0
"""Tolerance of the run that tells the integration error, over that asked for. A tighter one might
ask for more than rounding allows."""
PLACES = 4
"""On each way that are looked at, the guess among them."""
DERIVATIVE_ERROR = 0.1
"""Relative error of the derivatives with which they no longer lead a fit."""


@dataclass(frozen=True)
class Horizon:
    """For how long a run can be fitted as a whole, and what longer records would be worth.

    - `times`: (T,) s, those of the samples.
    - `growth`: (T, p + 1) m, root mean square displacement of the bodies' points per unit of each
      parameter's coordinate, and last of the disturbance of the initial velocity, per m/s.
    - `rate`: 1/s, by which the latter grows as an exponential since the first contact.
    - `error`: (T,) the largest error of the integration, over the noise: a bound, the difference
      from a run of ten times the tolerance.
    - `derivative_error`: (T,) likewise, relative, the largest of the parameters', over the record
      so far.
    - `numerical`: s, from where on one of these is too large: more than the noise, or a tenth.
    - `guesses`: see `Guess`. `convergence`: s, the first length of a record that loses one of them.
    - `information`: what the data tell over time; see `Identifiability`.

    Times are infinite where the run does not come so far.
    """

    times: np.ndarray
    growth: np.ndarray
    rate: float
    error: np.ndarray
    derivative_error: np.ndarray
    numerical: float
    guesses: tuple[ways.Guess, ...]
    information: Identifiability

    @property
    def convergence(self) -> float:
        """s, see above."""
        return min(guess.since for guess in self.guesses)

    @property
    def single_shot(self) -> float:
        """s, beyond which a fit must not use a single run: the earlier of the two."""
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
                f"use: {'; '.join(reasons)}. Take multiple shooting, or let the record grow from "
                f"{1e3 * min(self.single_shot, time):.4g} ms.",
                UserWarning,
                stacklevel=2,
            )

    def __str__(self) -> str:
        """A readable table."""
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
        called = self.information.labels
        rows = [("offsets of", *called, "finds its way")]
        for guess in self.guesses:
            rows.append(("", *(f"{x:+.3g}" for x in guess.offsets), _until(guess.since)))
        return aligned(rows)

    def _trade(self) -> list[str]:
        """What records of the horizon's length and of full length tell."""
        over = self.information.over_time()
        lengths = {float(self.times[-1])}
        lengths |= {t for t in (self.convergence, self.numerical) if np.isfinite(t)}
        called = self.information.labels
        rows = [("record", *called)]
        for length in sorted(lengths):
            at = int(np.searchsorted(self.times, length))
            rows.append((f"{1e3 * length:.4g} ms", *(number(x) for x in over[at])))
        return ["Standard deviations that data can reach, by length of the record:", *aligned(rows)]


def _until(time: float) -> str:
    return "to the end" if np.isinf(time) else f"up to {1e3 * time:.4g} ms"


def horizon(
    scene: Scene,
    state: State,
    parameters: Mapping[str, Parameter],
    sensors: Sensors,
    *,
    uncertainty: Mapping[str, float],
    start_time: float = 0.0,
    integration: Integration | None = None,
) -> Horizon:
    """For how long the motion at these parameters can be fitted by single runs.

    It makes two runs, one of them ten times looser, and `PLACES` shorter ones for each wrong
    guess: two for each parameter, and with several of them eight (of two, four) for all at once.

    **Arguments:**

    - `scene`, `state`, `parameters`, `sensors`, `start_time`, `integration`: as in
      `identifiability`; the run ends with the last sample.
    - `uncertainty`: by parameter, how far a first guess may be off, in the scale's coordinate: of a
      `Log` scale log(5) for a factor of five.

    **Raises:** `ValueError` for arguments that no run can use; `SimulationError` if the run at the
    parameters' own values fails.
    """
    integration = Integration() if integration is None else integration
    spread = _checked(uncertainty, parameters)
    shots = Shots(scene, state, dict(parameters), as_sensors(sensors, scene), start_time)
    truth = coordinates_of(scene, state, parameters)
    found = shots.run(truth, integration, throw=True)
    errors = _errors(shots, found, shots.run(truth, _loosened(integration), throw=True))
    sizes = growth.sizes(found.derivatives, growth.points(scene))
    touching = np.any([found.values[name] > 0.0 for name in growth.penetrations(scene)], axis=0)
    onset = _first(found.times, touching)
    return Horizon(
        found.times,
        sizes,
        growth.rate(found.times, sizes[:, -1], onset if np.isfinite(onset) else start_time),
        *errors,
        _first(found.times, (errors[0] > 1.0) | (errors[1] > DERIVATIVE_ERROR)),
        tuple(_guess(shots, truth, found, off, integration) for off in ways.offsets(spread)),
        shots.information(found, truth, integration),
    )


def _checked(uncertainty: Mapping[str, float], parameters: Mapping[str, Parameter]) -> np.ndarray:
    """(p,) uncertainties in the order of the parameters."""
    names, given = sorted(parameters), sorted(uncertainty)
    require(names == given, "uncertainty", given, f"one of each of {names}", "name all of them")
    for name in parameters:
        require_positive(f"uncertainty[{name!r}]", uncertainty[name], "tell how far off a guess is")
    return np.array([float(uncertainty[name]) for name in parameters])


def _loosened(integration: Integration) -> Integration:
    atol = None if integration.atol is None else LOOSER * integration.atol
    return replace(integration, rtol=LOOSER * integration.rtol, atol=atol)


def _errors(
    shots: Shots, found: Sensitivities, loose: Sensitivities
) -> tuple[np.ndarray, np.ndarray]:
    """Bounds of those of the values, (T,) in units of noise, and of the derivatives, (T,) relative:
    differences from a looser run."""
    weights = shots.weights(found.times)
    values = [np.abs(found.values[n] - loose.values[n]) * w for n, w in weights.items()]
    p = len(shots.parameters)
    differences, size = np.zeros((2, len(found.times), p))
    for name, weight in weights.items():
        own = found.derivatives[name][:, :p] * weight[:, None]
        differences += (loose.derivatives[name][:, :p] * weight[:, None] - own) ** 2
        size += own**2
    total, wrong = np.cumsum(size, axis=0), np.cumsum(differences, axis=0)
    relative = np.sqrt(wrong / np.where(total > 0.0, total, 1.0))
    return np.max(values, axis=0), relative.max(axis=1)


def _guess(
    shots: Shots,
    truth: np.ndarray,
    found: Sensitivities,
    offsets: np.ndarray,
    integration: Integration,
) -> ways.Guess:
    """A guess and for how long its way to the truth is open."""
    weights = shots.weights(found.times)
    wanted = {name: found.values[name] * weight for name, weight in weights.items()}
    closed = np.zeros(len(found.times), bool)
    for share in np.linspace(0.0, 1.0, PLACES + 1)[1:]:
        there = shots.run(truth + share * offsets, integration, throw=False)
        n = len(there.times)
        values = {name: there.values[name] * weight[:n] for name, weight in weights.items()}
        along = {
            name: (there.derivatives[name][:, : len(offsets)] @ offsets) * weight[:n]
            for name, weight in weights.items()
        }
        closed |= ways.closed(wanted, values, along, len(found.times))
    return ways.Guess(offsets, closed, _first(found.times, closed))


def _first(times: np.ndarray, where: np.ndarray) -> float:
    """The first time at which something holds; infinite if it never does."""
    return float(times[np.argmax(where)]) if where.any() else np.inf

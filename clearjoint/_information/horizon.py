"""Longest record that a fit by a single run can use.

Small differences grow from impact to impact. From some length of the record on, the run of a wrong
guess has another sequence of impacts than the data, and the fit may end in wrong parameters; and
integration errors grow until the computed run differs from the true motion.

The first limit is found by tests of whether the misfit falls all the way from a wrong guess to the
truth, along the straight line between them in the parameters' coordinates: if not, a local minimum
or a ridge may stop the fit. The slope of the misfit is r^T J d, with the residuals r and their
derivatives J at a point of the line, and the direction d from the truth to the guess. It is a sum
over samples, so its cumulative sums are the slopes for records of every length.
"""

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float
from typing_extensions import override

from .._export.tables import aligned, number, percent
from .._fields.cautions import warn_the_user
from .._fields.checks import require, require_positive
from .._model.bodies import State
from .._model.scene import Scene
from .._parametrisation.parameter import Parameter, check_parameters, coordinates_of, values_at
from .._simulation.run.sensitivities import Sensitivities, sensitivities
from .._simulation.step import presets
from .._simulation.step.settings import Settings, settings_or
from ..quantities.base import Quantity
from . import analysis
from . import error_growth as growth
from .analysis import Identifiability, Sensor, Sensors, outputs_of

LOOSER = 10.0
"""Ratio of the tolerance of a second run to that of the main run. The difference of the two runs
estimates the error of the main run. With a tighter second run, rounding might dominate."""
PATH_POINTS = 4
"""Number of points on the line from the truth to a wrong guess, including the guess, at which the
slope of the misfit is computed."""
DERIVATIVE_ERROR = 0.1
"""Relative error of derivatives above which they count as useless for a fit."""
ALL_CORNERS = 3
"""Largest number of parameters for which guesses with all parameters wrong are tested in every
combination of signs, up to eight; for more parameters, eight random combinations are tested."""
FLAT = 1e-6
"""Cosine of the angle between the residuals and their derivatives along the line, below which the
misfit counts as constant. By rounding and integration errors, it is not exactly zero then."""


@dataclass(frozen=True)
class WrongGuess:
    """A wrong guess, and the records for which a fit from it may not find the truth.

    - `offsets`: coordinates of the guess minus those of the truth.
    - `blocked`: for the record up to each of the T sample times, whether the misfit rises somewhere
      on the line from the guess to the truth.
    - `since`: end of the shortest blocked record, s; infinite if no record is blocked.
    """

    offsets: Float[np.ndarray, " p"]
    blocked: Bool[np.ndarray, " T"]
    since: float


@dataclass(frozen=True)
class FitHorizon:
    """Longest record that a fit by a single run can use, and what limits it.

    Such a fit compares all samples with one run from the initial state. A coordinate is a
    parameter's value on its scale, such as the logarithm of the value.

    - `times`: (T,) s, times of the samples.
    - `growth`: (T, p + 1) m, root mean square displacement of points of the bodies per unit of each
      parameter's coordinate and, in the last column, per m/s of a perturbation of the initial
      velocity.
    - `rate`: 1/s, rate of exponential growth of the last column of `growth` since the first contact
      or, without contact, since the start; NaN for fewer than two positive displacements there.
    - `error`: (T,) bound of the integration error in units of the noise, the largest of all
      outputs: the difference from a run with ten times the tolerance, whose error is larger.
    - `derivative_error`: (T,) bound of the relative error of the derivatives over the record up to
      each time, the largest of all parameters.
    - `numerical`: first time at which `error` exceeds 1 or `derivative_error` exceeds 0.1, s.
    - `guesses`: the tested wrong guesses, each with the records for which a fit from it may fail.
    - `information`: the `Identifiability` of the parameters, also for shorter records.

    `numerical` and the properties `convergence` and `single_shot` are infinite if never reached.

    >>> sensors, errors = {"probe": cj.Sensor(x, times, noise=1e-4)}, {"stiffness": np.log(1.5)}
    >>> free = {"stiffness": stiffness}
    >>> limits = cj.fit_horizon(scene, state, free, sensors, uncertainty=errors)
    >>> limits.growth.shape
    (30, 2)
    """

    times: Float[np.ndarray, " T"]
    growth: Float[np.ndarray, "T directions"]
    rate: float
    error: Float[np.ndarray, " T"]
    derivative_error: Float[np.ndarray, " T"]
    numerical: float
    guesses: tuple[WrongGuess, ...]
    information: Identifiability

    @property
    def convergence(self) -> float:
        """End of the shortest record for which a fit from one of the guesses may fail, s."""
        return min(guess.since for guess in self.guesses)

    @property
    def single_shot(self) -> float:
        """Smaller of `numerical` and `convergence`, s: records ending earlier suit a single run."""
        return min(self.numerical, self.convergence)

    def warn_if_beyond(self, time: float) -> None:
        """Warn if a record's last sample, at `time`, s, is at `single_shot` or later. The
        `UserWarning` names the limits reached, and suggests the argument `grow` of `identify`."""
        if time >= self.single_shot:
            reasons = []
            if time >= self.convergence:
                reasons.append(
                    f"from {1e3 * self.convergence:.4g} ms on, fits from guesses with this "
                    "uncertainty may end in a wrong minimum"
                )
            if time >= self.numerical:
                reasons.append(
                    f"from {1e3 * self.numerical:.4g} ms on, integration errors exceed the noise "
                    "or make the derivatives useless"
                )
            warn_the_user(
                f"The record ends at {1e3 * time:.4g} ms and is too long for a fit by a single "
                f"run: {'; '.join(reasons)}. Fit growing windows, of "
                f"which the first ends before {1e3 * self.single_shot:.4g} ms: "
                "identify(..., grow=[...])."
            )

    @override
    def __str__(self) -> str:
        end = float(self.times[-1])
        limits = [
            f"A run of {1e3 * end:g} ms; small differences of velocity grow at a rate of "
            f"{self.rate:.3g} 1/s after the first contact.",
            f"Integration and derivatives are accurate {_until(self.numerical)} (the error at the "
            f"end is {number(self.error[-1])} times the noise, that of derivatives "
            f"{percent(self.derivative_error[-1])}).",
            f"Fits from all guesses converge {_until(self.convergence)}.",
        ]
        guesses = [("offsets of", *self.information.labels, "converges")]
        for guess in self.guesses:
            guesses.append(("", *(f"{x:+.3g}" for x in guess.offsets), _until(guess.since)))
        deviations = self.information.over_time()
        # Lengths of the record at the limits and at the end, each with a row of the table.
        ends = {end} | {t for t in (self.convergence, self.numerical) if np.isfinite(t)}
        rows = [("record", *self.information.labels)]
        for length in sorted(ends):
            at = int(np.searchsorted(self.times, length))
            rows.append((f"{1e3 * length:.4g} ms", *(number(x) for x in deviations[at])))
        head = "Standard deviations that data can reach, by length of the record:"
        return "\n".join([*limits, "", *aligned(guesses), "", head, *aligned(rows)])


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

    The parameters' values are taken as the truth. Two runs with these values, one of them with ten
    times the tolerance, estimate the integration error. For each of several wrong guesses, four
    more runs, at the guess and at points between it and the truth, test whether the misfit falls
    all the way to the truth. If one of them fails, records that end after the failure count as too
    long. There are two guesses for each parameter, too large and too small, and for several
    parameters guesses with all of them wrong: four for two parameters, eight for more.

    **Arguments:**

    - `scene`, `state`, `parameters`, `sensors`, `settings`, `start_time`: as in `identifiability`;
      the run ends at the last sample.
    - `uncertainty`: largest error of the value from which a fit starts, positive, by name of each
      parameter, in the coordinate of its scale: log(5) for a factor of five on a `Log` scale.

    **Raises:** `ValueError` as `identifiability`, for an `uncertainty` that is not one positive
    number for each parameter, and for a parameter or sensor with a name used here, such as "initial
    velocity"; `SimulationError` if a run with the parameters' values fails.

    >>> sensors, errors = {"probe": cj.Sensor(x, times, noise=1e-4)}, {"stiffness": np.log(1.5)}
    >>> free = {"stiffness": stiffness}
    >>> cj.fit_horizon(scene, state, free, sensors, uncertainty=errors).single_shot
    inf
    """
    tight = settings_or(settings, presets.derivatives)
    check_parameters(parameters)
    names, keys = sorted(parameters), sorted(uncertainty)
    require(names == keys, "uncertainty", keys, f"one for each of {names}", "name all of them")
    for name, size in uncertainty.items():
        remedy = "give the possible error of the guess"
        require_positive(f"uncertainty[{name!r}]", size, remedy)
    spread = np.array([float(uncertainty[name]) for name in parameters])
    by_name, truth = analysis.as_sensors(sensors, scene), coordinates_of(scene, state, parameters)
    times = analysis.times_of(by_name)
    # The motion of `points` shows how a `disturbance` grows, and `contacts` when impacts begin.
    points, contacts = growth.points(scene), growth.penetrations(scene)
    outputs, end_time = outputs_of(by_name) | points | contacts, float(times[-1])
    disturbance = {growth.DISTURBANCE: growth.disturbance(scene)}
    # These names are used beside the user's.
    for argument, named, reserved in (
        ("parameters", parameters, disturbance),
        ("sensors", outputs_of(by_name), points | contacts),
    ):
        taken = sorted(set(named) & set(reserved))
        require(not taken, argument, taken, "of other names, which are used here", "rename them")

    def run_at(coordinates: np.ndarray, settings: Settings, throw: bool = True) -> Sensitivities:
        # Only the parameters' values change, which are arguments of the compiled program.
        moved = {
            name: Parameter(parameters[name].variation, parameters[name].scale, value=value)
            for name, value in values_at(parameters, coordinates).items()
        }
        free, options = moved | disturbance, {"start_time": start_time, "throw": throw}
        return sensitivities(scene, state, end_time, free, outputs, times, settings, **options)

    true_run, weights = run_at(truth, tight), _weights(by_name, times)
    # `_near` shifts angles by whole turns to the values nearest to those of the true run.
    loose = _near(run_at(truth, tight.looser(LOOSER)), true_run, outputs)
    error, derivative_error = _errors(true_run, loose, weights, len(truth))
    sizes = growth.sizes(true_run.derivatives, points)
    # Differences grow exponentially only through impacts, so the rate is fitted from the first
    # contact on.
    touching = np.any([true_run.outputs[name] > 0.0 for name in contacts], axis=0)
    onset = _first(times, touching)

    def near_truth(coordinates: np.ndarray) -> Sensitivities:
        return _near(run_at(coordinates, tight, throw=False), true_run, outputs)

    guesses = [_wrong_guess(near_truth, true_run, truth, d, weights) for d in offsets(spread)]
    # The last column is that of the disturbance, which comes after the parameters.
    rate = growth.rate(times, sizes[:, -1], onset if np.isfinite(onset) else start_time)
    numerical = _first(times, (error > 1.0) | (derivative_error > DERIVATIVE_ERROR))
    information = analysis.identifiability_from(true_run, parameters, truth, by_name, tight)
    return FitHorizon(
        times, sizes, rate, error, derivative_error, numerical, tuple(guesses), information
    )


def _weights(sensors: Mapping[str, Sensor], times: np.ndarray) -> dict[str, np.ndarray]:
    """Return the weights of each output at `times`, (T,) by name: the inverse of the noise where
    the sensor has a sample, and zero at other times."""
    weights: dict[str, np.ndarray] = {}
    for name, sensor in sensors.items():
        weight = np.zeros(len(times))
        weight[np.searchsorted(times, sensor.times)] = 1.0 / sensor.noise
        weights |= dict.fromkeys(outputs_of({name: sensor}), weight)
    return weights


def _near(
    run: Sensitivities, reference: Sensitivities, outputs: Mapping[str, Quantity]
) -> Sensitivities:
    """Return a run whose periodic outputs, such as angles, are shifted by whole periods to the
    values nearest to a reference run."""
    values = dict(run.outputs)
    for name, output in outputs.items():
        if (period := getattr(output, "period", None)) is not None:
            difference = values[name] - reference.outputs[name][: len(run.times)]
            values[name] = values[name] - period * np.round(difference / period)
    return replace(run, outputs=values)


def _errors(
    run: Sensitivities, loose: Sensitivities, weights: Mapping[str, np.ndarray], p: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return two arrays, (T,): the largest error of an output at each time, divided by its noise;
    and, for the record up to each time, the largest relative error of the derivatives by one of the
    first p parameters. Errors are differences from `loose`, the same run with a larger tolerance.
    `weights`: by output, (T,), 1/noise or, at times without a sample, zero."""
    of_values = [np.abs(run.outputs[n] - loose.outputs[n]) * w for n, w in weights.items()]
    # Errors of derivatives are compared with the derivatives of the whole record so far, because a
    # fit uses their sum over all samples.
    squared_errors, squares = np.zeros((2, len(run.times), p))
    for name, weight in weights.items():
        weighted = run.derivatives[name][:, :p] * weight[:, None]
        squared_errors += (loose.derivatives[name][:, :p] * weight[:, None] - weighted) ** 2
        squares += weighted**2
    # A parameter without any effect so far has no relative error; the divisor 1 avoids 0/0.
    total, error = np.cumsum(squares, axis=0), np.cumsum(squared_errors, axis=0)
    relative = np.sqrt(error / np.where(total > 0.0, total, 1.0))
    return np.max(of_values, axis=0), relative.max(axis=1)


def offsets(uncertainty: Float[np.ndarray, " p"]) -> Float[np.ndarray, "guesses p"]:
    """Return the offset of each wrong guess from the truth. A wrong parameter is off by plus or
    minus its `uncertainty`. First each parameter is wrong alone; then, if there are several, all
    are wrong together, in every combination of signs or, for more than `ALL_CORNERS` parameters, in
    eight random combinations."""
    p, directions = len(uncertainty), (1.0, -1.0)
    signs = [sign * row for row in np.eye(p) for sign in directions]
    # With a single parameter, all parameters together would be the same guesses again.
    if 1 < p <= ALL_CORNERS:
        signs += map(np.array, itertools.product(directions, repeat=p))
    elif p > ALL_CORNERS:
        signs += [*np.random.default_rng(0).choice(directions, (2**ALL_CORNERS, p))]
    return uncertainty * np.array(signs)


def _wrong_guess(
    run_at: Callable[[np.ndarray], Sensitivities],
    true_run: Sensitivities,
    truth: np.ndarray,
    offset: np.ndarray,
    weights: Mapping[str, np.ndarray],
) -> WrongGuess:
    """Test for which records the misfit falls all the way from the guess, `truth` + `offset`, to
    the truth. `run_at` computes the run at given coordinates. `weights`: result of `_weights`."""
    times = true_run.times
    true_values, blocked = _weighted(true_run.outputs, weights), np.zeros(len(times), bool)
    # A record is blocked if the misfit rises at any of the points between the truth and the guess.
    for fraction in np.linspace(0.0, 1.0, PATH_POINTS + 1)[1:]:
        run = run_at(truth + fraction * offset)
        # Derivatives by the parameters come first; the others are not needed here.
        along = {name: run.derivatives[name][:, : len(offset)] @ offset for name in weights}
        values, slopes = _weighted(run.outputs, weights), _weighted(along, weights)
        blocked |= blocked_records(true_values, values, slopes)
    return WrongGuess(offset, blocked, _first(times, blocked))


def _weighted(
    rows: Mapping[str, np.ndarray], weights: Mapping[str, np.ndarray]
) -> Float[np.ndarray, "S n"]:
    """Return `rows`, values or derivatives of S outputs at the n times that the run reached, times
    their `weights`: one over the noise, and zero at times at which an output has no sample."""
    return np.stack([rows[name] * weight[: len(rows[name])] for name, weight in weights.items()])


def blocked_records(
    truth: Float[np.ndarray, "S T"],
    values: Float[np.ndarray, "S n"],
    slopes: Float[np.ndarray, "S n"],
) -> Bool[np.ndarray, " T"]:
    """Return for which records the misfit rises towards the truth at a point of the line.

    `truth` and `values` are the outputs at the truth and at the point, and `slopes` the derivatives
    at the point along the direction from truth to guess, all divided by the noise. If the run at
    the point failed after n of T times, longer records are blocked. A misfit below the noise does
    not block a record, nor does a constant misfit: before the first impact, for example, the run
    doesn't depend on the clearance, but in a longer record it does.
    """
    n = values.shape[1]  # Number of times that the run at the point has reached.
    residuals = values - truth[:, :n]
    slope = np.cumsum((residuals * slopes).sum(axis=0))
    # Squared norms of the residuals and of the slopes over each record.
    misfit, size = (np.cumsum((part**2).sum(axis=0)) for part in (residuals, slopes))
    is_blocked = np.ones(truth.shape[1], bool)
    # A negative slope means that the misfit rises towards the truth. Divided by the norms, the
    # slope is the cosine of an angle, so that the limit does not depend on the size of the misfit.
    # A misfit up to 1 is within the noise.
    is_blocked[:n] = (slope < -FLAT * np.sqrt(misfit * size)) & (misfit > 1.0)
    return is_blocked


def _first(times: np.ndarray, where: np.ndarray) -> float:
    """The first of `times` at which `where` is true; infinite if there is none."""
    return float(times[np.argmax(where)]) if where.any() else np.inf

"""Result of a fit: estimates, uncertainty, tests of the residuals, and report."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from .._export.datasets import AbstractTabular, Labelled, estimate_labels, labelled_dataset, texts
from .._export.tables import aligned, duration, estimates_table, numbered
from .._information import fisher_information as information
from .._information.horizon import FitHorizon
from .._measurements.series import Measurements
from .._model.bodies import State
from .._model.scene import Scene
from .._parametrisation import variations
from .._parametrisation.parameter import GONE, Bounded, Parameter, step_limits, values_at
from .._parametrisation.variations import AbstractSeriesVariation, SeriesDelay, StateNumber
from .._result_codes import RESULTS
from . import checking
from . import goodness_of_fit as statistics
from .checking import LikelihoodCheck
from .levenberg_marquardt import Ending, Search
from .posterior.result import Posterior
from .residuals import RunMisfit
from .screening.screening import Screened

if TYPE_CHECKING:
    import xarray as xr

AT_BOUND = 1e-3
"""Distance from a bound of a `Bounded` scale, over its range, that counts as at the bound."""
ALIKE = 1.3
"""Ratio of the half widths of two intervals up to which the report says that they agree."""
SHOWN = 3
"""Largest number of other minima that the warnings describe."""
FAR = 2.0
"""Root mean square of residuals above which they count as far above the noise."""
GOOD = 1.5
"""Root mean square of residuals up to which a series counts as well fitted."""
PIECES = 20
"""Number of equal pieces of the record in which large residuals are searched; also the smallest
number of samples that are examined for errors of a sensor or for outliers."""
DOUBLINGS = 5
"""Number of growing windows to suggest, each twice as long as the one before it."""
MOST = 0.5
"""Share of chi squared above which one cause counts as the main cause."""
OUTLIER_SHARE = 0.02
"""Share of the samples with the largest residuals, which are examined as outliers."""
LEAST_FREEDOM = 0.25
"""Smallest share of a correlated series' samples that count as degrees of freedom."""
UNCORRELATED = 1e-3
"""p-value of the test of whiteness below which residuals count as correlated."""
Kind = type[AbstractSeriesVariation]
"""Kind of an error of sensors, such as `SeriesBias`."""


@dataclass(frozen=True)
class Fit(AbstractTabular):
    """Result of a fit: estimates, their uncertainty, and tests of the residuals.

    - `scene`, `state`: scene and initial state with the estimated values.
    - `parameters`, `units`: the p parameters, and the unit of each one's value, by name, in the
      order of arrays (p,).
    - `searches`: the result of the search from each start.
    - `best`: the search with the smallest chi squared, among `searches` and ``check.searches``.
    - `screened`: the result of each pass of a `Screening`.
    - `horizon`: the `FitHorizon` given to `identify`, or ``None``.
    - `check`: the test of the covariance by runs around the estimates, or ``None`` if not made.
    - `start_time`: start of the fitted run, s.

    Chi squared is the sum of the squared residuals, which are in standard deviations of the noise.
    A coordinate is a parameter's value on its scale, such as the logarithm of the value.

    >>> data = cj.Measurements({"x": cj.Series(x, times, 0.1 * np.cos(10.0 * times), noise=1e-4)})
    >>> fit = cj.identify(scene, state, data, {"stiffness": stiffness}, progress=False)
    >>> fit.ending.name, list(fit.standard_errors)
    ('CONVERGED', ['stiffness'])
    """

    scene: Scene
    state: State
    parameters: dict[str, Parameter]
    units: dict[str, str]
    measurements: Measurements
    searches: tuple[Search, ...]
    best: Search
    screened: tuple[Screened, ...] = ()
    horizon: FitHorizon | None = None
    check: LikelihoodCheck | None = None
    start_time: float = 0.0

    @override
    def to_xarray(self) -> "xr.Dataset":
        """Return the `estimate` and `standard_error` along "parameter" and the bounds of the 95 %
        `interval` along ("parameter", "bound"), in the `unit` of each parameter, and the
        `correlation` along ("parameter", "with"). Attributes are `ending`, `chi_squared`,
        `degrees_of_freedom`, `p_value` and `warnings`.
        """
        along = ("parameter",)
        variables = {
            "estimate": Labelled(along, [*self.estimates.values()]),
            "standard_error": Labelled(along, [*self.standard_errors.values()]),
            "interval": Labelled((*along, "bound"), [*self.intervals.values()]),
            "correlation": Labelled((*along, "with"), self.correlation),
        }
        labels = estimate_labels(self.units) | {"with": Labelled(("with",), texts([*self.units]))}
        names = "chi_squared", "degrees_of_freedom", "p_value"
        notes = {"ending": self.ending.value, **{name: getattr(self, name) for name in names}}
        notes["warnings"] = " ".join(self.warnings) or "none"
        return labelled_dataset("fit", variables, labels, tuple(notes.items()))

    @property
    def ending(self) -> Ending:
        """Reason why the best search ended; ``ending.value`` is a text."""
        return self.best.ending

    @property
    def coordinates(self) -> Float[np.ndarray, " p"]:
        """Coordinates of the estimates, (p,)."""
        return self.best.best.coordinates

    @property
    def estimates(self) -> dict[str, float]:
        """Estimated value of each parameter by name, in `units`."""
        return values_at(self.parameters, self.coordinates)

    @property
    def correlated(self) -> list[str]:
        """Names of the series whose residuals are correlated, with a `whiteness` below 0.001. Empty
        if the best run failed, because then `residuals` has meaningless rows."""
        reached = self.best.best.result == RESULTS.successful
        return [name for name, p in self.whiteness.items() if reached and p < UNCORRELATED]

    @cached_property
    def widening(self) -> Float[np.ndarray, " p"]:
        """Factor, 1 or more, by which the correlation of residuals widens the standard error of
        each coordinate, (p,).

        It is 1 if no series is `correlated`. Otherwise the covariance of the coordinates follows
        from the Jacobian J and the covariance R of the residuals: (J^T J)^-1 J^T R J (J^T J)^-1. In
        R, a series with correlated residuals has the autocovariances of an autoregressive process
        that is fitted to them; other series have the stated noise.
        """
        if not self.correlated:
            return np.ones(len(self.parameters))
        stated = self.best.best.covariance  # (J^T J)^-1
        middle = np.zeros_like(stated)  # J^T R J, a sum over the series
        for name, rows in self._jacobians.items():
            noise, count = self._correlated_noise.get(name), len(rows)
            if noise is None:
                middle += rows.T @ rows
                continue
            of_series = noise.gradient_covariance(rows)
            # The fit has reduced the sum of the squared residuals, from which the noise is
            # estimated, by about that of `lost` samples. Without correlation, this is the number of
            # parameters, divided among the series.
            lost = float(np.trace(stated @ of_series)) / noise.variance
            middle += of_series * count / max(count - lost, LEAST_FREEDOM * count)
        errors = np.sqrt(np.diag(stated))
        actual = np.sqrt(np.maximum(np.diag(stated @ middle @ stated), 0.0))
        return np.maximum(actual / errors, 1.0)

    @cached_property
    def _correlated_noise(self) -> dict[str, statistics.CorrelatedNoise]:
        return {name: statistics.correlated_noise(self.residuals[name]) for name in self.correlated}

    @property
    def _interval_widening(self) -> Float[np.ndarray, " p"]:
        """Factor, (p,), by which each interval is widened: 1 where `widening` is 1, else `widening`
        times a factor of Student's distribution, because the variance of correlated noise is
        estimated from few independent samples."""
        noises = self._correlated_noise.values()
        fewest = min((noise.effective for noise in noises), default=math.inf)
        factor = statistics.student_factor(fewest) if math.isfinite(fewest) else 1.0
        return np.where(self.widening > 1.0, factor * self.widening, 1.0)

    @cached_property
    def covariance(self) -> Float[np.ndarray, "p p"]:
        """Covariance of the coordinates, (p, p): that for the stated noise, with standard errors
        multiplied by `widening`."""
        return self.best.best.covariance * np.outer(self.widening, self.widening)

    @cached_property
    def value_covariance(self) -> Float[np.ndarray, "p p"]:
        """Covariance of the values, (p, p), in products of `units`, by the slopes of the scales at
        the estimates."""
        pairs = zip(self.parameters.values(), self.coordinates, strict=True)
        slopes = [float(parameter.scale.slope(u)) for parameter, u in pairs]
        return self.covariance * np.outer(slopes, slopes)

    @property
    def correlation(self) -> Float[np.ndarray, "p p"]:
        """Correlation of the estimated coordinates, (p, p)."""
        return information.correlation(self.covariance)

    @property
    def standard_errors(self) -> dict[str, float]:
        """Standard deviation of each estimated value by name, in `units`."""
        deviations = np.sqrt(np.diag(self.value_covariance))
        return dict(zip(self.parameters, deviations.tolist(), strict=True))

    @property
    def _is_gone(self) -> np.ndarray:
        """Whether each coordinate has a standard deviation above `GONE`, (p,): on a `Log` scale,
        such an estimate is about zero or infinite."""
        return np.diag(self.covariance) > GONE**2

    @property
    def intervals(self) -> dict[str, tuple[float, float]]:
        """95 % confidence interval (low, high) of each value by name, in `units`.

        Intervals come from the first of these sources that exists:

        1. the `posterior`: its central intervals, which need not contain the estimates;
        2. the points that `check` has explored, if it has found that chi squared is not quadratic:
           all values at points whose chi squared is at most 3.84 above the lowest;
        3. the covariance: the estimate plus and minus 1.96 standard errors of the coordinate. The
           interval of a friction that may be zero is from zero to the largest friction that the
           data allow (`AbstractScale.interval`).

        Each interval is extended to contain those by the covariance at every minimum that a search
        has found with a chi squared at most 3.84 above that of the fit, except at minima in the box
        of the `posterior`. If residuals are `correlated`, each interval is widened about its
        middle, in coordinates, by `widening` times a factor of Student's distribution.
        """
        minima, posterior = [self.best.best, *self._other_minima], self.posterior
        # Minima in the posterior's box are part of the posterior.
        if posterior is not None:
            start, end = posterior.box
            minima = [m for m in minima if ((m.coordinates < start) | (m.coordinates > end)).any()]
        # Ends of the intervals in coordinates, (2, p), by the posterior or the exploration.
        explored = None
        if posterior is not None:
            pairs = zip(self.parameters.values(), posterior.intervals.values(), strict=True)
            of_posterior = [[p.scale.coordinate(end) for end in interval] for p, interval in pairs]
            explored = np.array(of_posterior).T
        elif self.check is not None and self.check.exploration is not None:
            explored = np.array(self.check.exploration.intervals())
        # Low and high ends of all intervals in values, (2, p) from each source.
        ends = self._intervals_around(minima) if minima else []
        if explored is not None:
            half = 0.5 * np.diff(explored, axis=0)[0] * self._interval_widening
            low, high = (explored.mean(axis=0) + sign * half for sign in (-1.0, 1.0))
            lows, highs = (values_at(self.parameters, u).values() for u in (low, high))
            ends.append(np.array([[*lows], [*highs]]))
        lowest, highest = np.min(ends, axis=(0, 1)).tolist(), np.max(ends, axis=(0, 1)).tolist()
        return dict(zip(self.parameters, zip(lowest, highest, strict=True), strict=True))

    def _intervals_around(self, minima: Sequence[RunMisfit]) -> list[Float[np.ndarray, "2 p"]]:
        """Return low and high ends of the values' intervals by the covariance at each minimum."""
        # If a coordinate has run towards infinity, its scale must know in which direction. If the
        # estimate is there (`_is_gone`), the direction is from the start of its search to it. The
        # searches of `check` begin near their results: for them, the first of all starts is taken.
        # If only another minimum is there, the direction is from the estimate to this minimum.
        own = next((s for s in self.searches if s is self.best), self.searches[0])
        went_up = self.coordinates > own.start
        scales = [parameter.scale for parameter in self.parameters.values()]
        ends, intervals = checking.interval_ends(minima, self.chi_squared), []
        # A parameter without any effect on the data may have any value. Its standard deviation is
        # finite, because the covariance is that of an invertible matrix.
        has_effect = self.best.best.jacobian.any(axis=0)
        for low, high in zip(ends[::2], ends[1::2], strict=True):  # two rows for each minimum
            middle, half = 0.5 * (low + high), 0.5 * (high - low) * self._interval_widening
            half = np.where(has_effect, half, math.inf)
            is_up = np.where(self._is_gone, went_up, middle > self.coordinates)
            rows = zip(scales, middle, half, is_up, strict=True)
            intervals.append(np.array([scale.interval(*row) for scale, *row in rows]).T)
        return intervals

    @property
    def posterior(self) -> Posterior | None:
        """Posterior, with few points, that `check` has computed because chi squared is not
        quadratic; ``None`` if `check` has not computed one."""
        return None if self.check is None else self.check.posterior

    @property
    def rivals(self) -> list[dict[str, float]]:
        """Values of the parameters, by name, at each other minimum that fits the data about as
        well, the smallest chi squared first.

        The chi squared of such a minimum is within the joint 95 % confidence region of the best
        minimum. Around the best minimum and around each earlier one in the list, the 95 % interval
        of at least one coordinate, from the covariance there, does not contain this minimum.
        """
        minima = statistics.competing_minima(self.best.best, self._other_minima)
        return [values_at(self.parameters, minimum.coordinates) for minimum in minima]

    @cached_property
    def predictions(self) -> dict[str, np.ndarray]:
        """Predicted values of each series by name at its sample times, (N,), SI; meaningless at
        times that the fitted run does not reach (`Ending.FAILED`). Those of a quantity with a
        period, such as an angle, are within half a period of the measured values."""
        nearest = dict(self._outputs)
        for name, series in self.measurements.series.items():
            if series.period is not None:
                turns = np.round((nearest[name] - np.asarray(series.values)) / series.period)
                nearest[name] = nearest[name] - series.period * turns
        return nearest

    @property
    def _outputs(self) -> dict[str, np.ndarray]:
        """The `predictions` as the run has them: angles may jump from pi to -pi."""
        return self._at_samples(self.best.best.predicted.ravel())

    @cached_property
    def residuals(self) -> dict[str, np.ndarray]:
        """Residuals of each series by name, (N,): (prediction - value) / noise, or 1e6 at times
        that the fitted run does not reach. `chi_squared` includes these 1e6 too."""
        return self._at_samples(self.best.best.residuals)

    @cached_property
    def _jacobians(self) -> dict[str, np.ndarray]:
        return self._at_samples(self.best.best.jacobian)

    def _at_samples(self, rows: np.ndarray) -> dict[str, np.ndarray]:
        """Return, by name, the rows (N, ...) at the N sample times of each series, from `rows` of
        the shape (S T, ...): those of S series, one after the other, at all T times of the run."""
        times, series = self.measurements.times(), self.measurements.series
        parts = zip(series.items(), np.split(rows, len(series)), strict=True)
        return {name: part[np.searchsorted(times, s.times)] for (name, s), part in parts}

    @property
    def rms(self) -> dict[str, float]:
        """Root mean square of each series' residuals by name, about 1 for noise as stated."""
        return {name: _rms(row) for name, row in self.residuals.items()}

    @property
    def samples(self) -> int:
        """Total number of samples of all series."""
        return sum(len(series) for series in self.measurements.series.values())

    @property
    def chi_squared(self) -> float:
        """Sum of the squared residuals of all series."""
        return self.best.best.chi_squared

    @property
    def degrees_of_freedom(self) -> int:
        """Number of samples less the number of parameters; the expected chi squared."""
        return self.samples - len(self.parameters)

    @property
    def p_value(self) -> float:
        """Probability of at least this chi squared by noise; NaN without degrees of freedom."""
        return statistics.chi_squared_p(self.chi_squared, self.degrees_of_freedom)

    @property
    def whiteness(self) -> dict[str, float]:
        """p-value of the Ljung-Box test of each series; NaN for under 20 samples or zeros only."""
        return {name: statistics.whiteness(row) for name, row in self.residuals.items()}

    @property
    def normality(self) -> dict[str, float]:
        """p-value of the D'Agostino-Pearson test for normal residuals, of each series by name; NaN
        for fewer than 20 samples and for equal residuals."""
        return {name: statistics.normality(row) for name, row in self.residuals.items()}

    @property
    def warnings(self) -> list[str]:
        """Sentences on problems of the fit; an empty list if there are none."""
        problems = *self._problems(), *self._uncertain_directions(), *self._noise()
        return [*self._correlation(), *self.doubts, *problems]

    @cached_property
    def advice(self) -> list[str]:
        """Sentences on remedies, in the order in which to try them; empty unless the best run
        fails, or residuals are more than twice the stated noise (the square root of chi squared per
        degree of freedom is above 2)."""
        # Without degrees of freedom, residuals say nothing about the model.
        scatter = self._scatter if self.degrees_of_freedom > 0 else 0.0
        fits_well = not scatter > FAR and self.ending is not Ending.FAILED
        return [] if fits_well else list(_remedies(self, scatter))

    @override
    def __str__(self) -> str:
        # Whether the covariance is valid comes first, and is left out of the warnings at the end: a
        # warning of correlated residuals, if any, and the result of the test by further runs.
        on_test = [] if self.check is None else [self._test_report()]
        on_covariance = [*self._correlation(), *on_test]
        series, end = len(self.measurements.series), self.measurements.times()[-1]
        parts = [
            f"Fit of {self.samples} samples in {series} series to {end:g} s: "
            f"{self.ending.value}, {self.best.evaluations} runs",
            *on_covariance,
            estimates_table(self.estimates, self.standard_errors, self.intervals, self.units),
            f"chi squared {self.chi_squared:.6g} with {self.degrees_of_freedom} degrees of "
            f"freedom, p = {self.p_value:.2g}",
            _series_table(self),
        ]
        if len(self.parameters) > 1:
            rows = [["correlation", *self.parameters]]
            for name, row in zip(self.parameters, self.correlation, strict=True):
                rows.append([name, *(f"{number:.4f}" for number in row)])
            parts.append("\n".join(aligned(rows)))
        if len(self.searches) > 1:
            parts.append(_searches_table(self))
        rest = [warning for warning in self.warnings if warning not in on_covariance]
        parts.append("\n".join(f"Warning: {warning}" for warning in rest))
        if self.advice:
            parts.append("Remedies, in this order:\n" + numbered(self.advice))
        return "\n\n".join(part for part in parts if part)

    def _test_report(self) -> str:
        """Sentences on `check`, which must not be ``None``: whether chi squared rises as the
        covariance predicts and, if not, where the intervals come from."""
        assert self.check is not None
        check, test, explored = self.check, self.check.test, self.check.exploration
        cost = f"{check.runs} runs around the estimates, {duration(check.seconds)}"
        if explored is None:  # the test has passed
            return (
                f"The covariance was tested up to 4 standard errors away ({cost}): chi squared "
                "rises as predicted."
            )
        # An exploration was made, so at least one point differs from the prediction.
        bad = test.differing
        worst = int(np.argmax(np.where(bad, np.abs(test.actual - test.predicted), 0.0)))
        result = (
            f"at {bad.sum()} of {len(bad)} points up to 4 standard errors away, chi squared does "
            f"not rise as the covariance predicts (in the worst case by {test.actual[worst]:.3g} "
            f"instead of {test.predicted[worst]:.3g})"
        )
        number = f"{check.minima} {'minimum' if check.minima == 1 else 'minima'}"
        source = f"all points with a chi squared at most 3.84 above the lowest, with {number}"
        # The first explored point is the end of the search, and `best` the minimum to which the fit
        # has moved since.
        moved = float(explored.chi_squared[0]) - self.chi_squared
        # Standard errors are still right if there is one minimum, and the exploration found
        # intervals of about their width. The exploration is trusted if the intervals no longer
        # grew, and if integration errors change chi squared by at most 1, as much as a displacement
        # by one standard error does. The test tolerates a decrease of chi squared up to `FLOOR`,
        # which is no move to another minimum.
        single = check.minima == 1 and moved <= checking.FLOOR
        reliable = explored.settled and abs(check.difference) <= 1.0
        at_estimates = self.best.best  # the run that has the covariance
        alike = single and reliable and check.widening(at_estimates) < ALIKE
        head = "Chi squared is rough" if alike else "Standard errors are not valid"
        if check.posterior is not None:
            intervals = (
                f"The intervals are those of a posterior by {check.posterior.runs} more runs "
                f"without derivatives, {duration(check.posterior.seconds)}, around the lowest of "
                f"{number} ({cost})."
            )
        else:
            intervals = f"The intervals {'agree with those from' if alike else 'contain'} {source}"
            intervals += f" ({cost})."
        parts = [f"{head}: {result}. {intervals}"]
        if alike:
            parts.append("There may be lower minima farther away.")
        if moved > checking.FLOOR:
            parts.append(
                f"The fit has moved to a minimum whose chi squared is {moved:.3g} lower than "
                "at the end of the search."
            )
        return " ".join([*parts, *self._interval_doubts(check, explored)])

    def _interval_doubts(
        self, check: LikelihoodCheck, explored: checking.Exploration
    ) -> Iterator[str]:
        """Sentences on possible reasons why the intervals from an exploration are wrong: a record
        beyond the horizon, an exploration that has not settled, and integration errors."""
        # Of the horizon by runs around the estimates and the predicted one, the earlier counts.
        until = check.test.horizon
        if self.horizon is not None:
            until = min(until, self.horizon.single_shot)
        if math.isfinite(until):
            past = sum(int((s.times >= until).sum()) for s in self.measurements.series.values())
            yield (
                f"{past} of {self.samples} samples, from {until:.4g} s on, lie beyond the horizon "
                "of a fit by a single run."
            )
        if not explored.settled and check.posterior is None:
            yield (
                "The exploration ended when it had cost as much as the fit itself, before the "
                f"intervals were final: pass check_runs={checking.MOST_NUMBER}, or shorten the "
                "record."
                if check.bounded
                else "The intervals were still growing: increase check_runs, or shorten the record."
            )
        # A rise of chi squared by 1 is that of a displacement by one standard error.
        if abs(check.difference) > 1.0:
            yield (
                f"Integration errors change chi squared by {check.difference:.2g}: reduce rtol, or "
                "shorten the record."
            )

    @property
    def doubts(self) -> list[str]:
        """Sentences on a failed test of the covariance; empty if it passed or was not made."""
        return [] if self.check is None or self.check.passed else [self._test_report()]

    def _correlation(self) -> Iterator[str]:
        if not self.correlated:
            return
        largest, probabilities = float(self.widening.max()), self.whiteness
        series = ", ".join(f"{name!r} (p = {probabilities[name]:.2g})" for name in self.correlated)
        cause = "the noise is coloured, or the model or a sensor lacks an effect"
        # The advice, if there is any, contains this sentence already.
        faults = [] if self.advice else [*_sensor_faults(self)]
        text = (
            f"Residuals are not white in {series}: {cause}. Standard errors and intervals allow "
            f"for the correlation of neighbouring samples, and are up to {largest:.3g} times as "
            "large as for independent noise of the stated size. They don't allow for an error of "
            "the estimates due to a missing effect."
        )
        yield " ".join([text, *faults])

    def _problems(self) -> Iterator[str]:
        if self.ending is not Ending.CONVERGED:
            yield f"Not converged: {self.ending.value}."
        if self.screened and not self.screened[-1].complete:
            end = self.screened[-1].times[-1]
            yield f"Screening reached only {end:.4g} s: increase its rounds."
        others = statistics.competing_minima(self.best.best, self._other_minima)
        for rival in others[:SHOWN]:
            values = values_at(self.parameters, rival.coordinates).items()
            yield (
                f"Another minimum is only {rival.chi_squared - self.chi_squared:.2g} higher in chi "
                "squared, at "
                + ", ".join(f"{name} {value:.5g}" for name, value in values)
                + ": the data do not decide between them."
            )
        if len(others) > SHOWN:
            yield f"{len(others) - SHOWN} more minima are in Fit.rivals."
        # An estimate with a huge deviation (`_is_gone`) is at zero or infinity if its interval is.
        for (name, (low, high)), gone in zip(self.intervals.items(), self._is_gone, strict=True):
            scale, value = self.parameters[name].scale, self.estimates[name]
            if isinstance(scale, Bounded):
                for bound in (scale.low, scale.high):
                    if abs(value - bound) < AT_BOUND * (scale.high - scale.low):
                        yield f"{name} is at its bound {bound:g}."
            elif gone and (low == 0.0 or math.isinf(high)):
                yield f"{name} is {limit_text(low, high, self.units[name])}"

    @property
    def _other_minima(self) -> list[RunMisfit]:
        """Minima that searches other than the best one have found: they converged there or, where
        chi squared is rough, stalled."""
        searches = (*self.searches, *(() if self.check is None else self.check.searches))
        in_minimum = Ending.CONVERGED, Ending.STALLED
        return [s.best for s in searches if s is not self.best and s.ending in in_minimum]

    def _uncertain_directions(self) -> Iterator[str]:
        """A warning for each combination of parameters that the data hardly determine: a change
        along it by one standard deviation changes a coordinate by more than the scale's `max_step`
        or, if that is infinite, by more than the coordinate's magnitude."""
        limits = step_limits(self.parameters)
        # A coordinate near zero is thus reported too, even if its error is small in its unit. A
        # fixed size would never report parameters whose usual values are small, such as clearances.
        sizes = np.where(np.isfinite(limits), limits, np.abs(self.coordinates))
        for change, deviation in statistics.directions(self.best.best.jacobian):
            if np.any(deviation * np.abs(change) > sizes):
                # Parameters with a negligible part in the combination are not named.
                pairs = zip(change, self.parameters, strict=True)
                combination = " ".join(f"{w:+.3g} {name}" for w, name in pairs if abs(w) > 1e-3)
                yield (
                    f"The data hardly determine the combination {combination} (standard deviation "
                    f"{deviation:.2g}, in the coordinates of the scales)."
                )

    @property
    def _scatter(self) -> float:
        """Residuals in multiples of the stated noise: sqrt(chi squared / degrees of freedom)."""
        return math.sqrt(self.chi_squared / self.degrees_of_freedom)

    def _noise(self) -> Iterator[str]:
        if self.degrees_of_freedom > 0:
            ratio = f"Residuals are {self._scatter:.3g} times the stated noise"
            if self.p_value < statistics.UNLIKELY:
                yield f"{ratio}: the noise is understated, or the model lacks an effect."
            elif self.p_value > 1.0 - statistics.UNLIKELY:
                yield f"{ratio}: the noise is overstated."


def limit_text(low: float, high: float, unit: str) -> str:
    """Return a text on the 95 % interval from `low` to `high`, which begins at zero or ends at
    infinity: for example "at most 0.1 N m (95 %): a smaller value fits as well."."""
    if low in (0.0, -math.inf) and math.isinf(high):
        return "not determined by the data: any value fits as well."
    limit, others = f"at most {high:.3g}", "smaller"
    if math.isinf(high):
        limit, others = f"at least {low:.3g}", "larger"
    return f"{limit}{'' if unit == '1' else ' ' + unit} (95 %): a {others} value fits as well."


def _series_table(fit: Fit) -> str:
    rows = [["series", "samples", "rms / noise", "p (white)", "p (normal)"]]
    rms, white, normal = fit.rms, fit.whiteness, fit.normality
    for name, row in fit.residuals.items():
        tests = f"{white[name]:.2g}", f"{normal[name]:.2g}"
        rows.append([name, str(len(row)), f"{rms[name]:.3f}", *tests])
    return "\n".join(aligned(rows))


def _searches_table(fit: Fit) -> str:
    # A star marks the fit's best search.
    rows = [["start", "chi squared", "runs", "ended"]]
    for number, search in enumerate(fit.searches):
        mark = " *" if search is fit.best else ""
        chi_squared, runs = f"{search.best.chi_squared:.6g}", str(search.evaluations)
        rows.append([f"{number}{mark}", chi_squared, runs, search.ending.value])
    table = "\n".join(aligned(rows))
    if not fit.screened:
        return table
    runs = sum(screening.runs for screening in fit.screened)
    rounds = sum(len(screening.times) for screening in fit.screened)
    return f"starts from screening by {runs} runs in {rounds} rounds:\n{table}"


def _remedies(fit: Fit, scatter: float) -> Iterator[str]:
    """Sentences on remedies for a poor fit, the cheapest and most likely first; `scatter` is the
    size of the residuals in multiples of the stated noise, 0 without degrees of freedom."""
    # A missing effect would leave a trace in the residuals, which would then be correlated.
    if all(statistics.whiteness(row) > UNCORRELATED for row in fit.residuals.values()):
        yield (
            "Residuals are white: the model fits, and the noise may be understated. If the sensors "
            f"can be that noisy, state a noise {scatter:.3g} times as large."
        )
    sizes = fit.rms
    worst = max(sizes, key=lambda name: sizes[name])
    others = [size for name, size in sizes.items() if name != worst]
    # The size of residuals at times that a failed run does not reach has no meaning.
    reached = fit.best.best.result == RESULTS.successful
    # If the model fits all other series, the fault is probably in the sensor of this one.
    if reached and others and max(others) <= GOOD:
        yield (
            f"Only series {worst!r} does not fit: its residuals are {sizes[worst]:.3g} times its "
            "noise. Check its unit, sign, axes and noise, and the position of the sensor."
        )
    if reached:
        yield from _sensor_faults(fit)
        yield from _outliers(fit)
    yield from _shorter_records(fit)
    if len(fit.searches) == 1 and not fit.screened:
        yield (
            "Search from several starts, by starts=cj.Starts(8). If impacts make chi squared "
            "rough, screen starts without derivatives, by starts=cj.Screening(...)."
        )
    else:
        # Searches that end in one minimum differ in chi squared by less than a hundredth.
        ends = [search.best.chi_squared for search in fit.searches]
        single = "all in one minimum. The model probably lacks an effect."
        several = "in several minima. Use more starts, or a wider spread."
        yield (
            f"The {len(ends)} searches ended at chi squared from {min(ends):.3g} to "
            f"{max(ends):.3g}: {single if max(ends) < 1.01 * min(ends) else several}"
        )
    if fit.ending is Ending.EXHAUSTED:
        number = fit.best.evaluations
        yield f"The search had not converged after {number} runs: increase max_iterations."
    if not any(isinstance(p.variation, StateNumber) for p in fit.parameters.values()):
        yield (
            "Estimate the initial state too, unless it is known more accurately than the noise, "
            'for example by cj.Parameter.initial(lambda state: state.bodies["..."].spin[2]).'
        )


def _explanation(
    residuals: Float[np.ndarray, " M"], part: slice, effects: Mapping[Kind, Float[np.ndarray, " M"]]
) -> tuple[float, dict[Kind, float], float]:
    """Find a few errors of a sensor that together explain most of the misfit of its series.

    Kinds of errors, such as a bias, are added one by one, each time the one that makes the
    residuals smallest, until together they explain the share `MOST` of the series' chi squared.
    `residuals` are those of all series, `part` the rows of the sensor's series, and `effects` the
    derivatives of `residuals` by an error of each kind.

    **Returns:** the decrease of the chi squared of all series; by chosen kind, the error's value
    less that of an ideal sensor; and the share of the series' chi squared that the errors explain.
    All are zero or empty if even all kinds together explain less than `MOST`.
    """
    chosen: list[Kind] = []
    before = float(np.sum(residuals[part] ** 2))  # Chi squared of the series.

    def fitted(kinds: Sequence[Kind]) -> tuple[np.ndarray, np.ndarray]:
        """Return the size of an error of each of these `kinds`, by least squares, and the residuals
        of all series that remain with these errors."""
        columns = np.stack([effects[kind] for kind in kinds], axis=1)
        # Columns of unit length, so that the cutoff does not depend on the units of the errors.
        sizes = np.linalg.norm(columns, axis=0)
        smallest = information.LEAST_SINGULAR_VALUE
        # Minus: the errors cancel the residuals.
        values = -np.linalg.lstsq(columns / sizes, residuals, rcond=smallest)[0] / sizes
        return values, residuals + columns @ values

    while len(chosen) < len(effects):
        others = [kind for kind in effects if kind not in chosen]
        chosen.append(min(others, key=lambda kind: float(np.sum(fitted([*chosen, kind])[1] ** 2))))
        values, remaining = fitted(chosen)
        explained = 1.0 - float(np.sum(remaining[part] ** 2)) / before
        if explained > MOST:
            decrease = float(np.sum(residuals**2) - np.sum(remaining**2))
            return decrease, dict(zip(chosen, values.tolist(), strict=True)), explained
    return 0.0, {}, 0.0


def _effects_of_errors(fit: Fit, name: str) -> dict[Kind, Float[np.ndarray, " N"]]:
    """Derivatives of the residuals of the series `name` by each kind of error of its sensor, at the
    values of an ideal sensor."""
    series = fit.measurements[name]
    quantity, times = fit._outputs[name], np.asarray(series.times)
    # For each sample, the predicted value and the time since the start of the run.
    instants = [*zip(quantity.tolist(), (times - fit.start_time).tolist(), strict=True)]
    # A delayed sensor reads an earlier value of the quantity, hence the minus.
    period = series.period
    continuous = quantity if period is None else np.unwrap(quantity, period=period)
    effects: dict[Kind, np.ndarray] = {SeriesDelay: -np.gradient(continuous, times)}
    for kind in (variations.SeriesBias, variations.SeriesGain, variations.SeriesDrift):
        fault = kind((name,))
        # The reading is linear in the error: its derivative is the effect of one unit.
        unit_error = kind.neutral + 1.0
        effects[kind] = np.array([fault.error(unit_error, *instant) for instant in instants])
    return {kind: effect / np.asarray(series.noise) for kind, effect in effects.items()}


def _sensor_faults(fit: Fit) -> Iterator[str]:
    """A sentence on a series whose misfit is mostly explained by a few errors of its sensor, if
    there is such a series; of several, on the one whose errors lower total chi squared the most."""
    residuals = np.concatenate([*fit.residuals.values()])
    jacobian = np.concatenate([*fit._jacobians.values()])
    # Orthonormal basis of the changes of residuals that the fit's parameters can make. The small
    # number avoids a division by the zero norm of a parameter without effect.
    basis = np.linalg.qr(jacobian / np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300))[0]
    of_parameters = [parameter.variation for parameter in fit.parameters.values()]
    errors = [error for error in of_parameters if isinstance(error, AbstractSeriesVariation)]
    estimated = {(type(error), series) for error in errors for series in error.series}
    # The best explanation so far: its decrease of chi squared, series, errors and share.
    most, name, values, explained = 0.0, "", {}, 0.0
    end = 0
    for series, row in fit.residuals.items():
        part = slice(end, end + len(row))  # Rows of this series among those of all series.
        end = part.stop
        # Too few samples don't tell one cause from another.
        if len(row) < PIECES or not (_rms(row) > FAR or series in fit.correlated):
            continue
        effects = {}
        for kind, effect in _effects_of_errors(fit, series).items():
            column = np.zeros(len(residuals))
            column[part] = effect
            # Wrong estimates compensate for a part of the error. The other part is in the residuals
            # of all series, and is taken here. With the whole, the error would seem smaller.
            column -= basis @ (basis.T @ column)
            if (kind, series) not in estimated and np.linalg.norm(column) > 0.0:
                effects[kind] = column
        decrease, faults, share = _explanation(residuals, part, effects)
        if decrease > most:
            name, most, values, explained = series, decrease, faults, share
    if not values:  # No series is explained by errors of its sensor.
        return
    unit = fit.measurements[name].unit
    described, remedies = [], []
    for kind, value in values.items():
        value_unit = kind((name,)).unit_of(unit)
        size = f"{kind.neutral + value:.3g}" + ("" if value_unit == "1" else f" {value_unit}")
        described.append(f"a {kind.noun} of {size}")
        remedies.append(f"cj.Parameter.{kind.noun}({name!r})")
    device = "clock and trigger" if [*values] == [SeriesDelay] else "sensor"
    yield (
        f"Series {name!r} differs from the motion as if its {device} had "
        f"{' and '.join(described)}, which would explain {explained:.0%} of its misfit: "
        f"check the {device}, or estimate it, by {' and '.join(remedies)} among the parameters."
    )


def _outliers(fit: Fit) -> Iterator[str]:
    """A sentence if the largest residuals contribute most of chi squared."""
    squares = np.concatenate(list(fit.residuals.values())) ** 2
    count = max(int(OUTLIER_SHARE * len(squares)), 1)
    largest = np.sort(squares)[::-1][:count]
    # Of few samples, the largest few would often contribute most, also without outliers.
    if len(squares) >= PIECES and largest.sum() >= MOST * squares.sum():
        name, worst = max(fit.residuals.items(), key=lambda item: float(np.abs(item[1]).max()))
        time = float(fit.measurements[name].times[np.argmax(np.abs(worst))])
        yield (
            f"{count} of {len(squares)} samples contribute "
            f"{largest.sum() / squares.sum():.0%} of chi "
            f"squared, the worst at {time:.6g} s in {name!r}: remove outliers, or state a larger "
            "noise for these samples. Times of impact peaks are the first to deviate."
        )


def _shorter_records(fit: Fit) -> Iterator[str]:
    """Sentences that advise to fit a shorter record or growing windows, or to use `fit_horizon`."""
    all_series, horizon = fit.measurements.series, fit.horizon
    times = np.concatenate([np.asarray(s.times) for s in all_series.values()])
    rows = np.concatenate([fit.residuals[name] for name in all_series])
    start, end = float(times.min()), float(times.max())
    edges = np.linspace(start, end, PIECES + 1)
    # The run fits the data up to the first piece of the record with large residuals.
    pieces = ((low, (times >= low) & (times <= high)) for low, high in pairwise(edges))
    until = float(next((low for low, inside in pieces if _rms(rows[inside]) > FAR), edges[-1]))

    def at(time: float) -> str:  # with digits for the record's length, wherever it begins
        return f"{round(float(time), 4 - math.floor(math.log10(end - start or 1.0))):.12g}"

    # With large residuals from the first piece on, no part of the record fits.
    if until == start < end:
        length = (end - start) / PIECES
        wrong = "the scene, the initial state or a unit is wrong, not the value of a parameter"
        if len(fit.best.windows) > 1:
            yield (
                "The run deviates from the data from the first samples on, although windows of the "
                "record were fitted first: begin with a shorter one, by grow=("
                f"{at(start + length)}, ...). If that fails too, {wrong}."
            )
        else:
            # The first window is one piece, and each further one is twice as long.
            grow = ", ".join(at(start + length * 2**k) for k in range(DOUBLINGS))
            yield (
                "The run deviates from the data from the first samples on: fit growing windows of "
                "the record, from which a search converges from farther away, by "
                f"identify(..., grow=({grow})). If the data up to {at(start + length)} s do not "
                f"fit either, {wrong}."
            )
    elif until < end:
        # The first window is the part that fits, and the next ones are longer in small steps.
        ends = until + (end - until) * np.array([0.0, 0.25, 0.5])
        grow = ", ".join(map(at, ends))
        yield (
            f"The run follows the data up to {at(until)} s and deviates afterwards: fit growing "
            f"windows of the record, by identify(..., grow=({grow}))."
        )
    if horizon is None:
        yield (
            "Compute the longest record that a single run can fit, by "
            "cj.fit_horizon(scene, state, parameters, measurements, uncertainty=...)."
        )
    elif end >= horizon.single_shot:
        yield (
            f"The record ends at {at(end)} s, but a single run can only fit a record that ends "
            f"before {at(horizon.single_shot)} s: shorten the record, or fit growing windows, of "
            "which the first ends before this time, by grow=[...]."
        )


def _rms(row: Float[np.ndarray, " N"]) -> float:
    return math.sqrt(float(np.mean(row**2))) if len(row) else 0.0

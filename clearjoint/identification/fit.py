"""The result of an identification."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from ..export.labelled import Labelled, labelled_dataset, texts
from ..export.tabular import AbstractTabular
from ..information import fisher_information as information
from ..information.horizon import FitHorizon
from ..measurements.series import Measurements
from ..model.bodies import State
from ..model.scene import Scene
from ..parametrisation.parameter import Parameter
from ..parametrisation.scales import Bounded
from . import goodness_of_fit as statistics
from . import likelihood, rivals
from .advice import Evidence
from .checking import LikelihoodCheck
from .levenberg_marquardt import Ending
from .report import (
    correlation_table,
    estimates_table,
    numbered,
    searches_table,
    series_table,
)
from .residuals import RunMisfit
from .screening.screening import Screened
from .searches import Search

if TYPE_CHECKING:
    import xarray as xr

AT_BOUND = 1e-3
"""Distance from a bound, over that between the bounds, below which an estimate is at the bound."""

ALIKE = 1.3
"""Factor between intervals up to which they count as alike."""
SHOWN = 3
"""Other minima that the report lists."""


@dataclass(frozen=True)
class Fit(AbstractTabular):
    """Estimates, how sure they are, and what they leave unexplained.

    - `scene`, `state`: with the estimates in their places.
    - `parameters`, `units`: by name, in the order of all arrays.
    - `measurements`: those that were fitted.
    - `searches`: one from each start; `best`: the one with the smallest chi squared, of these and
      of those of `check`.
    - `screened`: the starts that each pass of a `Screening` left.
    - `horizon`: the one given, or ``None``.
    - `check`: the test of the covariance by runs around the estimates, or ``None`` without one.

    `to_xarray`, `to_dataframe`, `to_csv` and `to_netcdf` give estimates, errors and correlations.

    >>> data = cj.Series(x, times, 0.1 * np.cos(10.0 * times), noise=1e-4)
    >>> fit = cj.identify(
    ...     scene,
    ...     state,
    ...     cj.Measurements({"x": data}),
    ...     {"stiffness": stiffness},
    ...     guess={"stiffness": 90.0},
    ...     progress=False,
    ... )
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

    def to_xarray(self) -> "xr.Dataset":
        """An `xarray.Dataset` along "parameter": `estimate`, `standard_error` and the bounds of the
        95 % `interval` in the `unit` of each, and the `correlation` along "with"; chi squared and
        the ending are attributes. See `AbstractTabular`."""
        names = [*self.parameters]
        along, errors = ("parameter",), self.standard_errors
        variables = {
            "estimate": Labelled(along, [self.estimates[name] for name in names]),
            "standard_error": Labelled(along, [errors[name] for name in names]),
            "interval": Labelled((*along, "bound"), [self.intervals[name] for name in names]),
            "correlation": Labelled((*along, "with"), self.correlation),
        }
        labels = {
            "parameter": Labelled(along, texts(names)),
            "unit": Labelled(along, texts([self.units[name] for name in names])),
            "bound": Labelled(("bound",), texts(["low", "high"])),
            "with": Labelled(("with",), texts(names)),
        }
        notes = {
            "ending": self.ending.value,
            "chi_squared": self.chi_squared,
            "degrees_of_freedom": self.degrees_of_freedom,
            "p_value": self.p_value,
            "warnings": " ".join(self.warnings) or "none",
        }
        return labelled_dataset("fit", variables, labels, tuple(notes.items()))

    @property
    def ending(self) -> Ending:
        """How the search ended; its value says it in words."""
        return self.best.ending

    @property
    def coordinates(self) -> Float[np.ndarray, " p"]:
        """Coordinates (p,) of the estimates."""
        return self.best.best.coordinates

    @property
    def estimates(self) -> dict[str, float]:
        """Values of the parameters."""
        return self._values(self.coordinates)

    @cached_property
    def covariance(self) -> Float[np.ndarray, "p p"]:
        """Covariance (p, p) of the coordinates, if the noise is as stated."""
        return statistics.parameter_covariance(self.best.best.jacobian)

    @cached_property
    def value_covariance(self) -> Float[np.ndarray, "p p"]:
        """Covariance (p, p) of the values, by the slopes of the scales."""
        scales = [parameter.scale for parameter in self.parameters.values()]
        slopes = [float(s.slope(u)) for s, u in zip(scales, self.coordinates, strict=True)]
        return self.covariance * np.outer(slopes, slopes)

    @property
    def correlation(self) -> Float[np.ndarray, "p p"]:
        """Correlation (p, p) of the coordinates."""
        return information.correlation(self.covariance)

    @property
    def standard_errors(self) -> dict[str, float]:
        """Standard deviation of each value."""
        deviations = np.sqrt(np.diag(self.value_covariance))
        return dict(zip(self.parameters, deviations.tolist(), strict=True))

    @property
    def intervals(self) -> dict[str, tuple[float, float]]:
        """95 % confidence interval of each value, within the bounds of its scale.

        It also covers other minima in which searches ended, as far as their chi squared allows, and
        where `check` has explored chi squared, all points at which it is at most 3.84 above the
        lowest.
        """
        ends = rivals.intervals(self.best.best, self._other_minima)
        if self.check is not None and self.check.exploration is not None:
            explored = self.check.exploration.intervals()
            ends = np.minimum(ends[0], explored[0]), np.maximum(ends[1], explored[1])
        low, high = map(self._values, ends)
        return {name: (low[name], high[name]) for name in self.parameters}

    @property
    def rivals(self) -> list[dict[str, float]]:
        """Values of the parameters at other minima that fit the data about as well as the best,
        although they lie outside its own intervals; the one with the smallest chi squared first."""
        minima = rivals.rivals(self.best.best, self._other_minima)
        return [self._values(minimum.coordinates) for minimum in minima]

    @cached_property
    def predictions(self) -> dict[str, np.ndarray]:
        """The fitted run at the times of each series, (N,), SI."""
        times = self.measurements.times()
        rows = zip(self.measurements.series.items(), self.best.best.predicted, strict=True)
        return {name: row[np.searchsorted(times, s.times)] for (name, s), row in rows}

    @cached_property
    def residuals(self) -> dict[str, np.ndarray]:
        """(Prediction - value) / noise of each series, (N,)."""
        series = self.measurements.series
        return {n: np.asarray(series[n].residuals(row)) for n, row in self.predictions.items()}

    @property
    def rms(self) -> dict[str, float]:
        """Root mean square of each series' residuals: 1 if the noise is as stated."""
        return {n: math.sqrt(float(np.mean(row**2))) for n, row in self.residuals.items()}

    @property
    def samples(self) -> int:
        """Number of samples in all series."""
        return sum(len(series) for series in self.measurements.series.values())

    @property
    def chi_squared(self) -> float:
        """Sum of the squared residuals."""
        return self.best.best.chi_squared

    @property
    def degrees_of_freedom(self) -> int:
        """Degrees of freedom: samples less parameters."""
        return self.samples - len(self.parameters)

    @property
    def p_value(self) -> float:
        """Probability of so large a chi squared if noise and model are right."""
        return statistics.chi_squared_p(self.chi_squared, self.degrees_of_freedom)

    @property
    def whiteness(self) -> dict[str, float]:
        """Probability of so much autocorrelation in white noise, of each series (Ljung-Box)."""
        return {name: statistics.whiteness(row) for name, row in self.residuals.items()}

    @property
    def normality(self) -> dict[str, float]:
        """Probability of such skewness and kurtosis in normal noise, of each series."""
        return {name: statistics.normality(row) for name, row in self.residuals.items()}

    @property
    def warnings(self) -> list[str]:
        """Sentences on what speaks against the estimates; none if nothing does."""
        return [
            *self.doubts,
            *self._of_search(),
            *self._of_rivals(),
            *self._at_bounds(),
            *self._unseen(),
            *self._of_noise(),
        ]

    @cached_property
    def advice(self) -> list[str]:
        """Sentences on what to try, in order, with the numbers at hand, if the fit ends far above
        the noise; none if it does not."""
        scatter = (
            math.sqrt(self.chi_squared / self.degrees_of_freedom)
            if self.degrees_of_freedom > 0
            else 0.0
        )
        return Evidence(
            self.measurements,
            self.parameters,
            self.predictions,
            self.residuals,
            self.searches,
            self.best,
            scatter,
            bool(self.screened),
            self.horizon,
        ).advice()

    def __str__(self) -> str:
        """Estimates, goodness of fit, series, correlations, warnings and advice, as aligned
        tables."""
        first = [] if self.check is None else [self._of_test()]
        parts = [
            self._head(),
            *first,
            estimates_table(self.estimates, self.standard_errors, self.intervals, self.units),
            f"chi squared {self.chi_squared:.6g} with {self.degrees_of_freedom} degrees of "
            "freedom, "
            f"p = {self.p_value:.2g}",
            series_table(self.residuals, self.rms, self.whiteness, self.normality),
        ]
        if len(self.parameters) > 1:
            parts.append(correlation_table(list(self.parameters), self.correlation))
        if len(self.searches) > 1:
            parts.append(searches_table(self.searches, self.best, self.screened))
        rest = [warning for warning in self.warnings if warning not in first]
        parts.append("\n".join(f"Warning: {warning}" for warning in rest))
        if self.advice:
            parts.append("What to try, in this order:\n" + numbered(self.advice))
        return "\n\n".join(part for part in parts if part)

    def _head(self) -> str:
        series, end = len(self.measurements.series), self.measurements.times()[-1]
        return (
            f"Fit of {self.samples} samples in {series} series to {end:g} s: "
            f"{self.ending.value}, {self.best.evaluations} runs"
        )

    def _of_test(self) -> str:
        """What the runs around the estimates showed, and what was done about it."""
        assert self.check is not None
        check, test, explored = self.check, self.check.test, self.check.exploration
        cost = f"{check.runs} runs around the estimates, {check.seconds:.2g} s"
        if explored is None:
            return (
                f"The covariance was tested up to 4 standard errors away ({cost}): chi squared "
                "rises as it predicts."
            )
        bad = test.differing
        worst = int(np.argmax(np.where(bad, np.abs(test.found - test.predicted), 0.0)))
        where = (
            f"at {bad.sum()} of {len(bad)} points up to 4 standard errors away chi squared does "
            f"not rise as the covariance predicts (by {test.found[worst]:.3g} for "
            f"{test.predicted[worst]:.3g} at the worst)"
        )
        number = f"{check.minima} {'minimum' if check.minima == 1 else 'minima'}"
        source = f"of chi squared at most 3.84 above the lowest, with {number} ({cost})"
        if self._confirmed:
            parts = [
                f"Chi squared is rough: {where}. The intervals agree with those {source}; lower "
                "minima may lie beyond."
            ]
        else:
            parts = [f"Standard errors do not hold: {where}. Intervals are those {source}."]
        if self._moved > likelihood.FLOOR:
            parts.append(
                f"The fit has moved to a minimum {self._moved:.3g} lower in chi squared than the "
                "one in which the search had ended."
            )
        parts += self._past_horizon()
        if not explored.settled:
            parts.append("They were still growing: raise check_runs, or shorten the record.")
        if abs(check.difference) > 1.0:
            parts.append(
                f"Errors of the integration change chi squared by {check.difference:.2g}: tighten "
                "rtol, or shorten the record."
            )
        return " ".join(parts)

    @cached_property
    def _confirmed(self) -> bool:
        """Whether runs around the estimates lead to intervals like those by the covariance."""
        check = self.check
        if check is None or check.exploration is None:
            return check is None or check.passed
        one = check.minima == 1 and self._moved <= likelihood.FLOOR
        calm = check.exploration.settled and abs(check.difference) <= 1.0
        return one and calm and check.widening(self.best.best) < ALIKE

    @property
    def _moved(self) -> float:
        """By how much the exploration lowered chi squared."""
        assert self.check is not None and self.check.exploration is not None
        return float(self.check.exploration.chi_squared[0]) - self.chi_squared

    @property
    def doubts(self) -> list[str]:
        """What is said of the covariance where chi squared does not rise as it predicts: that runs
        around the estimates contradict it, or that they lead to the same intervals."""
        return [] if self.check is None or self.check.passed else [self._of_test()]

    def _past_horizon(self) -> list[str]:
        """A sentence on the samples that one run can't fit, if there are any."""
        assert self.check is not None
        limits = [self.check.horizon]
        if self.horizon is not None:
            limits.append(self.horizon.single_shot)
        if not math.isfinite(min(limits)):
            return []
        until = min(limits)
        past = sum(int((s.times >= until).sum()) for s in self.measurements.series.values())
        return [
            f"{past} of {self.samples} samples, from {until:.4g} s on, lie past the horizon of a "
            "fit by a single run."
        ]

    def _of_search(self) -> Sequence[str]:
        warnings = []
        if self.ending is not Ending.CONVERGED:
            warnings.append(f"Not converged: {self.ending.value}.")
        if self.screened and not self.screened[-1].complete:
            end = self.screened[-1].times[-1]
            warnings.append(f"Screening came to {end:.4g} s only: allow more rounds.")
        return warnings

    def _of_rivals(self) -> Sequence[str]:
        warnings = []
        others = rivals.rivals(self.best.best, self._other_minima)
        for rival in others[:SHOWN]:
            excess = rival.chi_squared - self.chi_squared
            values = self._values(rival.coordinates).items()
            warnings.append(
                f"Another minimum is only {excess:.2g} higher in chi squared, at "
                + ", ".join(f"{name} {value:.5g}" for name, value in values)
                + ": the data do not tell which is right."
            )
        if len(others) > SHOWN:
            warnings.append(f"{len(others) - SHOWN} more such minima are in Fit.rivals.")
        return warnings

    @property
    def _other_minima(self) -> list[RunMisfit]:
        found = (*self.searches, *(() if self.check is None else self.check.searches))
        others = [s for s in found if s is not self.best and s.ending is Ending.CONVERGED]
        return [search.best for search in others]

    def _at_bounds(self) -> Sequence[str]:
        warnings = []
        for name, parameter in self.parameters.items():
            scale, value = parameter.scale, self.estimates[name]
            if isinstance(scale, Bounded):
                near = AT_BOUND * (scale.high - scale.low)
                for bound in (scale.low, scale.high):
                    if abs(value - bound) < near:
                        warnings.append(f"{name} is at its bound {bound:g}.")
        return warnings

    def _unseen(self) -> Sequence[str]:
        """A warning for each combination of parameters that is so uncertain that one standard
        deviation changes a coordinate by more than its scale's stride."""
        warnings = []
        sizes = [
            p.scale.max_step if math.isfinite(p.scale.max_step) else abs(u)
            for p, u in zip(self.parameters.values(), self.coordinates, strict=True)
        ]
        for change, deviation in statistics.directions(self.best.best.jacobian):
            if np.any(deviation * np.abs(change) > np.array(sizes)):
                warnings.append(
                    f"The data hardly see the combination {combination(change, self.parameters)} "
                    f"(standard deviation {deviation:.2g}, in the coordinates of the scales)."
                )
        return warnings

    def _of_noise(self) -> Sequence[str]:
        if self.degrees_of_freedom < 1:
            return []
        scatter = math.sqrt(self.chi_squared / self.degrees_of_freedom)
        if self.p_value < statistics.UNLIKELY:
            return [
                f"Residuals are {scatter:.3g} times the stated noise: the noise is understated, or "
                "the model lacks something."
            ]
        if self.p_value > 1.0 - statistics.UNLIKELY:
            return [f"Residuals are {scatter:.3g} times the stated noise: it is overstated."]
        return []

    def _values(self, coordinates: Float[np.ndarray, " p"]) -> dict[str, float]:
        pairs = zip(self.parameters.items(), coordinates, strict=True)
        return {name: float(p.scale.value(u)) for (name, p), u in pairs}


def combination(
    change: Float[np.ndarray, " p"], names: Sequence[str] | dict[str, Parameter]
) -> str:
    """A combination of parameters in words, without those that hardly change along it."""
    words = [f"{part:+.3g} {name}" for part, name in zip(change, names, strict=True)]
    return " ".join(w for w, part in zip(words, change, strict=True) if abs(part) > 1e-3)

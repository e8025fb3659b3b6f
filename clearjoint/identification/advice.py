"""Advice for a fit whose residuals are far above the noise."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ..information.horizon import FitHorizon
from ..measurements.series import Measurements
from ..parametrisation.parameter import Parameter
from ..parametrisation.variations import SeriesDelay, StateNumber
from . import goodness_of_fit as statistics
from .levenberg_marquardt import Ending
from .searches import Search

FAR = 2.0
"""Ratio of residuals to stated noise above which a fit is far above the noise."""
GOOD = 1.5
"""Ratio of residuals to stated noise up to which a series counts as well fitted."""
PIECES = 20
"""Number of pieces of the record, to find the piece where the run departs from the data."""
MOST = 0.5
"""Share of chi squared above which one cause counts as the main cause."""
FEW = 0.02
"""Share of the samples that may be outliers: the largest residuals are summed over this share."""
UNCORRELATED = 1e-3
"""p-value of the test of whiteness below which residuals are not white."""


@dataclass(frozen=True)
class Evidence:
    """Results of a fit from which advice follows.

    - `measurements`, `parameters`, `searches`, `best`, `horizon`: as in `Fit`.
    - `predictions`: (N,) predicted values of each series by name, SI.
    - `residuals`: (N,) of each series by name, in standard deviations.
    - `scatter`: square root of chi squared per degree of freedom; 1 for the stated noise.
    - `screened`: whether a screening found the starts.
    """

    measurements: Measurements
    parameters: Mapping[str, Parameter]
    predictions: Mapping[str, np.ndarray]
    residuals: Mapping[str, np.ndarray]
    searches: Sequence[Search]
    best: Search
    scatter: float
    screened: bool
    horizon: FitHorizon | None

    def advice(self) -> list[str]:
        """Return sentences on remedies, the cheapest and most likely first.

        The list is empty for a fit whose residuals are about as large as the noise.
        """
        if not self.scatter > FAR and self.best.ending is not Ending.FAILED:
            return []
        parts = (
            self._white(),
            self._single_series(),
            self._delayed(),
            self._outliers(),
            self._window(),
            self._horizon(),
            self._starts(),
            self._iterations(),
            self._initial_state(),
        )
        return [sentence for sentence in parts if sentence is not None]

    def _white(self) -> str | None:
        p_values = [statistics.whiteness(row) for row in self.residuals.values()]
        if any(not p > UNCORRELATED for p in p_values):
            return None
        return (
            "Residuals are white: the model fits, and the noise may be understated. If the sensors "
            f"can be that noisy, state a noise {self.scatter:.3g} times as large."
        )

    def _single_series(self) -> str | None:
        sizes = {name: _rms(row) for name, row in self.residuals.items()}
        worst = max(sizes, key=lambda name: sizes[name])
        others = [size for name, size in sizes.items() if name != worst]
        if not others or max(others) > GOOD:
            return None
        return (
            f"Only series {worst!r} does not fit: its residuals are {sizes[worst]:.3g} times its "
            "noise. Check its unit, sign, axes and noise, and the position of the sensor."
        )

    def _delayed(self) -> str | None:
        variations = [parameter.variation for parameter in self.parameters.values()]
        estimated = {
            name for one in variations if isinstance(one, SeriesDelay) for name in one.series
        }
        for name, series in self.measurements.series.items():
            if len(series) < PIECES:
                continue
            # A small delay adds delay * rate to the residuals. Least squares gives the delay that
            # explains most of them.
            rate = np.gradient(self.predictions[name], np.asarray(series.times))
            rate = rate / np.asarray(series.noise)
            row = self.residuals[name]
            power = float(rate @ rate)
            shift = float(row @ rate) / power if power > 0.0 else 0.0
            explained = 1.0 - _rms(row - shift * rate) ** 2 / max(_rms(row) ** 2, 1e-300)
            if explained > MOST and _rms(row) > FAR:
                direction = "late" if shift > 0.0 else "early"
                remedy = (
                    "start its delay from another guess"
                    if name in estimated
                    else f"estimate its delay, by a parameter cj.Parameter.delay({name!r})"
                )
                return (
                    f"Series {name!r} seems {abs(shift):.3g} s {direction}, which would explain "
                    f"{explained:.0%} of its misfit: check its clock and its trigger, or {remedy}."
                )
        return None

    def _outliers(self) -> str | None:
        rows = np.concatenate(list(self.residuals.values())) ** 2
        count = max(int(FEW * len(rows)), 1)
        largest = np.sort(rows)[::-1][:count]
        if len(rows) < PIECES or largest.sum() < MOST * rows.sum():
            return None
        name, worst = max(self.residuals.items(), key=lambda item: float(np.abs(item[1]).max()))
        time = float(self.measurements[name].times[np.argmax(np.abs(worst))])
        return (
            f"{count} of {len(rows)} samples contribute {largest.sum() / rows.sum():.0%} of chi "
            f"squared, the worst at {time:.6g} s in {name!r}: remove outliers, or state a larger "
            "noise for these samples. Times of impact peaks are the first to deviate."
        )

    def _window(self) -> str | None:
        start, until = self._fitted_until()
        end = float(self.measurements.times()[-1])
        if until is None:
            first = start + (end - start) / PIECES
            return (
                "The run deviates from the data from the first samples on: fit only the data up to "
                f"{first:.4g} s, by measurements.between({start:.4g}, {first:.4g}). If that fails "
                "too, the scene, the initial state or a unit is wrong, not the value of a "
                "parameter."
            )
        if until >= end:
            return None
        ends = until + (end - until) * np.array([0.0, 0.25, 0.5])
        grow = ", ".join(f"{one:.4g}" for one in ends)
        return (
            f"The run follows the data up to {until:.4g} s and deviates afterwards: fit growing "
            f"windows of the record, by identify(..., grow=({grow}))."
        )

    def _fitted_until(self) -> tuple[float, float | None]:
        """Return the time of the first sample and the time up to which the run fits the data, s.

        The second time is ``None`` if even the first piece of the record does not fit.
        """
        times = np.concatenate([np.asarray(s.times) for s in self.measurements.series.values()])
        rows = np.concatenate([self.residuals[name] for name in self.measurements.series])
        edges = np.linspace(times.min(), times.max(), PIECES + 1)
        for begin, end in zip(edges, edges[1:], strict=False):
            inside = (times >= begin) & (times <= end)
            if inside.any() and _rms(rows[inside]) > FAR:
                return float(edges[0]), None if begin == edges[0] else float(begin)
        return float(edges[0]), float(edges[-1])

    def _horizon(self) -> str | None:
        end = float(self.measurements.times()[-1])
        if self.horizon is None:
            return (
                "Compute the longest record that a single run can fit, by "
                "cj.fit_horizon(scene, state, parameters, measurements, uncertainty=...)."
            )
        if end > self.horizon.single_shot:
            return (
                f"The record ends at {end:.4g} s, but a single run can fit only "
                f"{self.horizon.single_shot:.4g} s: shorten the record, or fit windows that grow "
                "from this time, by grow=[...]."
            )
        return None

    def _starts(self) -> str | None:
        if len(self.searches) == 1 and not self.screened:
            return (
                "Search from several starts, by starts=cj.Starts(8). If impacts make chi squared "
                "rough, screen starts without derivatives, by starts=cj.Screening(...)."
            )
        sizes = [search.best.chi_squared for search in self.searches]
        return (
            f"The {len(sizes)} searches ended at chi squared from {min(sizes):.3g} to "
            f"{max(sizes):.3g}: "
            + (
                "all in one minimum. The model probably lacks an effect."
                if max(sizes) < 1.01 * min(sizes)
                else "in several minima. Use more starts, or a wider spread."
            )
        )

    def _iterations(self) -> str | None:
        if self.best.ending is not Ending.EXHAUSTED:
            return None
        number = self.best.evaluations
        return f"The search had not converged after {number} runs: increase max_iterations."

    def _initial_state(self) -> str | None:
        variations = [parameter.variation for parameter in self.parameters.values()]
        if any(isinstance(one, StateNumber) for one in variations):
            return None
        return (
            "Estimate the initial state too, unless it is known more accurately than the noise, "
            'for example by cj.Parameter.initial(lambda state: state.bodies["..."].spin[2]).'
        )


def _rms(row: Float[np.ndarray, " N"]) -> float:
    return math.sqrt(float(np.mean(row**2))) if len(row) else 0.0

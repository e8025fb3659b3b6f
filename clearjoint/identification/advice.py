"""What to try, in order, when a fit ends far above the noise."""

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
"""Residuals over the stated noise from which a fit is far above it."""
GOOD = 1.5
"""Likewise, up to which a series is fitted."""
PIECES = 20
"""Pieces of the record in which one looks for where the run leaves the data."""
MOST = 0.5
"""Share of chi squared that one cause explains."""
FEW = 0.02
"""Share of the samples that are few."""
UNCORRELATED = 1e-3
"""Probability of so much autocorrelation below which residuals are not white."""


@dataclass(frozen=True)
class Evidence:
    """What a fit leaves unexplained.

    - `predictions`, `residuals`: (N,) of each series, by name; residuals in standard deviations.
    - `scatter`: residuals over the stated noise, root mean square.
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
        """Sentences on what to try, the cheapest and likeliest first; none for a fit that ends
        near the noise."""
        if not self.scatter > FAR and self.best.ending is not Ending.FAILED:
            return []
        parts = (
            self._white(),
            self._alone(),
            self._late(),
            self._outliers(),
            self._window(),
            self._horizon(),
            self._starts(),
            self._iterations(),
            self._initial_state(),
        )
        return [sentence for sentence in parts if sentence is not None]

    def _white(self) -> str | None:
        """The noise itself, where nothing but noise is left."""
        tested = [statistics.whiteness(row) for row in self.residuals.values()]
        if any(not p > UNCORRELATED for p in tested):
            return None
        return (
            f"Residuals are white: state {self.scatter:.3g} times the noise, if the sensors may "
            "have it."
        )

    def _alone(self) -> str | None:
        """One series that does not fit, between others that do."""
        sizes = {name: _rms(row) for name, row in self.residuals.items()}
        worst = max(sizes, key=lambda name: sizes[name])
        others = [size for name, size in sizes.items() if name != worst]
        if not others or max(others) > GOOD:
            return None
        return (
            f"Only series {worst!r} is off, {sizes[worst]:.3g} times its noise: check its unit, "
            "sign, axes and noise, and where the sensor is."
        )

    def _late(self) -> str | None:
        """A shift in time that explains most of a series' misfit."""
        for name, series in self.measurements.series.items():
            if len(series) < PIECES:
                continue
            rate = np.gradient(self.predictions[name], np.asarray(series.times))
            rate = rate / np.asarray(series.noise)
            row = self.residuals[name]
            power = float(rate @ rate)
            shift = float(row @ rate) / power if power > 0.0 else 0.0
            explained = 1.0 - _rms(row - shift * rate) ** 2 / max(_rms(row) ** 2, 1e-300)
            if explained > MOST and _rms(row) > FAR:
                when = "late" if shift > 0.0 else "early"
                remedy = (
                    "let its delay start from another guess"
                    if name in self._delayed
                    else f"estimate it, by a parameter cj.Parameter.delay({name!r})"
                )
                return (
                    f"Series {name!r} looks {abs(shift):.3g} s {when}, which would explain "
                    f"{explained:.0%} of its misfit: check its clock and its trigger, or {remedy}."
                )
        return None

    @property
    def _delayed(self) -> set[str]:
        """Series whose delay is among the parameters."""
        kinds = [parameter.variation for parameter in self.parameters.values()]
        return {name for kind in kinds if isinstance(kind, SeriesDelay) for name in kind.series}

    def _outliers(self) -> str | None:
        """A few samples that make most of chi squared."""
        rows = np.concatenate(list(self.residuals.values())) ** 2
        count = max(int(FEW * len(rows)), 1)
        largest = np.sort(rows)[::-1][:count]
        if len(rows) < PIECES or largest.sum() < MOST * rows.sum():
            return None
        name, worst = max(self.residuals.items(), key=lambda item: float(np.abs(item[1]).max()))
        time = float(self.measurements[name].times[np.argmax(np.abs(worst))])
        return (
            f"{count} of {len(rows)} samples make {largest.sum() / rows.sum():.0%} of chi squared, "
            f"the worst at {time:.6g} s in {name!r}: leave outliers out, or give those samples "
            "more noise; peaks of impacts move in time before anything else."
        )

    def _window(self) -> str | None:
        """Windows that grow from what is fitted."""
        start, until = self._fitted_until()
        end = float(self.measurements.times()[-1])
        if until is None:
            first = start + (end - start) / PIECES
            return (
                f"The run is off from the first samples on: fit up to {first:.4g} s alone, by "
                f"measurements.between({start:.4g}, {first:.4g}). If that fails too, the scene, "
                "the initial state or a unit is wrong, and not a parameter's value."
            )
        if until >= end:
            return None
        ends = until + (end - until) * np.array([0.0, 0.25, 0.5])
        words = ", ".join(f"{one:.4g}" for one in ends)
        return (
            f"The run follows the data up to {until:.4g} s and leaves them after: let the record "
            f"grow, by identify(..., grow=({words}))."
        )

    def _fitted_until(self) -> tuple[float, float | None]:
        """The first sample's time, and the time, s, up to which residuals are about the noise;
        ``None`` if they nowhere are."""
        times = np.concatenate([np.asarray(s.times) for s in self.measurements.series.values()])
        rows = np.concatenate([self.residuals[name] for name in self.measurements.series])
        edges = np.linspace(times.min(), times.max(), PIECES + 1)
        for begin, end in zip(edges, edges[1:], strict=False):
            inside = (times >= begin) & (times <= end)
            if inside.any() and _rms(rows[inside]) > FAR:
                return float(edges[0]), None if begin == edges[0] else float(begin)
        return float(edges[0]), float(edges[-1])

    def _horizon(self) -> str | None:
        """How long a record one run can fit."""
        end = float(self.measurements.times()[-1])
        if self.horizon is None:
            return (
                "Ask cj.fit_horizon(scene, state, parameters, measurements, uncertainty=...) how "
                "long "
                "a record a single run can fit."
            )
        if end > self.horizon.single_shot:
            return (
                f"The record ends at {end:.4g} s, and a single run can fit "
                f"{self.horizon.single_shot:.4g} s: cut it there, or fit "
                "windows that grow from there: grow=[...]."
            )
        return None

    def _starts(self) -> str | None:
        """More starts, or fewer minima."""
        if len(self.searches) == 1 and not self.screened:
            return (
                "Search from several starts, by starts=cj.Starts(8); if impacts leave no slope to "
                "follow, by starts=cj.Screening(...)."
            )
        sizes = [search.best.chi_squared for search in self.searches]
        return (
            f"The {len(sizes)} searches ended at chi squared from {min(sizes):.3g} to "
            f"{max(sizes):.3g}: "
            + (
                "all in one minimum, so that the model lacks something."
                if max(sizes) < 1.01 * min(sizes)
                else "in several minima; take more starts, or a wider spread."
            )
        )

    def _iterations(self) -> str | None:
        """More runs for a search that had not ended."""
        if self.best.ending is not Ending.EXHAUSTED:
            return None
        number = self.best.evaluations
        return f"The search was still going on after {number} runs: allow more by max_iterations."

    def _initial_state(self) -> str | None:
        """Numbers of the initial state among the parameters."""
        kinds = [parameter.variation for parameter in self.parameters.values()]
        if any(isinstance(kind, StateNumber) for kind in kinds):
            return None
        return (
            "Estimate the initial state too, if it is not known to the noise: "
            'cj.Parameter.initial(lambda state: state.bodies["..."].spin[2]), say.'
        )


def _rms(row: Float[np.ndarray, " N"]) -> float:
    return math.sqrt(float(np.mean(row**2))) if len(row) else 0.0

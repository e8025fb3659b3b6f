"""Result of a posterior: points with their modes, intervals, evidence and report."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Int
from typing_extensions import override

from ..._export.datasets import AbstractTabular, Labelled, estimate_labels, labelled_dataset
from ..._export.tables import duration, estimates_table
from ..._parametrisation.parameter import Parameter, values_of_points
from ..points import Box

if TYPE_CHECKING:
    import arviz
    import xarray as xr

EDGE, EDGE_SHARE = 0.01, 0.02
"""Distance from an end of the box, over its width, up to which a point is at the end; share of the
points at one end above which the report warns, twice that of a uniform distribution."""
EVEN = 0.1
"""Largest difference of the points' cumulative distribution from the uniform one below which they
count as filling the box evenly."""
FEWEST_EFFECTIVE = 150.0
"""Effective number of runs below which the report warns, unless at least half that of points."""


@dataclass(frozen=True)
class Posterior(AbstractTabular):
    """Result of `posterior`: points that are distributed as the posterior of p parameters.

    - `parameters`: `Parameter` by name, in the order of the p coordinates; `units` by name.
    - `coordinates`: (n, p) points, on the parameters' scales, of equal weight.
    - `log_likelihood`: (n,) logarithm of the likelihood of all measured samples at each point, with
      the normalising constants of the normal distribution.
    - `modes`: (n,) index of the separate minimum of chi squared to which each point belongs, from 0
      for the one with the most points.
    - `log_evidence`, `log_evidence_error`: logarithm of the marginal likelihood, the mean of the
      likelihood over the prior, and its standard error.
    - `effective_sample_size`: effective number of the weighted runs from which the points were
      drawn: the square of the sum of the weights over the sum of their squares. Runs at equal
      points count as one.
    - `box`: lower and upper ends (p,) of the coordinates, outside which the prior is zero.
    - `runs`: number of runs; `failed`: number of those that failed, or whose prediction was 1e6
      standard deviations off a sample, so that their likelihood is zero.
    - `steps`: number of steps, each of which includes more of the record in the likelihood.
    - `seconds`: computing time.

    >>> data = cj.Measurements({"x": cj.Series(x, times, 0.1 * np.cos(10.0 * times), noise=1e-3)})
    >>> options = {"spread": 0.3, "draws": 64, "progress": False}
    >>> found = cj.posterior(scene, state, data, {"stiffness": stiffness}, **options)
    >>> low, high = found.intervals["stiffness"]
    >>> low < 100.0 < high, found.failed, found.weights.size
    (True, 0, 1)
    """

    parameters: dict[str, Parameter]
    units: dict[str, str]
    coordinates: Float[np.ndarray, "n p"]
    log_likelihood: Float[np.ndarray, " n"]
    modes: Int[np.ndarray, " n"]
    log_evidence: float
    log_evidence_error: float
    effective_sample_size: float
    box: Box
    runs: int
    failed: int
    steps: int
    seed: int
    seconds: float

    @cached_property
    def samples(self) -> dict[str, Float[np.ndarray, " n"]]:
        """Values of each parameter by name, (n,), in `units`."""
        return values_of_points(self.parameters, self.coordinates)

    @property
    def distinct(self) -> int:
        """Number of distinct points: a run with a large weight becomes several equal points."""
        return len(np.unique(self.coordinates, axis=0))

    @property
    def means(self) -> dict[str, float]:
        """Mean of each value by name, in `units`."""
        return {name: float(row.mean()) for name, row in self.samples.items()}

    @property
    def standard_deviations(self) -> dict[str, float]:
        """Standard deviation of each value by name, in `units`."""
        return {name: float(row.std()) for name, row in self.samples.items()}

    @property
    def intervals(self) -> dict[str, tuple[float, float]]:
        """Central 95 % interval (low, high) of each value by name, in `units`."""

        def interval(row: np.ndarray) -> tuple[float, float]:
            # With few points, intervals by NumPy's default method would be too narrow.
            low, high = np.quantile(row, (0.025, 0.975), method="weibull").tolist()
            return low, high

        return {name: interval(row) for name, row in self.samples.items()}

    @property
    def correlation(self) -> Float[np.ndarray, "p p"]:
        """Correlation of the coordinates, (p, p)."""
        return np.atleast_2d(np.corrcoef(self.coordinates.T))

    @property
    def weights(self) -> Float[np.ndarray, " modes"]:
        """Probability of each mode, its share of the points, (modes,), the largest first."""
        return np.bincount(self.modes) / len(self.modes)

    @property
    def warnings(self) -> list[str]:
        """Sentences on a box that cuts the posterior off, on parameters whose points fill the box
        evenly, and on a small effective number of runs; empty if there are no problems."""
        sentences = []
        low, high = self.box
        near = EDGE * (high - low)
        for k, name in enumerate(self.parameters):
            row = self.coordinates[:, k]
            number = len(row)
            # Positions in the box, 0 to 1, are compared with those of as many evenly spaced points.
            # Points that fill the box are at its ends too, which needs no second warning.
            positions = (np.sort(row) - low[k]) / (high[k] - low[k])
            if np.abs(positions - (np.arange(number) + 0.5) / number).max() < EVEN:
                sentences.append(
                    f"The points fill the box of {name} evenly: the data hardly determine it. "
                    "Increase its spread, or leave it out."
                )
                continue
            share = max((row < low[k] + near[k]).mean(), (row > high[k] - near[k]).mean())
            if share > EDGE_SHARE:
                sentences.append(
                    f"{share:.0%} of the points are at an end of the box of {name}: increase its "
                    "spread, or the data don't determine it."
                )
        if self.effective_sample_size < min(FEWEST_EFFECTIVE, 0.5 * len(self.coordinates)):
            sentences.append(
                f"The points, {self.distinct} of which are distinct, come from only "
                f"{self.effective_sample_size:.0f} effective runs: increase `draws`."
            )
        return sentences

    @override
    def to_xarray(self) -> "xr.Dataset":
        """Return the `mean`, the `standard_deviation` and the 95 % `interval` (low and high along
        "bound") of each parameter along "parameter", with its `unit`. Attributes are
        `log_evidence`, `log_evidence_error`, `effective_sample_size`, `runs`, `failed` and `seed`.
        """
        along = ("parameter",)
        variables = {
            "mean": Labelled(along, [*self.means.values()]),
            "standard_deviation": Labelled(along, [*self.standard_deviations.values()]),
            "interval": Labelled((*along, "bound"), [*self.intervals.values()]),
        }
        notes = tuple(self._notes().items())
        return labelled_dataset("posterior", variables, estimate_labels(self.units), notes)

    def to_arviz(self) -> "arviz.InferenceData":
        """Return the points as an `arviz.InferenceData` with one chain.

        ArviZ must be installed (``pip install 'clearjoint[arviz]'``). The group `posterior` has the
        values of the parameters, the attributes of the dataset from `to_xarray` and the `weights`
        of the modes. The group `log_likelihood` has the log-likelihood of the whole record, by the
        name "record", and `sample_stats` the entries of `modes`, by the name "mode".
        """
        try:
            import arviz
        except ImportError as error:
            message = "The points need ArviZ: pip install 'clearjoint[arviz]'."
            raise ImportError(message) from error

        data = arviz.from_dict(
            posterior={name: row[None] for name, row in self.samples.items()},
            log_likelihood={"record": self.log_likelihood[None]},
            sample_stats={"mode": self.modes[None]},
            posterior_attrs={**self._notes(), "weights": self.weights.tolist()},
        )
        for name, unit in self.units.items():
            data["posterior"][name].attrs["units"] = unit
        return data

    def _notes(self) -> Mapping[str, float | int]:
        evidence = "log_evidence", "log_evidence_error", "effective_sample_size"
        return {name: getattr(self, name) for name in (*evidence, "runs", "failed", "seed")}

    @override
    def __str__(self) -> str:
        # The table is that of a fit; headings of the same width keep its columns aligned.
        number = len(self.weights)
        weights = ", ".join(f"{weight:.0%}" for weight in self.weights)
        parts = [
            f"Posterior by {self.runs} runs, {self.failed} of which failed or are impossible "
            f"({duration(self.seconds)}, seed {self.seed})",
            estimates_table(self.means, self.standard_deviations, self.intervals, self.units)
            .replace("estimate", "mean    ", 1)
            .replace("standard error", "deviation     ", 1),
            f"{number} separate {'minimum' if number == 1 else 'minima'}, weights {weights}\n"
            f"logarithm of the evidence {self.log_evidence:.6g}, standard error "
            f"{self.log_evidence_error:.2g}\n"
            f"{len(self.coordinates)} points, {self.distinct} of which are distinct, from "
            f"{self.effective_sample_size:.0f} effective runs",
            "\n".join(f"Warning: {warning}" for warning in self.warnings),
        ]
        return "\n\n".join(part for part in parts if part)

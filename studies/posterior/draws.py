"""Posteriors of draws of the noise, and how often their intervals contain the truth."""

import sys
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

import clearjoint as cj
from studies.posterior.cases import Case

HEAD = (
    "case",
    "draws",
    "intervals that contain the truth, %",
    "draws with several minima",
    "runs",
    "failed",
    "s",
)


@dataclass(frozen=True)
class Row:
    """Posteriors of the draws of a case, and whether each interval contains the truth (n, p)."""

    case: Case
    found: Sequence[cj.results.Posterior]

    @property
    def inside(self) -> np.ndarray:
        """Whether each interval contains the truth, (n, p)."""
        return np.array(
            [
                [low < self.case.truth[name] < high for name, (low, high) in one.intervals.items()]
                for one in self.found
            ]
        )

    def cells(self) -> tuple[str, ...]:
        """Return the row as text."""
        return (
            self.case.label,
            str(len(self.found)),
            ", ".join(f"{name} {100 * part:.0f}" for name, part in self._shares()),
            str(sum(len(one.weights) > 1 for one in self.found)),
            f"{np.median([one.runs for one in self.found]):.0f}",
            str(sum(one.failed for one in self.found)),
            f"{np.median([one.seconds for one in self.found]):.2g}",
        )

    def _shares(self) -> list[tuple[str, float]]:
        return list(zip(self.case.truth, self.inside.mean(axis=0).tolist(), strict=True))


def cover(case: Case, draws: int, number: int) -> Row:
    """Draw posteriors of `number` points for each draw of the noise; report to standard error."""
    generator, found = np.random.default_rng(0), []
    for seed in range(draws):
        data = case.clean.with_noise(generator)
        found.append(
            cj.posterior(
                case.scene,
                case.state,
                data,
                case.parameters,
                guess=case.guess,
                spread=case.spread,
                number=number,
                seed=seed,
                progress=False,
            )
        )
        print(*Row(case, found).cells(), sep=" | ", file=sys.stderr, flush=True)
    return Row(case, found)


def figure(row: Row) -> Figure:
    """Draw the points of the first posterior of a case, and the truth."""
    samples, names = row.found[0].samples, list(row.case.truth)
    drawn = Figure(figsize=(4.0 * (len(names) - 1), 3.6), layout="constrained")
    panels = np.atleast_1d(drawn.subplots(1, len(names) - 1))
    for axes, name in zip(panels, names[1:], strict=True):
        axes.scatter(samples[names[0]], samples[name], c=row.found[0].modes, s=8, cmap="tab10")
        axes.plot(row.case.truth[names[0]], row.case.truth[name], "k+", ms=14, label="truth")
        units = row.found[0].units
        axes.locator_params(axis="x", nbins=4)
        axes.set(xlabel=f"{names[0]} [{units[names[0]]}]", ylabel=f"{name} [{units[name]}]")
        axes.legend()
    return drawn

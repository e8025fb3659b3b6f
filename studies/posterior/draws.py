"""Posteriors of draws of the noise, kept in a file, and the coverage of their intervals."""

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.stats import binomtest

import clearjoint as cj
from studies.posterior.cases import Case

HEAD = (
    "case",
    "draws",
    "intervals that contain the truth, % (and its 95 % interval)",
    "draws with several minima",
    "effective runs: median, smallest",
    "runs",
    "failed",
    "s",
)


@dataclass(frozen=True)
class Draw:
    """Result of a posterior for a draw of the noise.

    - `name`, `label`: of the case; `number`: of points; `seed`: of the noise and the posterior.
    - `truth`: true value by name; `intervals`: 95 % interval by name.
    - `minima`: number of separate minima; `effective`: effective number of runs.
    - `runs`, `failed`: numbers of runs; `seconds`: time, s.
    """

    name: str
    label: str
    number: int
    seed: int
    truth: dict[str, float]
    intervals: dict[str, tuple[float, float]]
    minima: int
    effective: float
    runs: int
    failed: int
    seconds: float

    @property
    def inside(self) -> dict[str, bool]:
        """Whether each parameter's interval contains the truth."""
        return {n: low < self.truth[n] < high for n, (low, high) in self.intervals.items()}


def drawn(name: str, case: Case, number: int, seed: int) -> Draw:
    """Return the result of a posterior of `number` points for a draw of the noise."""
    data = case.clean.with_noise(np.random.default_rng(seed))
    found = cj.posterior(
        case.scene,
        case.state,
        data,
        case.parameters,
        guess=case.guess,
        spread=case.spread,
        draws=number,
        seed=seed,
        progress=False,
    )
    counts = len(found.weights), found.effective_sample_size, found.runs, found.failed
    truth, ends = case.truth, found.intervals
    return Draw(name, case.label, number, seed, truth, ends, *counts, found.seconds)


def kept(file: Path) -> list[Draw]:
    """Return the draws in a file; none if there is no file."""
    return (
        [Draw(**json.loads(line)) for line in file.read_text().splitlines()]
        if file.exists()
        else []
    )


def cover(
    name: str, make: Callable[[], Case], draws: int, number: int, file: Path
) -> Sequence[Draw]:
    """Return draws of a case; those that the file lacks are computed and appended to it."""
    same = [one for one in kept(file) if (one.name, one.number) == (name, number)]
    found = {one.seed: one for one in same if one.seed < draws}
    if len(found) < draws:
        case = make()
        for seed in sorted(set(range(draws)) - set(found)):
            found[seed] = drawn(name, case, number, seed)
            with file.open("a") as lines:
                lines.write(json.dumps(asdict(found[seed])) + "\n")
    return list(found.values())


def cells(draws: Sequence[Draw]) -> tuple[str, ...]:
    """Return the row of a case as text."""
    shares, effective = [], [one.effective for one in draws]
    for name in draws[0].truth:
        count = sum(one.inside[name] for one in draws)
        ends = [100.0 * end for end in binomtest(count, len(draws)).proportion_ci(method="wilson")]
        share = 100.0 * count / len(draws)
        shares.append(f"{name} {share:.0f} ({ends[0]:.0f} to {ends[1]:.0f})")
    return (
        draws[0].label,
        str(len(draws)),
        ", ".join(shares),
        str(sum(one.minima > 1 for one in draws)),
        f"{np.median(effective):.0f}, {min(effective):.0f}",
        f"{np.median([one.runs for one in draws]):.0f}",
        str(sum(one.failed for one in draws)),
        f"{np.median([one.seconds for one in draws]):.2g}",
    )


def figure(cases: Sequence[Sequence[Draw]]) -> Figure:
    """Draw the intervals of all draws of some cases relative to the truth."""
    most = max(len(draws[0].truth) for draws in cases)
    found = Figure(figsize=(3.2 * most, 2.4 * len(cases)), layout="constrained")
    panels = found.subplots(len(cases), most, squeeze=False)
    for row, draws in zip(panels, cases, strict=True):
        row[0].set_title(draws[0].label, loc="left", fontsize=8)
        row[0].set_ylabel("draw")
        for axes in row[len(draws[0].truth) :]:
            axes.set_axis_off()
        for axes, (name, truth) in zip(row, draws[0].truth.items(), strict=False):
            for height, one in enumerate(draws):
                ends = [100.0 * (end / truth - 1.0) for end in one.intervals[name]]
                colour = "tab:blue" if one.inside[name] else "tab:red"
                axes.plot(ends, (height, height), color=colour, lw=1.2)
            axes.axvline(0.0, color="k", lw=0.8)
            axes.locator_params(axis="x", nbins=5)
            axes.set_xlabel(f"error of {name} [%]")
    return found

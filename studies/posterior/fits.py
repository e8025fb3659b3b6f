"""How often intervals of fits contain the truth, by explored points and by the small posterior."""

import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

import clearjoint as cj
from studies.fits import coverage

HEAD = (
    "case",
    "draws",
    "with a posterior",
    "intervals that contain the truth: by explored points",
    "by the fit",
    "s: fit; of this the posterior",
    "runs of the posterior",
)
CASES: dict[str, Callable[[], coverage.Case]] = {
    "crank-rocker, short": lambda: coverage.pins("rocker foot", 1.1, 0.02),
    "crank-rocker": lambda: coverage.pins("rocker foot", 1.1),
}


@dataclass(frozen=True)
class Draw:
    """Whether intervals of a fit contain the truth, (p,), by points and by the fit; its times, s,
    with and in the posterior; and the posterior's number of runs."""

    by_points: tuple[bool, ...]
    by_fit: tuple[bool, ...]
    seconds: tuple[float, float]
    runs: int


def drawn(case: coverage.Case, data: cj.Measurements) -> Draw:
    """Fit a draw of the noise from the far start, in growing windows."""
    begun = time.perf_counter()
    fit = case.fit(data, case.guess, grow=case.grow, check_runs=400)
    seconds = time.perf_counter() - begun
    found = fit.posterior
    # A search that has not converged is not checked.
    without = fit if fit.check is None else replace(fit, check=replace(fit.check, posterior=None))
    by_points, by_fit = (
        tuple(low < case.truth[name] < high for name, (low, high) in one.intervals.items())
        for one in (without, fit)
    )
    if found is None:
        return Draw(by_points, by_fit, (seconds, 0.0), 0)
    return Draw(by_points, by_fit, (seconds, found.seconds), found.runs)


def cells(case: coverage.Case, draws: Sequence[Draw]) -> tuple[str, ...]:
    """Return the row of a case as text."""
    shares = (
        ", ".join(
            f"{name} {count}" for name, count in zip(case.truth, np.sum(rows, axis=0), strict=True)
        )
        for rows in ([one.by_points for one in draws], [one.by_fit for one in draws])
    )
    seconds = np.median([one.seconds for one in draws], axis=0)
    return (
        f"{case.label}, {1e3 * case.clean.times()[-1]:g} ms",
        str(len(draws)),
        str(sum(one.runs > 0 for one in draws)),
        *shares,
        f"{seconds[0]:.2g}; {seconds[1]:.2g}",
        f"{np.median([one.runs for one in draws]):.0f}",
    )


def cover(case: coverage.Case, number: int) -> tuple[str, ...]:
    """Fit a number of draws of the noise; report to standard error, and return the row as text."""
    generator, draws = np.random.default_rng(0), []
    for _ in range(number):
        draws.append(drawn(case, case.clean.with_noise(generator)))
        print(*cells(case, draws), sep=" | ", file=sys.stderr, flush=True)
    return cells(case, draws)

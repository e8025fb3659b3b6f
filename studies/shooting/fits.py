"""Fits of one long record by single runs and by windows."""

import time
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.figure import Figure

import clearjoint as cj
from studies.common.identification_problem import PARAMETERS, STARTS, TRUTH, WINDOWS

BEGINNING, WIDTH, END = 0.06, 0.01, 0.187
"""The first window, the others, and the record, s."""
CLOSE = replace(cj.presets.derivatives, rtol=1e-10, max_steps=20_000)
"""Closer than the ties between windows; a run with absurd parameters is given up."""
GUESS = STARTS["stiff, wide"]


@dataclass(frozen=True)
class Attempt:
    """A fit in one way, and how long it took, s."""

    way: str
    fit: cj.Fit
    seconds: float

    def row(self) -> str:
        """A line of the table."""
        off = self.fit.estimates, self.fit.standard_errors
        errors = [f"{off[0][n] / TRUTH[n] - 1:+.1e} ({off[1][n] / TRUTH[n]:.0e})" for n in TRUTH]
        a_sample = self.fit.chi_squared / self.fit.samples
        runs = f"{self.fit.best.evaluations}"
        cells = [self.way, f"{a_sample:.4g}", *errors, runs, f"{self.seconds:.0f}"]
        return f"| {' | '.join(cells)} |"


def single(data: cj.Measurements, limits: cj.Horizon | None, grow: list[float]) -> Attempt:
    """A fit by a single run."""
    begun = time.perf_counter()
    fit = cj.identify(
        *cj.double_pendulum(),
        data,
        PARAMETERS,
        guess=GUESS,
        grow=grow,
        horizon=limits,
        settings=CLOSE,
        check_runs=0,
        progress=False,
    )
    way = "single run, growing windows" if grow else "single run, at once"
    return Attempt(way, fit, time.perf_counter() - begun)


def by_shots(data: cj.Measurements, end: float) -> tuple[Attempt, cj.ShootingFit]:
    """A fit by windows, from one of the record's beginning."""
    begun = time.perf_counter()
    parts = {name: series.between(0.0, BEGINNING) for name, series in data.series.items()}
    beginning = cj.Measurements({name: part for name, part in parts.items() if part is not None})
    first = single(beginning, None, [t for t in WINDOWS if t < BEGINNING]).fit
    found = cj.identify_by_shots(
        *cj.double_pendulum(),
        data,
        PARAMETERS,
        np.arange(BEGINNING, end - 0.25 * WIDTH, WIDTH).tolist(),
        guess=first.estimates,
        settings=CLOSE,
        max_iterations=25,
        progress=False,
    )
    return Attempt("multiple shooting", found.fit, time.perf_counter() - begun), found


def figure(found: cj.ShootingFit, limit: float) -> Figure:
    """What the estimates are off, by the end of the record, and the gaps that are left."""
    drawn = Figure(figsize=(9.5, 3.8), layout="constrained")
    left, right = drawn.subplots(1, 2)
    every = found.fit.best.windows
    reached = np.array([window.end_time for window in every])
    windows = [w for k, w in enumerate(every) if (reached[k + 1 :] > w.end_time).all()]
    ends = [1e3 * window.end_time for window in windows]
    for name, parameter in PARAMETERS.items():
        taken = [[i for i in window.iterations if i.accepted][-1] for window in windows]
        column = list(PARAMETERS).index(name)
        values = [float(parameter.scale.value(one.coordinates[column])) for one in taken]
        left.semilogy(ends, np.abs(np.array(values) / TRUTH[name] - 1), "o-", ms=3, label=name)
    for k, style in ((1, ":"), (5, "--")):
        label = "horizon" if k == 1 else "five horizons"
        left.axvline(1e3 * k * limit, color="0.4", ls=style, label=label)
    left.set(xlabel="end of the record, ms", ylabel="relative error of the estimate, 1")
    left.legend(fontsize=8)
    right.semilogy(1e3 * found.boundaries, np.abs(found.gaps).max(axis=1), "o", ms=4)
    right.set(xlabel="boundary between windows, ms", ylabel="largest gap, m or m/s")
    return drawn

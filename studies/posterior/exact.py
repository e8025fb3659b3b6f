"""Coverage of intervals of the exact posterior, for many draws of the noise from the same runs.

A run does not depend on the noise. Its prediction gives chi squared for every draw, so that a few
thousand runs around the truth give the posteriors of a thousand draws, by importance sampling. This
separates the question whether 95 % intervals contain the truth in 95 % of draws, although chi
squared may be rough, from the question whether `cj.posterior` finds them.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

import clearjoint as cj
from clearjoint.identification.posterior.tempering import Mixture, Target, draw, normalised
from clearjoint.identification.residuals import experiment, samples
from clearjoint.identification.screening.misfit_curves import SideBySide
from studies.posterior.cases import Case
from studies.posterior.draws import Draw

HEAD = (
    "case",
    "runs",
    "draws",
    "effective runs: median, smallest",
    "intervals of the exact posterior that contain the truth, %",
    "exact probability in the intervals of draws of `cj.posterior`, %",
)
INFLATED, WIDER = 2.0, 1.3
"""Factor on the noise, and on the standard deviations of the normal distributions around points of
the posterior for this noise: the posteriors of all draws lie within the runs."""
POINTS = 150
TOGETHER = 50
"""Number of draws whose chi squared is computed at once."""


def lanes(case: Case, data: cj.Measurements) -> SideBySide:
    """Return runs of a case as lanes, and the data with which they are compared."""
    outputs = {name: series.channel for name, series in data.series.items()}
    runs = experiment(
        case.scene, case.state, case.parameters, outputs, data.times(), 0.0,
        cj.presets.identification,
    )  # fmt: skip
    return SideBySide(runs, samples(data, len(runs.times)))


def cover(case: Case, runs: int, draws: int, kept: Sequence[Draw]) -> tuple[str, ...]:
    """Return the row of a case as text.

    **Arguments:** `kept`: results of `cj.posterior` for the case, whose intervals are compared with
    the exact posterior of the same data.
    """
    truth = np.array([p.scale.coordinate(case.truth[n]) for n, p in case.parameters.items()])
    half = np.array([case.spread[name] for name in case.parameters])
    series = case.clean.series.items()
    noisier = {name: replace(one, noise=INFLATED * one.noise) for name, one in series}
    wide = lanes(case, cj.Measurements(noisier))
    target = Target(
        wide.chi_squared,
        wide.count,
        truth - half,
        truth + half,
        lambda points: np.zeros(len(points)),
    )
    around = draw(target, POINTS, np.random.default_rng(0)).points
    mixture = Mixture.around(around, np.full(POINTS, 1.0 / POINTS))
    mixture = Mixture(mixture.centres, WIDER * mixture.roots, mixture.weights)
    points = mixture.drawn(runs, np.random.default_rng(1))
    exact = lanes(case, case.clean)
    data = exact.data
    offsets = exact.predictions(points) - data.values[:, : exact.count]
    for row, period in zip(np.moveaxis(offsets, 1, 0), data.periods, strict=True):
        if period is not None:
            row -= period * np.round(row / period)
    shifts = (offsets * data.weights[:, : exact.count]).reshape(runs, -1)
    fine = np.isfinite(shifts).all(axis=1)
    shifts, points = shifts[fine], points[fine]
    log_weights = -mixture.log_density(points)
    shares, effective = posteriors(shifts, points < truth, log_weights, draws)
    inside = ((shares > 0.025) & (shares < 0.975)).mean(axis=0)
    return (
        case.label,
        str(runs),
        str(draws),
        f"{np.median(effective):.0f}, {effective.min():.0f}",
        ", ".join(f"{n} {100 * one:.1f}" for n, one in zip(case.truth, inside, strict=True)),
        "; ".join(_held(case, shifts, points, log_weights, kept)),
    )


def _held(
    case: Case,
    shifts: np.ndarray,
    points: np.ndarray,
    log_weights: np.ndarray,
    kept: Sequence[Draw],
) -> list[str]:
    """Return for each number of points the mean exact probability in the intervals of draws."""
    squares = (shifts**2).sum(axis=1)
    held: dict[int, list[list[float]]] = {}
    for one in kept:
        data = case.clean.with_noise(np.random.default_rng(one.seed)).series
        noise = [(data[name].values - s.values) / s.noise for name, s in case.clean.series.items()]
        weights = normalised(log_weights - 0.5 * squares + shifts @ np.concatenate(noise))[0]
        row = []
        for (name, parameter), values in zip(case.parameters.items(), points.T, strict=True):
            low, high = (parameter.scale.coordinate(end) for end in one.intervals[name])
            row.append(float(weights[(values > low) & (values < high)].sum()))
        held.setdefault(one.number, []).append(row)
    texts = []
    for number, rows in held.items():
        means = zip(case.truth, np.mean(rows, axis=0), strict=True)
        percent = ", ".join(f"{name} {100 * mean:.1f}" for name, mean in means)
        texts.append(f"{number} points, {len(rows)} draws: {percent}")
    return texts


def posteriors(
    shifts: np.ndarray, below: np.ndarray, log_weights: np.ndarray, draws: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return the posterior probability that each parameter is below its true value, (draws, p), and
    the effective number of runs, (draws,), for draws of the noise.

    **Arguments:** `shifts`: (n, M) predictions less those at the truth, over the noise; `below`:
    (n, p) whether the parameter is below its true value in each of n runs; `log_weights`: (n,)
    of the runs, before the data.
    """
    generator, squares = np.random.default_rng(0), (shifts**2).sum(axis=1)
    shares, effective = [], []
    while len(shares) < draws:
        noise = generator.standard_normal((shifts.shape[1], min(TOGETHER, draws - len(shares))))
        # Chi squared of each draw less its value at the truth, which is the same for all runs.
        rises = squares[:, None] - 2.0 * shifts @ noise
        for logarithms in (log_weights[:, None] - 0.5 * rises).T:
            weights, _ = normalised(logarithms)
            shares.append(weights @ below)
            effective.append(1.0 / (weights**2).sum())
    return np.array(shares), np.array(effective)

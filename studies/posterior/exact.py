"""Coverage of intervals of the exact posterior, for many draws of the noise from the same runs.

A run does not depend on the noise. Its prediction gives chi squared for every draw, so that a few
thousand runs around the truth give the posteriors of a thousand draws, by importance sampling. This
separates the question whether 95 % intervals contain the truth in 95 % of draws, although chi
squared may be rough, from the question whether `cj.posterior` finds them.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import logsumexp, softmax
from scipy.stats import multivariate_normal

import clearjoint as cj
from studies.posterior.cases import Case
from studies.posterior.draws import Draw

HEAD = (
    "case",
    "runs",
    "draws",
    "effective runs: median, smallest",
    "intervals of the exact posterior that contain the truth, %",
    "draws of `cj.posterior`: exact probability in its intervals, %; exact intervals that contain "
    "the truth",
)
INFLATED, WIDER = 2.0, 1.3
"""Factor on the noise, and on the standard deviations of the normal distributions around points of
the posterior for this noise: the posteriors of all draws lie within the runs."""
POINTS, NEAR = 150, 25
"""Number of points of this posterior, and number of nearest points that give the covariance of the
normal distribution around each."""
TOGETHER = 50
"""Number of draws whose chi squared is computed at once."""


def drawn_around(points: np.ndarray, runs: int) -> tuple[np.ndarray, np.ndarray]:
    """Return points drawn from equal normal distributions around some points (n, p), (runs, p), and
    the logarithm of their density, (runs,).

    Each distribution has the covariance of the points nearest to its centre, so that the mixture
    follows a curved region.
    """
    whole = np.cov(points.T)
    scaled = np.linalg.solve(np.linalg.cholesky(whole), points.T).T
    order = np.linalg.norm(scaled[:, None] - scaled, axis=2).argsort(axis=1)
    # A small share of the whole covariance keeps that of nearly equal points regular.
    local = np.array([np.cov(points[near].T) for near in order[:, :NEAR]]) + 1e-3 * whole
    covariances = WIDER**2 * local
    generator = np.random.default_rng(1)
    chosen = generator.integers(len(points), size=runs)
    normal = generator.standard_normal((runs, points.shape[1]))
    drawn = points[chosen] + np.einsum(
        "nij,nj->ni", np.linalg.cholesky(covariances)[chosen], normal
    )
    densities = [
        multivariate_normal(centre, covariance).logpdf(drawn)
        for centre, covariance in zip(points, covariances, strict=True)
    ]
    return drawn, logsumexp(densities, axis=0) - np.log(len(points))


def residuals(case: Case, points: np.ndarray) -> np.ndarray:
    """Return the residuals of runs at points (n, p) with respect to the record without noise,
    (n, M); NaN for runs that fail."""
    series, times = case.clean.series, case.clean.times()
    axes = {
        name: cj.Axis(parameter.variation, np.asarray(parameter.scale.value(row)))
        for (name, parameter), row in zip(case.parameters.items(), points.T, strict=True)
    }
    runs = cj.sweep(
        case.scene,
        case.state,
        times[-1],
        axes,
        {name: one.channel for name, one in series.items()},
        cj.presets.identification,
        cj.Saving(times, states=False),
        zipped=True,
        progress=False,
    )
    rows = []
    for name, one in series.items():
        predictions = runs[name].values[:, np.searchsorted(times, one.times)]
        rows.append([one.residuals(prediction) for prediction in predictions])
    return np.concatenate(rows, axis=1)


def cover(case: Case, runs: int, draws: int, kept: Sequence[Draw]) -> tuple[str, ...]:
    """Return the row of a case as text.

    **Arguments:** `kept`: results of `cj.posterior` for the case, whose intervals are compared with
    the exact posterior of the same data.
    """
    series = case.clean.series.items()
    noisier = {name: replace(one, noise=INFLATED * one.noise) for name, one in series}
    around = cj.posterior(
        case.scene,
        case.state,
        cj.Measurements(noisier),
        case.parameters,
        guess=case.truth,
        spread=case.spread,
        draws=POINTS,
        progress=False,
    )
    points, log_density = drawn_around(np.unique(around.coordinates, axis=0), runs)
    shifts = residuals(case, points)
    fine = np.isfinite(shifts).all(axis=1)
    shifts, points, log_weights = shifts[fine], points[fine], -log_density[fine]
    # The prior is that of `cj.posterior`, zero outside the box around the guess.
    guess = np.array([p.scale.coordinate(case.guess[n]) for n, p in case.parameters.items()])
    half = np.array([case.spread[name] for name in case.parameters])
    log_weights[(np.abs(points - guess) > half).any(axis=1)] = -np.inf
    truth = np.array([p.scale.coordinate(case.truth[n]) for n, p in case.parameters.items()])
    shares, effective = posteriors(shifts, points < truth, log_weights, draws)
    inside = ((shares > 0.025) & (shares < 0.975)).mean(axis=0)
    return (
        case.label,
        str(runs),
        str(draws),
        f"{np.median(effective):.0f}, {effective.min():.0f}",
        ", ".join(f"{n} {100 * one:.1f}" for n, one in zip(case.truth, inside, strict=True)),
        "; ".join(_compared(case, shifts, points, log_weights, kept)),
    )


def _compared(
    case: Case,
    shifts: np.ndarray,
    points: np.ndarray,
    log_weights: np.ndarray,
    kept: Sequence[Draw],
) -> list[str]:
    """Return the last cell of the row for each number of points of draws of `cj.posterior`: the
    mean exact probability in the intervals, and the number of draws whose exact intervals contain
    the truth."""
    squares = (shifts**2).sum(axis=1)
    rows: dict[int, list[list[tuple[float, bool]]]] = {}
    for one in kept:
        data = case.clean.with_noise(np.random.default_rng(one.seed)).series
        noise = [(data[name].values - s.values) / s.noise for name, s in case.clean.series.items()]
        weights = softmax(log_weights - 0.5 * squares + shifts @ np.concatenate(noise))
        row = []
        for (name, parameter), values in zip(case.parameters.items(), points.T, strict=True):
            low, high = (parameter.scale.coordinate(end) for end in one.intervals[name])
            below = weights[values < parameter.scale.coordinate(case.truth[name])].sum()
            held = weights[(values > low) & (values < high)].sum()
            row.append((float(held), bool(0.025 < below < 0.975)))
        rows.setdefault(one.number, []).append(row)
    texts = []
    for number, found in rows.items():
        held, inside = np.moveaxis(np.array(found, float), 2, 0)
        percent = ", ".join(f"{100.0 * mean:.1f}" for mean in held.mean(axis=0))
        counts = ", ".join(f"{count:.0f}" for count in inside.sum(axis=0))
        texts.append(f"{number} points: {percent}; {counts} of {len(found)}")
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
            weights = softmax(logarithms)
            shares.append(weights @ below)
            effective.append(1.0 / (weights**2).sum())
    return np.array(shares), np.array(effective)

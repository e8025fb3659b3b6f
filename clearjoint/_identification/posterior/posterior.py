"""Posterior distribution of parameters, by runs that are computed side by side."""

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

import numpy as np
from jaxtyping import Float, Int

from ..._dynamics.constraint_report import check_names
from ..._fields.checks import require, require_count
from ..._measurements.series import Measurements
from ..._model.bodies import State
from ..._model.scene import Scene
from ..._parametrisation.parameter import Parameter, check_parameters, values_of_points
from ..._simulation.run.terminal import ProgressBar
from ..._simulation.step import presets
from ..._simulation.step.settings import Settings, settings_or
from ..comparison import Comparison, check_sets, comparison
from ..goodness_of_fit import RISE
from ..points import Box, Points
from ..residuals import UNREACHED
from ..starts import Guess, half_widths, start_coordinates
from .result import Posterior
from .tempering import ImpossiblePriorError, Target, draw

NEAREST = 10
"""Fewest neighbours of a point: with fewer, chance gaps between the points would divide a mode."""
SMALLEST = 0.01
"""Share of all points below which a mode, perhaps of stray points, joins the nearest larger one."""


def modes(points: Points, chi_squared: Float[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
    """Return for each point the number of its mode, from 0 for that with the most points.

    A mode is a group of points around one minimum of chi squared. Points are taken from the lowest
    chi squared upwards. A point without neighbours in a group begins a new group. Any other point
    joins, of the groups of its neighbours, the one with the lowest minimum; each of the other
    groups is united with this one if chi squared rises by less than 3.84 from the minimum of the
    other group to the point (F. Chazal et al., *Persistence-based clustering in Riemannian
    manifolds*, 2013). At the end, a group with less than 1 % of the points is united with the
    nearest larger one. A minimum with fewer points than a point has neighbours may not be found.
    """
    # Resampling has made copies of points, which would take the places of neighbours.
    distinct, kept, copies = np.unique(points, axis=0, return_index=True, return_inverse=True)
    values, number = chi_squared[kept], len(distinct)
    # Coordinates are divided by their deviations. Along principal axes, a division would make
    # distant modes near: most of the deviation along the axis between them is their distance.
    deviations = distinct.std(axis=0)
    scaled = distinct / np.where(deviations > 0.0, deviations, 1.0)
    distances = np.linalg.norm(scaled[:, None] - scaled, axis=2)
    # The nearest point is the point itself, hence the 1. With more parameters, neighbours must lie
    # in more directions.
    near = np.argsort(distances, axis=1, kind="stable")[:, : max(NEAREST, 4 * points.shape[1]) + 1]
    neighbour = np.zeros((number, number), bool)
    np.put_along_axis(neighbour, near, True, axis=1)
    neighbour |= neighbour.T  # Two points are neighbours if either is near the other.
    group = np.full(number, -1)  # Index of the lowest point of each point's group.
    for point in np.argsort(values, kind="stable"):
        # Groups of the neighbours with a lower chi squared; the others have no group yet, index -1.
        around = {int(k) for k in group[neighbour[point]] if k >= 0}
        if not around:
            group[point] = point
            continue
        lowest = min(around, key=lambda k: values[k])
        group[point] = lowest
        for other in around - {lowest}:
            if values[point] - values[other] < RISE:
                group[group == other] = lowest
    # Groups with few points join the group of the nearest point in a large one. The largest group
    # is large even if all are small.
    # Some versions of NumPy return the inverse of `unique` as a column, hence `ravel`.
    sizes = np.bincount(group[copies.ravel()], minlength=number)  # With copies of points.
    large = sizes >= min(SMALLEST * len(points), sizes.max())
    for small in np.flatnonzero((sizes > 0) & ~large):
        members = group == small
        others = large[group]
        closest = np.where(others, distances[members].min(axis=0), np.inf).argmin()
        group[members] = group[closest]
    # Numbers of the modes, in the order of their number of points.
    groups, numbers, sizes = np.unique(
        group[copies.ravel()], return_inverse=True, return_counts=True
    )
    rank = np.empty(len(groups), int)
    rank[np.argsort(-sizes, kind="stable")] = np.arange(len(groups))
    return rank[numbers.ravel()]


FEWEST = 32
"""Smallest number of points that a posterior may have."""
LogPrior = Callable[[dict[str, np.ndarray]], Float[np.ndarray, " n"]]
"""Function of the values by name, (n,) each, that returns the logarithm of a density, (n,)."""


def posterior(
    scene: Scene,
    state: State,
    measurements: Measurements,
    parameters: Mapping[str, Parameter],
    settings: Settings | None = None,
    *,
    start_time: float = 0.0,
    guess: Guess | None = None,
    spread: float | Mapping[str, float] = 1.0,
    log_prior: LogPrior | None = None,
    draws: int = 500,
    seed: int = 0,
    progress: bool = True,
) -> Posterior:
    """Return the posterior distribution of parameters, by sequential Monte Carlo.

    Unlike the covariance of a fit, a posterior is right where chi squared is rough or has several
    minima, and it needs no start near the truth. Points are drawn from the prior, which is limited
    to a box around the guess and may be much narrower than the box. Then more and more of the
    record enters the likelihood; at each step the points are weighted, resampled and moved. At the
    end, importance sampling around them gives the points of the result and the evidence. The noise
    is assumed to be normal, with the standard deviations in the measurements.

    **Arguments:**

    - `scene`, `state`, `measurements`, `parameters`, `start_time`: as in `identify`.
    - `settings`: by default `clearjoint.presets.identification`. Runs have no derivatives.
    - `guess`: values at the centre of the box, by name; by default those in the scene.
    - `spread`: half the width of the box, in coordinates: positive, one number or one by name.
    - `log_prior`: logarithm of the prior density of the coordinates in the box, up to a constant: a
      function of the values by name, (n,) each, that returns (n,). By default the prior is uniform.
      It is called for some ten thousand values, some hundred or thousand at once.
    - `draws`: number of points of the result, at least 32. Importance sampling lasts until the
      effective number of its weighted runs reaches `draws`, for at most five rounds; the result's
      `warnings` tell if that is too small. 500 points of three parameters take about 10 000 runs.
    - `seed`: whole number from 0. Equal seeds give equal bits, for any number of threads.

    **Returns:** a `clearjoint.results.Posterior`. A run that fails, or whose prediction is 1e6
    standard deviations off a sample, has the likelihood zero.

    **Raises:** `ValueError` for unsupported arguments, if the prior is zero at all or almost all
    points of the box, and if so few points are possible, because the runs of the others fail, that
    they have no covariance.

    >>> data = cj.Measurements({"x": cj.Series(x, times, 0.1 * np.cos(10.0 * times), noise=1e-3)})
    >>> options = {"spread": 0.3, "draws": 64, "progress": False}
    >>> found = cj.posterior(scene, state, data, {"stiffness": stiffness}, **options)
    >>> found.coordinates.shape, abs(found.means["stiffness"] - 100.0) < 1.0
    ((64, 1), True)
    """
    begun = time.perf_counter()
    check_names(scene, state)
    check_sets(scene, [measurements])
    check_parameters(parameters)
    half = half_widths(spread, tuple(parameters))
    remedy = "pass the possible error of each guess"
    positive = bool(np.all(np.isfinite(half) & (half > 0.0)))
    require(positive, "spread", spread, "finite and positive for each parameter", remedy)
    enough = isinstance(draws, int) and draws >= FEWEST
    expected = f"a whole number from {FEWEST}"
    require(enough, "draws", draws, expected, "500 points serve up to about five parameters")
    require_count("seed", seed, "pass 0", zero=True)
    settings = settings_or(settings, presets.identification)
    compared = comparison(scene, state, measurements, parameters, start_time, settings)
    centre, *others = start_coordinates(scene, state, parameters, guess, None)
    require(not others, "guess", guess, "one guess, the centre of the box", "widen `spread`")
    box = centre - half, centre + half
    # The progress is shown as the time up to which the record is in the likelihood.
    with ProgressBar(progress, desc="posterior", unit=" steps") as bar:

        def on_step(time: float, runs: int) -> None:
            bar.set_postfix_str(f"to {time:.4g} s, {runs} runs")
            bar.update()

        result = drawn_posterior(compared, box, log_prior, draws, seed, on_step=on_step)
    return replace(result, seconds=time.perf_counter() - begun)


def drawn_posterior(
    compared: Comparison,
    box: Box,
    log_prior: LogPrior | None,
    number: int,
    seed: int,
    most_runs: float = math.inf,
    on_step: Callable[[float, int], None] = lambda time, runs: None,
) -> Posterior:
    """Return the posterior distribution of parameters, as `number` points, for a prior in a box of
    coordinates; the prior is uniform if `log_prior` is ``None``. `on_step` is called after each
    step with the time up to which the record is in the likelihood, s, and the number of runs.

    **Raises:** `ImpossiblePointsError`; `TooManyRunsError` before more than `most_runs` runs.
    """
    begun, runs, failed = time.perf_counter(), 0, 0

    def curves(points: Points, count: int) -> Float[np.ndarray, "n counts"]:
        # The function `curves` of the target, which makes runs; here it also counts them.
        nonlocal runs, failed
        if runs + len(points) > most_runs:
            raise TooManyRunsError(f"more than {most_runs:g} runs")
        # A missed sample has the residual `UNREACHED`; from it on, the point is impossible.
        sums = compared.chi_squared(points, count)
        # Differences of sums have rounding errors, which the factor 0.5 allows for.
        misses_here = np.diff(sums, axis=1, prepend=0.0) >= 0.5 * UNREACHED**2
        missed = np.maximum.accumulate(misses_here, axis=1)
        runs += len(points)
        failed += int(missed[:, -1].sum())
        return np.where(missed, np.inf, sums)

    prior = partial(_log_prior, compared.parameters, log_prior)
    target = Target(curves, compared.count, *box, prior)
    generator = np.random.default_rng(seed)
    try:
        drawn = draw(target, number, generator, lambda count: on_step(compared.time(count), runs))
    except ImpossiblePriorError as error:
        raise ImpossiblePointsError(
            f"The prior is zero at all or almost all points of the box around `guess` ({error}). "
            "Centre `guess` where `log_prior` is finite, and reduce `spread` to that region."
        ) from error
    except (FloatingPointError, np.linalg.LinAlgError) as error:
        # All weights are zero, or the points with a weight have no covariance.
        few = isinstance(error, np.linalg.LinAlgError)
        raise ImpossiblePointsError(
            f"{'Almost all' if few else 'All'} points are impossible: {failed} of "
            f"{runs} runs failed or predicted values 1e6 standard deviations off. Centre "
            "`guess` on values with which the scene runs, or change `spread` or `log_prior`."
        ) from error
    # Logarithm of the normal density at a residual of zero, summed over all samples. Weights are
    # inverse standard deviations, and zero where a series has no sample.
    weights = compared.data.weights
    constant = float(np.log(weights[weights > 0.0] / math.sqrt(2.0 * math.pi)).sum())
    return Posterior(
        dict(compared.parameters),
        dict(compared.units),
        drawn.points,
        constant - 0.5 * drawn.chi_squared,
        modes(drawn.points, drawn.chi_squared),
        constant + drawn.log_evidence,
        drawn.error,
        drawn.effective,
        box,
        runs,
        failed,
        drawn.steps,
        seed,
        time.perf_counter() - begun,
    )


class ImpossiblePointsError(ValueError):
    """Error of `drawn_posterior` if too few points have a likelihood or a prior above zero."""


class TooManyRunsError(ArithmeticError):
    """Raised by `drawn_posterior` before the number of runs would exceed its `most_runs`."""


def _log_prior(
    parameters: Mapping[str, Parameter], log_prior: LogPrior | None, points: np.ndarray
) -> np.ndarray:
    if log_prior is None:
        return np.zeros(len(points))
    logarithms = np.asarray(log_prior(values_of_points(parameters, points)), float)
    expected, remedy = f"of shape ({len(points)},)", "return a number for each value"
    require(logarithms.shape == (len(points),), "log_prior", logarithms.shape, expected, remedy)
    valid = not np.isnan(logarithms).any() and not (logarithms == np.inf).any()
    remedy = "return -inf for impossible values"
    require(valid, "log_prior", "NaN or infinity", "finite numbers, or -inf", remedy)
    return logarithms

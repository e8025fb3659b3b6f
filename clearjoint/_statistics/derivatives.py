r"""Derivatives of statistics of a motion by nominal values of its parameters.

Between manufactured specimens the coordinate of a parameter (see `Uncertain`) varies as \(\theta +
\sigma z\) about the nominal coordinate \(\theta\), with a random number z of a known distribution,
the standardised coordinate. For an output f of a run, the expectation \(J(\theta) = E[f(\theta +
\sigma z)]\) is smooth even where f is not.

- Normal distribution with the standard deviation \(\sigma\): by Stein's identity, \(J' = E[f z] /
  \sigma\), the coefficient of z in a regression of f on Hermite polynomials of z (divided by
  \(\sigma\)). The regression is the likelihood-ratio method with control variates: the other
  polynomials reduce the variance and leave the expectation as it is.
- Uniform distribution: \(J' = (E[f | z = 1] - E[f | z = -1]) / (2 \sigma)\), exactly, where
  \(\sigma\) is half the width. Runs are made in pairs, one at each end of the distribution, with
  the same start and the same values of all other parameters.
"""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import Float
from typing_extensions import Unpack

from .._dynamics.constraint_report import check_names
from .._export.datasets import Labelled, labelled_dataset, texts
from .._fields.checks import require, require_count, require_positive
from .._fields.objects import with_arrays
from .._model.bodies import State
from .._model.scene import Scene
from .._simulation.reductions.base import result_name
from .._simulation.run.outputs import Output, requested_by
from .._simulation.step.settings import Settings
from .._sweeps.sweep import SweepOptions, sweep
from .ensemble import (
    DISTURBANCE,
    directions,
    disturbed_axes,
    number_failed,
    require_distinct_names,
    scalar_outputs,
)
from .uncertain import Uncertain, check_confidence, check_uncertain

if TYPE_CHECKING:
    import xarray as xr

LEAST_RUNS = 10
"""Smallest number of runs for each coefficient of the regression. Intervals from so few runs
contain the true derivative as often as stated, but half of them are wider than 3.5 times the root
mean square error of the estimate; with 40 runs for each coefficient, than 2.4 times this error."""
ENDINGS = (
    "mean",
    "standard_error",
    *(f"derivative{part}" for part in ("", "_standard_error", "_low", "_high")),
)
"""Endings of the names of an output's results, after an underscore."""
MOST_POWER = 4.0
"""Largest exponent k with which a run's squared residual is divided by (1 - leverage)^k."""


def statistics_derivatives(
    scene: Scene,
    state: State,
    end_time: float | Callable[[Scene], float],
    uncertain: Mapping[str, Uncertain],
    outputs: Mapping[str, Output],
    settings: Settings | None = None,
    *,
    draws: int = 2000,
    disturbance: float = DISTURBANCE,
    seed: int = 0,
    confidence: float = 0.95,
    **options: Unpack[SweepOptions],
) -> "xr.Dataset":
    """Estimate the derivatives of the outputs' means by the parameters' nominal values, with
    confidence intervals, also for chaotic motions, whose own derivatives grow without bound.

    The means are over the tolerances of manufacture and over starts that differ by less than a
    measurement can resolve.

    **Arguments:**

    - `scene`, `state`, `end_time`, `outputs`, `settings`, and the options `start_time`, `path`,
      `executor`, `threads`, `chunk`, `progress`: as in `sweep`.
    - `uncertain`: the p parameters by name. All parameters with a `deviation` share the same
      `draws` runs; each parameter with a `half_width` or `between` takes `draws` further runs.
    - `draws`: number of runs with their own draws of all parameters. It must be even, because the
      further runs come in pairs, and at least 10 (1 + 3 p + p (p - 1)/2), ten for each coefficient
      of the regression.
    - `disturbance`, `seed`: as in `ensemble`.
    - `confidence`: level, between 0 and 1, of the intervals, which are by Student's distribution.

    **Returns:** an `xarray.Dataset`. For each output "force" with one number in each run (others
    are left out), ``force_mean`` and ``force_standard_error`` (of the mean) are scalars;
    ``force_derivative``, ``force_derivative_standard_error``, ``force_derivative_low`` and
    ``force_derivative_high`` (the confidence interval) are along "parameter". Derivatives are in
    the output's unit, by the nominal coordinates on the parameters' scales, such as the logarithm
    of the nominal value for `Log`; ``coordinate`` has the names of these coordinates. ``failed``
    counts the failed runs, which are left out, as are values that are not finite.

    **Raises:** `ValueError` for unsupported arguments, such as outputs "force" and
    "force_derivative", two of whose results would have the same name; and if too few runs succeed.

    **Warns:** as `sweep` does, for example of failed runs.

    >>> tolerance = cj.Uncertain(cj.Parameter(stiffness.variation, cj.Log()), deviation=0.02)
    >>> speed = {"speed": cj.Peak(cj.quantities.Velocity("ball"), "m/s")}
    >>> found = cj.statistics_derivatives(
    ...     scene, state, 0.5, {"stiffness": tolerance}, speed, draws=200, progress=False
    ... )
    >>> print(f"{float(found['speed_derivative'][0]):.3f}")  # 0.1 m sqrt(k/m): half of 1 m/s
    0.500
    """
    check_names(scene, state)
    check_uncertain(uncertain)
    require_positive("disturbance", disturbance, "give it in m/s")
    check_confidence(confidence)
    require_count("draws", draws, "give a number of runs")
    require(draws % 2 == 0, "draws", draws, "even", "add one")
    fewest = LEAST_RUNS * _coefficients(len(uncertain))
    expected = f"{fewest} or more for {len(uncertain)} parameters"
    require(draws >= fewest, "draws", draws, expected, "run more")
    require_distinct_names(requested_by(outputs, None), ENDINGS)
    scene, state = with_arrays((scene, state))
    points = _points(uncertain, draws, seed)
    pairs = zip(uncertain.items(), points.T, strict=True)
    axes = {name: number.axis(scene, state, column) for (name, number), column in pairs}
    along = directions(scene, len(points), seed)
    # The two runs of a pair, which come after the first `draws` runs, share their direction.
    along[draws + 1 :: 2] = along[draws::2]
    start_time = options.get("start_time", 0.0)
    lanes = disturbed_axes(scene, state, axes, disturbance, along, start_time)
    results = sweep(scene, state, end_time, lanes, outputs, settings, zipped=True, **options)
    from scipy.special import stdtrit

    # One unit of each standardised coordinate, in the coordinate of the parameter's scale.
    sizes = np.array([number.centre_and_size(scene, state)[1] for number in uncertain.values()])
    normal = np.array([number.is_normal for number in uncertain.values()])
    variables = {"failed": number_failed(results)}
    for name, (values, unit) in scalar_outputs(results).items():
        # A coordinate changes by its size when the standardised coordinate changes by 1. Divided by
        # the sizes, derivatives by standardised coordinates become those by nominal coordinates.
        estimated = estimate(points, values, draws, normal)
        derivatives, errors = estimated.derivatives / sizes, estimated.errors / sizes
        # Half the width of the intervals, by Student's distribution.
        half = stdtrit(estimated.freedom, 0.5 * (1.0 + confidence)) * errors
        # Only the first runs are independent draws from the distributions, whose mean is wanted.
        sample = values[:draws][np.isfinite(values[:draws])]
        error = sample.std(ddof=1) / np.sqrt(len(sample))
        rows = derivatives, errors, derivatives - half, derivatives + half
        results_of = sample.mean(), error, *rows
        for ending, numbers in zip(ENDINGS, results_of, strict=True):
            dims = ("parameter",) if np.ndim(numbers) else ()
            variables[result_name(name, ending)] = Labelled(dims, numbers, unit)
    coordinates = [number.parameter.scale.label(name) for name, number in uncertain.items()]
    labels = {
        "parameter": Labelled(("parameter",), texts(list(uncertain))),
        "coordinate": Labelled(("parameter",), texts(coordinates)),
    }
    notes = {"runs": len(points), "seed": seed, "confidence": confidence}
    notes["disturbance"] = f"{disturbance:g} m/s"
    return labelled_dataset("derivatives of statistics", variables, labels, tuple(notes.items()))


def _coefficients(parameters: int) -> int:
    """Return the number of coefficients of the regression for a number of `parameters`: a constant,
    three powers of each parameter, and the products of two."""
    return 1 + 3 * parameters + parameters * (parameters - 1) // 2


def _points(uncertain: Mapping[str, Uncertain], draws: int, seed: int) -> np.ndarray:
    """Return the standardised coordinates of all runs, (runs, p).

    The first `draws` rows are independent draws. Then come as many rows for each parameter with a
    uniform distribution, in pairs that differ only in this parameter: it is 1 in the first row of a
    pair and -1 in the second.
    """
    # With the seed alone, the draws would come from the same random numbers as `directions`.
    require_count("seed", seed, "give a whole number", zero=True)
    rng = np.random.default_rng([seed, 1])

    def drawn(count: int) -> np.ndarray:
        # Independent draws of all parameters, (count, p).
        columns = zip(uncertain.values(), rng.random((count, len(uncertain))).T, strict=True)
        return np.stack([number.standardised(column) for number, column in columns], axis=1)

    blocks = [drawn(draws)]
    for k, number in enumerate(uncertain.values()):
        if not number.is_normal:
            # Both runs of a pair have the same draw of all other parameters.
            pairs = np.repeat(drawn(draws // 2), 2, axis=0)
            pairs[0::2, k], pairs[1::2, k] = 1.0, -1.0
            blocks.append(pairs)
    return np.concatenate(blocks)


class Estimate(NamedTuple):
    """Derivatives of an output's mean by the nominal coordinates in units of sigma, their standard
    errors, and the degrees of freedom of these errors."""

    derivatives: Float[np.ndarray, " p"]
    errors: Float[np.ndarray, " p"]
    freedom: Float[np.ndarray, " p"]


def estimate(
    points: Float[np.ndarray, "runs p"],
    values: Float[np.ndarray, " runs"],
    draws: int,
    normal: np.ndarray,
) -> Estimate:
    """Return the derivatives of an output's mean by the nominal coordinates in units of sigma, from
    its `values` at the `points` of `_points`: for the `normal` parameters, (p,) bools, by a fit to
    the first `draws` runs, which are independent; for uniform ones by the pairs of runs."""
    p = points.shape[1]
    derivatives, errors, freedom = np.zeros((3, p))
    usable = np.isfinite(values[:draws])
    needed, successful = LEAST_RUNS * _coefficients(p), int(usable.sum())
    expected = f"so many that {needed} runs succeed ({successful} did)"
    require(successful >= needed, "draws", draws, expected, "run more, or find the failure")
    slopes, slope_errors = _regression(points[:draws][usable], values[:draws][usable], normal)
    derivatives[normal], errors[normal] = slopes[normal], slope_errors[normal]
    freedom[normal] = successful - _coefficients(p)
    # Each uniform parameter has as many runs as there are independent draws, in pairs.
    blocks = values[draws:].reshape(-1, draws // 2, 2)
    for k, pairs in zip(np.flatnonzero(~normal), blocks, strict=True):
        # The ends of the distribution are at 1 and -1, a distance of 2.
        quotients = 0.5 * (pairs[:, 0] - pairs[:, 1])
        quotients = quotients[np.isfinite(quotients)]
        count = len(quotients)
        require(count > 1, "draws", count, "2 pairs of runs or more", "run more")
        derivatives[k], errors[k] = quotients.mean(), quotients.std(ddof=1) / np.sqrt(count)
        freedom[k] = count - 1
    return Estimate(derivatives, errors, freedom)


def _regression(z: np.ndarray, y: np.ndarray, normal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the coefficients of the p standardised coordinates z (runs, p) in a regression of the
    output y (runs,), and their standard errors, (p,) each. The regressors are polynomials of one
    coordinate up to degree 3, those of Hermite for `normal`, (p,), and of Legendre for uniform
    distributions, and products of two coordinates. They are orthogonal under the distribution of z,
    so that the expectation of the coefficient of z does not depend on the other regressors."""
    p = z.shape[1]
    square = np.where(normal, z**2 - 1.0, 1.5 * z**2 - 0.5)
    cube = np.where(normal, z**3 - 3.0 * z, 2.5 * z**3 - 1.5 * z)
    products = [z[:, i] * z[:, j] for i in range(p) for j in range(i)]
    columns = [np.ones(len(z)), *z.T, *square.T, *cube.T, *products]
    design = np.stack(columns, axis=1)
    inverse = np.linalg.pinv(design)
    residuals = y - design @ (inverse @ y)
    # The scatter of a chaotic output depends on z: the errors don't assume equal variances. They
    # are the HC4 errors of F. Cribari-Neto, *Asymptotic inference under heteroskedasticity of
    # unknown form*, 2004. The residual of a smooth output is a polynomial of higher degree: it is
    # largest at the runs that are farthest from the nominal values, which have the largest
    # leverage. HC3 errors, with the power 2, were so small there that intervals by 10 runs for each
    # coefficient held 81 to 89 % of the derivatives, and cross-fitting 77 to 83 %, for the stated
    # 95 %.
    leverage = np.einsum("ij,ji->i", design, inverse)
    power = np.minimum(MOST_POWER, leverage / leverage.mean())
    # A leverage of 1, of a run that alone determines a coefficient, would divide by zero.
    scaled = residuals / np.maximum(1.0 - leverage, 1e-12) ** (0.5 * power)
    errors = np.sqrt(((inverse * scaled) ** 2).sum(axis=1))
    # After the constant come the coefficients of z.
    return (inverse @ y)[1 : p + 1], errors[1 : p + 1]

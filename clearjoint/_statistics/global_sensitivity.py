"""Sobol indices: the shares of the variance of an output that its parameters cause."""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

import numpy as np
from typing_extensions import Unpack

from .._dynamics.constraint_report import check_names
from .._export.datasets import Labelled, labelled_dataset, texts
from .._fields.cautions import warn_the_user
from .._fields.checks import require, require_count
from .._fields.objects import with_arrays
from .._model.bodies import State
from .._model.scene import Scene
from .._simulation.run.outputs import Output
from .._simulation.step.settings import Settings
from .._sweeps.sweep import SweepOptions, sweep
from .ensemble import number_failed, scalar_outputs
from .uncertain import Uncertain, axes_at, check_confidence, check_uncertain, unit_cube

if TYPE_CHECKING:
    import xarray as xr

ORDERS = ("first_order", "total_order")
"""Names of the two indices, in SciPy's order."""
RANDOMISATIONS = 4
"""Number of independent randomisations of the Sobol points. With more of them, Student's quantile
in the intervals is smaller, but each has fewer points, which fill the distributions less evenly:
with 8, for smooth outputs, errors are up to 5 times and intervals up to 3 times larger."""


def sobol_indices(
    scene: Scene,
    state: State,
    end_time: float | Callable[[Scene], float],
    uncertain: Mapping[str, Uncertain],
    outputs: Mapping[str, Output],
    settings: Settings | None = None,
    *,
    draws: int = 256,
    seed: int = 0,
    confidence: float = 0.95,
    **options: Unpack[SweepOptions],
) -> "xr.Dataset":
    """Compute which parameters cause the variance of outputs, by a sweep over their distributions.

    The first-order index of a parameter is the share of the variance that it causes alone, and its
    total index is the share that it causes alone and together with other parameters. The estimator
    is that of `scipy.stats.sobol_indices` (Saltelli et al., Computer Physics Communications 181,
    2010). It takes groups of p + 2 runs: two at random points, and one for each parameter, at the
    first point with this parameter's value from the second. The random points are Sobol points in
    four independent randomisations (two for two groups), from whose differences follow standard
    errors of the indices and intervals by Student's distribution with three degrees of freedom.

    **Arguments:**

    - `scene`, `state`, `end_time`, `outputs`, `settings`, and the options `start_time`, `path`,
      `executor`, `threads`, `chunk`, `progress`: as in `sweep`.
    - `uncertain`: p parameters, two or more, `Uncertain` by name.
    - `draws`: n, a power of two, 2 or more; n (p + 2) runs are made.
    - `seed`: of the scrambled Sobol points.
    - `confidence`: level of the intervals, between 0 and 1.

    **Returns:** an `xarray.Dataset` along "parameter". For each output "force" with one number in
    each run (others are left out) it has the indices ``force_first_order`` and
    ``force_total_order``, each with the ends of its interval in variables whose names end in
    ``_low`` and ``_high``. The scalars ``force_mean`` and ``force_deviation`` are the mean and
    standard deviation over the distributions, from all successful runs at the two random points of
    the groups. For the indices, groups with a failed run, or with a value that is not finite, are
    left out. ``failed`` counts the failed runs.

    **Raises:** `ValueError` for unsupported arguments, and if groups of fewer than two
    randomisations are left.

    **Warns:** `UserWarning` if groups are left out; also as `sweep` does, such as of failed runs.

    >>> uncertain = {
    ...     "stiffness": cj.Uncertain(lambda s: s.forces["spring"].stiffness, half_width=10.0),
    ...     "mass": cj.Uncertain(lambda s: s.bodies["ball"].mass, half_width=0.01),
    ... }
    >>> speed = {"speed": cj.Peak(cj.quantities.Velocity("ball"), "m/s")}
    >>> found = cj.sobol_indices(scene, state, 0.5, uncertain, speed, draws=64, progress=False)
    >>> bool(found["speed_total_order"].sel(parameter="stiffness") > 0.9)
    True
    """
    check_names(scene, state)
    check_uncertain(uncertain)
    p = len(uncertain)
    require(p > 1, "uncertain", list(uncertain), "two parameters or more", "add a parameter")
    require_count("draws", draws, "give a power of two")
    require(draws & (draws - 1) == 0 and draws > 1, "draws", draws, "a power of two", "round it up")
    check_confidence(confidence)
    scene, state = with_arrays((scene, state))
    axes = axes_at(scene, state, uncertain, _groups(p, draws, seed))
    results = sweep(scene, state, end_time, axes, outputs, settings, zipped=True, **options)
    variables = {"failed": number_failed(results)}
    for name, (values, unit) in scalar_outputs(results).items():
        groups = values.reshape(draws, p + 2)
        # Only the first two points of a group are independent draws from the distributions.
        sample = groups[:, :2][np.isfinite(groups[:, :2])]
        variables[f"{name}_mean"] = Labelled((), sample.mean(), unit)
        variables[f"{name}_deviation"] = Labelled((), sample.std(ddof=1), unit)
        for order, numbers in _indices(groups, confidence).items():
            variables[f"{name}_{order}"] = Labelled(("parameter",), numbers, "1")
    labels = {"parameter": Labelled(("parameter",), texts(list(uncertain)))}
    notes = {"runs": draws * (p + 2), "seed": seed, "confidence": confidence}
    return labelled_dataset("Sobol indices", variables, labels, tuple(notes.items()))


def _groups(p: int, draws: int, seed: int) -> np.ndarray:
    """Return the points of all runs in the unit cube, (draws (p + 2), p), in groups of p + 2.

    A group has two independent points A and B, and for each parameter the point A with this
    parameter's coordinate from B. Groups come one after the other, so that a larger `draws` appends
    to the runs of a stored sweep. With n = min(`RANDOMISATIONS`, `draws`) independently scrambled
    Sobol sequences, group i takes its points from sequence i modulo n.
    """
    require_count("seed", seed, "give a whole number", zero=True)
    randomisations = min(RANDOMISATIONS, draws)
    seeds = np.random.SeedSequence(seed).generate_state(randomisations)
    each = [unit_cube(2 * p, draws // randomisations, "sobol", int(s)) for s in seeds]
    # Stacked along axis 1, so that the sequences alternate from group to group. A row has A and B.
    points_a, points_b = np.split(np.stack(each, axis=1).reshape(draws, 2 * p), 2, axis=1)
    groups = np.repeat(points_a[:, None], p + 2, axis=1)
    groups[:, 1] = points_b
    # In point 2 + k of each group, coordinate k is replaced by that of B.
    groups[:, 2 + np.arange(p), np.arange(p)] = points_b
    return groups.reshape(-1, p)


def _indices(groups: np.ndarray, confidence: float) -> dict[str, np.ndarray]:
    """Return the first-order and total indices of an output, and the ends of their confidence
    intervals, (p,) by name. `groups`: (n, p + 2), the output's values, a row for each group of runs
    from `_groups`. Groups with a value that is not finite are left out."""
    from scipy.special import stdtrit

    usable = np.isfinite(groups).all(axis=1)
    # Successive groups are of different randomisations.
    used, randomisation = groups[usable], (np.arange(len(groups)) % RANDOMISATIONS)[usable]
    randomisations = np.unique(randomisation)
    expected = "2 groups without failures or more, of different randomisations"
    require(len(randomisations) > 1, "draws", len(used), expected, "run more")
    if len(used) < len(groups):
        warn_the_user(f"{len(used)} of {len(groups)} groups of runs are used.")
    # Outputs at the points A, B and, for each parameter, at A with this parameter from B. The mean
    # is subtracted, because the indices vary less without it.
    a, b, *mixed = (used - used[:, :2].mean()).T
    # The indices are the means of these terms over the variance, as in SciPy.
    first_terms, total_terms = [b * (c - a) for c in mixed], [0.5 * (a - c) ** 2 for c in mixed]
    moments = [np.ones(len(used)), 0.5 * (a + b), 0.5 * (a**2 + b**2)]
    terms = [*moments, *first_terms, *total_terms]
    # A row for each randomisation: number, sum and sum of squares, then p and p terms.
    sums = np.array([[term[randomisation == k].sum() for term in terms] for k in randomisations])

    def both_orders(row: np.ndarray) -> np.ndarray:
        """Return first-order and total indices, (2, p), from `row`, sums of `terms` over groups."""
        number, mean, square = row[0], row[1] / row[0], row[2] / row[0]
        variance = square - mean**2
        # An output that does not vary has the indices zero, as in SciPy.
        return (row[3:] / number / variance if variance > 0.0 else 0.0 * row[3:]).reshape(2, -1)

    # Standard error by the jackknife: by the indices without each randomisation in turn. The groups
    # of one randomisation are not independent: the spread of single groups, such as in a bootstrap,
    # is that of random points, which is up to 200 times the error of Sobol points.
    total, freedom = sums.sum(axis=0), len(randomisations) - 1
    indices, without_one = both_orders(total), np.array([both_orders(total - row) for row in sums])
    error = np.sqrt(freedom * without_one.var(axis=0))
    half = stdtrit(freedom, 0.5 * (1.0 + confidence)) * error
    by_ending = {"": indices, "_low": indices - half, "_high": indices + half}
    return {
        f"{order}{ending}": numbers[k]
        for k, order in enumerate(ORDERS)
        for ending, numbers in by_ending.items()
    }

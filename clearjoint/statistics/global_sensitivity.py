"""Sobol indices: the shares of the variance of an output that its parameters cause."""

import warnings
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

import numpy as np
from typing_extensions import Unpack

from ..export.datasets import Labelled, labelled_dataset, texts
from ..fields.cautions import level_of_the_user
from ..fields.checks import require, require_count
from ..fields.objects import with_arrays
from ..model.bodies import State
from ..model.scene import Scene
from ..simulation.step.settings import Settings
from ..sweeps.outputs import Output
from ..sweeps.sweep import SweepOptions, sweep
from .ensemble import number_failed, scalar_outputs
from .uncertain import Uncertain, axes_at, check_confidence, check_uncertain, unit_cube

if TYPE_CHECKING:
    import xarray as xr

ORDERS = ("first_order", "total_order")
"""Names of the two indices, in SciPy's order."""
RESAMPLES = 999
"""Number of bootstrap samples from which the intervals are computed."""


def sobol_indices(
    scene: Scene,
    state: State,
    end_time: float | Callable[[Scene], float],
    uncertain: Mapping[str, Uncertain],
    outputs: Mapping[str, Output],
    settings: Settings | None = None,
    *,
    count: int = 256,
    seed: int = 0,
    confidence: float = 0.95,
    **options: Unpack[SweepOptions],
) -> "xr.Dataset":
    """Compute which parameters cause the variance of outputs, by a sweep over their distributions.

    The first-order index of a parameter is the share of the variance that it causes alone, and its
    total index is the share that it causes alone and together with other parameters. The estimator
    is that of `scipy.stats.sobol_indices` (Saltelli et al., Computer Physics Communications 181,
    2010). It takes groups of p + 2 runs: two at random points, and one for each parameter, at the
    first point with this parameter's value from the second. Intervals are percentiles of a
    bootstrap over these groups.

    **Arguments:**

    - `scene`, `state`, `end_time` s, `outputs`, `settings`, and the options `start_time`, `path`,
      `executor`, `threads`, `chunk`, `progress`: as in `sweep`.
    - `uncertain`: p parameters, two or more, `Uncertain` by name.
    - `count`: n, a power of two, 2 or more; n (p + 2) runs are made.
    - `seed`: of the scrambled Sobol points and of the bootstrap.
    - `confidence`: level of the intervals, between 0 and 1.

    **Returns:** an `xarray.Dataset` along "parameter". An output with one number in each run, for
    example one named "force", gives the indices ``force_first_order`` and ``force_total_order``,
    each with the ends of its interval in variables whose names end in ``_low`` and ``_high``. Its
    mean and standard deviation over the distributions are the scalars ``force_mean`` and
    ``force_deviation``, from all successful runs at the two random points of the groups. Other
    outputs are left out. For the indices, groups with a failed run, or with a value that is not
    finite, are left out. Of the remaining groups only the first are used, as many as the largest
    power of two up to their number, because the estimator requires a power of two. ``failed``
    counts the failed runs.

    **Raises:** `ValueError` for unsupported arguments, and if fewer than two groups are left.

    **Warns:** `UserWarning` if groups are left out; also as `sweep` does, such as of failed runs.

    >>> stiffness = lambda scene: scene.forces["spring"].stiffness
    >>> mass = lambda scene: scene.bodies["ball"].mass
    >>> uncertain = {
    ...     "stiffness": cj.Uncertain(stiffness, half_width=10.0),
    ...     "mass": cj.Uncertain(mass, half_width=0.01),
    ... }
    >>> speed = {"speed": cj.Peak(cj.quantities.Velocity("ball"), "m/s")}
    >>> found = cj.sobol_indices(scene, state, 0.5, uncertain, speed, count=64, progress=False)
    >>> bool(found["speed_total_order"].sel(parameter="stiffness") > 0.9)
    True
    """
    check_uncertain(uncertain)
    p = len(uncertain)
    require(p > 1, "uncertain", list(uncertain), "two parameters or more", "add a parameter")
    require_count("count", count, "give a power of two")
    require(count & (count - 1) == 0 and count > 1, "count", count, "a power of two", "round it up")
    check_confidence(confidence)
    scene, state = with_arrays((scene, state))
    axes = axes_at(scene, state, uncertain, _groups(p, count, seed))
    results = sweep(scene, state, end_time, axes, outputs, settings, zipped=True, **options)
    variables = {"failed": number_failed(results)}
    for name, (values, unit) in scalar_outputs(results).items():
        groups = values.reshape(count, p + 2)
        # Only the first two points of a group are independent draws from the distributions.
        sample = groups[:, :2][np.isfinite(groups[:, :2])]
        variables[f"{name}_mean"] = Labelled((), sample.mean(), unit)
        variables[f"{name}_deviation"] = Labelled((), sample.std(ddof=1), unit)
        for order, numbers in _indices(groups, confidence, seed).items():
            variables[f"{name}_{order}"] = Labelled(("parameter",), numbers, "1")
    labels = {"parameter": Labelled(("parameter",), texts(list(uncertain)))}
    notes = {"runs": count * (p + 2), "seed": seed, "confidence": confidence}
    return labelled_dataset("Sobol indices", variables, labels, tuple(notes.items()))


def _groups(p: int, count: int, seed: int) -> np.ndarray:
    """Return the points of all runs in the unit cube, (count (p + 2), p), in groups of p + 2.

    A group has two independent points A and B, and for each parameter the point A with this
    parameter's coordinate from B. Groups come one after the other, so that a larger `count` appends
    to the runs of a stored sweep.
    """
    first, second = np.split(unit_cube(2 * p, count, "sobol", seed), 2, axis=1)
    groups = np.repeat(first[:, None], p + 2, axis=1)
    groups[:, 1] = second
    groups[:, 2 + np.arange(p), np.arange(p)] = second
    return groups.reshape(-1, p)


def _indices(groups: np.ndarray, confidence: float, seed: int) -> dict[str, np.ndarray]:
    """Return first-order and total indices of an output, and the ends of their intervals.

    Groups with a value that is not finite are left out.

    **Arguments:** `groups`: (n, p + 2) the output in each run, NaN for failed runs; `confidence`:
    level of the intervals; `seed`: of the bootstrap.

    **Returns:** arrays (p,) by name: the indices by the names in `ORDERS`, and the ends of their
    intervals by these names with "_low" and "_high" appended.

    **Raises:** `ValueError` if fewer than two groups are left.

    **Warns:** `UserWarning` if fewer than n groups are used.
    """
    from scipy import stats

    whole = groups[np.isfinite(groups).all(axis=1)]
    require(len(whole) > 1, "count", len(whole), "2 groups without failures or more", "run more")
    # SciPy's estimator requires a power of two, for which Sobol points fill the cube evenly.
    used = 1 << (len(whole).bit_length() - 1)
    if used < len(groups):
        text = f"{used} of {len(groups)} groups of runs are used."
        warnings.warn(text, stacklevel=level_of_the_user())

    # SciPy takes arrays (1, n) of the runs at the points A and B, and (p, 1, n) of those at A with
    # one parameter from B. The bootstrap resamples the indices of the groups.
    def both_orders(rows: np.ndarray) -> np.ndarray:
        a, b, ab = whole[rows, :1].T, whole[rows, 1:2].T, whole[rows, 2:].T[:, None]
        found = stats.sobol_indices(func={"f_A": a, "f_B": b, "f_AB": ab}, n=used)
        return np.stack([found.first_order, found.total_order])

    # The bootstrap of SciPy's own result takes no seed, so it would differ from call to call.
    interval = stats.bootstrap(
        (np.arange(used),),
        both_orders,
        n_resamples=RESAMPLES,
        confidence_level=confidence,
        method="percentile",
        vectorized=False,
        rng=np.random.default_rng(seed),
    ).confidence_interval
    parts = {"": both_orders(np.arange(used)), "_low": interval.low, "_high": interval.high}
    return {
        f"{order}{suffix}": numbers[k]
        for k, order in enumerate(ORDERS)
        for suffix, numbers in parts.items()
    }

"""Ensembles: runs from starts that differ by less than a measurement can resolve."""

import math
import warnings
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float
from typing_extensions import Unpack

from .._dynamics.constraint_report import check_names, constraint_report
from .._export.datasets import Labelled
from .._fields.checks import (
    as_number,
    require,
    require_count,
    require_positive,
    require_shape,
    require_types,
)
from .._fields.objects import with_arrays
from .._information import error_growth as growth
from .._information.error_growth import radii_of_gyration
from .._model.bodies import State
from .._model.scene import Scene
from .._parametrisation.variations import SceneNumber, with_values
from .._simulation.lanes.lane import SAVED
from .._simulation.reductions.base import result_name
from .._simulation.results.solution import SUCCESSFUL
from .._simulation.run.outputs import Output, Requested, requested_by
from .._simulation.run.sensitivities import sensitivities
from .._simulation.step import presets
from .._simulation.step.settings import Settings
from .._sweeps.axes import Axis, Values, lanes_of
from .._sweeps.outputs import NOT_OUTPUTS
from .._sweeps.sweep import SweepOptions, sweep

if TYPE_CHECKING:
    import xarray as xr

PARTS = ("velocity", "spin")
"""Fields of a body's initial state that are disturbed; positions are not."""
RANK_TOLERANCE = 1e-8
"""Singular values of the constraints' Jacobian count as zero up to this share of the largest."""
NEGLIGIBLE = 1e-9
"""Components of a disturbance below this share of its size are rounding errors and are set to zero,
so that velocities which the constraints fix get no axis."""


def directions(scene: Scene, draws: int, seed: int) -> Float[np.ndarray, "draws v"]:
    """Return a random direction in the space of all velocities for each draw of an ensemble.

    The v columns, all standard normal, are x, y and z of velocity and of spin, body after body. The
    first rows don't depend on `draws`, so that a stored ensemble can be extended.
    """
    require_count("seed", seed, "give a whole number", zero=True)
    return np.random.default_rng(seed).standard_normal((draws, 6 * len(scene.bodies)))


def disturbed_velocities(
    bodies: Sequence[str],
    scene: Scene,
    state: State,
    size: float,
    along: Float[np.ndarray, "n v"],
    start_time: float,
) -> Float[np.ndarray, "n v"]:
    """Return the velocity (m/s, global) and spin (rad/s, body axes) of each body at n disturbed
    starts. Columns are in the order of `bodies`, which need not be that of `scene`.

    A row of `along`, standard normal numbers, is a random direction. A disturbance is the part of
    it that the constraints permit. It is added to the velocities of `state`, scaled so that the
    root mean square of the added speeds over starts and bodies is expected to be `size`, m/s. A
    spin counts by the speed at its body's radius of gyration.
    """
    radii = radii_of_gyration(scene)
    lengths = np.concatenate([[1.0] * 3 + [radii[name]] * 3 for name in bodies])
    # In speeds at the radius of gyration, spins and velocities of all bodies are comparable. The
    # constraints are linear in the velocities, so that directions in the null space of their
    # Jacobian satisfy the constraints exactly, whatever the size.
    jacobian = constraint_report(scene, state, start_time).columns(bodies) / lengths
    singular, vectors = np.zeros(0), np.zeros((0, len(lengths)))
    if jacobian.size:
        _, singular, vectors = np.linalg.svd(jacobian)
    rank = int(np.sum(singular > RANK_TOLERANCE * singular.max(initial=0.0)))
    # The singular vectors after the first `rank` span the null space. Without constraints, every
    # direction is free.
    free = vectors[rank:] if jacobian.size else np.eye(len(lengths))
    remedy = "remove a joint or driver"
    require(len(free) > 0, "scene", "no free velocity", "one that can move", remedy)
    # The rows of `free` are orthonormal, so that the expected squared length of a direction that is
    # projected on them is their number. With the factor before the projection, the expected squared
    # speed, averaged over the bodies, is the square of `size`.
    added = size * np.sqrt(len(radii) / len(free)) * (along @ free.T) @ free
    added[np.abs(added) < NEGLIGIBLE * size] = 0.0
    return velocities_of(bodies, state) + added / lengths


def disturbed_axes(
    scene: Scene,
    state: State,
    axes: Mapping[str, Axis],
    size: float,
    along: Float[np.ndarray, "lanes v"],
    start_time: float,
    draws: int = 1,
) -> dict[str, Axis]:
    """Return axes of a zipped sweep that add a disturbance to the initial velocities of each lane.

    The result has the given `axes` and an axis, with a name such as "disturbed velocity x of arm",
    for each component of a velocity or spin that the disturbance changes in any lane. `size` and
    `along` are as in `disturbed_velocities`. Groups of `draws` successive lanes must have equal
    values of `axes`. A disturbance satisfies the constraints of the lane's scene. But if `draws` is
    1 and `axes` change only numbers of the scene, all lanes use the constraints of `scene`, so that
    the numbers must differ little from its own.
    """
    require_shape("start_time", start_time, (), "pass one time in s")
    # Whether the Jacobian of the given scene serves all lanes. Axes that change only numbers of the
    # scene leave the initial state as it is. With one draw for each value, every lane would need
    # its own Jacobian and singular value decomposition, which would be slow. These are the axes of
    # `statistics_derivatives`, whose numbers vary only within the tolerances of manufacture. If a
    # number differs by a small share, the tiny disturbance violates the constraints only by about
    # this share of itself. An ensemble's axes may change numbers much, but each of its Jacobians
    # serves many draws.
    shared = draws == 1 and all(isinstance(a.variation, SceneNumber) for a in axes.values())
    block = len(along) if shared else draws
    velocities, nominal = np.empty_like(along), np.empty_like(along)
    bodies = tuple(scene.bodies)
    values = {} if shared else {name: axis.values[::block] for name, axis in axes.items()}
    blocks = range(0, len(along), block)
    # All lanes of a block have the same Jacobian.
    for begin, pair in zip(blocks, at_points(scene, state, axes, values, len(blocks)), strict=True):
        rows = slice(begin, begin + block)
        if pair is None:  # The sweep does not run these lanes.
            velocities[rows] = nominal[rows] = velocities_of(bodies, state)
            continue
        block_scene, start = pair
        velocities[rows] = disturbed_velocities(
            bodies, block_scene, start, size, along[rows], start_time
        )
        nominal[rows] = velocities_of(bodies, start)
    # Components that no disturbance changes, such as all those out of a planar mechanism's plane,
    # need no axis.
    disturbed = dict(axes)
    names = [(b, part, k) for b in bodies for part in PARTS for k in range(3)]
    for column, (body, part, k) in enumerate(names):
        if (velocities[:, column] != nominal[:, column]).any():
            path = partial(_component, body=body, part=part, k=k)
            name = f"disturbed {part} {'xyz'[k]} of {body}"
            require(name not in axes, "axes", name, "names of no disturbed velocity", "rename it")
            disturbed[name] = Axis.initial(path, velocities[:, column])
    return disturbed


def at_points(
    scene: Scene, state: State, axes: Mapping[str, Axis], values: Values, count: int
) -> list[tuple[Scene, State] | None]:
    """Return scene and state at each of `count` points, ``None`` where a scene can't have the
    values. `values`: those at the points, by name of the axis; empty to change nothing."""
    if not values:
        return [(scene, state)] * count
    lanes = lanes_of(scene, state, axes, values)
    return [None if k in lanes.bad else lanes.of(k) for k in range(count)]


def _component(state: State, body: str, part: str, k: int) -> float:
    return getattr(state.bodies[body], part)[k]


def velocities_of(bodies: Sequence[str], state: State) -> Float[np.ndarray, " v"]:
    """Return velocity (m/s, global) and spin (rad/s, body axes) of the `bodies`, in their order."""
    states = [state.bodies[name] for name in bodies]
    return np.concatenate([[*body.velocity, *body.spin] for body in states]).astype(float)


DISTURBANCE = 1e-9
"""Default size of the disturbance of the initial velocities, m/s: far below the resolution of
measurements, and far above rounding errors."""
TANGENT_SETTINGS = replace(presets.derivatives, derivative_tolerance=1e9)
"""Settings of the runs with a tangent. With so large a tolerance, it does not control the steps: a
growth rate needs few correct digits of it, and as it grows, steps would become ever shorter."""
TANGENT_TIMES = 256
"""Number of times, evenly spaced over the run, at which the size of the tangent is computed."""
ROUNDING = 1e-12
"""Largest rounding error of a quantile's level."""
DRAW, QUANTILE = "draw", "quantile"
"""Names of the results' dimensions besides the axes."""
SAMPLE_TIMES = result_name(SAVED, "time")
"""Name of the sample times, where they differ between lanes."""
FAILED, EXPONENT = "failed", "lyapunov_exponent"
"""Names of results that are no statistics of an output."""
ENDINGS = "", "mean", "deviation", "standard_error", "quantile", "quantile_standard_error"
"""Endings of the names of an output's statistics, after an underscore."""


def ensemble(
    scene: Scene,
    state: State,
    end_time: float | Callable[[Scene], float],
    axes: Mapping[str, Axis] | None = None,
    outputs: Mapping[str, Output] | None = None,
    settings: Settings | None = None,
    *,
    draws: int = 100,
    disturbance: float = DISTURBANCE,
    seed: int = 0,
    quantiles: tuple[float, ...] = (0.05, 0.5, 0.95),
    exponents: int = 0,
    **options: Unpack[SweepOptions],
) -> "xr.Dataset":
    """Repeat each run of a sweep from slightly different starts, and return statistics of outputs.

    A chaotic motion can be computed from a measured start only up to its predictability horizon,
    but its statistics can be computed beyond. The starts differ in velocities and spins only, in
    random directions that the constraints permit. All runs are lanes of one zipped `sweep`.

    **Arguments:**

    - `scene`, `state`, `end_time`, `outputs`, `settings`, and the options `save`, `start_time`,
      `path`, `executor`, `threads`, `chunk`, `progress`: as in `sweep`. Statistics are of outputs
      with one number in each run, such as `Peak`, and of quantities at each time of `save`.
    - `axes`: `Axis` by name; the points are all combinations of the values, by default only the
      scene and state as they are.
    - `draws`: runs at each point, 2 or more. More draws of the same seed extend a stored ensemble.
    - `disturbance`: m/s, root mean square speed that is added to the bodies; a spin counts by the
      speed at its body's radius of gyration.
    - `seed`: of the random directions. All points share the directions.
    - `quantiles`: levels between 0 and 1.
    - `exponents`: number of draws from which the largest Lyapunov exponent is computed at each
      point, from 2 to `draws`; 0 for none. Each of these draws takes one more run, with
      derivatives, with `presets.derivatives` and a larger `derivative_tolerance` in place of
      `settings`; these runs are made one after the other.

    **Returns:** an `xarray.Dataset` along the axes. For each output "force":

    - ``force``: the values along "draw", NaN for failed runs;
    - ``force_mean``, its ``force_standard_error``, and ``force_deviation`` (standard deviation);
    - ``force_quantile`` and ``force_quantile_standard_error`` along "quantile". The standard error
      is NaN for a level too near 0 or 1 for the number of draws: for 0.05 with fewer than 19, for
      0.01 with fewer than 99.

    If `save` is a function of the scene, its times are ``saved_time``, along "saved_number".
    ``failed`` counts failed runs, which the statistics leave out. These are NaN where all runs
    failed; so are ``force_deviation`` and all standard errors where only one run succeeded.

    With `exponents`, ``lyapunov_exponent``, 1/s, is the growth rate of a tangent in the second half
    of the run, on average over the first `exponents` draws; its standard error is
    ``lyapunov_exponent_standard_error``. Both are NaN at a point where fewer than two of the runs
    with derivatives succeed. The tangent is the derivative of the motion by the initial velocity,
    as by `sensitivities`. Unlike the difference of two runs, it is exact across impacts, needs no
    size, and does not stop growing when it is as large as the motion.

    **Raises:** `ValueError` for unsupported arguments, such as an axis named "draw" or
    "quantile", which are dimensions of the result, and outputs "force" and "force_mean", two of
    whose results would have the same name; and for constraints that leave no velocity free.

    **Warns:** as `sweep` does, for example of failed runs.

    >>> speed = {"speed": cj.Peak(cj.quantities.Velocity("ball"), "m/s")}
    >>> found = cj.ensemble(scene, state, 0.5, outputs=speed, draws=20, progress=False)
    >>> found["speed"].shape, int(found["failed"]), round(float(found["speed_mean"]), 6)
    ((20,), 0, 1.0)
    """
    check_names(scene, state)
    axes = {} if axes is None else axes
    require_types("axes", axes, Axis, "an Axis", "pass {name: cj.Axis(path, values)}")
    taken, expected = sorted({DRAW, QUANTILE} & set(axes)), f"not named {DRAW} or {QUANTILE}"
    require(not taken, "axes", taken, expected, "rename the axis")
    require_count("draws", draws, "give a number of runs at each point")
    require(draws > 1, "draws", draws, "2 or more", "statistics need several runs")
    require_positive("disturbance", disturbance, "give it in m/s")
    levels = np.asarray(as_number(quantiles, "quantiles"))
    inside = levels.ndim == 1 and bool(((levels > 0.0) & (levels < 1.0)).all())
    differ = 0 < len(levels) == len(set(levels.tolist())) if inside else False
    expected, remedy = "levels between 0 and 1, each once", "pass for example (0.5,)"
    require(differ, "quantiles", quantiles, expected, remedy)
    possible = isinstance(exponents, int) and (exponents == 0 or 2 <= exponents <= draws)
    expected = f"0, or a whole number from 2 to draws = {draws}"
    require(possible, "exponents", exponents, expected, "a standard error needs two runs")
    requested = requested_by(outputs, options.get("save"))
    endings = ("", "standard_error") if exponents else ()
    growth_names = [result_name(EXPONENT, ending) for ending in endings]
    require_distinct_names(requested, ENDINGS, [FAILED, DRAW, QUANTILE, *growth_names, *axes])
    scene, state = with_arrays((scene, state))
    # The values of each axis at all combinations of values; those of the last axis change fastest.
    grids = np.meshgrid(*(axis.values for axis in axes.values()), indexing="ij")
    points = [grid.ravel() for grid in grids]
    count = len(points[0]) if points else 1
    # The draws of a point are successive lanes; all points share the draws' directions.
    pairs = zip(axes.items(), points, strict=True)
    repeated = {n: Axis(axis.variation, np.repeat(column, draws)) for (n, axis), column in pairs}
    along = np.tile(directions(scene, draws, seed), (count, 1))
    start_time = options.get("start_time", 0.0)
    lanes = disturbed_axes(scene, state, repeated, disturbance, along, start_time, draws)
    results = sweep(scene, state, end_time, lanes, outputs, settings, zipped=True, **options)
    shape = tuple(len(axis.values) for axis in axes.values())
    labels = {n: (n, a.values, {"units": a.unit_in(scene, state)}) for n, a in axes.items()}
    notes = {"draws": draws, "disturbance": f"{disturbance:g} m/s", "seed": seed}
    statistics = _statistics(results, labels, (*shape, draws), levels, requested.quantities)
    if exponents:
        rates = np.empty((count, 2))
        values = dict(zip(axes, points, strict=True))
        for k, pair in enumerate(at_points(scene, state, axes, values, count)):
            if pair is None:  # The scene cannot have the values at this point.
                rates[k] = math.nan
                continue
            changed, start = pair  # Scene and state with the values of the axes at this point.
            end = end_time(changed) if callable(end_time) else end_time
            span, progress = (start_time, end), options.get("progress", True)
            rates[k] = _lyapunov_exponent(
                changed, start, span, disturbance, along[:exponents], progress
            )
        for column, name in zip(rates.T, growth_names, strict=True):
            statistics[name] = tuple(axes), column.reshape(shape), {"units": "1/s"}
    return statistics.assign_attrs({**results.attrs, **notes})


def require_distinct_names(
    requested: Requested, endings: Collection[str], taken: Collection[str] = ()
) -> None:
    """Raise a `ValueError` if two results of statistics would have the same name, so that one of
    them would be lost. An output with one number in each run, or one at each sample time, has a
    result for each of the `endings`, such as "force_mean". `taken`: other names in the dataset."""
    reductions, sections = requested.reductions.items(), requested.sections
    outputs = [result_name(name, part) for name, r in reductions for part in r.units()]
    outputs += [*requested.quantities, *(result_name(name, "count") for name in sections)]
    names = [*taken, *(result_name(name, e) for name in outputs for e in endings)]
    twice = sorted({name for name in names if names.count(name) > 1})
    expected, remedy = "outputs whose results have names of their own", "rename an output or axis"
    require(not twice, "outputs", twice, expected, remedy)


def failed_runs(results: "xr.Dataset") -> Bool[np.ndarray, " lanes"]:
    return results["result"].values != SUCCESSFUL


def number_failed(results: "xr.Dataset") -> Labelled:
    return Labelled((), int(failed_runs(results).sum()), description="number of failed runs")


def scalar_outputs(
    results: "xr.Dataset", quantities: Collection[str] = ()
) -> dict[str, tuple[np.ndarray, str]]:
    """Return, by name, (values, unit) of each output of a zipped sweep that is a number, (lanes,),
    or is named in `quantities` and has sample times, (lanes, times); NaN in failed lanes."""
    failed = failed_runs(results)
    by_name = {}
    for name, variable in results.data_vars.items():
        if name in quantities or (variable.dims == ("lane",) and name not in NOT_OUTPUTS):
            # Transposed, because `failed` is along the first dimension and sample times follow it.
            values = np.where(failed, np.nan, variable.values.astype(float).T).T
            by_name[str(name)] = values, variable.attrs.get("units", "1")
    return by_name


def _statistics(
    results: "xr.Dataset",
    labels: Mapping[str, tuple],
    shape: tuple[int, ...],
    levels: Float[np.ndarray, " q"],
    quantities: Collection[str],
) -> "xr.Dataset":
    """Return the statistics over the draws at each combination of axis values.

    The lanes of `results`, of a zipped sweep, are in C order along `shape`: the number of values of
    each axis, then the number of draws. `labels` are the coordinates along the axes, `levels` are
    the levels of the quantiles, and `quantities` the names of outputs at sample times.
    """
    import xarray as xr

    statistics = xr.Dataset(coords={**labels, QUANTILE: levels})
    failed = failed_runs(results).reshape(shape).sum(axis=-1)
    statistics[FAILED] = tuple(labels), failed, {"long_name": "number of failed runs"}
    # Sample times that are a function of the scene are equal in all draws of a point, but NaN from
    # where a run failed.
    if SAMPLE_TIMES in results.data_vars:
        times = results[SAMPLE_TIMES]
        along = (*labels, DRAW, *times.dims[1:])
        of_draws = xr.DataArray(times.values.reshape(*shape, -1), dims=along, attrs=times.attrs)
        statistics[SAMPLE_TIMES] = of_draws.max(DRAW, keep_attrs=True)
    for name, (values, unit) in scalar_outputs(results, quantities).items():
        # Quantities have a further dimension, that of the sample times.
        times = results[name].dims[1:]
        coords = {dim: results[dim] for dim in times if dim in results.coords}
        values = values.reshape(*shape, *values.shape[1:])
        runs = xr.DataArray(values, coords, (*labels, DRAW, *times))
        deviation = runs.std(DRAW, ddof=1)
        with warnings.catch_warnings():
            # The quantiles of a point whose runs all failed are NaN.
            warnings.simplefilter("ignore", RuntimeWarning)
            quantile = runs.quantile(levels, DRAW).transpose(..., QUANTILE)
            errors = _quantile_errors(runs.transpose(..., DRAW).values, levels)
        # In the order of `ENDINGS`.
        variables = (
            runs,
            runs.mean(DRAW),
            deviation,
            deviation / np.sqrt(runs.count(DRAW)),
            quantile,
            quantile.copy(data=errors),
        )
        for ending, variable in zip(ENDINGS, variables, strict=True):
            statistics[result_name(name, ending)] = variable.assign_attrs(units=unit)
    return statistics


def _quantile_errors(
    runs: Float[np.ndarray, "... draws"], levels: Float[np.ndarray, " q"]
) -> Float[np.ndarray, "... q"]:
    """Return the standard errors of the quantiles of `runs`, at q levels, over the draws. Failed
    runs are NaN, and are left out. An error is NaN if fewer than two runs succeeded, and for a
    level p whose distance from 0 or 1 is below sqrt(p (1 - p)/n), for n successful runs."""
    # The share of n draws below the true quantile has a binomial distribution with the standard
    # deviation sqrt(p (1 - p)/n). Half the distance between the quantiles at the levels one
    # deviation below and above is therefore the standard error of a quantile.
    errors = np.full((*runs.shape[:-1], len(levels)), np.nan)
    for point in np.ndindex(*runs.shape[:-1]):
        usable = runs[point][np.isfinite(runs[point])]
        if len(usable) > 1:
            deviation = np.sqrt(levels * (1.0 - levels) / len(usable))
            ends = np.array([levels - deviation, levels + deviation])
            # Levels outside 0 to 1 have no quantiles. With the smallest or largest value in their
            # place, half the distance was 0.06 to 0.6 of the standard error.
            within = (ends[0] > -ROUNDING) & (ends[1] < 1.0 + ROUNDING)
            at_ends = np.quantile(usable, np.clip(ends[:, within], 0.0, 1.0))
            errors[point][within] = 0.5 * (at_ends[1] - at_ends[0])
    return errors


def _lyapunov_exponent(
    scene: Scene,
    state: State,
    span: tuple[float, float],
    size: float,
    along: Float[np.ndarray, "draws v"],
    progress: bool,
) -> tuple[float, float]:
    """Return the largest Lyapunov exponent, 1/s, from runs between the two times of `span`, s, as
    an average over starts that are disturbed by `size`, m/s, in the directions `along`; and the
    standard error of this average.

    The exponent of a start is the growth rate of the tangent in the second half of the run; in the
    first half the tangent turns to the direction of fastest growth. Runs that fail are left out. If
    fewer than two remain, both numbers are NaN.
    """
    start_time, end_time = span
    axes: dict[str, Axis] = disturbed_axes(scene, state, {}, size, along, start_time)
    # Without the start itself, where the tangent has not grown yet.
    times = np.linspace(start_time, end_time, TANGENT_TIMES + 1)[1:]
    # The tangent is the derivative of the coordinates of points of all bodies by the size of a
    # disturbance of the initial velocities.
    points, parameters = growth.points(scene), {growth.DISTURBANCE: growth.disturbance(scene)}
    options = {"start_time": start_time, "throw": False, "progress": progress}
    rates = []
    for k in range(len(along)):
        # The initial state of this draw, with its disturbed velocities.
        values = [(axis.variation, axis.values[k]) for axis in axes.values()]
        _, start = with_values(scene, state, values)
        run = sensitivities(
            scene, start, end_time, parameters, points, times, TANGENT_SETTINGS, **options
        )
        # The result of a failed run contains only the times before its failure.
        if len(run.times) == len(times):
            sizes = growth.sizes(run.derivatives, points)[:, 0]
            rates.append(growth.rate(times, sizes, 0.5 * (start_time + end_time)))
    if len(rates) < 2:
        return math.nan, math.nan
    return float(np.mean(rates)), float(np.std(rates, ddof=1) / np.sqrt(len(rates)))

"""Wear of clearance joints over many cycles of a periodic motion, in stages."""

import dataclasses
import re
import shutil
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import jax
import numpy as np
from jaxtyping import Float
from tqdm.auto import tqdm

from .._compilation.digests import LONG, digest
from .._fields.cautions import quiet
from .._fields.checks import require, require_count, require_positive
from .._fields.objects import with_arrays
from .._fields.types import ArrayLike
from .._math.vectors import fold_constants
from .._model.bodies import BodyState, State
from .._model.clearance_joints.clearance import ClearanceJoint
from .._model.clearance_joints.journal_bases import require_bases_only
from .._model.profiles import AbstractProfile, PeriodicSpline
from .._model.scene import Scene
from .._parametrisation.parameter import Parameter, check_parameters
from .._result_codes import RESULTS
from .._simulation.lanes.lane import Common
from .._simulation.run.saving import Saving
from .._simulation.run.simulate import simulate
from .._simulation.step import presets
from .._simulation.step.method import Scheme
from .._simulation.step.settings import Settings, settings_or
from .._sweeps.store.metadata import remove_abandoned, unfinished, write_dataset
from .._sweeps.store.program import RUN, programs
from ..quantities.base import require_known
from .wear_depths import even_angles, quadrature_times, wear_depths
from .wear_derivatives import MovingSpline, ParameterDirection, derivatives_in_spans, directions_of
from .wear_growth import History, JointWear, contact_history, grow
from .wear_rates import PARTS, PROFILES, Part, WearRates

if TYPE_CHECKING:
    import xarray as xr
    from scipy.interpolate import CubicSpline

FIRST_CHANGE = 0.2
"""Change of worn depth in the first stage over the largest penetration beyond the force's onset."""
GROWTH = 2.0
"""Largest number of cycles of a stage, divided by the number of cycles of the stage before; the
spline of `cycles_to_depth` through the stages then has an error of about 1e-3."""
SHORTENED = 0.25
"""Number of cycles of a shortened stage, divided by the number before shortening, if the run after
the stage failed; if the correction was too large, the smallest such ratio."""
FEWEST_CHANGE = 1e-3
"""Smallest change of the worn depth in a shortened stage, divided by the change in the first stage.
"""
SETTLING_RUNS = 8
"""Largest number of runs after a stage until the motion is periodic."""
LEAST_PENETRATION = 1e-12
"""Smallest scale of errors of depths, m, for joints whose contacts stay open."""
ADDRESS = re.compile(" at 0x[0-9a-f]+")
"""Part of the `repr` of a Python function that differs between processes."""
INTEGRATION = 0.02
"""Absolute tolerance of the integration over a stage, divided by the stage's permitted error."""
CONTACTS = ("contacts", "direct")
"""Variables of a store that are no part of the result: `history` and `direct` of `JointWear`."""
FEWEST_SAMPLES = 8
"""Smallest number of angles, `samples`. With 8 of them a cubic B-spline, which is four spacings
wide, covers half of the circumference."""
EXTREMES = {"penetration": "m", "force": "N"}
"""Unit of each quantity, by name, of which a result contains the largest value in each stage."""
LARGEST_LOSS = 0.05
"""Largest difference between a profile and the spline through its `samples`, over its range."""
STEPS_PER_SAMPLE = 16
"""Smallest number of quadrature steps in a cycle, divided by the number of angles. If a contact
circles the wall once a cycle, so many steps resolve its motion from one angle to the next."""


def wear(
    scene: Scene,
    state: State,
    cycle: float,
    rates: Mapping[str, WearRates],
    cycles: float | ArrayLike,
    settings: Settings | None = None,
    *,
    parameters: Mapping[str, Parameter] | None = None,
    settle: int = 1,
    measured: int = 2,
    tolerance: float = 0.1,
    stage_error: float = 0.01,
    largest_change: float | None = None,
    samples: int = 96,
    stages: int = 10_000,
    depth: float | None = None,
    start_time: float = 0.0,
    path: str | PathLike[str] | None = None,
    progress: bool = True,
) -> "xr.Dataset":
    """Compute how the profiles of clearance joints wear over many cycles of a periodic motion.

    A run measures the wear of a few cycles (Archard's law; see `clearjoint.WearRates`). Over the
    cycles of a stage, the depths then grow with the forces, sliding speeds and directions of the
    contacts of this run, while the pressure follows the wall. This is integrated by an implicit
    method, so that the depth of a stage may be many times the elastic penetration. A run with the
    new profiles follows. The depths are then integrated again, with contacts that change linearly
    over the cycles of the stage, from those of the run before it to those of the run after it. If
    this corrects the depths by more than `stage_error`, the stage is repeated with fewer cycles.

    **Arguments:**

    - `scene`, `state`, `start_time` s: as in `simulate`. The drives must repeat after a `cycle`, s.
    - `rates`: wear rates of the joints that wear, by name: each a `ClearanceJoint` without
      `line_points`, since a profile is the same all along the axis.
    - `cycles`: number of cycles to compute, such as 1e6, or ``np.inf`` if only `depth` ends the
      computation. Or a rising array, (n,), that fixes the stages: the number of cycles before each
      stage after the first one, such as ``found["cycles"][1:]`` of an earlier result with slightly
      different parameters. Corrections and `largest_change` then shorten no stage.
    - `settings`: of the runs; by default `clearjoint.presets.default` and, for the further runs
      that compute derivatives, `clearjoint.presets.derivatives`.
    - `parameters`: with respect to which the depths are differentiated, by names of your choice;
      they must not select a number of a profile that wears. The logarithms of the positive wear
      rates are additional parameters, with names such as "pin bearing rate". For the derivatives,
      the number of cycles before each stage is held fixed. The derivatives are valid if the motion
      has settled before the measured cycles.
    - `settle`: number of cycles of a run before the wear is measured, in which the memory of a
      `Servo`, which begins anew in each run, must settle too; `measured`: number of cycles
      that are measured, even. Their first and second half must agree to the relative `tolerance`:
      in the sum of the depths that wear off each joint, and in the sum of the derivatives with
      respect to each parameter. A motion that is not periodic needs many measured cycles.
    - `stage_error`: largest correction of the depths of a stage, relative to the sum of the joint's
      largest depth and its largest penetration, measured from where the force begins. The corrected
      depths have a smaller error. For differences between results take 1e-4, since the integration
      has a relative error of about a fiftieth of `stage_error`.
    - `largest_change`: largest change of depth in a stage, m; by default not limited. A stage has
      at most twice the cycles of the stage before, and the depth changes by a fifth of the
      penetration in the first stage.
    - `samples`: number of angles around the wall and around the journal, at least 8, and enough to
      resolve the profiles that wear, as a multiple of the number of knots of a spline always is.
    - `stages`: largest number of stages.
    - `depth`: m; the computation also ends when the deepest point of a part has lost this depth.
    - `path`: folder of a Zarr store of the result. Each stage is written; if the folder contains an
      earlier result of the same scene and arguments, computation continues from there.
      `stage_error`, `largest_change`, `stages` and `depth` may be other ones than before.

    **Returns:** an `xarray.Dataset` along "joint", "stage", "angle" and "body":

    - ``cycles``: number of cycles before each stage, (stage).
    - ``bearing_depth``, ``journal_depth``: depth worn off before each stage, m, (joint, stage,
      angle). The angle, rad, is about the axis of the bearing or journal, from its x axis (see
      `clearjoint.quantities.JournalOffset`).
    - ``bearing_rate``, ``journal_rate``: depth per cycle at the beginning of the stage, m, (joint,
      stage, angle). If the number of `stages` or a failure ends the computation, the last stage has
      no run: its rates, penetration and force are NaN, and its depths are not corrected.
    - ``bearing_depth_derivative``, ``journal_rate_derivative`` and so on: the derivatives of these
      depths and rates with respect to each parameter's coordinate (its value on its scale, such as
      the logarithm for `Log`), along the additional dimension "parameter". Only with `parameters`.
    - ``penetration``, ``force``: largest penetration, m, and largest sum of the normal forces at
      the two ends of the journal, N, in the measured cycles of a stage, (joint, stage).
    - ``bearing_volume``, ``journal_volume``: worn volume before a stage, m^3, (joint, stage).
    - ``final_position``, ``final_orientation``, ``final_velocity``, ``final_spin``: the state after
      the last run whose wear was used, as in `clearjoint.BodyState`, (body, 3) or (body, 4).

    The attribute ``ending`` is "reached the cycles", "reached the depth", or the reason why the
    computation ended before either. The attribute ``failure`` is this reason if the run of a stage
    failed, was not periodic, or wore nothing although only `depth` ends the computation; otherwise
    it is empty. `clearjoint.worn` returns the scene of a stage, and `clearjoint.cycles_to_depth`
    the number of cycles until a depth is reached.

    **Raises:** `ValueError` for an argument that is not supported or outside its range, an initial
    state with which no run can start, and a store of another computation; if the run of the first
    stage fails, its two halves differ by more than `tolerance`, or it wears nothing although only
    `depth` ends the computation; if the state at the end of a run does not fit the drives at
    `start_time`, so that `cycle` is not their period; and if a law has a force at a larger distance
    of the surfaces than its `onset_offset` states.

    After a long stage the journal first falls to the worn wall. Up to eight runs follow, each from
    the state at the end of the one before, until the halves of one agree to `tolerance`. If none
    does, or a run fails, the stage is repeated with fewer cycles, until the depth hardly changes.

    ```python
    import clearjoint as cj

    scene, state = cj.mechanisms.slider_crank(0.1e-3)
    rates = {"slider pin": cj.WearRates(bearing=1e-15)}
    found = cj.wear(scene, state, 0.012, rates, 1e5, stages=3)
    print(float(found["bearing_depth"].max()), "m")
    ```
    """
    scene, state = with_arrays((scene, state))
    run = CycleRun(
        rates=rates,
        cycle=cycle,
        settle=settle,
        measured=measured,
        tolerance=tolerance,
        samples=samples,
        settings=settings,
        start_time=start_time,
        cycles=np.asarray(cycles, float),
        stage_error=stage_error,
        largest_change=largest_change,
        stages=stages,
        depth=depth,
    )
    run.check(scene)
    scene = _with_splines(scene, run.rates_of_parts, samples)
    if parameters is not None:
        check_parameters(parameters)
        # The path to a parameter's number depends on the structure of the scene. So the profiles
        # that wear become `MovingSpline`s, with zeros as derivatives, before the directions are
        # made.
        count = len(parameters) + np.count_nonzero(list(run.rates_of_parts.values()))
        unworn = np.zeros((1 + count, len(rates), len(PARTS), samples))
        scene = _with_depths(scene, list(rates), unworn)
        directions = directions_of(scene, state, run.rates_of_parts, parameters)
        run = dataclasses.replace(run, directions=directions)
    stages_so_far = _Stages.first(run, scene, state)
    store = None if path is None else _Store(Path(path), _digest(scene, state, run))
    if store is not None:
        stages_so_far = store.read(stages_so_far)
    begun, last = stages_so_far.cycles[-1], float(run.cycles.max())
    total = last if np.isfinite(last) else None
    units = {"unit": " cycles", "unit_scale": True}
    with tqdm(total=total, initial=begun, disable=not progress, **units) as bar:
        while not stages_so_far.has_ended():
            stages_so_far.add()
            bar.update(stages_so_far.cycles[-1] - bar.n)
            if store is not None:
                store.write(stages_so_far.dataset(), stages_so_far.contacts())
    result = stages_so_far.dataset()
    # Only after the last stage is the attribute `ending` known.
    if store is not None:
        store.write(result, stages_so_far.contacts())
    return result


def worn(scene: Scene, found: "xr.Dataset", stage: int = -1) -> Scene:
    """Return a scene with the worn profiles at the beginning of a stage, by default the last one,
    of a result of `clearjoint.wear`; `scene` is the one that was given to it.

    A profile that has worn becomes a `clearjoint.profiles.PeriodicSpline` with a knot at each angle
    of the result. Parts without wear keep their profiles.

    >>> import xarray as xr
    >>> dims, depth = ("joint", "stage", "angle"), 5e-6 * np.ones((1, 1, 8))
    >>> found = xr.Dataset(
    ...     {"bearing_depth": (dims, depth), "journal_depth": (dims, 0.0 * depth)},
    ...     {"joint": ["shoulder"]},
    ... )
    >>> scene, _ = cj.mechanisms.double_pendulum()
    >>> profile = cj.worn(scene, found).joints["shoulder"].bearing_profile
    >>> print(f"{profile.at(0.0).value:.1e} m")
    5.0e-06 m
    """
    names, count = [str(name) for name in found["joint"].values], found.sizes["stage"]
    remedy = "count stages from 0, or from -1 for the last one"
    expected = f"a stage of {count}"
    require(stage in range(-count, count), "stage", stage, expected, remedy)
    for name in names:
        require_known("scene", name, list(scene.joints))
    # Depths (1, joints, 2, angles) of bearings and journals at the selected stage. There is one row
    # because derivatives are not selected.
    depths = _stacked(found[[f"{part}_depth" for part in PARTS]].isel(stage=[stage]), "depth")[0]
    deepest = dict(zip(names, depths[0].max(axis=2), strict=True))
    return _with_depths(_with_splines(scene, deepest, depths.shape[-1]), names, depths)


def cycles_to_depth(found: "xr.Dataset", depth: float, joint: str, part: Part = "bearing") -> float:
    """Return the number of cycles until the deepest point of a part has lost a depth, m, according
    to a result of `clearjoint.wear`; infinite if the depth was not reached.

    The depth is interpolated between the stages by a cubic spline.

    **Raises:** `ValueError` if the depth is not positive, or for a joint or part without wear.

    >>> import xarray as xr
    >>> depths = np.array([[[0.0, 0.0], [2e-6, 1e-6]]])  # of one joint, in two stages
    >>> found = xr.Dataset(
    ...     {"bearing_depth": (("joint", "stage", "angle"), depths)},
    ...     {"joint": ["pin"], "cycles": ("stage", [0.0, 1000.0])},
    ... )
    >>> print(f"{cj.cycles_to_depth(found, 1e-6, 'pin'):.0f} cycles")
    500 cycles
    """
    deepest = _of_joint(found, depth, joint, part)[f"{part}_depth"].max("angle").values
    if not deepest[-1] >= depth:
        return float("inf")
    _, life = _reached(found["cycles"].values, deepest, depth)
    return life


def _of_joint(found: "xr.Dataset", depth: float, joint: str, part: Part) -> "xr.Dataset":
    """Return the result of one joint, after a check of the arguments of `cycles_to_depth`."""
    require_positive("depth", depth, "give a depth in m, such as 1e-6")
    for argument, name, known in ("part", part, PARTS), ("joint", joint, found["joint"].values):
        expected = f"one of {', '.join(known)}"
        require(name in known, argument, name, expected, "name a part that wears")
    return found.sel(joint=joint)


def _reached(cycles: np.ndarray, depths: np.ndarray, depth: float) -> tuple["CubicSpline", float]:
    """Return the cubic spline through `depths`, m, at `cycles`, the numbers of cycles before the
    stages. Return also the number of cycles at which the spline first reaches `depth`, m. The last
    of `depths` must be at least `depth`."""
    from scipy.interpolate import CubicSpline

    spline = CubicSpline(cycles, depths)
    # By rounding, there may be no root if the last depth equals `depth`.
    roots = [root for root in spline.solve(depth, extrapolate=False) if np.isfinite(root)]
    return spline, float(min(roots, default=cycles[-1]))


def life_derivatives(
    found: "xr.Dataset", depth: float, joint: str, part: Part = "bearing"
) -> dict[str, float]:
    """Return the derivatives of `clearjoint.cycles_to_depth` by the parameters of a wear result.

    They are cycles per unit of each parameter's coordinate, by name of the parameter: for the scale
    `Log`, per unit of its natural logarithm. NaN if the depth, m, was not reached.

    **Raises:** `ValueError` if the result has no derivatives, or the depth is not positive.

    >>> import xarray as xr
    >>> depths = np.array([[[0.0, 0.0], [2e-6, 1e-6]]])  # of one joint, in two stages
    >>> dims = "joint", "stage", "angle"
    >>> found = xr.Dataset(
    ...     {
    ...         "bearing_depth": (dims, depths),
    ...         "bearing_depth_derivative": ((*dims, "parameter"), depths[..., None]),
    ...     },
    ...     {"joint": ["pin"], "cycles": ("stage", [0.0, 1000.0]), "parameter": ["load"]},
    ... )
    >>> print(f"{cj.life_derivatives(found, 1e-6, 'pin')['load']:.0f} cycles")
    -500 cycles
    """
    of_joint, remedy = _of_joint(found, depth, joint, part), "pass `parameters` to wear()"
    require("parameter" in found.dims, "found", list(found.dims), "with derivatives", remedy)
    names = [str(name) for name in found["parameter"].values]
    depths = of_joint[f"{part}_depth"].transpose("stage", "angle").values
    slopes = of_joint[f"{part}_depth_derivative"].transpose("stage", "angle", "parameter").values
    deepest, cycles = depths.max(axis=1), found["cycles"].values
    if not deepest[-1] >= depth:
        return dict.fromkeys(names, float("nan"))
    spline, life = _reached(cycles, deepest, depth)
    # If a parameter raises the curve of the depth by `change` at the end of the life, the life is
    # shorter by `change` over the slope of the curve. A spline depends linearly on its values, so
    # the change of the curve is the spline through the derivatives of its values.
    at_deepest = [of_stage[row.argmax()] for of_stage, row in zip(slopes, depths, strict=True)]
    change = type(spline)(cycles, np.array(at_deepest))(life)
    lives = -change / spline(life, 1)
    return dict(zip(names, lives.tolist(), strict=True))


@dataclass(frozen=True)
class CycleRun:
    """Arguments of `wear`, checked by `check`; `measure` makes the run of a stage with them.

    `directions`: result of `directions_of`, for derivatives; empty without them. A store is
    recognised by the `repr` of this object and by `cycles`; other fields that are not in the `repr`
    may change when the store is continued.
    """

    rates: Mapping[str, WearRates]
    cycle: float
    settle: int
    measured: int
    tolerance: float
    samples: int
    settings: Settings | None = None
    start_time: float = 0.0
    directions: Mapping[str, ParameterDirection] = dataclasses.field(default_factory=dict)
    cycles: Float[np.ndarray, "*n"] = dataclasses.field(kw_only=True, repr=False)
    stage_error: float = dataclasses.field(default=0.01, kw_only=True, repr=False)
    largest_change: float | None = dataclasses.field(kw_only=True, repr=False)
    stages: int = dataclasses.field(kw_only=True, repr=False)
    depth: float | None = dataclasses.field(kw_only=True, repr=False)

    @property
    def rates_of_parts(self) -> dict[str, tuple[float, float]]:
        """Wear rates of the bearing and the journal of each joint, m^2/N."""
        return {name: (rate.bearing, rate.journal) for name, rate in self.rates.items()}

    def check(self, scene: Scene) -> None:
        named, expected = dict(self.rates), "of one joint at least"
        require(len(named) > 0, "rates", named, expected, "name a joint")
        supported = [n for n, joint in scene.joints.items() if isinstance(joint, ClearanceJoint)]
        for name, of_joint in self.rates.items():
            require_known("rates", name, supported)
            require_bases_only("rates", name, scene.laws()[name])
            remedy = "pass cj.WearRates(bearing=...)"
            is_rates = isinstance(of_joint, WearRates)
            require(is_rates, f"rates[{name!r}]", of_joint, "a WearRates", remedy)
        require_positive("cycle", self.cycle, "give the duration of a cycle in s")
        goals = np.atleast_1d(np.asarray(self.cycles, float))
        is_row = goals.ndim == 1 and goals.size > 0
        positive = is_row and bool(np.all(np.diff(goals, prepend=0.0) > 0.0))
        remedy = "give a number of cycles, such as 1e6, or a rising row of them"
        require(positive, "cycles", self.cycles, "positive and rising", remedy)
        if self.depth is not None:
            require_positive("depth", self.depth, "give a depth in m, such as 1e-5")
        # A row fixes the stages, whose lengths must be finite.
        finite = np.isfinite(goals).all() or (self.depth is not None and np.ndim(self.cycles) == 0)
        require(finite, "cycles", self.cycles, "finite", "give a `depth` that ends the computation")
        require_count("settle", self.settle, "give a number of cycles", zero=True)
        require_count("measured", self.measured, "give an even number of cycles")
        even = self.measured % 2 == 0
        require(even, "measured", self.measured, "even, as its two halves are compared", "add one")
        require_count("samples", self.samples, "give a number of angles")
        require_positive("tolerance", self.tolerance, "give a relative difference, such as 0.1")
        require_positive("stage_error", self.stage_error, "give a relative error, such as 0.01")
        small, remedy = self.stage_error < 1.0, "give a relative error, such as 0.01"
        require(small, "stage_error", self.stage_error, "less than 1", remedy)
        if self.largest_change is not None:
            require_positive("largest_change", self.largest_change, "give a depth in m, or None")
        enough, expected = self.samples >= FEWEST_SAMPLES, f"at least {FEWEST_SAMPLES}"
        require(enough, "samples", self.samples, expected, "take the default of 96")
        require_count("stages", self.stages, "give a number of stages")

    def measure(
        self, scene: Scene, state: State, depths: Float[np.ndarray, "joints 2 samples"]
    ) -> "_Measured":
        """Run a stage from `state`; return the wear per cycle, its derivatives and the final state.
        If the run fails, the wear is zero; if the second run, for the derivatives, fails, these are
        zero; see `failure`. `depths`: m, already lost by bearings and journals, as in `scene`."""
        # The measured cycles begin after those in which the motion settles.
        begin = self.start_time + self.settle * self.cycle
        middle, end = (begin + part * self.measured * self.cycle for part in (0.5, 1.0))
        start, settings, save = self.start_time, self.settings, Saving(steps=True)
        solution = simulate(
            scene, state, end, settings, save, start_time=start, throw=False, progress=False
        )
        result, shape = solution.result, (len(self.rates), len(PARTS), self.samples)
        halves = np.zeros((2, 1 + len(self.directions), *shape))
        extremes = np.zeros((2, len(self.rates), len(EXTREMES)))
        rates = self.rates_of_parts
        histories: list[list[History]] = [[] for _ in rates]
        # For each half and joint, the run gives the wear (row 0 of `halves`), the largest
        # penetration and force, and the contacts.
        if result == RESULTS.successful:
            # A contact may run around the whole wall in a cycle. The wear at an angle is then that
            # of the short time in which the contact passes it, which the quadrature must resolve.
            longest = self.cycle / (STEPS_PER_SAMPLE * self.samples)
            spans = (begin, middle), (middle, end)
            times = [quadrature_times(solution, *span, longest) for span in spans]
            for k, instants in enumerate(times):
                for j, (name, of_parts) in enumerate(rates.items()):
                    of_half = wear_depths(scene, solution, name, of_parts, instants, self.samples)
                    halves[k, 0, j], extremes[k, j], signals = of_half
                    joint = _clearance_joint(scene, name)
                    # The work is divided by the cycles of both halves, whose histories are joined.
                    history = contact_history(joint, depths[j], instants, signals, self.measured)
                    histories[j].append(history)
            # `simulate` computes no derivatives. They need another run, which gives no wear.
            if directions := self.directions:
                derivatives, result = derivatives_in_spans(
                    scene, state, start, times, rates, directions, settings, self.samples
                )
                if derivatives is not None:
                    halves[:, 1:] = derivatives
        return _Measured(
            # Each half has half of the measured cycles.
            halves=halves / (0.5 * self.measured),
            extremes=extremes.max(axis=0),
            histories=[np.concatenate(of_halves, axis=2) for of_halves in histories if of_halves],
            # Only what a store keeps, so that a computation that is continued has the same bits.
            state=State(solution.final.bodies),
            failure="" if result == RESULTS.successful else RESULTS[result],
        )

    def difference(self, measured: "_Measured") -> float:
        """Return the largest relative difference of the two halves of the measured cycles.

        The depths of each joint are compared, and the derivatives of all joints by each parameter.
        The difference is |S1 - S2| / max(A1, A2). S1 and S2 are the sums of the two halves over all
        angles of bearing and journal, A1 and A2 those of the magnitudes, which can't cancel.
        """
        depths, slopes = measured.halves[:, 0], measured.halves[:, 1:]
        # A row of two numbers, one for each half, for each joint and then for each parameter.
        sums = [*depths.sum(axis=(2, 3)).T, *slopes.sum(axis=(2, 3, 4)).T]
        sizes = [*np.abs(depths).sum(axis=(2, 3)).T, *np.abs(slopes).sum(axis=(2, 3, 4)).T]
        differences, scales = np.abs(np.diff(sums)[:, 0]), np.max(sizes, axis=1)
        return float(np.max(differences / np.where(scales > 0.0, scales, 1.0)))


class _Measured(NamedTuple):
    """Wear of J joints, measured by one run.

    - `halves`: (2, 1 + p, J, 2, samples) m, for each half of the measured cycles: the depths of
      bearing and journal per cycle, then their derivatives with respect to each of p parameters.
    - `extremes`: (J, 2) largest penetration, m, and largest sum of the forces at both ends, N.
    - `histories`: contacts of each joint in all measured cycles; empty if the run failed.
    - `state`: the state at the end of the run.
    - `failure`: text of the run's result code; empty for a successful run.
    """

    halves: Float[np.ndarray, "2 rows joints 2 samples"]
    extremes: Float[np.ndarray, "joints 2"]
    histories: list[History]
    state: State
    failure: str


@dataclass
class _Stages:
    """The stages computed so far, of J joints that wear.

    - `run`: the arguments of `wear`; `scene`: from `_with_splines`, before any wear.
    - `cycles`: number of cycles before each stage.
    - `depths`: for each stage, (1 + p, J, 2, samples) m, the depths that have worn off before it,
      bearing before journal, and their derivatives along the p `run.directions`.
    - `rates`: for each stage with a run, m per cycle in the form of `depths`.
    - `extremes`: for each stage with a run, the `extremes` of its `_Measured`. The last stage may
      have no run yet. Its depths are then extrapolated, and are corrected after its run.
    - `wears`: wear of each joint in the last run; empty before the first one.
    - `state`: from which the next run starts.
    - `failure`: why no further stage can be computed; empty if one can.
    - `ending`: why the computation ended; empty while it goes on.
    """

    run: CycleRun
    scene: Scene
    state: State
    cycles: list[float]
    depths: list[np.ndarray]
    rates: list[np.ndarray] = dataclasses.field(default_factory=list)
    extremes: list[np.ndarray] = dataclasses.field(default_factory=list)
    wears: list[JointWear] = dataclasses.field(default_factory=list)
    failure: str = ""
    ending: str = ""

    @staticmethod
    def first(run: CycleRun, scene: Scene, state: State) -> "_Stages":
        """Return the stages before any run: one stage, in which no joint has worn."""
        shape = 1 + len(run.directions), len(run.rates), len(PARTS), run.samples
        return _Stages(run, scene, state, cycles=[0.0], depths=[np.zeros(shape)])

    def add(self) -> None:
        """Run the last stage, correct its depths by the run, and extrapolate them to a new stage.

        If the run fails or the correction is too large, the stage is replaced by a shorter one.
        Where this does not help, the first stage raises an error, and later ones set `failure`, so
        that the results so far are kept.
        """
        run = self.run
        # After a run, a new stage without a run is appended, unless the computation has ended. So
        # all stages have runs only if a store is continued beyond its end. How long the next stage
        # may be is not stored: it gets as many cycles as the last one.
        if len(self.rates) == len(self.cycles):
            self._extrapolate(self.cycles[-1] - self.cycles[-2])
            return
        measured = self._measured()
        # `difference` compares the wear in the two halves of the measured cycles: it is small if
        # the motion is periodic. `length` is the number of cycles of the stage whose end the run
        # has measured.
        difference, is_after_stage = run.difference(measured), len(self.cycles) > 1
        length = self.cycles[-1] - self.cycles[-2] if is_after_stage else 0.0
        # `_shorten` returns whether it could shorten the stage, which the next call then runs.
        if measured.failure or difference > run.tolerance:
            if not self._shorten(SHORTENED * length):
                self._refuse(measured.failure, difference)
            return
        depths, wears = self.depths[-1], self._wears(measured)
        if is_after_stage:
            try:
                depths, _ = self._grown(length, wears)
            except RuntimeError as error:
                if not self._shorten(SHORTENED * length):
                    self.failure = f"the depths of a stage failed: {error}"
                return
            # The largest correction of a depth (in row 0; others have derivatives) of each joint is
            # compared with the depth plus the penetration: a small depth needs little accuracy.
            scales = depths[0].max(axis=(1, 2)) + self._pressed()
            corrections = np.abs(depths - self.depths[-1])[0].max(axis=(1, 2))
            # The extrapolation is of first order in the length of the stage, so that its error is
            # proportional to the square of the length. The factor 0.9 leaves a margin, and 1e-9
            # avoids a division by zero.
            error = float(np.max(corrections / scales)) / run.stage_error
            next_length = length * min(GROWTH, 0.9 / np.sqrt(max(error, 1e-9)))
            if error > 1.0 and self._shorten(max(next_length, SHORTENED * length)):
                return
        self.depths[-1] = depths
        rows = [wear.per_cycle(depths[:, j]) for j, wear in enumerate(wears)]
        self.rates.append(np.stack(rows, axis=1))
        self.extremes.append(measured.extremes)
        self.state, self.wears = measured.state, wears
        if self.has_ended():
            return
        # Without wear, no number of cycles leads to a depth.
        if np.isinf(run.cycles.max()) and not self.rates[-1][0].any():
            self.failure = "no part wears in the measured cycles"
            remedy = "check the loads, or give a number of cycles"
            expected = f"finite ({self.failure})"
            require(is_after_stage, "cycles", np.inf, expected, remedy)
            return
        if not is_after_stage:
            next_length = self._cycles_to_change(FIRST_CHANGE)
        self._extrapolate(next_length)

    def has_ended(self) -> bool:
        """Return whether there is nothing more to compute, and set `ending` if so."""
        run = self.run
        # A goal is reached only when the run of the last stage has corrected the depths.
        has_run = len(self.rates) == len(self.cycles)
        if self.failure:
            self.ending = self.failure
        elif has_run and self.cycles[-1] >= run.cycles.max():
            self.ending = "reached the cycles"
        elif has_run and run.depth is not None and self.depths[-1][0].max() >= run.depth:
            self.ending = "reached the depth"
        elif len(self.cycles) >= run.stages:
            self.ending = f"{run.stages} stages"
        else:
            self.ending = ""
        return self.ending != ""

    def _measured(self) -> _Measured:
        """Return the wear by a run of the last stage. The journal may first have to fall to the
        worn wall, so that further runs follow until the motion is periodic."""
        run, state = self.run, self.state
        scene = _with_depths(self.scene, list(run.rates), self.depths[-1])
        # Before the first stage, nothing has worn: the journal need not fall. The state is the
        # user's, so that errors about it are raised as they are.
        if len(self.cycles) == 1:
            return run.measure(scene, state, self.depths[-1][0])
        for _ in range(SETTLING_RUNS):
            try:
                with quiet():  # Cautions are for the state that a user gives.
                    measured = run.measure(scene, state, self.depths[-1][0])
            except ValueError as error:
                # A state from a run fits the start of the drives unless their period is another.
                raise ValueError(
                    f"Argument `cycle` must be a period of the scene's drives, but is {run.cycle} "
                    f"s: the state after {run.settle + run.measured} cycles doesn't fit their "
                    "start."
                ) from error
            if measured.failure or run.difference(measured) <= run.tolerance:
                break
            state = measured.state
        return measured

    def _wears(self, measured: _Measured) -> list[JointWear]:
        direct = np.zeros_like(self.depths[-1][1:])
        if self.run.directions:
            # `measured` has the total derivatives by the parameters. A part of them comes from the
            # depths, which the parameters have changed: `per_cycle` with a `direct` of zero returns
            # this part. What remains are the derivatives at fixed depths, `direct`.
            wears = self.joint_wears(measured.histories, direct.swapaxes(0, 1))
            through_depths = [w.per_cycle(self.depths[-1][:, j])[1:] for j, w in enumerate(wears)]
            direct = measured.halves.mean(axis=0)[1:] - np.stack(through_depths, axis=1)
        return self.joint_wears(measured.histories, direct.swapaxes(0, 1))

    def joint_wears(
        self, histories: Iterable[History], direct: Iterable[np.ndarray]
    ) -> list[JointWear]:
        rates = self.run.rates_of_parts
        unworn = _with_depths(self.scene, list(rates), np.zeros_like(self.depths[0][:1]))
        rows = zip(rates.items(), histories, direct, strict=True)
        return [
            JointWear(_clearance_joint(unworn, name), of_parts, history, slopes)
            for (name, of_parts), history, slopes in rows
        ]

    def _refuse(self, failure: str, difference: float) -> None:
        """Set the field `failure`, or raise an error if this is the first stage. The reason is the
        run's `failure` or, if it is empty, the `difference` in wear of the halves of its cycles."""
        reason = f"the run of a stage failed: {failure}"
        if not failure:
            reason = f"the two halves of the measured cycles differ by {difference:.3g} in wear"
            if self.run.directions:
                reason += " or in its derivatives"
        expected = f"a cycle of a periodic motion ({reason})"
        remedy = "check the duration, or raise `settle`, `measured` or `tolerance`"
        require(len(self.cycles) > 1, "cycle", self.run.cycle, expected, remedy)
        self.failure = reason

    def _pressed(self) -> Float[np.ndarray, " joints"]:
        """Largest penetration of each joint in the last run, m, measured from the force's onset."""
        pressed = self.extremes[-1][:, 0].copy()
        for j, name in enumerate(self.run.rates):
            joint = _clearance_joint(self.scene, name)
            # The force may begin before the surfaces touch; the penetration is then negative.
            pressed[j] += float(joint.law.onset_offset())
            expected = f"a distance at which the force of {name!r} has not begun"
            offset, remedy = joint.law.onset_offset(), "mend the law"
            has_force = not self.rates[-1][0, j].any() or pressed[j] > 0.0
            require(has_force, "onset_offset", offset, expected, remedy)
        return np.maximum(pressed, LEAST_PENETRATION)

    def _cycles_to_change(self, change: float) -> float:
        """Return after how many cycles any joint's worn depth has changed by `change` times the
        joint's largest penetration (see `_pressed`); infinite without wear."""
        fastest = self.rates[-1][0].max(axis=(1, 2))
        # A joint that does not wear takes infinitely many; 1 avoids a division by its rate of zero.
        cycles = change * self._pressed() / np.where(fastest > 0.0, fastest, 1.0)
        return float(np.min(np.where(fastest > 0.0, cycles, np.inf)))

    def _shorten(self, length: float) -> bool:
        """Replace the last stage by one of at most `length` cycles. Return false, without a change,
        for the first one, prescribed `cycles`, or a length in which depths would hardly change."""
        if len(self.cycles) == 1 or self.run.cycles.ndim == 1:
            return False
        if length < self._cycles_to_change(FIRST_CHANGE * FEWEST_CHANGE):
            return False
        del self.cycles[-1], self.depths[-1]
        self._extrapolate(length)
        return True

    def _extrapolate(self, length: float) -> None:
        """Append the cycles and depths at the end of a stage of `length` cycles, or of fewer if
        `cycles`, `depth` or `largest_change` of `wear` end it. If `cycles` is an array, only its
        next number or `depth` ends the stage."""
        run = self.run
        goal = float(run.cycles[run.cycles > self.cycles[-1]].min())
        left = goal - self.cycles[-1]
        if run.cycles.ndim == 1:
            length = left  # no limit shortens stages that are prescribed
        elif run.largest_change is not None:
            fastest = self.rates[-1][0].max()
            length = min(length, run.largest_change / fastest) if fastest > 0.0 else length
        length = min(length, left)
        try:
            depths, reached = self._grown(length)
        except RuntimeError as error:
            self.failure = f"the depths of a stage failed: {error}"
            return
        # By rounding, the sum could be below the goal, and a needless stage would follow.
        self.cycles.append(goal if reached == left else self.cycles[-1] + reached)
        self.depths.append(depths)

    def _grown(self, length: float, end: list[JointWear] | None = None) -> tuple[np.ndarray, float]:
        """Return the depths `length` cycles after the start of the last stage in `rates`, or where
        they reach the goal `run.depth` before, and the number of cycles until then. With `end`, the
        wear of each joint in a run after `length` cycles, return the corrected depths."""
        run, stage = self.run, len(self.rates) - 1
        rows, per_cycle, pressed = self.depths[stage], self.rates[stage], self._pressed()
        rtol = INTEGRATION * run.stage_error
        # A little deeper than `depth`, which the depths should reach even if the correction makes
        # them smaller. The correction itself is over the whole stage.
        until = None if run.depth is None or end else run.depth * (1.0 + 0.1 * run.stage_error)
        curves, reached = [], length
        for j, wear in enumerate(self.wears):
            sizes, size = np.abs(per_cycle[:, j]).max(axis=(1, 2)), per_cycle[0, j].max()
            # The absolute tolerances are `rtol` times these scales. That of the depth is the
            # penetration; that of a derivative, its change while the depth grows by as much.
            scales = pressed[j] * np.where(sizes > 0.0, sizes / (size or 1.0), 1.0)
            wear_at_end = end[j] if end else None
            curves.append(grow(wear, wear_at_end, rows[:, j], length, rtol, rtol * scales, until))
            # A curve ends before `length` where its deepest point reaches `until`.
            reached = min(reached, curves[-1].t_max)
        depths = rows.copy()
        for j, (wear, curve) in enumerate(zip(self.wears, curves, strict=True)):
            depths[:, j, wear.wearing] = curve(reached).reshape(len(rows), -1, rows.shape[-1])
        # The integration has an error, but material doesn't grow again.
        depths[0] = np.maximum(depths[0], rows[0])
        return depths, reached

    def contacts(self) -> dict[str, tuple]:
        """Return the variables `CONTACTS` of the store, as pairs of dimensions and values by name,
        with which the computation can be continued; none before the first run."""
        if not self.wears:
            return {}
        histories = np.stack([wear.history for wear in self.wears])
        direct = np.stack([wear.direct for wear in self.wears])
        dims = ("joint", "base", "number", "instant"), ("joint", "row", "part", "angle")
        return dict(zip(CONTACTS, zip(dims, (histories, direct), strict=True), strict=True))

    def dataset(self) -> "xr.Dataset":
        import xarray as xr

        # (stages, 1 + parameters, joints, parts, angles): row 0 of a stage has its depths, and the
        # others have their derivatives.
        depths, names = np.array(self.depths), list(self.run.rates)
        # The last stage has no run, and so no rate, penetration and force. The reshape is for the
        # first stage, when the lists are empty.
        rates = np.full(depths.shape, np.nan)
        rates[: len(self.rates)] = np.array(self.rates).reshape(-1, *depths.shape[1:])
        extremes = np.full((len(depths), len(names), len(EXTREMES)), np.nan)
        extremes[: len(self.extremes)] = np.array(self.extremes).reshape(-1, *extremes.shape[1:])
        variables: dict[str, tuple] = {}
        for k, (name, unit) in enumerate(EXTREMES.items()):
            variables[name] = ("stage", "joint"), extremes[:, :, k], {"units": unit}
        joints = [_clearance_joint(self.scene, name) for name in names]
        lengths = np.array([float(joint.journal_length) for joint in joints])
        for k, part in enumerate(PARTS):
            radii = np.array([float(getattr(joint, f"{part}_radius")) for joint in joints])
            volumes = depths[:, 0, :, k].mean(axis=-1) * (2.0 * np.pi * radii * lengths)
            variables[f"{part}_volume"] = ("stage", "joint"), volumes, {"units": "m^3"}
        dims = "stage", "joint", "angle"
        for name, rows, unit in (("depth", depths, "m"), ("rate", rates, "m per cycle")):
            for k, part in enumerate(PARTS):
                variables[f"{part}_{name}"] = dims, rows[:, 0, :, k], {"units": unit}
                if self.run.directions:
                    along = ("stage", "parameter", *dims[1:]), rows[:, 1:, :, k], {"units": unit}
                    variables[f"{part}_{name}_derivative"] = along
        for field in fields(BodyState):
            rows = [np.asarray(getattr(body, field.name)) for body in self.state.bodies.values()]
            components = "component" if len(rows[0]) == 3 else "euler_parameter"
            variables[f"final_{field.name}"] = ("body", components), np.array(rows)
        return xr.Dataset(
            variables,
            coords={
                "cycles": ("stage", self.cycles),
                "joint": names,
                "angle": ("angle", even_angles(depths.shape[-1]), {"units": "rad"}),
                **({"parameter": [*self.run.directions]} if self.run.directions else {}),
                "body": list(self.state.bodies),
            },
            attrs={"ending": self.ending, "failure": self.failure},
        ).transpose("joint", "stage", "angle", ..., missing_dims="ignore")


def _clearance_joint(scene: Scene, name: str) -> ClearanceJoint:
    joint = scene.joints[name]
    assert isinstance(joint, ClearanceJoint), "`CycleRun.check` refuses others"
    return joint


@dataclass(frozen=True)
class _Store:
    """Zarr store of the stages, with the digest of the computation to which they belong."""

    path: Path
    digest: str

    def write(self, result: "xr.Dataset", contacts: Mapping[str, tuple]) -> None:
        """Replace the store by one with a `result` of `wear` and the variables `contacts`, those
        that `_Stages.contacts` returns. At any time, even after the process is killed, `_folder`
        returns a complete store."""
        old = _old(self.path)
        remove_abandoned(self.path)
        with unfinished(self.path) as new:
            write_dataset(new, result.assign(contacts).assign_attrs(digest=self.digest))
            # The old store is kept under another name until the new one has its place.
            if self.path.exists():
                shutil.rmtree(old, ignore_errors=True)
                self.path.rename(old)
            new.rename(self.path)
        shutil.rmtree(old, ignore_errors=True)

    def read(self, first: _Stages) -> _Stages:
        """Return the stored stages, or `first` if there is no store."""
        if not _folder(self.path).exists():
            return first
        stored, remedy = _opened(self.path), "pass another folder"
        expected = "a folder without a result, or with one of the same scene and arguments"
        is_same = stored.attrs.get("digest") == self.digest
        require(is_same, "path", str(self.path), expected, remedy)
        # With `stages=1`, a store may be written before any run, and has no contacts then.
        needed = (*EXTREMES, *CONTACTS) if stored.sizes["stage"] > 1 else EXTREMES
        lacking = ", ".join(name for name in needed if name not in stored)
        text, expected = f"{self.path} without {lacking}", "a store of this version"
        require(not lacking, "path", text, expected, remedy)
        depths, rates = (_stacked(stored, name) for name in ("depth", "rate"))
        # In a stage without a run, the penetrations of all joints are NaN: the first joint's tell.
        measured = int(np.isfinite(stored["penetration"].values[0]).sum())
        extremes = np.stack([stored[name].values.T for name in EXTREMES], axis=-1)
        contacts = [stored[name].values for name in CONTACTS if measured]
        wears = first.joint_wears(*contacts) if measured else []
        return dataclasses.replace(
            first,
            wears=wears,
            cycles=stored["cycles"].values.tolist(),
            depths=list(depths),
            rates=list(rates[:measured]),
            extremes=list(extremes[:measured]),
            state=final_state(stored),
            failure=stored.attrs["failure"],
        )


def _old(path: Path) -> Path:
    return path.with_name(f"{path.name}.old")


def _folder(path: Path) -> Path:
    """Return the folder that contains the store: `path` or, between the two renamings of
    `_Store.write`, the folder to which the old store has been renamed."""
    return _old(path) if _old(path).exists() and not path.exists() else path


def _version(folder: Path) -> int | None:
    """Return a folder's inode, which changes if a store is replaced; ``None`` without a folder."""
    try:
        return folder.stat().st_ino
    except FileNotFoundError:
        return None


def open_wear(path: str | PathLike[str]) -> "xr.Dataset":
    """Read the result of `clearjoint.wear` from the `path` of its store, also while it grows.

    **Raises:** `ValueError` if there is no store of wear at the path.

    >>> import xarray as xr
    >>> depth = ("joint", "stage", "angle"), np.zeros((1, 1, 8))
    >>> _ = xr.Dataset({"bearing_depth": depth}).to_zarr("wear.zarr", consolidated=False)
    >>> dict(cj.open_wear("wear.zarr").sizes)
    {'joint': 1, 'stage': 1, 'angle': 8}
    """
    return _opened(path).drop_vars(CONTACTS, errors="ignore")


def _opened(path: str | PathLike[str]) -> "xr.Dataset":
    import xarray as xr

    remedy = "pass the `path` that was given to wear()"
    while True:
        folder, failure = _folder(Path(path)), None
        version = _version(folder)
        try:
            exists = (folder / "bearing_depth").is_dir()
            require(exists, "path", str(path), "a folder with a result of wear()", remedy)
            with xr.open_zarr(folder, consolidated=False) as found:
                found.load()
        except (OSError, ValueError) as error:
            failure = error
        # If `wear` has replaced the store meanwhile, its arrays may be of two stores or missing.
        if folder == _folder(Path(path)) and version == _version(folder):
            if failure is not None:
                raise failure
            return found


def final_state(found: "xr.Dataset") -> State:
    """Return the state after the last run whose wear was used; without any, the initial state."""
    numbers = {field.name: found[f"final_{field.name}"].values for field in fields(BodyState)}
    bodies = {
        str(name): BodyState(**{field: of_bodies[j] for field, of_bodies in numbers.items()})
        for j, name in enumerate(found["body"].values)
    }
    return State(bodies)


def _stacked(found: "xr.Dataset", name: str) -> Float[np.ndarray, "stages rows joints 2 samples"]:
    """Return the depths, m, or rates, m per cycle, of a result, of both `PARTS`: row 0 has values,
    the other rows their derivatives by the parameters, if any. `name`: "depth" or "rate"."""
    dims = "stage", "parameter", "joint", "angle"
    of_parts = []
    for part in PARTS:
        rows = [found[f"{part}_{name}"].expand_dims("parameter").transpose(*dims).values]
        if "parameter" in found.dims:
            rows.append(found[f"{part}_{name}_derivative"].transpose(*dims).values)
        of_parts.append(np.concatenate(rows, axis=1))
    return np.stack(of_parts, axis=3)


def _digest(scene: Scene, state: State, run: CycleRun) -> str:
    """Return a digest by which a store recognises its computation. The digest does not depend on
    arguments that a user may change to continue (see `CycleRun`)."""
    # The text of a direction may contain an address in memory, which differs from process to
    # process. So the derivatives of scene and state along the direction are used instead, with the
    # profiles of the joints unchanged.
    named = dataclasses.replace(run, directions=dict.fromkeys(run.directions))
    effects = [
        jax.jvp(lambda u, a=along: a.without_profiles(scene, state, u), (0.0,), (1.0,))[1]
        for along in run.directions.values()
    ]
    texts = [
        f"_{named!r}",  # with the name that the class had when the first stores were written
        repr(run.cycles.tolist()),  # the text of the run does not contain this field
        str(jax.tree.structure((scene, state))),
    ]
    parts: list[str | bytes] = [ADDRESS.sub("", text) for text in texts]
    # A text with an address contains a function, which is recognised by the operations that JAX
    # traces, as by the stores of sweeps.
    if parts != texts:
        settings = settings_or(run.settings, presets.default)
        common = Common(
            Scheme.of(settings, redundant=False),
            fold_constants(scene),
            start_time=np.asarray(run.start_time),
            max_steps=np.asarray(settings.max_steps),
        )
        parts.append(programs(common, state)[RUN])
    leaves = jax.tree.leaves((scene, state, effects))
    parts += [np.asarray(leaf).tobytes() for leaf in leaves]
    return digest(*parts, digits=LONG)


def _with_splines(
    scene: Scene, wear: Mapping[str, Sequence[float] | np.ndarray], samples: int
) -> Scene:
    """Replace each profile that wears by a periodic spline through it at `samples` angles. `wear`
    has, by name of the joint, numbers for bearing and journal, positive if the part wears."""

    def spline(name: str, k: int, profile: AbstractProfile | None) -> AbstractProfile | None:
        if not wear[name][k] > 0.0:
            return profile
        # ``None`` is the profile of a circle.
        if profile is None:
            return PeriodicSpline.through(np.zeros(samples))
        resampled = PeriodicSpline.through(profile.at(even_angles(samples)).value)
        # A profile with waves that the samples do not resolve would be another one.
        angles = even_angles(4 * max(samples, profile.angles()))
        values = np.asarray(profile.at(angles).value)
        lost = np.abs(np.asarray(resampled.at(angles).value) - values).max()
        expected = f"enough to resolve the {PROFILES[k]} of {name!r}"
        remedy = f"give a multiple of {profile.angles()}, its number of angles"
        # A constant profile has the range zero, but rounding errors: a tiny loss is allowed.
        resolved = bool(lost <= max(LARGEST_LOSS * np.ptp(values), LEAST_PENETRATION))
        require(resolved, "samples", samples, expected, remedy)
        return resampled

    return _with_profiles(scene, wear, spline)


def _with_depths(
    scene: Scene, names: list[str], depths: Float[np.ndarray, "rows joints 2 samples"]
) -> Scene:
    """Return the scene of `_with_splines` with material removed from its bearings and journals.

    Row 0 of `depths` has the removed depths at even angles, m, and each further row their
    derivatives by one parameter. With further rows, the new profiles are `MovingSpline`s, which the
    parameters move along these derivatives; without them, they are `PeriodicSpline`s. A part whose
    profile isn't a spline with as many knots as angles doesn't wear, and is unchanged.
    """

    def worn_off(name: str, k: int, profile: AbstractProfile | None) -> AbstractProfile | None:
        is_spline = isinstance(profile, PeriodicSpline | MovingSpline)
        if not is_spline or len(profile.coefficients) != depths.shape[-1]:
            return profile
        # Wear enlarges the radius of the bearing and reduces that of the journal.
        signed_rows = (1.0, -1.0)[k] * depths[:, names.index(name), k]
        # Interpolation is linear, so that it applies to derivatives as well.
        changes = [np.asarray(PeriodicSpline.through(row).coefficients) for row in signed_rows]
        coefficients = np.asarray(profile.coefficients) + changes[0]
        if len(changes) == 1:
            return PeriodicSpline(coefficients)
        # The shifts are zeros: derivatives are taken at the present parameters.
        return MovingSpline(coefficients, np.concatenate(changes[1:]), np.zeros(len(changes) - 1))

    return _with_profiles(scene, names, worn_off)


def _with_profiles(
    scene: Scene,
    names: Iterable[str],
    new: Callable[[str, int, AbstractProfile | None], AbstractProfile | None],
) -> Scene:
    """Replace the profiles of named joints by the results of a function of the name, the index of
    the part in `PARTS`, and the profile."""
    joints = dict(scene.joints)
    for name in names:
        joint = _clearance_joint(scene, name)
        profiles = {f: new(name, k, getattr(joint, f)) for k, f in enumerate(PROFILES)}
        with quiet():  # Cautions are for the profiles that a user gives.
            joints[name] = dataclasses.replace(joint, **profiles)
    return dataclasses.replace(scene, joints=joints)

"""Wear of clearance joints over many cycles, with profiles that change."""

import dataclasses
import hashlib
import shutil
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, fields
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Literal, NamedTuple

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Float
from tqdm.auto import tqdm

from ..fields.checks import require, require_count, require_positive
from ..fields.conversion import with_arrays
from ..model.bodies import BodyState, State
from ..model.clearance_joints.clearance import ClearanceJoint
from ..model.profiles import PeriodicSpline
from ..model.scene import Scene
from ..parametrisation.paths import set_value
from ..quantities.base import require_known
from ..result_codes import RESULTS
from ..simulation.run.saving import Saving
from ..simulation.run.simulate import simulate
from ..simulation.step.settings import Settings
from .wear_depths import wear_depths

if TYPE_CHECKING:
    import xarray as xr

Part = Literal["bearing", "journal"]
PARTS: tuple[Part, Part] = ("bearing", "journal")
CHANGE_BY_PENETRATION = 0.2
"""Default of the largest change of depth in a stage, relative to the largest penetration."""
FIRST_STAGE = 0.1
"""Length of the first stage relative to the others, since it has no earlier one to extrapolate."""
FEWEST_SAMPLES = 8


@dataclass(frozen=True)
class WearRates:
    """Specific wear rates of the two parts of a joint, m^2/N: worn volume over force and distance.

    A rate is Archard's coefficient over the hardness, k/H. Tables often have mm^3/(N m), which is
    1e-9 m^2/N. Zero, the default, is a part that doesn't wear.

    >>> cj.WearRates(bearing=5.05e-4 * 1e-9)  # PTFE against steel, 5.05e-4 mm^3/(N m)
    WearRates(bearing=5.050000000000001e-13, journal=0.0)
    """

    bearing: float = 0.0
    journal: float = 0.0

    def __post_init__(self):
        for part in PARTS:
            remedy = "give it in m^2/N; 1 mm^3/(N m) is 1e-9 m^2/N"
            require_positive(part, getattr(self, part), remedy, zero=True)
        remedy = "give the rate of one part at least"
        require(self.bearing + self.journal > 0.0, "bearing", 0.0, "positive", remedy)


def wear(
    scene: Scene,
    state: State,
    cycle: float,
    rates: Mapping[str, WearRates],
    cycles: float,
    settings: Settings | None = None,
    *,
    settle: int = 1,
    measured: int = 2,
    tolerance: float = 0.1,
    largest_change: float | None = None,
    samples: int = 96,
    stages: int = 10_000,
    start_time: float = 0.0,
    path: str | PathLike[str] | None = None,
    progress: bool = True,
) -> "xr.Dataset":
    """Compute how the profiles of clearance joints wear over many cycles of a periodic motion.

    The wear of a few cycles is computed by a run (Archard's law; see `clearjoint.WearRates`) and
    extrapolated over as many cycles as a limit on the change of depth allows. Then the profiles are
    changed and the next stage begins, with the motion at the end of the run before. Two successive
    stages determine the rate of wear and its change (Adams-Bashforth method of second order).

    **Arguments:**

    - `scene`, `state`, `start_time` s: as in `simulate`. The drives must repeat after a cycle.
    - `cycle`: duration of a cycle, s.
    - `rates`: wear rates of the joints that wear, each a `ClearanceJoint`, by name.
    - `cycles`: number of cycles to extrapolate to, such as 1e6.
    - `settings`: of the runs; by default `clearjoint.presets.default`.
    - `settle`: number of cycles of a run before the wear is measured; `measured`: number of cycles
      that are measured, even. The two halves of them must agree in worn volume to `tolerance`,
      relatively. A motion that is not periodic needs many measured cycles.
    - `largest_change`: largest change of depth in a stage, m; by default a fifth of the largest
      penetration in the stage. With larger changes the profile oscillates, since the material that
      carries the load in one stage is gone in the next.
    - `samples`: number of angles around the wall and around the journal.
    - `stages`: largest number of stages.
    - `path`: folder of a Zarr store of the result. Each stage is written; if the folder contains
      an earlier result of the same scene and arguments, computation continues from there.
    - `progress`: whether to show a progress bar.

    **Returns:** an `xarray.Dataset` along "joint", "stage" and "angle":

    - ``cycles``: number of cycles before each stage, (stage).
    - ``bearing_depth``, ``journal_depth``: m, (joint, stage, angle), about the axis of each part
      from its x axis (see `clearjoint.quantities.JournalOffset`).
    - ``bearing_rate``, ``journal_rate``: depth per cycle in the stage, m, likewise; NaN in the
      last stage, which has no run.
    - ``penetration``: largest penetration in the run of a stage, m, (joint, stage).
    - ``final_position``, ``final_orientation``, ``final_velocity``, ``final_spin``: the state after
      the last run.

    The attribute ``ending`` is "reached the cycles", or the reason why the computation ended before
    them. `clearjoint.worn` returns the scene of a stage, `clearjoint.cycles_to_depth` a life.

    **Raises:** `ValueError` for unsupported arguments, for a cycle that is not periodic in the
    first stage, and for a store of another computation.

    ```python
    import clearjoint as cj

    scene, state = cj.mechanisms.slider_crank(0.1e-3)
    rates = {"slider pin": cj.WearRates(bearing=1e-15)}
    found = cj.wear(scene, state, 0.012, rates, 1e5, stages=3)
    print(float(found["bearing_depth"].max()), "m")
    ```
    """
    scene, state = with_arrays((scene, state))
    _check(scene, rates, cycle, cycles, settle, measured, samples, stages)
    run = _CycleRun(rates, cycle, settle, measured, tolerance, samples, settings, start_time)
    scene = _with_splines(scene, rates, samples)
    stages_so_far = _Stages.first(state, list(rates), samples)
    store = None if path is None else _Store(Path(path), _digest(scene, state, run, cycles))
    if store is not None:
        stages_so_far = store.read(stages_so_far)
    begun = stages_so_far.cycles[-1]
    with tqdm(total=float(cycles), initial=begun, disable=not progress) as bar:
        while not stages_so_far.has_ended(cycles, stages):
            stages_so_far.add(run, scene, cycles, largest_change)
            bar.update(stages_so_far.cycles[-1] - bar.n)
            if store is not None:
                store.write(stages_so_far.dataset())
    return stages_so_far.dataset()


def worn(scene: Scene, found: "xr.Dataset", stage: int = -1) -> Scene:
    """Return a scene with the profiles of a stage of `clearjoint.wear`.

    **Arguments:** `scene`: the scene that was given to `wear`; `found`: its result; `stage`: index,
    by default that of the last stage.

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
    names = [str(name) for name in found["joint"].values]
    depths = np.stack([found[f"{part}_depth"].values[:, stage] for part in PARTS], axis=1)
    # Parts that have not worn keep their profiles.
    has_worn = {
        name: WearRates(*(float(part.max() > 0.0) for part in of_joint))
        for name, of_joint in zip(names, depths, strict=True)
        if of_joint.max() > 0.0
    }
    return _with_depths(_with_splines(scene, has_worn, depths.shape[-1]), names, depths)


def cycles_to_depth(found: "xr.Dataset", depth: float, joint: str, part: Part = "bearing") -> float:
    """Return the number of cycles until the deepest point of a part has lost a depth.

    It is interpolated linearly between stages, and infinite if the depth was not reached.

    **Arguments:** `found`: result of `clearjoint.wear`; `depth`: m; `joint`: its name.

    >>> import xarray as xr
    >>> depths = np.array([[[0.0, 0.0], [2e-6, 1e-6]]])  # of one joint, in two stages
    >>> found = xr.Dataset(
    ...     {"bearing_depth": (("joint", "stage", "angle"), depths)},
    ...     {"joint": ["pin"], "cycles": ("stage", [0.0, 1000.0])},
    ... )
    >>> cj.cycles_to_depth(found, 1e-6, "pin")
    500.0
    """
    deepest = found[f"{part}_depth"].sel(joint=joint).max("angle").values
    if not deepest[-1] >= depth:
        return float("inf")
    return float(np.interp(depth, deepest, found["cycles"].values))


@dataclass(frozen=True)
class _CycleRun:
    """Run of some cycles, whose wear is measured; see the arguments of `wear`."""

    rates: Mapping[str, WearRates]
    cycle: float
    settle: int
    measured: int
    tolerance: float
    samples: int
    settings: Settings | None
    start_time: float

    def measure(self, scene: Scene, state: State) -> "_Measured":
        """Return the wear per cycle and the state after the run."""
        first = self.start_time + self.settle * self.cycle
        middle, last = (first + part * self.measured * self.cycle for part in (0.5, 1.0))
        solution = simulate(
            scene,
            state,
            last,
            self.settings,
            Saving(steps=True),
            start_time=self.start_time,
            throw=False,
            progress=False,
        )
        count = len(self.rates)
        halves, penetrations = np.zeros((2, count, len(PARTS), self.samples)), np.zeros((2, count))
        result = RESULTS[solution.result]
        if solution.result == RESULTS.successful:
            for k, span in enumerate(((first, middle), (middle, last))):
                for j, (name, rates) in enumerate(self.rates.items()):
                    of_parts = rates.bearing, rates.journal
                    halves[k, j], penetrations[k, j] = wear_depths(
                        scene, solution, name, of_parts, *span, self.samples
                    )
        return _Measured(
            halves.sum(axis=0) / self.measured,
            halves.sum(axis=(2, 3)),
            penetrations.max(axis=0),
            # Only what a store keeps, so that a computation that is continued has the same bits.
            State(solution.final.bodies),
            "" if solution.result == RESULTS.successful else result,
        )

    def difference(self, found: "_Measured") -> float:
        """Return the relative difference of the wear in both halves, the largest of all joints."""
        first, second = found.halves
        larger = np.maximum(first, second)
        return float(np.max(np.abs(first - second) / np.where(larger > 0.0, larger, 1.0)))


class _Measured(NamedTuple):
    """Wear measured by a run of J joints.

    - `depths`: (J, 2, samples) m per cycle, of bearing and journal.
    - `halves`: (2, J) sum of the depths in each half of the measured cycles, m.
    - `penetrations`: (J,) largest penetration, m.
    - `state`: at the end of the run.
    - `failure`: text of the run's result code; empty for a successful run.
    """

    depths: Float[np.ndarray, "joints 2 samples"]
    halves: Float[np.ndarray, "2 joints"]
    penetrations: Float[np.ndarray, " joints"]
    state: State
    failure: str


@dataclass
class _Stages:
    """The stages computed so far.

    - `cycles`: number of cycles before each stage. `depths`: (J, 2, samples) m there.
    - `rates`: depth per cycle, (J, 2, samples) m, and `penetrations`: (J,) m, in the run of each
      stage except the last one, which has no run yet.
    - `state`: from which the next run starts.
    - `failure`: why no further stage can be computed; empty for none.
    - `ending`: why the computation ended; empty while it goes on.
    """

    names: list[str]
    cycles: list[float]
    depths: list[np.ndarray]
    rates: list[np.ndarray]
    penetrations: list[np.ndarray]
    state: State
    failure: str = ""
    ending: str = ""

    @staticmethod
    def first(state: State, names: list[str], samples: int) -> "_Stages":
        """Return the unworn joints."""
        return _Stages(names, [0.0], [np.zeros((len(names), 2, samples))], [], [], state)

    def add(
        self,
        run: _CycleRun,
        scene: Scene,
        cycles: float,
        largest_change: float | None,
    ) -> None:
        """Measure the wear of the last stage and extrapolate it to a new one, or set `failure`."""
        scene = _with_depths(scene, self.names, self.depths[-1])
        try:
            found = run.measure(scene, self.state)
        except ValueError as error:
            if len(self.cycles) == 1:
                raise
            raise ValueError(
                f"Argument `cycle` must be a period of the scene's drives, but is {run.cycle} s: "
                f"the state after {run.settle + run.measured} cycles doesn't fit their start."
            ) from error
        difference = run.difference(found)
        if found.failure or difference > run.tolerance:
            self._refuse(found.failure, difference, run)
            return
        self.state = found.state
        self.rates.append(found.depths)
        self.penetrations.append(found.penetrations)
        self._extrapolate(cycles - self.cycles[-1], largest_change)

    def has_ended(self, cycles: float, stages: int) -> bool:
        """Return whether there is nothing more to compute, and set `ending` if so."""
        if self.failure:
            self.ending = self.failure
        elif self.cycles[-1] >= cycles:
            self.ending = "reached the cycles"
        elif len(self.cycles) >= stages:
            self.ending = f"{stages} stages"
        else:
            self.ending = ""
        return self.ending != ""

    def _refuse(self, failure: str, difference: float, run: _CycleRun) -> None:
        """Set `failure` for a run whose wear can't be extrapolated.

        **Raises:** `ValueError` in the first stage.
        """
        reason = f"the run of a stage failed: {failure}"
        if not failure:
            reason = f"the two halves of the measured cycles differ by {difference:.3g} in wear"
        require(
            len(self.cycles) > 1,
            "cycle",
            run.cycle,
            f"a cycle of a periodic motion ({reason})",
            "check the duration, or raise `settle`, `measured` or `tolerance`",
        )
        self.failure = reason

    def _extrapolate(self, left: float, largest_change: float | None) -> None:
        """Append the depths after the next stage, of `left` cycles at most."""
        rate = self.rates[-1]
        length = left
        # Each joint limits the stage by its own penetration.
        for j in range(len(self.names)):
            limit = largest_change
            if limit is None:
                limit = CHANGE_BY_PENETRATION * self.penetrations[-1][j]
            fastest = rate[j].max()
            if fastest > 0.0:
                length = min(length, limit / fastest)
        middle = rate
        if len(self.rates) == 1:
            length *= FIRST_STAGE
        else:
            # Rate at the middle of the stage, on the line through those of the last two stages.
            before = self.cycles[-1] - self.cycles[-2]
            middle = rate + 0.5 * length / before * (rate - self.rates[-2])
        change = np.maximum(middle, 0.0) * length
        self.cycles.append(self.cycles[-1] + length)
        self.depths.append(self.depths[-1] + change)

    def dataset(self) -> "xr.Dataset":
        """Return the result of `wear`."""
        import xarray as xr

        depths = np.array(self.depths)
        samples = depths.shape[-1]
        dims = "stage", "joint", "angle"
        metres = {"units": "m"}
        rates = np.full(depths.shape, np.nan)
        rates[: len(self.rates)] = np.array(self.rates).reshape(-1, *depths.shape[1:])
        penetrations = np.full(depths.shape[:2], np.nan)
        penetrations[: len(self.penetrations)] = self.penetrations
        variables: dict[str, tuple] = {"penetration": (dims[:2], penetrations, metres)}
        for k, part in enumerate(PARTS):
            variables[f"{part}_depth"] = dims, depths[:, :, k], metres
            variables[f"{part}_rate"] = dims, rates[:, :, k], {"units": "m per cycle"}
        for field in fields(BodyState):
            rows = [np.asarray(getattr(body, field.name)) for body in self.state.bodies.values()]
            components = "component" if len(rows[0]) == 3 else "parameter"
            variables[f"final_{field.name}"] = ("body", components), np.array(rows)
        return xr.Dataset(
            variables,
            coords={
                "cycles": ("stage", self.cycles),
                "joint": self.names,
                "angle": ("angle", np.arange(samples) * 2.0 * np.pi / samples, {"units": "rad"}),
                "body": list(self.state.bodies),
            },
            attrs={"ending": self.ending, "failure": self.failure},
        ).transpose("joint", "stage", "angle", ...)


@dataclass(frozen=True)
class _Store:
    """Zarr store of the stages, with the digest of the computation to which they belong."""

    path: Path
    digest: str

    def write(self, found: "xr.Dataset") -> None:
        """Replace the store; a process that is killed meanwhile leaves the old or the new one."""
        new, old = self._beside("new"), self._beside("old")
        shutil.rmtree(new, ignore_errors=True)
        with warnings.catch_warnings():
            # Zarr warns that version 3 of its format doesn't specify texts yet.
            warnings.simplefilter("ignore")
            found.assign_attrs(digest=self.digest).to_zarr(new, mode="w", consolidated=False)
        if self.path.exists():
            shutil.rmtree(old, ignore_errors=True)
            self.path.rename(old)
        new.rename(self.path)
        shutil.rmtree(old, ignore_errors=True)

    def read(self, first: _Stages) -> _Stages:
        """Return the stored stages, or `first` if there is no store."""
        import xarray as xr

        existing = [path for path in (self.path, self._beside("old")) if path.exists()]
        if not existing:
            return first
        with xr.open_zarr(existing[0], consolidated=False) as found:
            found.load()
        require(
            found.attrs.get("digest") == self.digest,
            "path",
            str(self.path),
            "a folder without a result, or with one of the same scene and arguments",
            "pass another folder",
        )
        depths = np.stack([found[f"{part}_depth"].values for part in PARTS], axis=2)
        rates = np.stack([found[f"{part}_rate"].values for part in PARTS], axis=2)
        measured = int(np.isfinite(found["penetration"].values[0]).sum())
        numbers = [found[f"final_{field.name}"].values for field in fields(BodyState)]
        names = [str(name) for name in found["body"].values]
        bodies = {name: BodyState(*(part[j] for part in numbers)) for j, name in enumerate(names)}
        return _Stages(
            first.names,
            found["cycles"].values.tolist(),
            list(np.moveaxis(depths, 1, 0)),
            list(np.moveaxis(rates, 1, 0))[:measured],
            list(found["penetration"].values.T)[:measured],
            State(bodies),
            found.attrs["failure"],
        )

    def _beside(self, suffix: str) -> Path:
        return self.path.with_name(f"{self.path.name}.{suffix}")


def _digest(scene: Scene, state: State, run: _CycleRun, cycles: float) -> str:
    """Return a digest of all that determines the stages."""
    parts = [repr(run), repr(cycles), str(jax.tree.structure((scene, state)))]
    parts += [np.asarray(leaf).tobytes().hex() for leaf in jax.tree.leaves((scene, state))]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def _with_splines(scene: Scene, rates: Mapping[str, WearRates], samples: int) -> Scene:
    """Return a scene in which the profiles of parts that wear are periodic splines."""
    angles = np.arange(samples) * 2.0 * np.pi / samples
    joints = dict(scene.joints)
    for name, of_joint in rates.items():
        joint = joints[name]
        assert isinstance(joint, ClearanceJoint)
        for part in PARTS:
            if getattr(of_joint, part) > 0.0:
                given = getattr(joint, f"{part}_profile")
                values = np.zeros(samples) if given is None else np.asarray(given.at(angles).value)
                spline = PeriodicSpline.through(values)
                joint = eqx.tree_at(
                    lambda j, part=part: getattr(j, f"{part}_profile"),
                    joint,
                    spline,
                    is_leaf=lambda node: node is None,
                )
        joints[name] = joint
    return dataclasses.replace(scene, joints=joints)


def _with_depths(
    scene: Scene, names: list[str], depths: Float[np.ndarray, "joints 2 samples"]
) -> Scene:
    """Return a scene from `_with_splines` with depths, m, removed from its parts."""
    for name, of_joint in zip(names, depths, strict=True):
        for part, sign, depth in zip(PARTS, (1.0, -1.0), of_joint, strict=True):
            profile = getattr(scene.joints[name], f"{part}_profile")
            if isinstance(profile, PeriodicSpline) and len(profile.coefficients) == len(depth):
                changed = PeriodicSpline.through(sign * depth).coefficients
                scene = set_value(
                    scene,
                    lambda s, n=name, p=part: getattr(s.joints[n], f"{p}_profile").coefficients,
                    np.asarray(profile.coefficients) + changed,
                )
    return scene


def _check(
    scene: Scene,
    rates: Mapping[str, WearRates],
    cycle: float,
    cycles: float,
    settle: int,
    measured: int,
    samples: int,
    stages: int,
) -> None:
    require(len(rates) > 0, "rates", dict(rates), "of one joint at least", "name a joint")
    known = [n for n, joint in scene.joints.items() if isinstance(joint, ClearanceJoint)]
    for name, of_joint in rates.items():
        require_known("rates", name, known)
        expected = "a WearRates"
        fine = isinstance(of_joint, WearRates)
        require(fine, f"rates[{name!r}]", of_joint, expected, "pass cj.WearRates(bearing=...)")
    require_positive("cycle", cycle, "give the duration of a cycle in s")
    require_positive("cycles", cycles, "give a number of cycles, such as 1e6")
    require_count("settle", settle + 1, "give a number of cycles, 0 or more")
    require_count("measured", measured, "give an even number of cycles")
    even = measured % 2 == 0
    require(even, "measured", measured, "even, as its two halves are compared", "add one")
    require_count("samples", samples, "give a number of angles")
    few = samples >= FEWEST_SAMPLES
    require(few, "samples", samples, f"at least {FEWEST_SAMPLES}", "take the default of 96")
    require_count("stages", stages, "give a number of stages")

"""Batches of runs of extreme scenes, and checks of their invariants."""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

import clearjoint as cj
from clearjoint.extend import Scalar
from studies.extremes.families import FAMILIES, RADIUS, Family, Trial
from studies.extremes.invariants import (
    Poses,
    contact_energy,
    deepest,
    drift,
    kinetic_energy,
    momentum,
    norm_error,
    poses,
    work_of_gravity,
)

RTOL = 1e-8
ALLOWED_ENERGY = 1e-4
"""Allowed energy error, over the energy exchanged."""
ALLOWED_NORM = 1e-6
ALLOWED_DRIFT = 1e-6
"""Allowed drift of constraints, m or rad."""
ALLOWED_MOMENTUM = 1e-8
"""Allowed change of momentum, over the sum of the bodies' momenta."""

WORKS = ("normal damping", "friction", "stabilisation", "supplied")


class Work(cj.extend.AbstractReduction):
    """Integrals of the energy ledger by name, J; zero for those that the scene lacks."""

    needs_ledger = True

    def start(self, now: Any) -> Any:
        """Return no tally: the ledger is integrated with the state."""
        del now
        return ()

    def update(self, tally: Any, now: Any) -> Any:
        """Return the tally unchanged."""
        del now
        return tally

    def results(self, tally: Any, now: Any) -> dict[str, Any]:
        """Return the integrals."""
        del tally
        return {name: now.work.get(name, 0.0) for name in WORKS}

    def units(self) -> dict[str, str]:
        """Return the units."""
        return dict.fromkeys(WORKS, "J")


@dataclass(frozen=True)
class Lane:
    """Result of a run.

    Result code, attempted steps, outputs, and violations of each invariant over the allowed ones
    (above 1 the invariant is violated).
    """

    result: str
    attempts: int
    outcome: Mapping[str, Any]
    violations: dict[str, float]

    @property
    def successful(self) -> bool:
        """Whether the run has the code "successful"."""
        return self.result == "successful"

    @property
    def wrong(self) -> bool:
        """Whether a successful run violates an invariant or has a NaN."""
        return self.successful and not all(value <= 1.0 for value in self.violations.values())


def run(
    name: str,
    trials: Sequence[Trial],
    max_steps: int,
    rtol: float = RTOL,
    start_time: float = 0.0,
) -> list[Lane]:
    """Run scenes of a family together, and check the invariants."""
    lanes: dict[int, Lane] = {}
    for atol in sorted({trial.atol for trial in trials}, key=str):
        numbers = [k for k, trial in enumerate(trials) if trial.atol == atol]
        chosen = [trials[k] for k in numbers]
        settings = cj.Settings(
            rtol=rtol,
            atol=atol,
            coordinates=FAMILIES[name].coordinates,
            ledger=True,
            max_steps=max_steps,
        )
        found = _swept(FAMILIES[name], chosen, settings, start_time)
        for lane, (k, trial) in enumerate(zip(numbers, chosen, strict=True)):
            lanes[k] = _judged(FAMILIES[name], trial, found.isel(trial=lane))
    return [lanes[k] for k in range(len(trials))]


def _swept(
    family: Family, trials: Sequence[Trial], settings: cj.Settings, start_time: float
) -> xr.Dataset:
    ends = iter([start_time + trial.end_time for trial in trials])

    def made(scene: cj.Scene, state: cj.State, number: Scalar) -> tuple[cj.Scene, cj.State]:
        del scene, state
        return trials[int(number)].scene, trials[int(number)].state

    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*lanes failed")
        return cj.sweep(
            trials[0].scene,
            trials[0].state,
            lambda scene: next(ends),  # asked for lane by lane
            {"trial": cj.Axis.change(made, np.arange(float(len(trials))))},
            {"work": Work(), **family.outputs},
            settings,
            start_time=start_time,
            progress=False,
            threads=1,
        )


def _judged(family: Family, trial: Trial, lane: xr.Dataset) -> Lane:
    meanings = lane.result.attrs["flag_meanings"].split()
    result = meanings[list(lane.result.attrs["flag_values"]).index(int(lane.result))]
    end = poses(_final(trial.scene, lane))
    works = {name: float(lane[f"work_{name}"]) for name in WORKS}
    outcome: dict[str, Any] = {"poses": end} | {name: float(lane[name]) for name in family.outputs}
    violations = _violations(family, trial.scene, poses(trial.state), end, works)
    outcome["ledger"] = violations["energy"] * ALLOWED_ENERGY
    return Lane(result, int(lane.attempts), outcome, violations)


def _final(scene: cj.Scene, lane: xr.Dataset) -> cj.State:
    parts = ("position", "orientation", "velocity", "spin")
    arrays = [lane[f"final_{part}"].values for part in parts]
    return cj.State(
        {name: cj.BodyState(*(a[k] for a in arrays)) for k, name in enumerate(scene.bodies)}
    )


def _violations(
    family: Family, scene: cj.Scene, start: Poses, end: Poses, works: dict[str, float]
) -> dict[str, float]:
    """Return the violations over the allowed ones; NaN stays NaN and is never allowed."""
    found = {
        "energy": _energy_gap(scene, start, end, works),
        "quaternion norm": float(norm_error(end)) / ALLOWED_NORM,
        "constraints": float(drift(scene, end)) / ALLOWED_DRIFT,
        "penetration": float(deepest(scene, end)),
    }
    if family.free:
        found |= _momentum_gaps(scene, start, end)
    return found


def _energy_gap(scene: cj.Scene, start: Poses, end: Poses, works: dict[str, float]) -> float:
    """Return the energy error over the allowed one."""
    before = kinetic_energy(scene, start), contact_energy(scene, start)
    after = kinetic_energy(scene, end), contact_energy(scene, end)
    gained = work_of_gravity(scene, start, end) + works["supplied"]
    lost = works["normal damping"] + works["friction"] + works["stabilisation"]
    gap = abs(sum(after) - sum(before) - gained + lost)
    exchanged = sum(before) + sum(after) + abs(gained) + abs(lost)
    return float(gap / (ALLOWED_ENERGY * exchanged)) if gap else 0.0


def _momentum_gaps(scene: cj.Scene, start: Poses, end: Poses) -> dict[str, float]:
    """Return the changes of the momenta over the sums of their parts."""
    before, after = momentum(scene, start), momentum(scene, end)
    masses = [float(body.mass) for body in scene.bodies.values()]
    speeds = [
        float(np.sqrt(np.sum(at[n].velocity ** 2))) for at in (start, end) for n in scene.bodies
    ]
    push = sum(m * v for m, v in zip(masses * 2, speeds, strict=True))
    scales = {"momentum": push, "angular momentum": push * RADIUS}
    return {
        name: float(np.max(np.abs(new - old))) / (ALLOWED_MOMENTUM * scales[name])
        for name, old, new in zip(scales, before, after, strict=True)
    }

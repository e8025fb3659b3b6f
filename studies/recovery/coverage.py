"""How often 95 % intervals hold the truth: by the covariance, and by runs around the estimates."""

import sys
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

import clearjoint as cj
from studies.common import identification_problem as pendulum
from studies.recovery import crank_rocker

SO_FAR = 5
RISE = 3.841
"""Rise of chi squared at the ends of a 95 % interval of one parameter."""
HEADINGS = (
    "scene, start",
    "draws",
    "search ended in a higher minimum; after the check",
    "95 % intervals with the truth, %, by the covariance",
    "by the check",
    "warned",
    "draws with a miss, warned of",
    "s, without check; check",
)


@dataclass(frozen=True)
class Case:
    """Measurements without noise of a scene at its `truth`, and how to fit draws of them."""

    label: str
    scene: cj.Scene
    state: cj.State
    parameters: dict[str, cj.Parameter]
    truth: dict[str, float]
    guess: dict[str, float]
    grow: tuple[float, ...]
    clean: cj.Measurements

    def fit(self, data: cj.Measurements, guess: dict[str, float], **options: Any) -> cj.results.Fit:
        """Fit a draw from a guess."""
        with warnings.catch_warnings(action="ignore", category=cj.PoorFitWarning):
            return cj.identify(
                self.scene,
                self.state,
                data,
                self.parameters,
                guess=guess,
                progress=False,
                **options,
            )


@dataclass(frozen=True)
class Draw:
    """A fit to a draw of the noise.

    - `plain`, `checked`: by parameter, whether the interval holds the truth.
    - `higher`: chi squared less that of a fit from the truth, before and after the check.
    - `warned`: whether the fit has a warning.
    - `seconds`: of the search and of the check.
    """

    plain: tuple[bool, ...]
    checked: tuple[bool, ...]
    higher: tuple[float, float]
    warned: bool
    seconds: tuple[float, float]


def pins(pin: str, angle: float, end_time: float = crank_rocker.END) -> Case:
    """The crank-rocker with clearance in a pin, from an angle of the crank on."""
    return Case(
        f"crank-rocker, {pin}, from {angle} rad",
        *crank_rocker.scene(pin, angle),
        crank_rocker.parameters(pin),
        crank_rocker.TRUTH,
        crank_rocker.FAR,
        tuple(end for end in crank_rocker.GROW if end < end_time),
        crank_rocker.ideal(pin, angle, end_time),
    )


def pendulums(sensor: str, start: str) -> Case:
    """The double pendulum of `studies.identification`, from one of its starts."""
    return Case(
        f"double pendulum, {sensor}, {start}",
        *cj.mechanisms.double_pendulum(),
        pendulum.PARAMETERS,
        pendulum.TRUTH,
        pendulum.STARTS[start],
        pendulum.WINDOWS,
        pendulum.ideal(sensor, 0.1)[0],
    )


CASES: dict[str, Callable[[], Case]] = {
    "rocker foot": lambda: pins("rocker foot", 1.1),
    "crank pin": lambda: pins("crank pin", 0.5),
    "probes": lambda: pendulums("probes", "soft, narrow"),
    "camera": lambda: pendulums("camera", "soft, narrow"),
}


def draws(case: Case, number: int) -> list[Draw]:
    """Fit so many draws of the noise; every fifth time the row so far goes to standard error."""
    generator = np.random.default_rng(0)
    found: list[Draw] = []
    while len(found) < number:
        found.append(_draw(case, case.clean.with_noise(generator)))
        if len(found) % SO_FAR == 0:
            print(row(case.label, found), file=sys.stderr, flush=True)
    return found


def _draw(case: Case, data: cj.Measurements) -> Draw:
    begun = time.perf_counter()
    found = case.fit(data, case.guess, grow=case.grow)
    seconds = time.perf_counter() - begun
    nearest = case.fit(data, case.truth, check_runs=0)
    first = found.searches[0].best
    half = np.sqrt(RISE * np.diag(np.linalg.pinv(first.jacobian.T @ first.jacobian)))
    truth = [p.scale.coordinate(case.truth[n]) for n, p in case.parameters.items()]
    plain = np.abs(first.coordinates - truth) < half
    held = [low < case.truth[n] < high for n, (low, high) in found.intervals.items()]
    after = found.check.seconds if found.check is not None else 0.0
    return Draw(
        tuple(plain.tolist()),
        tuple(held),
        (first.chi_squared - nearest.chi_squared, found.chi_squared - nearest.chi_squared),
        bool(found.warnings),
        (seconds - after, after),
    )


def row(label: str, found: Sequence[Draw]) -> str:
    """A line of the table."""
    plain, checked = (np.array([getattr(one, k) for one in found]) for k in ("plain", "checked"))
    higher = (np.array([one.higher for one in found]) > RISE).sum(axis=0)
    missed = [one for one in found if not all(one.checked)]
    seconds = np.median([one.seconds for one in found], axis=0)
    cells = [
        label,
        str(len(found)),
        f"{higher[0]}; {higher[1]}",
        *(", ".join(f"{share:.0f}" for share in 100.0 * h.mean(axis=0)) for h in (plain, checked)),
        str(sum(one.warned for one in found)),
        f"{len(missed)}, {sum(one.warned for one in missed)}",
        f"{seconds[0]:.2g}; {seconds[1]:.2g}",
    ]
    return "| " + " | ".join(cells) + " |"


def table(cases: Sequence[Case], number: int) -> None:
    """Print the table, a row at a time."""
    print("| " + " | ".join(HEADINGS) + " |\n" + "|---" * len(HEADINGS) + "|", flush=True)
    for case in cases:
        print(row(case.label, draws(case, number)), flush=True)

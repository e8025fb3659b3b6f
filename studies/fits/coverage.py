"""Coverage of 95 % intervals by the covariance, and by runs around the estimates."""

import sys
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

import clearjoint as cj
from studies.fits import crank_rocker
from studies.fits import problem as pendulum

REPORT_EVERY = 5
"""Number of draws between reports of progress."""
RISE = 3.841
"""Rise of chi squared at the ends of a 95 % interval of one parameter."""
HEAD = (
    "scene, start",
    "draws",
    "ended in a higher minimum: search; after the check",
    "intervals that contain the truth, %: by the covariance",
    "by the check",
    "warned",
    "draws with a miss; of these with a warning",
    "s: search; check",
)


@dataclass(frozen=True)
class Case:
    """A scene with measurements free of noise, and the start and windows of its fits."""

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

    - `by_covariance`, `by_check`: whether each parameter's interval contains the truth.
    - `higher`: chi squared minus that of a fit from the truth, before and after the check.
    - `warned`: whether the fit has a warning.
    - `seconds`: times of the search and of the check, s.
    """

    by_covariance: tuple[bool, ...]
    by_check: tuple[bool, ...]
    higher: tuple[float, float]
    warned: bool
    seconds: tuple[float, float]


def pins(pin: str, angle: float, end_time: float = crank_rocker.END) -> Case:
    """Return the crank-rocker with clearance in a pin, from an angle of the crank in rad."""
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
    """Return the double pendulum with a sensor, from one of its starts."""
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


@dataclass(frozen=True)
class Row:
    """Fits to draws of the noise of a case."""

    label: str
    draws: Sequence[Draw]

    def cells(self) -> tuple[str, ...]:
        """Return the row as text."""
        by_covariance, by_check = (
            np.array([getattr(draw, name) for draw in self.draws]).mean(axis=0)
            for name in ("by_covariance", "by_check")
        )
        higher = (np.array([draw.higher for draw in self.draws]) > RISE).sum(axis=0)
        missed = [draw for draw in self.draws if not all(draw.by_check)]
        seconds = np.median([draw.seconds for draw in self.draws], axis=0)
        return (
            self.label,
            str(len(self.draws)),
            f"{higher[0]}; {higher[1]}",
            ", ".join(f"{100.0 * part:.0f}" for part in by_covariance),
            ", ".join(f"{100.0 * part:.0f}" for part in by_check),
            str(sum(draw.warned for draw in self.draws)),
            f"{len(missed)}, {sum(draw.warned for draw in missed)}",
            f"{seconds[0]:.2g}; {seconds[1]:.2g}",
        )


def cover(case: Case, number: int) -> Row:
    """Fit a number of draws of the noise; print the row so far to standard error now and then."""
    generator = np.random.default_rng(0)
    found: list[Draw] = []
    while len(found) < number:
        found.append(_draw(case, case.clean.with_noise(generator)))
        if len(found) % REPORT_EVERY == 0:
            print(*Row(case.label, found).cells(), sep=" | ", file=sys.stderr, flush=True)
    return Row(case.label, found)


def _draw(case: Case, data: cj.Measurements) -> Draw:
    begun = time.perf_counter()
    found = case.fit(data, case.guess, grow=case.grow, check_runs=400)
    seconds = time.perf_counter() - begun
    nearest = case.fit(data, case.truth, check_runs=0)
    # The first search ended before the check moved the estimates: its Jacobian gives the intervals
    # that a fit without the check would report.
    first = found.searches[0].best
    half = np.sqrt(RISE * np.diag(np.linalg.pinv(first.jacobian.T @ first.jacobian)))
    truth = [p.scale.coordinate(case.truth[n]) for n, p in case.parameters.items()]
    by_covariance = np.abs(first.coordinates - truth) < half
    by_check = [low < case.truth[n] < high for n, (low, high) in found.intervals.items()]
    check_seconds = found.check.seconds if found.check is not None else 0.0
    return Draw(
        tuple(by_covariance.tolist()),
        tuple(by_check),
        (first.chi_squared - nearest.chi_squared, found.chi_squared - nearest.chi_squared),
        bool(found.warnings),
        (seconds - check_seconds, check_seconds),
    )

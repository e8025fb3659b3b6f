"""The horizon as it is said, and fits that try it."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.figure import Figure
from scipy.optimize import least_squares

import clearjoint as cj
from clearjoint import plot
from studies.identifiability.instruments import INSTRUMENTS, PARAMETERS, SHOULDER

RATE, END = 10e3, 0.2
"""Of the samples, 1/s, and of the long record, s."""
UNCERTAINTY = {"stiffness": np.log(5.0), "restitution": 1.8, "clearance": np.log(1.2)}
LENGTHS = (0.035, 0.045, 0.055, 0.065, 0.075, 0.085, 0.095, 0.105)
"""Of the records that are fitted, s."""
FREE = PARAMETERS | {
    "restitution": cj.Parameter(lambda s: s.joints[SHOULDER].law.restitution, cj.Bounded(0.0, 1.0))
}
PROBES = INSTRUMENTS["probes"]
BOUNDED_STEPS = replace(cj.presets.derivatives, max_steps=40_000)
"""A guess can make the damping stiff; such a run is given up."""
LOST = 1e6
"""Residual of samples that a run does not reach, over the noise."""


def times_to(end: float) -> np.ndarray:
    """Times of the samples, s."""
    return np.arange(1, round(end * RATE) + 1) / RATE


def said(end: float) -> cj.results.FitHorizon:
    """The horizon by the sensitivities."""
    sensors = {"probes": cj.Sensor(PROBES.channels, times_to(end), PROBES.noise)}
    return cj.fit_horizon(*cj.mechanisms.double_pendulum(), FREE, sensors, uncertainty=UNCERTAINTY)


@dataclass(frozen=True)
class Fit:
    """Fits to a record of the truth, without noise."""

    end: float

    def seen(self, coordinates: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Readings (N,) over the noise, and their derivatives (N, p)."""
        free = {
            name: cj.Parameter(p.variation, p.scale, value=float(p.scale.value(u)))
            for (name, p), u in zip(FREE.items(), coordinates, strict=True)
        }
        times = times_to(self.end)
        outputs = {str(k): channel for k, channel in enumerate(PROBES.channels)}
        run = cj.sensitivities(
            *cj.mechanisms.double_pendulum(),
            self.end,
            free,
            outputs,
            times,
            settings=BOUNDED_STEPS,
            throw=False,
        )
        missing = len(times) - len(run.times)
        values = [np.pad(v, (0, missing), constant_values=LOST) for v in run.values.values()]
        rows = [np.pad(d, ((0, missing), (0, 0))) for d in run.derivatives.values()]
        return np.concatenate(values) / PROBES.noise, np.concatenate(rows) / PROBES.noise

    def succeeds(self, offsets: np.ndarray) -> bool:
        """Whether a fit from the truth and these offsets finds a misfit below the noise."""
        truth = np.array([p.coordinate_in(*cj.mechanisms.double_pendulum()) for p in FREE.values()])
        wanted, _ = self.seen(truth)
        found = least_squares(
            lambda u: self.seen(u)[0] - wanted,
            truth + offsets,
            jac=lambda u: self.seen(u)[1],  # pyright: ignore
            method="lm",
            x_scale="jac",
            max_nfev=60,
        )
        return bool(np.mean(found.fun**2) < 1.0)


def comparison(found: cj.results.FitHorizon, lengths: Sequence[float]) -> Iterator[str]:
    """What is said and what fits do, a row a guess, in Markdown, as they are done."""
    head = [*found.information.labels, "said, ms", *(f"{1e3 * t:g}" for t in lengths)]
    yield _row(head)
    yield _row(["---"] * len(head))
    for guess in found.guesses:
        ends = ["yes" if Fit(length).succeeds(guess.offsets) else "no" for length in lengths]
        offsets = [f"{x:+.2f}" for x in guess.offsets + 0.0]
        yield _row([*offsets, f"{1e3 * guess.since:.4g}", *ends])


def _row(cells: list[str]) -> str:
    return f"| {' | '.join(cells)} |"


def figure(found: cj.results.FitHorizon) -> Figure:
    """Growth, errors, and what longer records tell."""
    drawn = Figure(figsize=(13.0, 4.2), layout="constrained")
    left, middle, right = drawn.subplots(1, 3)
    plot.growth(found, axes=left)
    plot.integration_error(found, axes=middle)
    plot.record_length(found.information, axes=right)
    right.set_ylim(1e-5, 100.0)
    return drawn

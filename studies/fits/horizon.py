"""Predicted horizon of a fit by a single run, and fits that test the prediction.

Fits use Levenberg and Marquardt's method (SciPy's) with the derivatives of `cj.sensitivities`, on
records free of noise. A fit succeeds if it ends with a misfit below the noise.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.figure import Figure
from scipy.optimize import least_squares

import clearjoint as cj
from clearjoint import plot
from studies.identifiability.instruments import INSTRUMENTS, PARAMETERS, SHOULDER

RATE, END = 10e3, 0.2
"""Sampling rate, 1/s, and length of the long record, s."""
UNCERTAINTY = {"stiffness": np.log(5.0), "restitution": 1.8, "clearance": np.log(1.2)}
LENGTHS = (0.035, 0.045, 0.055, 0.065, 0.075, 0.085, 0.095, 0.105)
"""Lengths of the fitted records, s."""
FREE = PARAMETERS | {
    "restitution": cj.Parameter(lambda s: s.joints[SHOULDER].law.restitution, cj.Bounded(0.0, 1.0))
}
PROBES = INSTRUMENTS["probes"]
BOUNDED_STEPS = replace(cj.presets.derivatives, max_steps=40_000)
"""Settings that end a run whose damping a guess makes stiff."""
LOST = 1e6
"""Residual of samples that a run does not reach, in standard deviations."""


def times_to(end: float) -> np.ndarray:
    """Return the times of the samples, s."""
    return np.arange(1, round(end * RATE) + 1) / RATE


def predict(end: float) -> cj.results.FitHorizon:
    """Return the horizon predicted by the sensitivities, for a record of a length in s."""
    sensors = {"probes": cj.Sensor(PROBES.channels, times_to(end), PROBES.noise)}
    return cj.fit_horizon(*cj.mechanisms.double_pendulum(), FREE, sensors, uncertainty=UNCERTAINTY)


@dataclass(frozen=True)
class Fit:
    """Fits to a record that ends at a time, s."""

    end: float

    def readings(self, coordinates: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return readings (N,) in units of the noise, and their derivatives (N, p)."""
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
        values = [np.pad(v, (0, missing), constant_values=LOST) for v in run.outputs.values()]
        rows = [np.pad(d, ((0, missing), (0, 0))) for d in run.derivatives.values()]
        return np.concatenate(values) / PROBES.noise, np.concatenate(rows) / PROBES.noise

    def succeeds(self, offsets: np.ndarray) -> bool:
        """Return whether a fit from the truth plus offsets (p,) finds a misfit below the noise."""
        truth = np.array([p.coordinate_in(*cj.mechanisms.double_pendulum()) for p in FREE.values()])
        truth_readings, _ = self.readings(truth)
        found = least_squares(
            lambda u: self.readings(u)[0] - truth_readings,
            truth + offsets,
            jac=lambda u: self.readings(u)[1],  # pyright: ignore
            method="lm",
            x_scale="jac",
            max_nfev=60,
        )
        return bool(np.mean(found.fun**2) < 1.0)


@dataclass(frozen=True)
class Row:
    """A guess, its predicted horizon, s, and whether fits to records of each length succeed."""

    offsets: np.ndarray
    horizon: float
    succeeds: tuple[bool, ...]

    def cells(self) -> tuple[str, ...]:
        """Return the row as text."""
        offsets = [f"{x:+.2f}" for x in self.offsets + 0.0]
        return (
            *offsets, f"{1e3 * self.horizon:.4g}", *("yes" if x else "no" for x in self.succeeds)
        )  # fmt: skip


def head(predicted: cj.results.FitHorizon, lengths: Sequence[float]) -> tuple[str, ...]:
    """Return the head of the table for records of lengths in s."""
    ends = (f"{1e3 * length:g}" for length in lengths)
    return (*predicted.information.labels, "predicted, ms", *ends)


def rows(predicted: cj.results.FitHorizon, lengths: Sequence[float]) -> Iterator[Row]:
    """Try fits from each guess of a prediction to records of lengths in s."""
    for guess in predicted.guesses:
        succeeds = tuple(Fit(length).succeeds(guess.offsets) for length in lengths)
        yield Row(guess.offsets, guess.since, succeeds)


def figure(predicted: cj.results.FitHorizon) -> Figure:
    """Draw growth, integration error, and bounds over the length of the record."""
    drawn = Figure(figsize=(13.0, 4.2), layout="constrained")
    left, middle, right = drawn.subplots(1, 3)
    plot.growth(predicted, axes=left)
    plot.integration_error(predicted, axes=middle)
    plot.record_length(predicted.information, axes=right)
    right.set_ylim(1e-5, 100.0)
    return drawn

"""Figures 13 to 17 of the paper, and the journal's orbit."""

import numpy as np
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from clearjoint import plot
from studies.double_pendulum.runs import ELBOW, END_ARM, SHOULDER, Run, Settings

UPWARDS = {"X": (1.0, 0.0, 0.0), "−Y (upwards)": (0.0, -1.0, 0.0)}


def figures(settings: Settings, clearance: Run, ideal: Run) -> dict[str, Figure]:
    """Return the paper's figures and the orbit of the journal, by file name."""
    return {
        "figure_13": _figure_13(clearance),
        "figure_14": _figure_14(settings, clearance, ideal),
        "figure_15": _figure_15(settings, clearance, ideal),
        "figure_16": _figure_16(settings, clearance),
        "figure_17": plot.journal_frames(
            clearance.saved,
            SHOULDER,
            settings.clearance,
            _frame_instants(clearance),
            section=UPWARDS,
        ),
        "orbit": _orbit(settings, clearance),
    }


def _figure_13(clearance: Run) -> Figure:
    figure = Figure(figsize=(10.0, 4.0), layout=ConstrainedLayoutEngine(wspace=0.05))
    left, right = figure.subplots(1, 2)
    impacts = clearance.of("V")
    margin = 0.2 * impacts.duration[0]
    plot.contact_and_reaction(
        clearance.saved,
        (SHOULDER, "V"),
        (ELBOW, END_ARM),
        axes=left,
        window=(impacts.onset[0] - margin, impacts.separation[0] + margin),
    )
    plot.hysteresis(clearance.saved, impacts, axes=right)
    left.set_title("(a) first impact")
    right.set_title("(b) first three impacts, base V")
    return figure


def _labels(settings: Settings) -> tuple[str, str]:
    return f"clearance {settings.clearance * 1e3:g} mm", "ideal joint"


def _figure_14(settings: Settings, clearance: Run, ideal: Run) -> Figure:
    figure = Figure(figsize=(10.0, 4.0), layout=ConstrainedLayoutEngine(wspace=0.05))
    left, right = figure.subplots(1, 2)
    with_clearance, without = _labels(settings)
    trajectories = {with_clearance: clearance.trajectory, without: ideal.trajectory}
    plot.position(trajectories, END_ARM, axes=left)
    observations = {with_clearance: clearance.steps, without: ideal.saved}
    plot.acceleration(observations, END_ARM, axes=right)
    left.set_title("(a)", loc="left")
    right.set_title("(b)", loc="left")
    return figure


def _figure_15(settings: Settings, clearance: Run, ideal: Run) -> Figure:
    figure = Figure(figsize=(9.0, 4.4), layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    runs = zip(_labels(settings), (clearance, ideal), strict=True)
    trajectories = {label: run.trajectory for label, run in runs}
    window = (0.0, min(3.0, settings.duration))
    for axes, across in zip(panels, ("X", "Z"), strict=True):
        plot.path(trajectories, END_ARM, (across, "Y"), window=window, axes=axes)
        axes.plot(0.0, 0.0, "k+", markersize=9, label="bearing")
        axes.label_outer()
    panels[0].invert_yaxis()
    panels[0].get_gridspec().set_width_ratios([np.ptp(axes.get_xlim()) for axes in panels])
    panels[0].set_title("view along Z, the shoulder's axis")
    panels[1].set_title("view along X")
    curves = panels[0].get_legend_handles_labels()
    figure.legend(*curves, loc="outside lower center", ncols=4, frameon=False)
    return figure


def _figure_16(settings: Settings, clearance: Run) -> Figure:
    figure = Figure(figsize=(8.0, 3.6), layout="constrained")
    plot.eccentricities(
        clearance.saved,
        SHOULDER,
        settings.clearance,
        window=(0.0, settings.early),
        axes=figure.subplots(),
    )
    return figure


def _orbit(settings: Settings, clearance: Run) -> Figure:
    figure = Figure(figsize=(4.8, 5.0), layout="constrained")
    plot.journal_orbit(
        clearance.saved,
        SHOULDER,
        settings.clearance,
        section=UPWARDS,
        window=(0.0, settings.early),
        axes=figure.subplots(),
    )
    return figure


def _frame_instants(clearance: Run) -> np.ndarray:
    """Return the start, and the times of eight contacts and of the rebounds between them, s."""
    peaks = np.sort(clearance.impacts.peak_time)
    apart = np.diff(peaks, prepend=0.0) > 0.1 * peaks[0]
    strikes = peaks[apart][:8]
    rebounds = 0.5 * (strikes[:-1] + strikes[1:])
    return np.sort(np.concatenate([[0.0], strikes, rebounds]))


def animated_instants(settings: Settings, clearance: Run) -> np.ndarray:
    """Return uniform times of the early motion, with a few repeated frames at every contact, s."""
    frames, halt = (16, 1) if settings.quick else (100, 3)
    peaks = clearance.impacts.peak_time
    strikes = np.repeat(peaks[peaks < settings.early], halt)
    return np.sort(np.concatenate([np.linspace(0.0, settings.early, frames), strikes]))

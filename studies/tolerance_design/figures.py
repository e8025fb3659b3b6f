"""Figures of `studies.tolerance_design`."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

import clearjoint as cj
from clearjoint import plot
from clearjoint.plot import style
from studies.tolerance_design.search import FORCE, POSITION, RANGE, Answer, Design


def margins(answers: list[Answer]) -> Figure:
    """Draw margins against clearance, with the largest clearance of each limit."""
    figure = Figure(figsize=(11.0, 6.6), layout="constrained")
    panels = figure.subplots(2, len(answers), sharex=True, squeeze=False)
    for column, answer in zip(panels.T, answers, strict=True):
        column[0].set_title(answer.design.title, fontsize="medium")
        for axes, name in zip(column, answer.design.limits, strict=True):
            _curve(answer, name, axes)
            axes.axvline(
                1e6 * answer.alone[name].value,
                color=style.VERMILLION,
                linewidth=1.2,
                label="largest clearance for this limit",
            )
    handles = panels[0, 0].get_legend_handles_labels()
    figure.legend(*handles, loc="outside upper center", ncols=4, frameon=False)
    return figure


def _curve(answer: Answer, name: str, axes: Axes) -> None:
    micrometres, values = 1e6 * answer.clearances, answer.margins[name]
    axes.axvspan(
        1e6 * RANGE[0],
        1e6 * answer.both.value,
        color=style.LIGHT,
        alpha=0.5,
        lw=0,
        label="both hold",
    )
    axes.axhline(0.0, color=style.GREY, linewidth=1.2, label="limit")
    axes.plot(
        micrometres, values, ".-", color=style.BLUE, linewidth=1.0, markersize=4, label="margin"
    )
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_xlim(*(1e6 * end for end in RANGE))
    low, high = np.nanmin(values), np.nanmax(values)
    room = 0.15 * (high - low)
    axes.set_ylim(low - room, high + room)
    style.dress(axes, "radial clearance, µm", f"{name}:\nlog(limit / peak)")


def motion(design: Design, clearance: float, growths: dict[str, np.ndarray]) -> Figure:
    """Draw slider and pin force of a design and of the ideal mechanism in the last revolution, and
    derivatives over the revolutions by label.
    """
    figure = Figure(figsize=(12.5, 4.2), layout="constrained")
    left, middle, right = figure.subplots(1, 3)
    run = design.run(clearance, design.instants())
    angles = 2.0 * np.pi * (run.times - run.times[0]) / design.period
    offset = 2.0 * np.pi * (run.times[0] / design.period % 1.0)
    label = f"{1e6 * clearance:.1f} µm"
    errors = {label: (angles, 1e6 * run.outputs["error"]), "ideal joint": (angles, 0.0 * angles)}
    plot.over_angle(errors, "slider from its ideal position, µm", axes=left)
    ideal = ideal_pin_force(design, angles + offset)
    forces = {label: run.outputs[FORCE], "ideal joint": ideal}
    forces = {name: (angles, 1e-3 * values) for name, values in forces.items()}
    plot.over_angle(forces, "pin force, kN", axes=middle)
    for axes, limit in (
        (left, 1e6 * design.limits[POSITION]),
        (middle, 1e-3 * design.limits[FORCE]),
    ):
        axes.axhline(limit, color=style.GREY, linewidth=1.2, linestyle=":", label="limit")
        start = np.degrees(offset)
        axes.xaxis.set_major_formatter(lambda x, _, start=start: f"{(x + start) % 360.0:.0f}")
    left.axhline(-1e6 * design.limits[POSITION], color=style.GREY, linewidth=1.2, linestyle=":")
    handles = middle.get_legend_handles_labels()
    figure.legend(*handles, loc="outside upper left", ncols=3, frameon=False)
    _growth(growths, right)
    return figure


def _growth(growths: dict[str, np.ndarray], axes: Axes) -> None:
    for (label, sizes), marker in zip(growths.items(), "os^v", strict=False):
        axes.semilogy(1 + np.arange(len(sizes)), sizes, f"{marker}-", markersize=4, label=label)
    style.dress(axes, "revolution", "largest derivative of the slider's position\nto the clearance")
    axes.legend(frameon=False, fontsize="small")


def ideal_pin_force(design: Design, angles: np.ndarray) -> np.ndarray:
    """Return the pin force of the ideal mechanism at crank angles, rad; N.

    Along X the pin drives the slider; across it, the force balances the moments of the rod about
    the crank pin.
    """
    scene, _ = cj.mechanisms.slider_crank(None)
    rod, slider = scene.bodies["rod"], scene.bodies["slider"]
    fine = np.linspace(-0.1, 2.0 * np.pi + 0.1, 20_001)
    tip = cj.mechanisms.CRANK_LENGTH * np.stack([np.cos(fine), np.sin(fine)])
    tilt = -np.arcsin(tip[1] / cj.mechanisms.ROD_LENGTH)
    along = cj.mechanisms.ROD_LENGTH * np.stack([np.cos(tilt), np.sin(tilt)])

    def second_rate(values: np.ndarray) -> np.ndarray:
        once = np.gradient(values, fine, axis=-1)
        return (2.0 * np.pi / design.period) ** 2 * np.gradient(once, fine, axis=-1)

    def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return a[0] * b[1] - a[1] * b[0]

    moment = float(rod.inertia[2]) * second_rate(tilt)
    moment = moment + float(rod.mass) * cross(0.5 * along, second_rate(tip + 0.5 * along))
    force_x = -float(slider.mass) * second_rate(tip[0] + along[0])
    force_y = (moment + along[1] * force_x) / along[0]
    return np.interp(angles % (2.0 * np.pi), fine, np.hypot(force_x, force_y))

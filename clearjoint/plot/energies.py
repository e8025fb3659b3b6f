"""The energy ledger over time."""

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

from ..simulation.results.observe import Observation
from .labels import fitting_unit, time_unit
from .style import DARK, TimeSpan, dress, lines, show

STORED = {
    "kinetic": ("kinetic",),
    "potential, 0 at the start": ("gravity",),
    "elastic": ("springs", "contacts", "bristles"),
}
"""Energies of an observation, by what the legend calls them."""
DISSIPATED = ("normal damping", "friction", "film", "stabilisation")
SUPPLIED = "supplied"


def energy_ledger(
    observation: Observation,
    *,
    window: TimeSpan | None = None,
    axes: np.ndarray | None = None,
) -> np.ndarray:
    """Where the energy is and goes, over time, and below what the ledger does not account for.

    Kinetic energy, potential energy of gravity since the first instant, elastic energy (springs,
    contacts, bristles), and since the start what was dissipated (normal damping, friction, films,
    stabilisation) and what drivers and loads have worked. Below, the drift: by how much the first
    three, with what was dissipated and without the work, differ from their sum at the start. Where
    the run kept no ledger, below is by how much the mechanical energy has changed.

    **Arguments:**

    - `observation`: of a run with `Settings(ledger=True)`.
    - `window`: instants between which to draw, s; the whole observation unless given.
    - `axes`: two, unless new ones are to be made.

    **Returns:** the axes, (2,); time in ms or s, energies in J, mJ or so.

    >>> scene, state = cj.mechanisms.double_pendulum()
    >>> settings, save = cj.Settings(ledger=True), cj.Saving(np.linspace(0, 0.02, 2001))
    >>> solution = cj.simulate(scene, state, 0.02, settings, save, progress=False)
    >>> above, below = plot.energy_ledger(cj.observe(scene, solution))
    >>> below.get_ylabel().split(",")[0]
    'drift'
    """
    if axes is None:
        looks = {"sharex": True, "height_ratios": (2.2, 1.0), "figsize": (6.4, 5.2)}
        axes = np.asarray(plt.subplots(2, 1, layout="constrained", **looks)[1])
    above, below = axes
    times = np.asarray(observation.times)
    faster, _ = time_unit(times, window)
    span = None if window is None else (faster * window[0], faster * window[1])
    during = show(above, times * faster, span)
    curves = {name: values[during] for name, values in _curves(observation).items()}
    factor, unit = fitting_unit(np.concatenate(list(curves.values())), "J")
    for (label, values), (colour, style) in zip(curves.items(), lines(), strict=False):
        look = {"color": colour, "linestyle": style, "linewidth": 1.8}
        above.plot(times[during] * faster, values * factor, label=label, **look)
    above.margins(x=0.0)
    above.legend(
        loc="lower center",
        bbox_to_anchor=(0.5, 1.0),
        handlelength=3.0,
        ncols=min(len(curves), 3),
        frameon=False,
    )
    dress(above, "", f"energy, {unit}")
    _drift(observation, during, window, below)
    return axes


def _curves(observation: Observation) -> dict[str, np.ndarray]:
    energies = observation.energies
    curves = {label: _sum(observation, names) for label, names in STORED.items()}
    found = {label: values for label, values in curves.items() if values is not None}
    if "potential, 0 at the start" in found:
        found["potential, 0 at the start"] = energies["gravity"] - energies["gravity"][0]
    if (dissipated := _sum(observation, DISSIPATED)) is not None:
        found["dissipated"] = dissipated
    if SUPPLIED in energies:
        found["work of drivers and loads"] = np.asarray(energies[SUPPLIED])
    return found


def _sum(observation: Observation, names: tuple[str, ...]) -> np.ndarray | None:
    energies = observation.energies
    there = [np.asarray(energies[name]) for name in names if name in energies]
    return np.sum(there, axis=0) if there else None


def _drift(
    observation: Observation, during: np.ndarray, window: TimeSpan | None, axes: Axes
) -> None:
    times = np.asarray(observation.times)
    faster, time = time_unit(times, window)
    kept = any(name in observation.energies for name in (*DISSIPATED, SUPPLIED))
    drift = np.asarray(observation.ledger_residual())[during]
    factor, unit = fitting_unit(drift, "J")
    show(axes, times * faster, None if window is None else (faster * window[0], faster * window[1]))
    axes.plot(times[during] * faster, drift * factor, color=DARK, linewidth=1.0)
    axes.margins(x=0.0)
    turned = max(np.ptp(values) for values in _curves(observation).values())
    if kept and turned > 0.0:
        share = np.abs(drift).max(initial=0.0) / turned
        text = f"at most {share:.1g} of the largest change above"
        axes.set_title(text, fontsize="small", loc="right")
    label = "drift" if kept else "mechanical,\nsince start"
    dress(axes, f"time, {time}", f"{label}, {unit}")

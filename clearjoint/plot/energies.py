"""Draw the energy ledger of a run over time."""

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

from ..simulation.results.observe import Observation
from .labels import fitting_unit, time_axis
from .style import DARK, TimeSpan, draw_lines, dress, legend_above

STORED = {
    "kinetic": ("kinetic",),
    "potential, 0 at the start": ("gravity",),
    "elastic": ("springs", "contacts", "bristles"),
}
"""Keys of `Observation.energies` whose sum is one curve, by the curve's label in the legend."""
DISSIPATED = ("normal damping", "friction", "film", "stabilisation")
"""Keys of `Observation.energies` whose sum is the curve "dissipated"."""
SUPPLIED = "supplied"
"""Key of `Observation.energies` with the work of drivers and loads."""


def energy_ledger(
    observation: Observation,
    *,
    window: TimeSpan | None = None,
    axes: np.ndarray | None = None,
) -> np.ndarray:
    """Draw the energies of a run over time, and below them the error of their balance, the drift.

    The upper axes show the kinetic energy, the potential energy of gravity relative to the first
    instant, the elastic energy (springs, contacts, bristles), the energy dissipated since the start
    (normal damping, friction, films, stabilisation) and the work of drivers and loads since the
    start. The drift is the change since the start of kinetic, potential, elastic and dissipated
    energy together, minus the work; it would be zero for an exact integration. A run without energy
    ledger has neither dissipated energy nor work: the lower axes then show the change of kinetic,
    potential and elastic energy together.

    **Arguments:**

    - `observation`: from `cj.observe`, of a run with `Settings(ledger=True)`.
    - `window`: start and end of the drawn time, s; by default the whole observation.
    - `axes`: array (2,) of the upper and the lower axes; new ones by default.

    **Returns:** the axes, (2,); time in ms or s, energies with a suitable prefix of J.

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
    mask, times, _ = time_axis(above, observation.times, window)
    curves = {name: values[mask] for name, values in _curves(observation).items()}
    factor, unit = fitting_unit(np.concatenate(list(curves.values())), "J")
    draw_lines(above, ((name, times, y * factor) for name, y in curves.items()), 1.8)
    above.margins(x=0.0)
    legend_above(above, min(len(curves), 3), handlelength=3.0)
    dress(above, "", f"energy, {unit}")
    _draw_drift(observation, window, below)
    return axes


def _curves(observation: Observation) -> dict[str, np.ndarray]:
    """Return the curves of the upper axes, (N,) J, by their label in the legend."""
    energies = observation.energies
    curves = {label: _sum(observation, names) for label, names in STORED.items()}
    known = {label: values for label, values in curves.items() if values is not None}
    if "potential, 0 at the start" in known:
        known["potential, 0 at the start"] = energies["gravity"] - energies["gravity"][0]
    if (dissipated := _sum(observation, DISSIPATED)) is not None:
        known["dissipated"] = dissipated
    if SUPPLIED in energies:
        known["work of drivers and loads"] = np.asarray(energies[SUPPLIED])
    return known


def _sum(observation: Observation, names: tuple[str, ...]) -> np.ndarray | None:
    """Return the sum (N,), J, of the named energies that were observed, None if there are none."""
    energies = observation.energies
    known = [np.asarray(energies[name]) for name in names if name in energies]
    return np.sum(known, axis=0) if known else None


def _draw_drift(observation: Observation, window: TimeSpan | None, axes: Axes) -> None:
    mask, times, time_label = time_axis(axes, observation.times, window)
    has_ledger = any(name in observation.energies for name in (*DISSIPATED, SUPPLIED))
    drift = np.asarray(observation.ledger_residual())[mask]
    factor, unit = fitting_unit(drift, "J")
    axes.plot(times, drift * factor, color=DARK, linewidth=1.0)
    axes.margins(x=0.0)
    largest_change = max(np.ptp(values) for values in _curves(observation).values())
    if has_ledger and largest_change > 0.0:
        share = np.abs(drift).max(initial=0.0) / largest_change
        text = f"at most {share:.1g} of the largest change above"
        axes.set_title(text, fontsize="small", loc="right")
    label = "drift" if has_ledger else "mechanical,\nsince start"
    dress(axes, time_label, f"{label}, {unit}")

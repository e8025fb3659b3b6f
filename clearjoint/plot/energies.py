"""Draw the energies of a run over time.

The energy ledger of a run consists of the integrals that ``Settings(ledger=True)`` adds to its
variables: the energies dissipated by damping, friction, films and stabilisation, and the work of
drivers and loads.
"""

import numpy as np
from matplotlib import pyplot as plt

from ..simulation.results.observation import Observation
from .labels import fitting_unit, time_axis
from .style import DARK, TimeSpan, draw_lines, dress, legend_above

POTENTIAL = "potential, 0 at the start"
ENERGIES = {
    "kinetic": ("kinetic",),
    POTENTIAL: ("gravity",),
    "elastic": ("springs", "contacts", "bristles"),
    "dissipated": ("normal damping", "friction", "film", "stabilisation"),
    "work of drivers and loads": ("supplied",),
}
"""Keys of `Observation.energies` whose sum is one curve, by the curve's label in the legend."""


def energy_ledger(
    observation: Observation,
    *,
    window: TimeSpan | None = None,
    axes: np.ndarray | None = None,
) -> np.ndarray:
    """Draw the energies of a run over time, and below them the error of their balance, the drift.

    The upper axes show the kinetic energy, the potential energy of gravity relative to the first
    instant, the elastic energy (of springs, contacts, and bristles of friction laws), the energy
    dissipated since the start (by normal damping, friction, films, and the stabilisation of
    constraints) and the work of drivers and loads since the start. Energies that the scene does not
    have are left out. The drift is the change since the start of kinetic, potential, elastic and
    dissipated energy together, minus the work; it would be zero for an exact integration. A title
    gives its largest magnitude as a fraction of the largest change of a curve above. In a run
    without ``Settings(ledger=True)``, dissipated energy and work are unknown: the lower axes then
    show the change of kinetic, potential and elastic energy together.

    **Arguments:**

    - `observation`: from `cj.observe`, best of a run with ``Settings(ledger=True)``.
    - `window`: start and end of the drawn time, s; by default all observed times.
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
    energies = observation.energies
    # Energies that the scene does not have, such as those of springs, are left out.
    changes = {
        label: np.sum([energies[name] for name in names if name in energies], axis=0)
        for label, names in ENERGIES.items()
        if not energies.keys().isdisjoint(names)
    }
    if POTENTIAL in changes:  # only its changes matter, and its zero is arbitrary
        changes[POTENTIAL] = changes[POTENTIAL] - changes[POTENTIAL][0]
    mask, times, time_label = time_axis(above, observation.times, window)
    curves = {name: values[mask] for name, values in changes.items()}
    factor, unit = fitting_unit(np.concatenate(list(curves.values())), "J")
    draw_lines(above, ((name, times, y * factor) for name, y in curves.items()), 1.8)
    above.margins(x=0.0)
    legend_above(above, min(len(curves), 3), handlelength=3.0)
    dress(above, "", f"energy, {unit}")
    time_axis(below, observation.times, window)
    drift = np.asarray(observation.ledger_residual())[mask]
    factor, unit = fitting_unit(drift, "J")
    below.plot(times, drift * factor, color=DARK, linewidth=1.0)
    below.margins(x=0.0)
    # Only a run with an energy ledger has these energies.
    has_ledger = not energies.keys().isdisjoint({*ENERGIES["dissipated"], "supplied"})
    largest_change = max(np.ptp(values) for values in changes.values())
    if has_ledger and largest_change > 0.0:  # a title tells how large the drift is relatively
        share = np.abs(drift).max(initial=0.0) / largest_change
        text = f"at most {share:.1g} of the largest change above"
        below.set_title(text, fontsize="small", loc="right")
    label = "drift" if has_ledger else "mechanical,\nsince start"
    dress(below, time_label, f"{label}, {unit}")
    return axes

"""Hysteresis of impacts: force over penetration, and the energy inside the loop."""

import numpy as np
from matplotlib.axes import Axes

from ..fields.checks import require
from ..simulation.results.impact_table import Impacts
from ..simulation.results.observe import Observation
from . import observed
from .labels import fitting_unit
from .style import axes_or_new, dress, inside, lines


def hysteresis(
    observation: Observation, impacts: Impacts, *, count: int = 3, axes: Axes | None = None
) -> Axes:
    """Normal force over penetration in the first impacts of one contact (Fig. 13b).

    The area inside a loop is the energy that the impact dissipates there; the legend gives it.

    **Arguments:**

    - `observation`: at instants that resolve the impacts, such as every accepted step.
    - `impacts`: those of one contact, from `Impacts.of`.
    - `count`: how many loops to draw.

    **Returns:** the axes; penetration in µm or so, force in N or kN.

    **Raises:** `ValueError` where there is no impact, or too few instants in one.

    >>> scene, state = cj.mechanisms.double_pendulum()
    >>> save = cj.Saving(np.linspace(0, 0.02, 2001), impacts=True)
    >>> solution = cj.simulate(scene, state, 0.02, save=save, progress=False)
    >>> observed = cj.observe(scene, solution)
    >>> axes = plot.hysteresis(observed, solution.impacts.of("shoulder", "V"), count=1)
    """
    remedy = "take another contact, or a longer run"
    require(len(impacts) > 0, "impacts", len(impacts), "one impact at least", remedy)
    axes = axes_or_new(axes)
    loops = [_loop(observation, impacts, k) for k in range(min(count, len(impacts)))]
    energies = [float(np.trapezoid(force, depth)) for depth, force in loops]
    deeper, length = fitting_unit(np.concatenate([depth for depth, _ in loops]), "m")
    stronger, strength = fitting_unit(np.concatenate([force for _, force in loops]), "N")
    for k, ((depth, force), (colour, style)) in enumerate(zip(loops, lines(), strict=False)):
        larger, energy = fitting_unit(np.array(energies[k]), "J")
        label = f"impact {k + 1} at {impacts.onset[k] * 1e3:.1f} ms"
        label = f"{label}: {energies[k] * larger:.3g} {energy}"
        look = {"color": colour, "linestyle": style, "linewidth": 2}
        axes.plot(depth * deeper, force * stronger, label=label, **look)
    axes.set_xlim(left=0.0)
    axes.set_ylim(bottom=0.0)
    axes.legend(loc="upper left", frameon=False)
    return dress(axes, f"penetration, {length}", f"contact force, {strength}")


def enclosed_energy(observation: Observation, impacts: Impacts, index: int) -> float:
    """Area inside the hysteresis loop of one impact, J: what is dissipated at that contact.

    >>> scene, state = cj.mechanisms.double_pendulum()
    >>> save = cj.Saving(np.linspace(0, 0.02, 2001), impacts=True)
    >>> solution = cj.simulate(scene, state, 0.02, save=save, progress=False)
    >>> observed = cj.observe(scene, solution)
    >>> impacts = solution.impacts.of("shoulder", "V")
    >>> plot.enclosed_energy(observed, impacts, 0) > 0.0  # J
    True
    """
    depth, force = _loop(observation, impacts, index)
    return float(np.trapezoid(force, depth))


def _loop(observation: Observation, impacts: Impacts, index: int) -> tuple[np.ndarray, np.ndarray]:
    """Penetration (m) and force (N) from the onset of an impact to its end, zeros at both ends."""
    seen = observed.contact(observation, impacts.joint[index], impacts.contact[index])
    inside_span = inside(observation.times, (impacts.onset[index], impacts.separation[index]))
    remedy = "observe every step: cj.observe(scene, solution, solution.steps)"
    samples = int(inside_span.sum())
    require(samples >= 3, "observation", samples, "of three instants or more in the impact", remedy)
    depth = np.maximum(seen.penetration[inside_span], 0.0)
    return np.pad(depth, 1), np.pad(seen.normal_force[inside_span], 1)

"""Forces of impacts: over time, and over penetration."""

import numpy as np
from matplotlib.axes import Axes

from ..model.plays.journal_bases import BASES
from ..simulation.impact_table import Impacts
from ..simulation.observe import Observation
from . import observed
from .style import TimeSpan, axes_or_new, dress, inside, lines, show


def contact_and_reaction(
    observation: Observation,
    contact: tuple[str, str],
    reaction: tuple[str, str],
    *,
    window: TimeSpan | None = None,
    axes: Axes | None = None,
) -> Axes:
    """Normal force of a contact and magnitude of an ideal joint's reaction over time (Fig. 13a).

    **Arguments:**

    - `observation`: at instants that resolve the impact.
    - `contact`: names of the clearance joint and of the contact in it, such as a base.
    - `reaction`: names of the ideal joint and of the body on which its force acts.
    - `window`: instants between which to draw, s; the whole observation unless given.

    **Returns:** the axes; time in ms, forces in N.

    >>> scene, state = cj.double_pendulum()
    >>> save = cj.Saving(np.linspace(0, 0.02, 2001), impacts=True)
    >>> solution = cj.simulate(scene, state, 0.02, save=save, progress=False)
    >>> observed = cj.observe(scene, solution)
    >>> axes = plot.contact_and_reaction(observed, ("shoulder", "V"), ("elbow", "arm 3"))
    """
    axes = axes_or_new(axes)
    inside_span = inside(observation.times, window)
    times = observation.times[inside_span] * 1e3
    force = observed.contact(observation, *contact).normal_force[inside_span]
    load = np.linalg.norm(observed.reaction(observation, *reaction).force[inside_span], axis=1)
    curves = {
        f"contact force at base {contact[1]}: peak {force.max():.0f} N": force,
        f"reaction at the {reaction[0]}: peak {load.max():.0f} N": load,
    }
    for (label, values), (colour, style) in zip(curves.items(), lines(), strict=False):
        axes.plot(times, values, color=colour, linestyle=style, linewidth=2, label=label)
    axes.set_ylim(0.0, 1.3 * max(force.max(), load.max()))
    axes.legend(loc="upper center", frameon=False)
    return dress(axes, "time, ms", "force, N")


def contact_forces(
    observation: Observation,
    joint: str,
    *,
    window: TimeSpan | None = None,
    axes: Axes | None = None,
) -> Axes:
    """Normal forces of all contacts of a joint over time.

    **Arguments:**

    - `observation`: along every accepted step, or at instants that resolve the impacts.
    - `joint`: name of the clearance joint.
    - `window`: instants between which to draw, s; the whole observation unless given.

    **Returns:** the axes; time in ms, force in N or kN.

    >>> scene, state = cj.double_pendulum()
    >>> save = cj.Saving(np.linspace(0, 0.02, 2001), impacts=True)
    >>> solution = cj.simulate(scene, state, 0.02, save=save, progress=False)
    >>> observed = cj.observe(scene, solution)
    >>> axes = plot.contact_forces(observed, "shoulder", window=(0.01, 0.0115))
    """
    axes = axes_or_new(axes)
    times = observation.times * 1e3
    inside_span = show(axes, times, None if window is None else (1e3 * window[0], 1e3 * window[1]))
    contacts = observed.contacts(observation, joint)
    forces = {name: np.asarray(one.normal_force)[inside_span] for name, one in contacts.items()}
    peak = max(force.max(initial=0.0) for force in forces.values())
    factor, unit = (1e-3, "kN") if peak >= 1e4 else (1.0, "N")
    for (name, force), (colour, style) in zip(forces.items(), lines(), strict=False):
        label = f"base {name}" if name in BASES else name
        look = {"color": colour, "linestyle": style, "linewidth": 1.2}
        axes.plot(times[inside_span], force * factor, label=label, **look)
    axes.set_ylim(bottom=0.0)
    columns = min(len(forces), 4)
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=columns, frameon=False)
    return dress(axes, "time, ms", f"normal force, {unit}")


def hysteresis(
    observation: Observation, impacts: Impacts, *, count: int = 3, axes: Axes | None = None
) -> Axes:
    """Normal force over penetration in the first impacts of one contact (Fig. 13b).

    The area inside a loop is the energy that the impact dissipates there; the legend gives it.

    **Arguments:**

    - `observation`: at instants that resolve the impacts.
    - `impacts`: those of one contact, from `Impacts.of`.
    - `count`: how many loops to draw.

    **Returns:** the axes; penetration in micrometres, force in N.

    >>> scene, state = cj.double_pendulum()
    >>> save = cj.Saving(np.linspace(0, 0.02, 2001), impacts=True)
    >>> solution = cj.simulate(scene, state, 0.02, save=save, progress=False)
    >>> observed = cj.observe(scene, solution)
    >>> axes = plot.hysteresis(observed, solution.impacts.of("shoulder", "V"), count=1)
    """
    axes = axes_or_new(axes)
    for k, (colour, style) in zip(range(min(count, len(impacts))), lines(), strict=False):
        depth, force = _loop(observation, impacts, k)
        energy = enclosed_energy(observation, impacts, k)
        label = f"impact {k + 1} at {impacts.onset[k] * 1e3:.1f} ms: {energy * 1e3:.3g} mJ"
        axes.plot(depth * 1e6, force, color=colour, linestyle=style, linewidth=2, label=label)
    axes.set_xlim(left=0.0)
    axes.set_ylim(bottom=0.0)
    axes.legend(loc="upper left", frameon=False)
    return dress(axes, "penetration, µm", "contact force, N")


def enclosed_energy(observation: Observation, impacts: Impacts, index: int) -> float:
    """Area inside the hysteresis loop of one impact, J: what is dissipated at that contact.

    >>> scene, state = cj.double_pendulum()
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
    depth = np.maximum(seen.penetration[inside_span], 0.0)
    return np.pad(depth, 1), np.pad(seen.normal_force[inside_span], 1)

"""Normal forces of contacts, over time and over the penetration."""

import numpy as np
from matplotlib.axes import Axes

from ..fields.checks import require
from ..fields.drawn_text import shown
from ..model.clearance_joints.journal_bases import BASES
from ..simulation.results.impact_table import Impacts
from ..simulation.results.observe import Observation
from . import observed
from .labels import fitting_unit, time_unit
from .style import TimeSpan, axes_or_new, dress, inside, lines, show

OVER_USUAL_PEAK, OVER_USUAL_VALUE = 6.0, 20.0
"""Largest value over the median of the contacts' peaks, or over the value that is exceeded for half
of the time in contact, from which on an axis is logarithmic."""
FEWEST_PEAKS = 3
DECADES = 4.0
"""Of a logarithmic axis, at most."""


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

    **Returns:** the axes; time in ms or s, forces in N or kN.

    >>> scene, state = cj.mechanisms.double_pendulum()
    >>> save = cj.Saving(np.linspace(0, 0.02, 2001), impacts=True)
    >>> solution = cj.simulate(scene, state, 0.02, save=save, progress=False)
    >>> observed = cj.observe(scene, solution)
    >>> axes = plot.contact_and_reaction(observed, ("shoulder", "V"), ("elbow", "arm 3"))
    """
    axes = axes_or_new(axes)
    inside_span = inside(observation.times, window)
    force = observed.contact(observation, *contact).normal_force[inside_span]
    load = np.linalg.norm(observed.reaction(observation, *reaction).force[inside_span], axis=1)
    largest = np.array([force.max(), load.max()])
    (factor, unit), (faster, time) = (
        fitting_unit(largest, "N"),
        time_unit(observation.times, window),
    )
    times = observation.times[inside_span] * faster
    peaks = [f"{peak * factor:.4g} {unit}" for peak in largest]
    curves = {
        f"contact force at {shown(_called(contact[1]))}: peak {peaks[0]}": force,
        f"reaction at the {shown(reaction[0])}: peak {peaks[1]}": load,
    }
    for (label, values), (colour, style) in zip(curves.items(), lines(), strict=False):
        axes.plot(times, values * factor, color=colour, linestyle=style, linewidth=2, label=label)
    axes.set_ylim(0.0, 1.3 * factor * largest.max())
    axes.legend(loc="upper center", frameon=False)
    return dress(axes, f"time, {time}", f"force, {unit}")


def contact_forces(
    observation: Observation,
    joint: str,
    *,
    window: TimeSpan | None = None,
    logarithmic: bool | None = None,
    axes: Axes | None = None,
) -> Axes:
    """Normal forces of all contacts of a joint over time.

    Contacts with the same force, such as both bases in planar motion, are one curve.

    **Arguments:**

    - `observation`: along every accepted step, or at instants that resolve the impacts.
    - `joint`: name of the clearance joint.
    - `window`: instants between which to draw, s; the whole observation unless given.
    - `logarithmic`: whether forces are on a logarithmic axis, on which free flight is below what is
      shown; unless given, where one peak is so much larger than the others that these could not be
      seen.

    **Returns:** the axes; time in ms or s, force in N or kN.

    >>> scene, state = cj.mechanisms.double_pendulum()
    >>> save = cj.Saving(np.linspace(0, 0.02, 2001), impacts=True)
    >>> solution = cj.simulate(scene, state, 0.02, save=save, progress=False)
    >>> observed = cj.observe(scene, solution)
    >>> axes = plot.contact_forces(observed, "shoulder", window=(0.01, 0.0115))
    """
    contacts = observed.contacts(observation, joint)
    forces = {_called(name): one.normal_force for name, one in contacts.items()}
    axes = axes_or_new(axes)
    return _over_time(observation.times, forces, ("normal force", "N"), window, logarithmic, axes)


def joint_forces(
    observation: Observation,
    *,
    window: TimeSpan | None = None,
    logarithmic: bool | None = None,
    axes: Axes | None = None,
) -> Axes:
    """Largest normal force among the contacts of each joint, over time, for all joints with play.

    **Arguments:** `observation`, `window`, `logarithmic`: as of `contact_forces`.

    **Returns:** the axes; time in ms or s, force in N or kN.

    **Raises:** `ValueError` for a scene without contacts.

    >>> scene, state = cj.mechanisms.double_pendulum()
    >>> save = cj.Saving(np.linspace(0, 0.02, 2001), impacts=True)
    >>> solution = cj.simulate(scene, state, 0.02, save=save, progress=False)
    >>> observed = cj.observe(scene, solution)
    >>> axes = plot.joint_forces(observed)
    """
    observed.require_contacts(observation)
    forces = {
        name: np.max([np.asarray(one.normal_force) for one in family.values()], axis=0)
        for name, family in observation.contacts.items()
    }
    axes = axes_or_new(axes)
    return _over_time(observation.times, forces, ("normal force", "N"), window, logarithmic, axes)


def _called(contact: str) -> str:
    return f"base {contact}" if contact in BASES else contact


def _over_time(
    times: np.ndarray,
    curves: dict[str, np.ndarray],
    quantity: tuple[str, str],
    window: TimeSpan | None,
    logarithmic: bool | None,
    axes: Axes,
) -> Axes:
    """Curves of a quantity, by name and SI unit, that is never negative."""
    faster, time = time_unit(times, window)
    span = None if window is None else (faster * window[0], faster * window[1])
    inside_span = show(axes, times * faster, span)
    drawn = observed.without_twins(
        {name: np.asarray(values)[inside_span] for name, values in curves.items()}
    )
    factor, unit = fitting_unit(np.concatenate([values for _, values in drawn]), quantity[1])
    for k, ((label, values), (colour, style)) in enumerate(zip(drawn, lines(), strict=False)):
        look = {"color": colour, "linestyle": style, "linewidth": 1.8 if k == 0 else 1.0}
        axes.plot(times[inside_span] * faster, values * factor, label=label, **look)
    axes.margins(x=0.0)
    axes.set_ylim(bottom=0.0)
    _rescale(axes, times[inside_span], [values for _, values in drawn], factor, logarithmic)
    columns = min(len(drawn), 4)
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=columns, frameon=False)
    return dress(axes, f"time, {time}", f"{quantity[0]}, {unit}")


def _rescale(
    axes: Axes,
    times: np.ndarray,
    curves: list[np.ndarray],
    factor: float,
    logarithmic: bool | None,
) -> None:
    """Make the axis of values logarithmic if that is wanted, or suits them."""
    peaks = np.concatenate([_peaks(values) for values in curves])
    if len(peaks) == 0 or logarithmic is False:
        return
    weights = np.tile(np.gradient(times) if len(times) > 1 else np.ones(len(times)), len(curves))
    values = np.concatenate(curves)
    order = np.argsort(values)
    order = order[values[order] > 0.0]
    usual = values[order][np.searchsorted(np.cumsum(weights[order]), 0.5 * weights[order].sum())]
    largest = peaks.max()
    squeezed = len(peaks) >= FEWEST_PEAKS and largest > OVER_USUAL_PEAK * np.median(peaks)
    if logarithmic or squeezed or largest > OVER_USUAL_VALUE * usual:
        lowest = np.clip(0.3 * min(peaks.min(), usual), largest * 10.0**-DECADES, 0.03 * largest)
        axes.set_yscale("log")
        axes.set_ylim(factor * lowest, 1.5 * factor * largest)


def _peaks(values: np.ndarray) -> np.ndarray:
    """The largest value of each stretch of positive ones."""
    ends = np.flatnonzero(np.diff(np.pad(values > 0.0, 1).astype(int)))
    return np.array([values[first:last].max() for first, last in ends.reshape(-1, 2)])


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

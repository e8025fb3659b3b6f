"""Forces of impacts over time, and with the penetrations below them."""

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

from ..model.plays.journal_bases import BASES
from ..simulation.observe import ContactObservation, Observation
from . import observed
from .labels import fitting_unit, time_unit
from .style import TimeSpan, axes_or_new, dress, hide_legend, inside, lines, show


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
        f"contact force at {_called(contact[1])}: peak {peaks[0]}": force,
        f"reaction at the {reaction[0]}: peak {peaks[1]}": load,
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
    axes: Axes | None = None,
) -> Axes:
    """Normal forces of all contacts of a joint over time.

    **Arguments:**

    - `observation`: along every accepted step, or at instants that resolve the impacts.
    - `joint`: name of the clearance joint.
    - `window`: instants between which to draw, s; the whole observation unless given.

    **Returns:** the axes; time in ms or s, force in N or kN.

        steps = cj.observe(scene, solution, solution.steps)
        plot.contact_forces(steps, "pin", window=(0.05, 0.06))
    """
    contacts = observed.contacts(observation, joint)
    forces = {_called(name): one.normal_force for name, one in contacts.items()}
    return _over_time(observation.times, forces, ("normal force", "N"), window, axes_or_new(axes))


def joint_forces(
    observation: Observation, *, window: TimeSpan | None = None, axes: Axes | None = None
) -> Axes:
    """Largest normal force among the contacts of each joint, over time, for all joints with play.

    **Arguments:** `observation`, `window`: as of `contact_forces`.

    **Returns:** the axes; time in ms or s, force in N or kN.

    **Raises:** `ValueError` for a scene without contacts.

        plot.joint_forces(cj.observe(scene, solution, solution.steps))
    """
    observed.require_contacts(observation)
    forces = {
        name: np.max([np.asarray(one.normal_force) for one in family.values()], axis=0)
        for name, family in observation.contacts.items()
    }
    return _over_time(observation.times, forces, ("normal force", "N"), window, axes_or_new(axes))


def force_and_penetration(
    observation: Observation,
    joint: str,
    *,
    window: TimeSpan | None = None,
    axes: np.ndarray | None = None,
) -> np.ndarray:
    """Normal forces of all contacts of a joint over time, and their penetrations below.

    **Arguments:** `observation`, `joint`, `window`: as of `contact_forces`; `axes`: two, unless new
    ones are to be made.

    **Returns:** the axes, (2,); time in ms or s, force in N or kN, penetration in µm or so: zero in
    flight.

        plot.force_and_penetration(steps, "pin", window=(0.05, 0.06))
    """
    contacts = observed.contacts(observation, joint)
    if axes is None:
        looks = {"sharex": True, "figsize": (6.4, 5.2), "layout": "constrained"}
        axes = np.asarray(plt.subplots(2, 1, **looks)[1])
    above, below = axes
    contact_forces(observation, joint, window=window, axes=above).set_xlabel("")
    depths = {_called(name): _depth(one) for name, one in contacts.items()}
    _over_time(observation.times, depths, ("penetration", "m"), window, below)
    hide_legend(below)
    return axes


def _called(contact: str) -> str:
    return f"base {contact}" if contact in BASES else contact


def _depth(contact: ContactObservation) -> np.ndarray:
    return np.maximum(np.asarray(contact.penetration), 0.0)


def _over_time(
    times: np.ndarray,
    curves: dict[str, np.ndarray],
    quantity: tuple[str, str],
    window: TimeSpan | None,
    axes: Axes,
) -> Axes:
    """Curves of a quantity, by name and SI unit, that is never negative."""
    faster, time = time_unit(times, window)
    span = None if window is None else (faster * window[0], faster * window[1])
    inside_span = show(axes, times * faster, span)
    drawn = {name: np.asarray(values)[inside_span] for name, values in curves.items()}
    factor, unit = fitting_unit(np.concatenate(list(drawn.values())), quantity[1])
    for k, ((label, values), (colour, style)) in enumerate(
        zip(drawn.items(), lines(), strict=False)
    ):
        look = {"color": colour, "linestyle": style, "linewidth": 1.8 if k == 0 else 1.0}
        axes.plot(times[inside_span] * faster, values * factor, label=label, **look)
    axes.margins(x=0.0)
    axes.set_ylim(bottom=0.0)
    columns = min(len(curves), 4)
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=columns, frameon=False)
    return dress(axes, f"time, {time}", f"{quantity[0]}, {unit}")

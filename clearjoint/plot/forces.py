"""Draw forces of contacts over time and over the penetration, and phases of the motion."""

import enum

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Patch

from .._fields.checks import require, require_count
from .._fields.drawn_text import shown
from .._model.clearance_joints.journal_bases import BASES
from .._simulation.results.impact_table import Impacts
from .._simulation.results.observe import ContactObservation, Observation
from . import observed
from .style import (
    BLUE,
    DARK,
    TimeSpan,
    axes_or_new,
    draw_lines,
    dress,
    fitting_unit,
    inside,
    legend_above,
    time_axis,
    time_unit,
)


def contact_and_reaction(
    observation: Observation,
    contact: tuple[str, str],
    reaction: tuple[str, str],
    *,
    window: TimeSpan | None = None,
    axes: Axes | None = None,
) -> Axes:
    """Draw a contact's normal force and the magnitude of a joint's reaction over time, with peaks.

    **Arguments:** `contact`: name of the clearance joint and label of the contact, such as
    ("shoulder", "V"). `reaction`: name of the ideal joint and of the body on which its force acts.

    >>> axes = plot.contact_and_reaction(observed, ("shoulder", "V"), ("elbow", "arm 3"))
    """
    axes = axes_or_new(axes)
    in_window = inside(observation.times, window)
    force = observed.contact(observation, *contact).normal_force[in_window]
    reactions = observed.named("joint", reaction[0], observation.reactions)
    load = observed.named("body", reaction[1], reactions).force[in_window]
    load = np.linalg.norm(load, axis=1)  # components (n, 3) to magnitudes (n,), N
    largest = np.array([force.max(), load.max()])
    factor, unit = fitting_unit(largest, "N")
    time_factor, time = time_unit(observation.times, window)
    times = observation.times[in_window] * time_factor
    peaks = [f"{peak * factor:.4g} {unit}" for peak in largest]
    curves = {
        f"contact force at {shown(_label(contact[1]))}: peak {peaks[0]}": force,
        f"reaction at the {shown(reaction[0])}: peak {peaks[1]}": load,
    }
    draw_lines(axes, ((name, times, y * factor) for name, y in curves.items()), linewidth=2.0)
    axes.set_ylim(0.0, 1.3 * factor * largest.max())  # with space for the legend above the curves
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
    """Draw the normal forces of all contacts of a joint over time. Contacts with equal forces, such
    as both bases in planar motion, share one curve.

    **Arguments:** `logarithmic`: whether the force axis is logarithmic; zero force is then not
    visible. By default it is logarithmic if the largest force exceeds six times the median of the
    peaks of the intervals of contact, or eight times the median over time of forces in contact.

    >>> axes = plot.contact_forces(observed, "shoulder", window=(0.01, 0.0115))
    """
    contacts = observed.contacts(observation, joint)
    forces = {_label(name): np.asarray(contact.normal_force) for name, contact in contacts.items()}
    return _over_time(observation.times, forces, window, logarithmic, axes)


def joint_forces(
    observation: Observation,
    *,
    window: TimeSpan | None = None,
    logarithmic: bool | None = None,
    axes: Axes | None = None,
) -> Axes:
    """Draw a curve over time for each joint with contacts: the resultant of the normal forces of
    its contacts, as `quantities.ContactForce`. Joints with equal curves share one. `logarithmic`:
    whether the force axis is logarithmic, by default under the conditions of `contact_forces`.

    >>> axes = plot.joint_forces(observed)
    """
    observed.require_contacts(observation)
    forces = {}
    for name, family in observation.contacts.items():
        pairs = ((np.asarray(c.normal), np.asarray(c.normal_force)) for c in family.values())
        # For each contact the normal force as a vector, (n, 3) N; their sum is the resultant.
        vectors = [normal * force[:, None] for normal, force in pairs]
        forces[name] = np.linalg.norm(np.sum(vectors, axis=0), axis=1)
    return _over_time(observation.times, forces, window, logarithmic, axes)


def _label(contact: str) -> str:
    return f"base {contact}" if contact in BASES else contact


def _over_time(
    times: np.ndarray,
    forces: dict[str, np.ndarray],
    window: TimeSpan | None,
    logarithmic: bool | None,
    axes: Axes | None,
) -> Axes:
    axes = axes_or_new(axes)
    mask, drawn_times, time_label = time_axis(axes, times, window)
    # Curves that would look equal become one, with a label that names all of them.
    curves = observed.without_twins({name: values[mask] for name, values in forces.items()})
    values = np.concatenate([force for _, force in curves])
    factor, unit = fitting_unit(values, "N")
    lines = ((label, drawn_times, force * factor) for label, force in curves)
    draw_lines(axes, lines, linewidth=1.0)
    # The first of the new curves is thicker, since the others may cover it.
    axes.get_lines()[-len(curves)].set_linewidth(1.8)
    axes.margins(x=0.0)
    axes.set_ylim(bottom=0.0)
    # The largest force in each interval of contact. Without any, the axis stays linear.
    peaks = np.array([f[i:j].max() for _, f in curves for i, j in observed.spans(f > 0.0)])
    if len(peaks) > 0 and logarithmic is not False:
        # The median over time of the forces in contact. Samples are dense where steps are short:
        # each force counts by the time for which it acts.
        drawn = times[mask]
        durations = np.gradient(drawn) if len(drawn) > 1 else np.ones(len(drawn))
        acting, weights = values > 0.0, np.tile(durations, len(curves))
        usual = np.quantile(values[acting], 0.5, weights=weights[acting], method="inverted_cdf")
        largest = peaks.max()
        # On a linear axis, half of the peaks would be in the lowest sixth of its height, or half of
        # the forces in its lowest eighth.
        has_outlier = largest > 6.0 * np.median(peaks)
        if logarithmic or has_outlier or largest > 8.0 * usual:
            # The axis begins somewhat below the smallest peak and the usual force, but it spans at
            # least one and a half decades, and at most four.
            lowest = np.clip(0.3 * min(peaks.min(), usual), 1e-4 * largest, 0.03 * largest)
            axes.set_yscale("log")
            axes.set_ylim(factor * lowest, 1.5 * factor * largest)
    legend_above(axes, min(len(curves), 4))
    return dress(axes, time_label, f"normal force, {unit}")


def hysteresis(
    observation: Observation, impacts: Impacts, *, count: int = 3, axes: Axes | None = None
) -> Axes:
    """Draw the normal force over the penetration, as a closed loop for each of a contact's first
    impacts. The area of a loop is the energy that the force dissipates, given in the legend.

    **Arguments:** `impacts`: of one contact: ``solution.impacts.of(joint, contact)``. `count`:
    largest number of impacts to draw.

    **Raises:** `ValueError` without impacts, or with under three observed instants in an impact.

    >>> axes = plot.hysteresis(observed, solution.impacts.of("shoulder", "V"), count=1)
    """
    remedy = "take another contact, or a longer run"
    require(len(impacts) > 0, "impacts", len(impacts), "at least one impact", remedy)
    require_count("count", count, "give a number of impacts")
    axes = axes_or_new(axes)
    # Each loop is the penetration (n,), m, and the force (n,), N, of an impact.
    loops = [_loop(observation, impacts, k) for k in range(min(count, len(impacts)))]
    depth_factor, depth_unit = fitting_unit(np.concatenate([depth for depth, _ in loops]), "m")
    force_factor, force_unit = fitting_unit(np.concatenate([force for _, force in loops]), "N")
    curves = []
    for k, (depth, force) in enumerate(loops):
        energy = np.trapezoid(force, depth)
        factor, unit = fitting_unit(energy, "J")
        label = f"impact {k + 1} at {impacts.onset[k] * 1e3:.1f} ms: {energy * factor:.3g} {unit}"
        curves.append((label, depth * depth_factor, force * force_factor))
    draw_lines(axes, curves, linewidth=2.0)
    axes.set_xlim(left=0.0)
    axes.set_ylim(bottom=0.0)
    axes.legend(loc="upper left", frameon=False)
    return dress(axes, f"penetration, {depth_unit}", f"contact force, {force_unit}")


def enclosed_energy(observation: Observation, impacts: Impacts, index: int) -> float:
    """Return the energy, J, that the normal force dissipates in the impact of row `index`: its
    integral over the penetration.

    **Raises:** `ValueError` for fewer than three observed instants in the impact.

    >>> impacts = solution.impacts.of("shoulder", "V")
    >>> plot.enclosed_energy(observed, impacts, 0) > 0.0  # J
    True
    """
    depth, force = _loop(observation, impacts, index)
    return float(np.trapezoid(force, depth))


def _loop(observation: Observation, impacts: Impacts, index: int) -> tuple[np.ndarray, np.ndarray]:
    # Penetration, m, and normal force, N, in an impact, with zeros at both ends, which close the
    # loop.
    contact = observed.contact(observation, impacts.joint[index], impacts.contact[index])
    times, onset, separation = observation.times, impacts.onset[index], impacts.separation[index]
    in_impact = (times >= onset) & (times <= separation)
    remedy = "observe every step: cj.observe(scene, solution, solution.steps)"
    samples = int(in_impact.sum())
    require(samples >= 3, "observation", samples, "of three or more instants in the impact", remedy)
    depth = np.maximum(contact.penetration[in_impact], 0.0)
    return np.pad(depth, 1), np.pad(contact.normal_force[in_impact], 1)


class ContactPhase(enum.IntEnum):
    """Phase of the motion in a joint with clearance: free flight, a short impact, or following, in
    which the journal stays at the bearing's wall. A joint whose contacts are in different phases
    is in the phase with the largest number.

    >>> max(plot.ContactPhase.FREE_FLIGHT, plot.ContactPhase.FOLLOWING).name
    'FOLLOWING'
    """

    FREE_FLIGHT = 0
    IMPACT = 1
    FOLLOWING = 2


FOLLOWING_STYLE = {"facecolor": "#9CCBE8", "edgecolor": BLUE, "linewidth": 0.4, "hatch": "////"}
BAR_STYLES = {
    ContactPhase.FREE_FLIGHT: (0.12, {"facecolor": "0.8", "edgecolor": "0.8"}),
    ContactPhase.IMPACT: (0.80, {"facecolor": DARK, "edgecolor": DARK, "linewidth": 0.8}),
    ContactPhase.FOLLOWING: (0.45, FOLLOWING_STYLE),
}
"""Height of a phase's bar as a fraction of a joint's row, and the bar's matplotlib style."""


def contact_phases(observation: Observation, joint: str) -> np.ndarray:
    """Return a joint's phase of motion at the N observed instants, (N,) numbers of `ContactPhase`.

    An interval of contact with a single compression and restitution is an impact. If the bodies
    approach again before they separate, or if the interval lasts to the end of the observation, it
    is an impact up to the first maximum of the penetration, and following from there on. An
    interval that begins at the first instant is following as a whole.

    **Source:** P. Flores et al., *Spatial revolute joints with clearances for dynamic analysis of
    multi-body systems*, 2006, except for the limit between impact and following.

    >>> phases = plot.contact_phases(observed, "shoulder")
    >>> plot.ContactPhase(phases[0]).name  # the journal starts in the middle
    'FREE_FLIGHT'
    """
    contacts = observed.contacts(observation, joint)
    return np.max([_phases(contact) for contact in contacts.values()], axis=0)


def _phases(contact: ContactObservation) -> np.ndarray:
    touching = np.asarray(contact.penetration) > 0.0
    approaching = np.asarray(contact.penetration_rate) > 0.0
    phases = np.where(touching, ContactPhase.IMPACT, ContactPhase.FREE_FLIGHT)
    for begin, end in observed.spans(touching):
        # At the first maximum, the surfaces cease to approach. If they approach throughout, it is
        # the appended instant after the last one.
        deepest = begin + int(np.argmin(np.append(approaching[begin:end], False)))
        if begin == 0:  # the onset is not observed, so this may be the end of a lasting contact
            phases[begin:end] = ContactPhase.FOLLOWING
        # The contact lasts beyond the observation, or the surfaces approach again.
        elif end == len(touching) or approaching[deepest:end].any():
            phases[deepest:end] = ContactPhase.FOLLOWING
    return phases


def motion_timeline(
    observation: Observation,
    joints: tuple[str, ...] | None = None,
    *,
    window: TimeSpan | None = None,
    axes: Axes | None = None,
) -> Axes:
    """Draw bars over time for the phases of each joint: free flight, impact or following the wall
    (see `contact_phases`). Numbers on the right are the percentages of the drawn time in them.

    **Arguments:** `joints`: names of joints, from top to bottom; by default all with contacts.

    >>> axes = plot.motion_timeline(observed)
    """
    observed.require_contacts(observation)
    names = tuple(observation.contacts) if joints is None else joints
    # Inches: 0.45 for each row, and 1.3 for the legend above and the time axis below.
    axes = axes_or_new(axes, (6.4, 1.3 + 0.45 * len(names)))
    times = np.asarray(observation.times)
    first, last = (times[0], times[-1]) if window is None else window
    factor, unit = time_unit(times, window)
    for row, name in enumerate(names):
        phases, durations = contact_phases(observation, name), []
        for phase, (height, look) in BAR_STYLES.items():
            # An interval lasts until the first instant of the next phase. Its start and its end are
            # moved into the window, s; intervals outside of the window then have no length.
            begins, ends = observed.spans(phases == phase).T
            starts = np.clip(times[begins], first, last)
            lengths = np.clip(times[np.minimum(ends, len(times) - 1)], first, last) - starts
            bars = (factor * np.stack([starts, lengths], axis=1)[lengths > 0.0]).tolist()
            axes.broken_barh(bars, (row - 0.5 * height, height), label=_phase_name(phase), **look)
            durations.append(lengths.sum())
        total = max(sum(durations), np.finfo(float).tiny)  # zero if no interval is in the window
        text = " / ".join(f"{100.0 * part / total:.0f}" for part in durations) + " %"
        # To the right of the axes: x is a fraction of their width, y is the row.
        text_style = {"transform": axes.get_yaxis_transform(), "va": "center", "fontsize": "small"}
        axes.text(1.01, row, text, **text_style)
    text_style = {"transform": axes.transAxes, "va": "bottom", "fontsize": "small"}
    axes.text(1.01, 1.02, "shares of the time", **text_style)
    axes.set_yticks(range(len(names)), [shown(name) for name in names])
    axes.set_xlim(first * factor, last * factor)
    axes.set_ylim(len(names) - 0.5, -0.5)  # the first joint at the top
    samples = [Patch(label=_phase_name(phase), **look) for phase, (_, look) in BAR_STYLES.items()]
    legend_above(axes, 3, handles=samples)
    dress(axes, f"time, {unit}", "")
    axes.grid(False, axis="y")
    return axes


def _phase_name(phase: ContactPhase) -> str:
    return phase.name.replace("_", " ").lower()

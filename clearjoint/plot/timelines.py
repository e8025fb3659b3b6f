"""Tell when a clearance joint is in free flight, in impact, or follows the wall, and draw it."""

import enum

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Patch

from ..fields.drawn_text import shown
from ..simulation.results.observe import ContactObservation, Observation
from . import observed
from .labels import time_unit
from .style import BLUE, DARK, TimeSpan, axes_or_new, dress, legend_above


class ContactPhase(enum.IntEnum):
    """Phase of a joint with clearance: free flight, a short impact, or following, in which the
    journal stays at the wall. If contacts of the joint differ, the phase with the largest number
    counts.

    >>> plot.ContactPhase(1).name
    'IMPACT'
    >>> max(plot.ContactPhase.FREE_FLIGHT, plot.ContactPhase.FOLLOWING).name
    'FOLLOWING'
    """

    FREE_FLIGHT = 0
    IMPACT = 1
    FOLLOWING = 2


BAR_STYLES = {
    ContactPhase.FREE_FLIGHT: (0.12, {"facecolor": "0.8", "edgecolor": "0.8"}),
    ContactPhase.IMPACT: (0.80, {"facecolor": DARK, "edgecolor": DARK, "linewidth": 0.8}),
    ContactPhase.FOLLOWING: (
        0.45,
        {"facecolor": "#9CCBE8", "edgecolor": BLUE, "linewidth": 0.4, "hatch": "////"},
    ),
}
"""Height of a phase's bar as a fraction of a joint's row, and the bar's matplotlib style: phases
differ by height, grey value and hatching."""


def contact_phases(observation: Observation, joint: str) -> np.ndarray:
    """Return the phase of a joint at each instant, (N,) `ContactPhase` numbers.

    A contact with a single compression and restitution is an impact. If the bodies approach again
    before they separate, or if the contact lasts to the end of the observation, the phase is impact
    up to the first maximum of the penetration, and following from there on. A contact at the first
    instant is following. If contacts of the joint differ, following has priority over impact, and
    impact over free flight.

    **Arguments:**

    - `observation`: from `cj.observe`, at every accepted step or at instants that resolve the
      impacts.
    - `joint`: name of a joint with contacts.

    **Raises:** `ValueError` for the name of a joint without contacts.

    **Source:** P. Flores and others 2006, except the limit between impact and following.

    >>> phases = plot.contact_phases(observed, "shoulder")
    >>> plot.ContactPhase(phases[0]).name  # the journal starts in the middle
    'FREE_FLIGHT'
    >>> share = np.mean(phases == plot.ContactPhase.FOLLOWING)
    """
    contacts = observed.contacts(observation, joint)
    return np.max([_phases(contact) for contact in contacts.values()], axis=0)


def _phases(contact: ContactObservation) -> np.ndarray:
    """Return the phases (N,) of a single contact, by the rules of `contact_phases`."""
    touching = np.asarray(contact.penetration) > 0.0
    approaching = np.asarray(contact.penetration_rate) > 0.0
    phases = np.where(touching, ContactPhase.IMPACT, ContactPhase.FREE_FLIGHT)
    for begin, end in observed.spans(touching):
        deepest = begin + int(np.argmin(np.append(approaching[begin:end], False)))
        if begin == 0:
            phases[begin:end] = ContactPhase.FOLLOWING
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
    """Draw when each clearance joint is in free flight, in impact, or following the wall.

    `plot.contact_phases` defines the three phases. The numbers on the right of each row are the
    percentages of the drawn time in free flight, in impact and in following, in this order.

    **Arguments:**

    - `observation`: from `cj.observe`, at every accepted step or at instants that resolve the
      impacts.
    - `joints`: names of joints, from top to bottom; by default all with contacts.

    **Returns:** the axes; time in ms or s, a row for each joint.

    **Raises:** `ValueError` for a scene without contacts.

    >>> axes = plot.motion_timeline(observed)
    """
    observed.require_contacts(observation)
    names = tuple(observation.contacts) if joints is None else joints
    axes = axes_or_new(axes, (6.4, 1.3 + 0.45 * len(names)))
    times = np.asarray(observation.times)
    first, last = (times[0], times[-1]) if window is None else window
    factor, unit = time_unit(times, window)
    for row, name in enumerate(names):
        phases = contact_phases(observation, name)
        starts, lengths, kinds = _intervals(times, phases, (first, last))
        for phase, (height, look) in BAR_STYLES.items():
            of_phase = kinds == phase
            bars = [*zip(factor * starts[of_phase], factor * lengths[of_phase], strict=True)]
            axes.broken_barh(bars, (row - 0.5 * height, height), label=_label(phase), **look)
        total = max(lengths.sum(), np.finfo(float).tiny)
        shares = [100.0 * lengths[kinds == phase].sum() / total for phase in BAR_STYLES]
        text = " / ".join(f"{share:.0f}" for share in shares) + " %"
        look = {"transform": axes.get_yaxis_transform(), "va": "center", "fontsize": "small"}
        axes.text(1.01, row, text, **look)
    look = {"transform": axes.transAxes, "va": "bottom", "fontsize": "small"}
    axes.text(1.01, 1.02, "shares of the time", **look)
    axes.set_yticks(range(len(names)), [shown(name) for name in names])
    axes.set_xlim(first * factor, last * factor)
    axes.set_ylim(len(names) - 0.5, -0.5)
    samples = [Patch(label=_label(phase), **look) for phase, (_, look) in BAR_STYLES.items()]
    legend_above(axes, 3, handles=samples)
    dress(axes, f"time, {unit}", "")
    axes.grid(False, axis="y")
    return axes


def _label(phase: ContactPhase) -> str:
    return phase.name.replace("_", " ").lower()


def _intervals(
    times: np.ndarray, phases: np.ndarray, window: TimeSpan
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the starts and lengths, s, and the phases of the M successive intervals of constant
    phase in a window, (M,) each, from the phases (N,) at times (N,), s."""
    changes = np.flatnonzero(np.diff(phases)) + 1
    rows = np.concatenate([[0], changes])
    starts = np.clip(times[rows], *window)
    ends = np.clip(np.append(times[changes], times[-1]), *window)
    in_window = ends > starts
    return starts[in_window], (ends - starts)[in_window], phases[rows][in_window]

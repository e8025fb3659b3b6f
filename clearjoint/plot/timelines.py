"""Motion modes over time: free flight, impact, and following of the wall."""

import enum

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Patch

from ..fields.drawn_text import shown
from ..simulation.results.observe import ContactObservation, Observation
from . import observed
from .labels import time_unit
from .style import BLUE, DARK, TimeSpan, axes_or_new, dress


class ContactPhase(enum.IntEnum):
    """What a joint with play does, in the order of what decides where its contacts differ.

    >>> plot.ContactPhase(1).name
    'IMPACT'
    >>> max(plot.ContactPhase.FREE_FLIGHT, plot.ContactPhase.FOLLOWING).name  # what decides
    'FOLLOWING'
    """

    FREE_FLIGHT = 0
    IMPACT = 1
    FOLLOWING = 2


LOOKS = {
    ContactPhase.FREE_FLIGHT: (0.12, {"facecolor": "0.8", "edgecolor": "0.8"}),
    ContactPhase.IMPACT: (0.80, {"facecolor": DARK, "edgecolor": DARK, "linewidth": 0.8}),
    ContactPhase.FOLLOWING: (
        0.45,
        {"facecolor": "#9CCBE8", "edgecolor": BLUE, "linewidth": 0.4, "hatch": "////"},
    ),
}
"""Height in the row of a joint, and look: apart by height, grey value and hatching."""


def contact_phases(observation: Observation, joint: str) -> np.ndarray:
    """What a joint does at each instant, (N,) `ContactPhase` numbers.

    A contact in which the bodies are pressed together once, and separate, is an impact. One in
    which they approach anew before they separate, or that lasts to the end of what is observed, is
    in impact until it is deepest for the first time, and is followed from there on; one that is
    there at the first instant is followed. Where contacts of the joint differ, one that is followed
    decides, then one in impact.

    **Arguments:** `observation`: along every accepted step, or at instants that resolve the
    impacts; `joint`: the name of one with contacts.

    **Source:** the modes of P. Flores and others 2006; the limit between impact and following is
    ours.

    >>> scene, state = cj.mechanisms.double_pendulum()
    >>> save = cj.Saving(np.linspace(0, 0.02, 2001), impacts=True)
    >>> solution = cj.simulate(scene, state, 0.02, save=save, progress=False)
    >>> observed = cj.observe(scene, solution)
    >>> phases = plot.contact_phases(observed, "shoulder")
    >>> plot.ContactPhase(phases[0]).name  # the journal begins amid its bearing
    'FREE_FLIGHT'
    >>> share = np.mean(phases == plot.ContactPhase.FOLLOWING)
    """
    contacts = observed.contacts(observation, joint)
    return np.max([_phases(one) for one in contacts.values()], axis=0)


def _phases(contact: ContactObservation) -> np.ndarray:
    touching = np.asarray(contact.penetration) > 0.0
    approaching = np.asarray(contact.penetration_rate) > 0.0
    phases = np.where(touching, ContactPhase.IMPACT, ContactPhase.FREE_FLIGHT)
    edges = np.flatnonzero(np.diff(np.pad(touching, 1).astype(int)))
    for begin, end in edges.reshape(-1, 2):
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
    """When each joint with play is in free flight, in impact, and follows the wall.

    See `plot.contact_phases`. At the right stands what share of the time each takes.

    **Arguments:**

    - `observation`: along every accepted step, or at instants that resolve the impacts.
    - `joints`: names of those to draw, from above; all that have contacts unless given.
    - `window`: instants between which to draw, s; the whole observation unless given.

    **Returns:** the axes; time in ms or s, a row for each joint.

    **Raises:** `ValueError` for a scene without contacts.

    >>> scene, state = cj.mechanisms.double_pendulum()
    >>> save = cj.Saving(np.linspace(0, 0.02, 2001), impacts=True)
    >>> solution = cj.simulate(scene, state, 0.02, save=save, progress=False)
    >>> observed = cj.observe(scene, solution)
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
        starts, lengths, kinds = _stretches(times, phases, (first, last))
        for phase, (height, look) in LOOKS.items():
            here = kinds == phase
            spans = np.stack([starts[here], lengths[here]], axis=1) * factor
            bars = [(float(begin), float(length)) for begin, length in spans]
            axes.broken_barh(bars, (row - 0.5 * height, height), label=_called(phase), **look)
        total = max(lengths.sum(), np.finfo(float).tiny)
        shares = [100.0 * lengths[kinds == phase].sum() / total for phase in LOOKS]
        text = " / ".join(f"{share:.0f}" for share in shares) + " %"
        look = {"transform": axes.get_yaxis_transform(), "va": "center", "fontsize": "small"}
        axes.text(1.01, row, text, **look)
    look = {"transform": axes.transAxes, "va": "bottom", "fontsize": "small"}
    axes.text(1.01, 1.02, "shares of the time", **look)
    axes.set_yticks(range(len(names)), [shown(name) for name in names])
    axes.set_xlim(first * factor, last * factor)
    axes.set_ylim(len(names) - 0.5, -0.5)
    samples = [Patch(label=_called(phase), **look) for phase, (_, look) in LOOKS.items()]
    where = {"loc": "lower center", "bbox_to_anchor": (0.5, 1.0)}
    axes.legend(handles=samples, ncols=3, frameon=False, **where)
    dress(axes, f"time, {unit}", "")
    axes.grid(False, axis="y")
    return axes


def _called(phase: ContactPhase) -> str:
    return phase.name.replace("_", " ").lower()


def _stretches(
    times: np.ndarray, phases: np.ndarray, window: TimeSpan
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Begin and length, s, and phase of each stretch of one phase within a window."""
    changes = np.flatnonzero(np.diff(phases)) + 1
    rows = np.concatenate([[0], changes])
    begins = np.clip(times[rows], *window)
    ends = np.clip(np.append(times[changes], times[-1]), *window)
    there = ends > begins
    return begins[there], (ends - begins)[there], phases[rows][there]

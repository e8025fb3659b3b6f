"""Draw the eccentricities of a journal's bases over time and in the bearing's cross-section."""

from collections.abc import Mapping

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from .._fields.checks import require, require_positive
from .._fields.drawn_text import shown
from .._fields.types import ArrayLike
from .._model.clearance_joints.journal_bases import BASES
from .._simulation.results.observe import Observation
from . import style
from .observed import contact, contacts, without_twins
from .sweeps import require_names

CrossSection = Mapping[str, ArrayLike]
"""Two perpendicular unit vectors by their labels, such as {"X": …, "Y": …}: the directions that a
figure draws to the right and upwards. Each is (3,) in global axes, or (N, 3) for each observed
time, for a bearing that turns."""
XY: CrossSection = {"X": (1.0, 0.0, 0.0), "Y": (0.0, 1.0, 0.0)}
"""The cross-section of a bearing at rest whose axis is the global z axis.

>>> plot.XY["X"]
(1.0, 0.0, 0.0)
"""


def eccentricities(
    observation: Observation,
    joint: str,
    clearance: float | None = None,
    *,
    window: style.TimeSpan | None = None,
    axes: Axes | None = None,
) -> Axes:
    """Draw the eccentricities of both bases over time, and the `clearance`, m, by default the
    observed one, as a horizontal line, above which a base touches the wall. Bases with the same
    eccentricity, as in planar motion, share one curve. If the eccentricity never differs from the
    clearance by more than 5 %, their difference is drawn instead, so that its changes are visible.

    >>> axes = plot.eccentricities(observed, "shoulder", 0.5e-3)
    """
    axes = style.axes_or_new(axes)
    radius = observed_clearance(observation, joint) if clearance is None else clearance
    factor, unit = length_unit(radius)
    in_window = style.inside(observation.times, window)
    bases = {f"base {base}": contact(observation, joint, base) for base in BASES}
    sizes = without_twins({n: np.asarray(c.eccentricity)[in_window] for n, c in bases.items()})
    differences = np.concatenate([size for _, size in sizes]) - radius
    # `zero` is the eccentricity, m, that the vertical axis shows as zero.
    zero, quantity = 0.0, "eccentricity"
    if bool((np.abs(differences) <= 0.05 * radius).all()):  # the journal stays at the wall
        zero, quantity = radius, "eccentricity − clearance"
        factor, unit = style.fitting_unit(differences, "m")
    time_factor, time = style.time_unit(observation.times[in_window])
    times = observation.times[in_window] * time_factor
    style.draw_lines(axes, ((label, times, (size - zero) * factor) for label, size in sizes))
    level = (radius - zero) * factor
    # The clearance's line lies behind the curves, whose `zorder` is 2.
    axes.axhline(level, color="black", linewidth=1.0, label="clearance", zorder=1.5)
    axes.set_xlim(times[0], times[-1])
    if zero == 0.0:
        axes.set_ylim(bottom=0.0)
    style.legend_above(axes, 3)
    return style.dress(axes, f"time, {time}", f"{quantity}, {unit}")


def eccentricity_vectors(
    observation: Observation, joint: str, base: str, section: CrossSection | None = None
) -> np.ndarray:
    """Return the vector from the bearing's axis to a base's centre, (N, 2) m, at N observed times.

    **Arguments:** `section`: two perpendicular unit vectors across the bearing's axis, by their
    labels, such as {"X": (1, 0, 0), "Y": (0, 1, 0)}: (3,) each in global axes, or (N, 3) if the
    bearing turns; by default the axes x and y of the bearing's frame. With a `section` and a
    profile of bearing or journal, the vector is the eccentricity in the direction of the contact.

    >>> plot.eccentricity_vectors(observed, "shoulder", "V").shape[1]
    2
    """
    observed = contact(observation, joint, base)
    remedy = f'pass "{BASES[0]}" or "{BASES[1]}" of a joint with a journal'
    require(observed.eccentricity is not None, "base", base, "a base of a journal", remedy)
    if section is None:
        return np.asarray(observed.offset)[:, :2]  # the third component is along the axis
    # The normal is the direction from the bearing's axis to the contact, and thus, if both surfaces
    # are circles, to the centre.
    vectors = observed.normal * np.asarray(observed.eccentricity)[:, None]
    directions = [np.asarray(direction, float) for direction in section.values()]
    products = [np.sum(a * b, axis=-1) for a in directions for b in directions]
    suits = len(directions) == 2 and np.allclose(np.array(products).T, [1, 0, 0, 1], atol=1e-6)
    expected, remedy = "two perpendicular unit vectors by their labels", "pass plot.XY, for example"
    require(suits, "section", dict(section), expected, remedy)
    return np.stack([np.sum(vectors * direction, axis=1) for direction in directions], axis=1)


def journal_orbit(
    observation: Observation,
    joint: str,
    clearance: float | None = None,
    *,
    section: CrossSection | None = None,
    window: style.TimeSpan | None = None,
    axes: Axes | None = None,
) -> Axes:
    """Draw the paths of the centres of both bases in the bearing's cross-section, with a circle
    whose radius is the `clearance`, m, by default the observed one: a base whose centre is outside
    the circle touches the wall. Bases with the same path share one curve. `section`: directions as
    in `eccentricity_vectors`.

    >>> axes = plot.journal_orbit(observed, "shoulder", 0.5e-3)
    """
    axes = style.axes_or_new(axes, (4.8, 5.0))
    radius = observed_clearance(observation, joint) if clearance is None else clearance
    factor, _ = length_unit(radius)
    in_window = style.inside(observation.times, window)
    vectors = {b: eccentricity_vectors(observation, joint, b, section) for b in BASES}
    paths = {f"base {base}": rows[in_window] for base, rows in vectors.items()}
    curves = [(label, *(path * factor).T) for label, path in without_twins(paths)]
    style.draw_lines(axes, curves)
    # `axes` may have earlier lines: the new ones are the last. W is thinner, as it may lie on V.
    for line, width in zip(axes.get_lines()[-len(curves) :], (1.6, 0.9), strict=False):
        line.set_linewidth(width)
    return _dress_orbit(axes, radius, section)


def orbit_in_contact(
    observation: Observation,
    joint: str,
    base: str,
    clearance: float | None = None,
    *,
    section: CrossSection | None = None,
    window: style.TimeSpan | None = None,
    axes: Axes | None = None,
) -> Axes:
    """Draw the path of the centre of one base in the bearing's cross-section, dark and thick where
    the base touches the wall, with a circle whose radius is the `clearance`, m, by default the
    observed one. `section`: directions as in `eccentricity_vectors`.

    >>> axes = plot.orbit_in_contact(observed, "shoulder", "V", 0.5e-3)
    """
    axes = style.axes_or_new(axes, (4.8, 5.0))
    in_window = style.inside(observation.times, window)
    orbit = eccentricity_vectors(observation, joint, base, section)[in_window]
    radius = observed_clearance(observation, joint) if clearance is None else clearance
    orbit = orbit * length_unit(radius)[0]
    touching = contact(observation, joint, base).penetration[in_window] > 0.0
    in_contact = np.where(touching[:, None], orbit, np.nan)  # the line has gaps in flight
    axes.plot(*orbit.T, color=style.BLUE, linewidth=0.8, label="in flight")
    axes.plot(*in_contact.T, color=style.DARK, linewidth=1.8, label="in contact")
    return _dress_orbit(axes, radius, section)


def clearance_circle(axes: Axes, clearance: float, *, factor: float = 1e3) -> Axes:
    """Draw a circle around the origin whose radius is the clearance, and give both axes the same
    scale. `factor`: from m to the unit of the axes, by default that to mm.

    >>> _, axes = plt.subplots()
    >>> axes = plot.clearance_circle(axes, 0.5e-3)
    """
    require_positive("clearance", clearance, "give it in m")
    angle = np.linspace(0.0, 2.0 * np.pi, 361)
    circle = clearance * factor * np.stack([np.cos(angle), np.sin(angle)])
    axes.plot(*circle, color="black", linewidth=1.0, label="clearance")
    axes.set_aspect("equal")
    return axes


def length_unit(clearance: float) -> tuple[float, str]:
    """Return the factor from m to the unit for lengths like a clearance, m, and the unit's text."""
    require_positive("clearance", clearance, "give it in m")
    return (1e3, "mm") if clearance >= 0.2e-3 else (1e6, "µm")


def observed_clearance(observation: Observation, joint: str) -> float:
    """Return the radial clearance of a joint, m: the median of the eccentricity of a base less its
    penetration, which varies only if the bearing or the journal has a profile."""
    bases = [c for c in contacts(observation, joint).values() if c.eccentricity is not None]
    # For the error: the names of the joints with a journal.
    families = observation.contacts.items()
    journals = [n for n, f in families if any(c.eccentricity is not None for c in f.values())]
    require(len(bases) > 0, "joint", joint, f"one with a journal, of {journals}", "name one")
    return float(np.median(np.asarray(bases[0].eccentricity) - bases[0].penetration))


def _dress_orbit(axes: Axes, clearance: float, section: CrossSection | None) -> Axes:
    factor, unit = length_unit(clearance)
    clearance_circle(axes, clearance, factor=factor)
    style.legend_above(axes, 3)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(4, steps=[1, 2, 5, 10]))
    right, up = map(shown, ("the bearing's x", "the bearing's y") if section is None else section)
    return style.dress(
        axes, f"eccentricity along {right}, {unit}", f"eccentricity along {up}, {unit}"
    )


def orbit(
    lane: xr.Dataset,
    outputs: tuple[str, str],
    clearance: float,
    *,
    window: style.TimeSpan | None = None,
    axes: Axes | None = None,
) -> Axes:
    """Draw the path of a journal or of a base in the bearing's cross-section, for one lane of a
    sweep, with a circle whose radius is the clearance. A dot marks the start.

    **Arguments:** `outputs`: names of the outputs that are drawn to the right and upwards,
    quantities in m, such as `quantities.JournalOffset`.

    >>> offsets = {a: cj.quantities.JournalOffset("shoulder", a) for a in ("x", "y")}
    >>> save = cj.Saving(np.linspace(0.0, 0.02, 201), states=False)
    >>> axes = {"clearance": cj.Axis(lambda scene: scene.joints["shoulder"].clearance, [0.5e-3])}
    >>> found = cj.sweep(pendulum, hanging, 0.02, axes, offsets, save=save, progress=False)
    >>> drawn = plot.orbit(found.isel(clearance=0), ("x", "y"), 0.5e-3)
    """
    require_names(lane, (*outputs, "saved_time"))
    for name in outputs:
        dims, remedy = lane[name].dims, "select a lane, dataset.isel(...), and outputs over time"
        is_row = len(dims) == 1 and dims == lane["saved_time"].dims
        require(is_row, "lane", dims, f"a single lane, with {name!r} over time", remedy)
    axes = style.axes_or_new(axes, (4.8, 5.0))
    in_window = style.inside(lane["saved_time"].values, window)
    factor, unit = length_unit(clearance)
    x, y = (lane[name].values[in_window] * factor for name in outputs)
    axes.plot(x, y, color=style.BLUE, linewidth=0.8)
    axes.plot(x[:1], y[:1], "o", color="black", markersize=4)  # the start
    clearance_circle(axes, clearance, factor=factor)
    return style.dress(axes, *(f"{shown(name)}, {unit}" for name in outputs))

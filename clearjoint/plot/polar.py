"""Draw polar bars and curves around a bearing: directions of contact, and wear."""

from collections.abc import Sequence
from itertools import count, takewhile
from typing import Literal

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.projections.polar import PolarAxes
from matplotlib.ticker import MaxNLocator
from scipy.stats import binned_statistic

from .._fields.checks import require, require_count
from .._fields.drawn_text import shown
from .._model.clearance_joints.journal_bases import BASES
from .._simulation.results.observe import Observation
from .journal import CrossSection, eccentricity_vectors, observed_clearance
from .observed import contact, without_twins
from .style import BLUE, DARK, LIGHT, VERMILLION, fitting_unit, legend_above, polar_or_new
from .sweeps import require_names

BAR_STYLES = (
    {"facecolor": LIGHT, "edgecolor": BLUE, "linewidth": 0.6},
    {"facecolor": "none", "edgecolor": VERMILLION, "linewidth": 0.6, "hatch": "////"},
)
"""Styles of base V and base W."""


def contact_rose(
    observation: Observation,
    joint: str,
    *,
    weight: Literal["impulse", "force"] = "impulse",
    sectors: int = 36,
    section: CrossSection | None = None,
    axes: Axes | None = None,
) -> PolarAxes:
    """Draw in which directions, and how strongly, a journal touches its bearing, as polar bars.

    The length of a bar is the impulse or the largest force of the contacts whose direction, see
    `eccentricity_vectors`, is in its sector. Contacts between the bases and at shoulders are left
    out.

    **Arguments:**

    - `weight`: "impulse", the time integral of the normal force in each sector, with base W stacked
      on base V; or "force", the largest normal force of each base. If both bases have equal values
      in all sectors, they share bars, which show the sum of the impulses, or the force of one base.
    - `sectors`: number of sectors; the first one begins at 0°, the direction drawn to the right.
    - `section`: directions drawn to the right and upwards, as in `eccentricity_vectors`.

    >>> axes = plot.contact_rose(observed, "shoulder", weight="force")
    """
    observed_clearance(observation, joint)  # checks that the joint has a journal
    is_valid, remedy = weight in ("impulse", "force"), "name one of them"
    require(is_valid, "weight", weight, "'impulse' or 'force'", remedy)
    require_count("sectors", sectors, "give a number of sectors")
    # Trapezoidal rule: each instant has half of the interval before it and after it.
    halves = 0.5 * np.diff(observation.times)
    durations = np.append(halves, 0.0) + np.append(0.0, halves)
    weights = {}  # impulses, N s, or forces, N, in each sector
    for base in BASES:
        x, y = eccentricity_vectors(observation, joint, base, section).T
        turns = np.arctan2(y, x) / (2.0 * np.pi) % 1.0  # the direction's angle in turns, 0 to 1
        values = np.asarray(contact(observation, joint, base).normal_force)
        kind = "max"
        if weight == "impulse":
            kind, values = "sum", values * durations
        binned = binned_statistic(turns, values, kind, sectors, range=(0.0, 1.0)).statistic
        weights[f"base {base}"] = np.nan_to_num(binned)  # a sector without contact has no maximum
    axes = polar_or_new(axes)
    directions = ("x", "y") if section is None else [shown(name) for name in section]
    distinct = dict(without_twins(weights))
    if weight == "force":
        return _bars(distinct, ("largest normal force", "N"), False, axes, directions)  # unstacked
    # Two bases with equal impulses share one bar, whose length is twice that impulse.
    shared = len(weights) / len(distinct)
    summed = {label: shared * sizes for label, sizes in distinct.items()}
    return _bars(summed, ("impulse", "N s"), True, axes, directions)  # stacked


def wear(lane: xr.Dataset, output: str, *, axes: Axes | None = None) -> PolarAxes:
    """Draw the volumes that one lane of a sweep wears off a bearing's wall, as polar bars over the
    angle from the x axis of the bearing's frame. Bars of base W are stacked on those of base V.

    **Arguments:** `output`: name of an output of the sweep that is a `clearjoint.ArchardWear`.

    >>> clearance = cj.Axis(lambda scene: scene.joints["shoulder"].clearance, [1e-4, 2e-4])
    >>> outputs = {"wear": cj.ArchardWear("shoulder", coefficient=1e-4, hardness=2e9, sectors=8)}
    >>> axes = {"clearance": clearance}
    >>> found = cj.sweep(pendulum, hanging, 0.02, axes, outputs, progress=False)
    >>> drawn = plot.wear(found.isel(clearance=1), "wear")
    """
    require_names(lane, tuple(f"{output}_{base} 1" for base in BASES))
    volumes = {}
    for base in BASES:
        # Each sector has a variable: "wear_V 1", "wear_V 2" and so on, until a name is missing.
        names = takewhile(lane.__contains__, (f"{output}_{base} {k}" for k in count(1)))
        sectors = [lane[name] for name in names]
        is_single = all(volume.ndim == 0 for volume in sectors)
        remedy = "select one: dataset.isel(...)"
        require(is_single, "lane", sectors[0].dims, "a single lane", remedy)
        volumes[f"base {base}"] = np.array([float(volume) for volume in sectors])
    return _bars(volumes, ("worn volume", "m^3"), True, polar_or_new(axes))


def worn_profile(
    found: xr.Dataset,
    joint: str,
    part: Literal["bearing", "journal"] = "bearing",
    *,
    curves: int = 6,
    axes: Axes | None = None,
) -> PolarAxes:
    """Draw the worn depth of a bearing or a journal over the angle from the x axis of its frame, as
    a curve for each of several numbers of cycles of the motion.

    **Arguments:** `found`: result of `clearjoint.wear`. `part`: "bearing", for its wall, or
    "journal". `curves`: number n of curves, at 1/n, 2/n and so on of all cycles; the last is black.

    >>> import xarray as xr
    >>> depths = {"bearing_depth": (("joint", "stage", "angle"), np.full((1, 2, 8), 1e-6))}
    >>> places = {"cycles": ("stage", [0, 10]), "joint": ["pin"], "angle": np.arange(8) * np.pi / 4}
    >>> axes = plot.worn_profile(xr.Dataset(depths, places), "pin")
    """
    require_names(found, (f"{part}_depth", "cycles"))
    joints = [str(name) for name in found["joint"].values]
    require(joint in joints, "joint", joint, f"one of {joints}", "name a joint that wears")
    require_count("curves", curves, "give a number of curves")
    axes = polar_or_new(axes)
    depths = found[f"{part}_depth"].sel(joint=joint).transpose("stage", "angle").values
    cycles, angles = found["cycles"].values, found["angle"].values
    factor, unit = _fitting(depths, "m")
    closed = np.append(angles, angles[0] + 2.0 * np.pi)  # each curve ends where it begins
    wanted = np.linspace(0.0, cycles[-1], curves + 1)[1:]  # without zero cycles
    for k, number in enumerate(wanted):
        # The computation of wear advances in stages of many cycles each. `depths` (stage, angle) is
        # known at the numbers of cycles in `cycles` (stage,), and interpolated between them.
        curve = [np.interp(number, cycles, depth) for depth in depths.T]
        shade = str(0.75 * (1.0 - (k + 1) / curves))  # grey value, from light to 0, black
        label = f"{number:.3g} cycles"
        axes.plot(closed, factor * np.append(curve, curve[0]), color=shade, label=label)
    axes.set_ylim(bottom=0.0)
    return _dressed(axes, angles, depths[-1], f"worn depth, {unit}")


def _bars(
    weights: dict[str, np.ndarray],
    quantity: tuple[str, str],
    stacked: bool,
    axes: PolarAxes,
    directions: Sequence[str] = ("x", "y"),
) -> PolarAxes:
    # `weights`: lengths of bars in each sector, by their label, such as "base V"; `quantity`: their
    # name and SI unit; `directions`: names of the directions 0° and 90°. `tops`: the radii at which
    # the outermost bar of each sector ends.
    tops = (np.sum if stacked else np.max)([*weights.values()], axis=0)
    sectors = len(tops)
    middles = 2.0 * np.pi * (np.arange(sectors) + 0.5) / sectors
    factor, unit = _fitting(tops, quantity[1])
    bottom = np.zeros(sectors)
    for (label, sizes), look in zip(weights.items(), BAR_STYLES, strict=False):
        heights = sizes * factor
        axes.bar(middles, heights, 2.0 * np.pi / sectors, bottom=bottom, label=label, **look)
        bottom = bottom + heights if stacked else bottom
    top = 1.08 * factor * tops.max(initial=0.0)  # with some space above the longest bar
    axes.set_ylim(0.0, top or 1.0)  # without any contact, an empty disc
    if top > 0.0:
        axes.set_yticks([tick for tick in MaxNLocator(4).tick_values(0.0, top) if 0.0 < tick < top])
    axes.tick_params(axis="x", pad=5)
    return _dressed(axes, middles, tops, f"{quantity[0]}, {unit}", directions)


def _dressed(
    axes: PolarAxes,
    angles: np.ndarray,
    heights: np.ndarray,
    label: str,
    directions: Sequence[str] = ("x", "y"),
) -> PolarAxes:
    # The numbers of the radial scale are midway between two of the grid lines at every 45°, where
    # they cover least of the bars.
    middles = 22.5 + 45.0 * np.arange(8)
    # From each middle to each bar, -180° to 180°.
    distance = (np.degrees(angles) - middles[:, None] + 180.0) % 360.0 - 180.0
    covered = np.where(np.abs(distance) < 22.5, heights, 0.0).sum(axis=1)
    axes.set_rlabel_position(float(middles[np.argmin(covered)]))
    axes.tick_params(axis="y", labelsize="small", colors=DARK)
    legend_above(axes, 2, height=1.08)  # above the text of the direction 90°
    axes.set_xlabel(label)
    names = {0: f"{directions[0]}, ", 90: f"{directions[1]}, "}
    degrees = [round(np.degrees(tick)) for tick in axes.get_xticks()]
    axes.set_xticklabels([f"{names.get(angle, '')}{angle}°" for angle in degrees])
    return axes


def _fitting(values: np.ndarray, unit: str) -> tuple[float, str]:
    """Return the factor and the unit of `fitting_unit`; but volumes are in mm³, or in µm³ times a
    power of ten, since the next prefix of a cubed length is nine powers of ten away."""
    if unit != "m^3":
        return fitting_unit(values, unit)
    largest = values.max(initial=0.0)
    if largest >= 1e-12:  # 1e-3 mm³
        return 1e9, "mm³"
    # The multiple of 3 that brings the largest volume between 1 and 1000 of the unit.
    power = max(3 * int(np.floor(np.log10(max(largest, 1e-18) * 1e18) / 3)), 0)
    exponent = str(power).translate(str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹"))
    return 10.0 ** (18 - power), "µm³" if power == 0 else f"10{exponent} µm³"

"""Sweeps over clearance and restitution, with their figures and findings."""

from collections.abc import Callable
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

import clearjoint as cj
from clearjoint import plot
from clearjoint.quantities import (
    Acceleration,
    JournalOffset,
    Penetration,
    PenetrationRate,
)
from studies.clearance_sweep.limit import limit
from studies.common.forces import largest_at_a_base
from studies.common.output import Output

SHOULDER, END_ARM, BASE = "shoulder", "arm 3", "V"
GRAVITY = 9.81
DURATION, QUICK_DURATION = 0.5, 0.2
"""End of all runs, s."""
FREE_FALLS = 12.0
"""Length of the saved orbits, in times of the journal's first free fall to the wall."""
ORBITS = (0.05e-3, 0.2e-3, 1e-3)
"""Clearances of the drawn orbits, m."""
MEDIAN = 15
"""Number of lanes of a moving median."""
TRANSITION = 0.3e-3
"""Clearance above which the dissipated energy grows more slowly, m."""
LOSSY = 0.8
"""Restitution up to which impacts dissipate nearly the same energy."""


def clearance_axis(values: Any) -> cj.Axis:
    """Return the axis of radial clearances of the shoulder, m."""
    return cj.Axis(lambda scene: scene.joints[SHOULDER].clearance, values)


def restitution_axis(values: Any) -> cj.Axis:
    """Return the axis of restitutions requested of the shoulder's contact law."""
    return cj.Axis(lambda scene: scene.joints[SHOULDER].law.restitution, values)


def free_fall(clearance: Any) -> Any:
    """Return the time of the journal's first fall from the centre to the wall, s."""
    return np.sqrt(2.0 * clearance / GRAVITY)


def orbit_times(scene: cj.Scene) -> np.ndarray:
    """Return instants of the first impacts in proportion to the free fall, s."""
    shoulder: Any = scene.joints[SHOULDER]
    return np.linspace(0.0, FREE_FALLS * free_fall(float(shoulder.clearance)), 1201)


SUMMARY: dict[str, Any] = {
    "peak_force": cj.Peak(largest_at_a_base(SHOULDER), "N"),
    "peak_acceleration": cj.Peak(Acceleration(END_ARM), "m/s^2"),
    "impacts": cj.ImpactCount(SHOULDER),
    "dissipated_energy": cj.DissipatedEnergy(),
}
IMPACTS = cj.Section(
    Penetration(SHOULDER, BASE), {"entry_speed": PenetrationRate(SHOULDER, BASE)}, count=80
)
"""Poincaré section of an impact oscillator: the states in which a base meets the wall."""
ORBIT = {c: JournalOffset(SHOULDER, c, BASE) for c in ("x", "y")}
"""Path of a base across the bearing."""


def sweep(output: Output) -> list[str]:
    """Run and draw summaries, impacts and orbits over the clearance, and return the findings."""
    scene, state = cj.mechanisms.double_pendulum()
    values = np.geomspace(0.05e-3, 1e-3, 16 if output.quick else 256)
    swept = cj.sweep(
        scene,
        state,
        QUICK_DURATION if output.quick else DURATION,
        {"clearance": clearance_axis(values)},
        {**SUMMARY, "impact": IMPACTS, **ORBIT},
        settings=cj.Settings(ledger=True),
        save=cj.Saving(orbit_times, states=False),
        path=output.store("sweep"),
        chunk=32,
    )
    in_free_falls(swept)
    output.save(_summary(swept), "summary")
    output.save(_impacts(swept), "impacts")
    output.save(_orbits(swept), "orbits")
    return sweep_findings(swept)


def in_free_falls(swept: xr.Dataset) -> None:
    """Add entry speeds and times of the impacts relative to those of the first."""
    fall = free_fall(swept["clearance"])
    relative = {
        "impact_relative_entry_speed": swept["impact_entry_speed"] / (GRAVITY * fall),
        "impact_relative_time": swept["impact_time"] / fall,
    }
    for name, values in relative.items():
        swept[name] = values.assign_attrs(units="1")


def _summary(swept: xr.Dataset) -> Figure:
    figure = Figure(figsize=(9.0, 6.4), layout="constrained")
    for name, axes in zip(SUMMARY, figure.subplots(2, 2).flat, strict=True):
        plot.against(swept, name, median=min(MEDIAN, swept.sizes["clearance"] // 2), axes=axes)
    return figure


def _impacts(swept: xr.Dataset) -> Figure:
    figure = Figure(figsize=(11.0, 4.6), layout="constrained")
    titles = {
        "relative_entry_speed": f"entry speed of base {BASE} / that of the first impact",
        "relative_time": "time / time of the first impact",
    }
    for (channel, title), axes in zip(titles.items(), figure.subplots(1, 2), strict=True):
        plot.bifurcation(swept, "impact", channel, number=True, axes=axes)
        axes.set_title(title, fontsize="medium")
    return figure


def _orbits(swept: xr.Dataset) -> Figure:
    figure = Figure(figsize=(11.0, 4.0), layout="constrained")
    for clearance, axes in zip(ORBITS, figure.subplots(1, 3), strict=True):
        lane = swept.sel(clearance=clearance, method="nearest")
        radius = float(lane["clearance"])
        plot.orbit(lane, ("x", "y"), radius, axes=axes)
        axes.invert_yaxis()  # gravity is along y
        last = FREE_FALLS * free_fall(radius)
        axes.set_title(f"{radius * 1e3:.2g} mm, first {last * 1e3:.0f} ms", fontsize="medium")
    return figure


def sweep_findings(swept: xr.Dataset) -> list[str]:
    """Return the findings, measured on the sweep over the clearance."""
    low, high = (swept.isel(clearance=index) for index in (0, -1))
    speeds = swept["impact_relative_entry_speed"].values
    first = np.abs(speeds[:, 0] - 1.0).max()
    power = {name: plot.power_law_exponent(swept, name) for name in SUMMARY}
    energy = [
        plot.power_law_exponent(swept, "dissipated_energy", within=within)
        for within in ((0.0, TRANSITION), (TRANSITION, 1.0))
    ]
    early = swept["peak_acceleration_time"] < 1.1 * free_fall(swept["clearance"])
    together = shared_impacts(speeds)
    return [
        f"{int((swept['result'] != 0).sum())} of {swept['result'].size} lanes failed",
        f"the first impact is a free fall, sqrt(2 g c), to {first:.0e} at every clearance",
        f"impacts 1 to {together} scale with it: relative entry speeds "
        + ", ".join(_range(speeds[:, k], ".3f") for k in range(1, together))
        + "; from the next one on they depend on the clearance, and soon without order",
        f"peak force {float(low['peak_force']) / 1e3:.3g} to {float(high['peak_force']) / 1e3:.3g} "
        f"kN, about as c^{power['peak_force']:.2f}, reached between "
        f"{_range(swept['peak_force_time'].values, '.2f')} s",
        "peak acceleration "
        f"{float(low['peak_acceleration']):.0f} to {float(high['peak_acceleration']):.0f} m/s², "
        f"as c^{power['peak_acceleration']:.2f}; it is that of the first impact in "
        f"{float(early.mean()):.0%} of the lanes",
        f"impacts: {_range(swept['impacts'].values, '.0f')}, without a trend "
        f"(c^{power['impacts']:.2f})",
        f"dissipated energy {float(low['dissipated_energy']):.2g} to "
        f"{float(high['dissipated_energy']):.2g} J, as c^{energy[0]:.2f} below "
        f"{TRANSITION * 1e3:g} mm and as c^{energy[1]:.2f}, with scatter, above",
    ]


def shared_impacts(speeds: np.ndarray) -> int:
    """Return the number of impacts whose relative entry speed is the same at all clearances, within
    5 %.

    `speeds`: (lanes, impacts).
    """
    spread = np.ptp(speeds, axis=0) / np.median(speeds, axis=0)
    return int(np.argmin(spread < 0.05))


def restitution_map(output: Output) -> list[str]:
    """Run and draw summaries over clearance and restitution, and return the findings."""
    scene, state = cj.mechanisms.double_pendulum()
    columns, rows = (6, 4) if output.quick else (32, 24)
    swept = cj.sweep(
        scene,
        state,
        DURATION,
        {
            "clearance": clearance_axis(np.geomspace(0.05e-3, 1e-3, columns)),
            "restitution": restitution_axis(np.linspace(0.1, 1.0, rows)),
        },
        SUMMARY,
        settings=cj.Settings(ledger=True),
        path=output.store("map"),
        chunk=64,
    )
    figure = Figure(figsize=(12.0, 3.6), layout="constrained")
    shown = ("peak_force", "impacts", "dissipated_energy")
    for name, axes in zip(shown, figure.subplots(1, 3), strict=True):
        plot.parameter_map(swept, name, "clearance", "restitution", axes=axes)
    output.save(figure, "map")
    return map_findings(swept)


def map_findings(swept: xr.Dataset) -> list[str]:
    """Return the findings, measured on the map."""
    outputs = swept[["peak_force", "impacts", "dissipated_energy"]]
    least, most = (outputs.isel(restitution=index) for index in (0, -1))
    impacts = outputs["impacts"].median("clearance")
    lossy = outputs.sel(restitution=slice(None, LOSSY))
    change = np.abs((lossy / lossy.isel(restitution=0)).median("clearance") - 1.0).max()
    rise = (most["peak_force"] / least["peak_force"]).median()
    return [
        f"{int((swept['result'] != 0).sum())} of {swept['result'].size} lanes failed",
        f"impacts grow from {float(impacts[0]):.0f} at restitution "
        f"{float(impacts['restitution'][0]):g} to {float(impacts[-1]):.0f} at 1 (medians over the "
        "clearances)",
        f"up to restitution {LOSSY} the clearance alone decides the rest: dissipated energy "
        f"changes by {float(change['dissipated_energy']):.0%} at most, peak force by "
        f"{float(change['peak_force']):.0%} (medians over the clearances)",
        f"at restitution 1 nothing is dissipated ({float(most['dissipated_energy'].max()):.0e} J), "
        f"and peak forces are {float(rise):.1f} times those at "
        f"{float(impacts['restitution'][0]):g} (median)",
    ]


def _range(values: np.ndarray, form: str) -> str:
    return f"{np.nanmin(values):{form}} to {np.nanmax(values):{form}}"


COMMANDS: dict[str, Callable[[Output], list[str]]] = {
    "sweep": sweep,
    "map": restitution_map,
    "limit": limit,
}

"""Limit of zero clearance: convergence of the end arm's motion to that with an ideal joint.

A journal fixed axially tends to the ideal revolute joint. The paper's journal slides along its
bearing, and tends to a cylindrical joint.
"""

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import clearjoint as cj
from clearjoint import plot
from clearjoint.quantities import Penetration, Position
from studies.common.output import Output

SHOULDER, END_ARM, BASE = "shoulder", "arm 3", "V"
DURATION = 0.5
"""End of all runs, s."""
BELOW_SATURATION = 0.3e-3
"""Clearance up to which the journal tilts across all of it within the run, m."""
PROPORTIONAL = (5e-6, BELOW_SATURATION)
"""Clearances larger than the penetration, m."""
COMPLIANT = (0.1e-6, 1e-6)
"""Clearances smaller than the penetration, m."""
BLUE, VERMILLION = "#0072B2", "#D55E00"


def limit(output: Output) -> list[str]:
    """Compute and draw the deviation of the end arm from its motion with an ideal joint, and return
    the findings.
    """
    fixed = deviations(output, "limit_held", cj.FixedAxially())
    free = deviations(output, "limit_free", cj.FreeAxially())
    figure = Figure(figsize=(10.0, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    plot.convergence(
        fixed, "deviation", within=PROPORTIONAL, label="fixed axially", colour=BLUE, axes=left
    )
    plot.convergence(
        free,
        "deviation",
        within=COMPLIANT,
        label="free, as in the paper",
        colour=VERMILLION,
        axes=left,
    )
    _mark_compliance(fixed, left)
    _over_total_gap(fixed, right)
    output.save(figure, "limit")
    return findings(fixed, free)


def _over_total_gap(fixed: xr.Dataset, axes: Axes) -> None:
    """Draw the deviation over the sum of clearance and penetration."""
    within = (0.0, _largest_total_gap(fixed))
    plot.convergence(fixed, "deviation", "play", within=within, label="fixed axially", axes=axes)
    axes.set_xlabel("clearance + penetration, mm")
    axes.set_ylabel("")


def deviations(output: Output, name: str, axial: Any) -> xr.Dataset:
    """Return a sweep over the clearance with the largest deviation of each run, and the sum of
    clearance and penetration.
    """
    times = np.linspace(0.0, DURATION, 251)
    ideal = cj.simulate(
        *cj.mechanisms.double_pendulum(None),
        DURATION,
        cj.Settings(rtol=1e-10),
        save=cj.Saving(times),
    ).saved
    assert ideal is not None
    clearances = np.geomspace(1e-7, 1e-3, 13 if output.quick else 65)
    components: Any = "xyz"
    swept = cj.sweep(
        *cj.mechanisms.double_pendulum(axial=axial),
        DURATION,
        {"clearance": cj.Axis(lambda scene: scene.joints[SHOULDER].clearance, clearances)},
        {
            **{f"path_{c}": Position(END_ARM, c) for c in components},
            "penetration": cj.Peak(Penetration(SHOULDER, BASE), "m"),
        },
        save=cj.Saving(times, states=False),
        path=output.store(name),
        chunk=16,
    )
    path = np.stack([swept[f"path_{c}"].values for c in components], axis=-1)
    away = np.linalg.norm(path - np.asarray(ideal.states.bodies[END_ARM].position), axis=-1)
    swept["deviation"] = ("clearance", away.max(axis=1), {"units": "m"})
    swept["play"] = (swept["clearance"] + swept["penetration"]).assign_attrs(units="m")
    return swept


def _mark_compliance(swept: xr.Dataset, axes: Axes) -> None:
    """Draw a line where the penetration equals the clearance."""
    equal = 1e3 * equal_penetration(swept)
    axes.axvline(equal, color="0.5", linewidth=1.0, linestyle="--")
    axes.annotate(
        "penetration = clearance",
        (equal, 0.4),
        xycoords=("data", "axes fraction"),
        xytext=(-4, 0),
        textcoords="offset points",
        rotation=90,
        ha="right",
        color="0.4",
    )


def equal_penetration(swept: xr.Dataset) -> float:
    """Return the clearance that equals the largest penetration of its run, m."""
    depth, clearances = swept["penetration"].values, swept["clearance"].values
    return float(np.exp(np.interp(0.0, np.log(clearances / depth), np.log(clearances))))


def _largest_total_gap(swept: xr.Dataset) -> float:
    return float(swept["play"].sel(clearance=BELOW_SATURATION, method="nearest"))


def findings(fixed: xr.Dataset, free: xr.Dataset) -> list[str]:
    """Return the findings, measured on the deviations."""
    proportional, compliant = (
        plot.power_law_exponent(fixed, "deviation", within=within)
        for within in (PROPORTIONAL, COMPLIANT)
    )
    play = fixed.sel(clearance=slice(None, BELOW_SATURATION))
    rate = plot.power_law_exponent(
        fixed, "deviation", "play", within=(0.0, _largest_total_gap(fixed))
    )
    ratio = (play["deviation"] / play["play"]).values
    low, high = (value * 1e6 for value in PROPORTIONAL)
    return [
        f"fixed axially: the end arm's largest deviation over {DURATION} s scales with "
        f"c^{proportional:.2f} from {low:g} to {high:g} µm",
        f"below {equal_penetration(fixed) * 1e6:.1f} µm the penetration is larger than the "
        f"clearance, and it goes with c^{compliant:.2f}: stiffness grows as c^-0.5, penetration at "
        "constant load falls as c^0.33 only",
        f"with the sum of clearance and penetration it scales at a rate of {rate:.2f}: it is "
        f"{ratio.min():.0f} to {ratio.max():.0f} times that sum (tilt of the 20 mm journal: 112)",
        f"at 1 mm it is {float(fixed['deviation'][-1]) * 1e3:.0f} mm and has levelled off: the run "
        "ends before the journal has tilted all the way",
        f"free axially, it tends to {float(free['deviation'][0]) * 1e3:.0f} mm and not to zero: "
        "the arm slides along the journal, a cylindrical joint",
    ]

"""Figures of elastic forces, loops of free impacts, and delivered restitution."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

import clearjoint as cj
from clearjoint.plot import style
from studies.contact_laws.curves import (
    CLEARANCE,
    ELASTICITIES,
    FACTORS,
    MASS,
    SPEED,
    STIFFNESS,
    VISCOUS,
    delivered,
    elastic_force,
    jankowski,
    loop,
)

COLOURS = (style.BLUE, style.VERMILLION, style.GREEN, style.PURPLE, style.DARK, "#E69F00")
DASHES = ("-", "--", "-.", ":")


def _line_style(k: int) -> dict[str, object]:
    """Return a colour and a dash pattern, different for each of 24 curves."""
    return {"color": COLOURS[k % 6], "linestyle": DASHES[(k // 6 + k) % 4], "linewidth": 1.6}


def forces() -> Figure:
    """Draw elastic force against penetration."""
    figure, panels = plt.subplots(1, 2, figsize=(10.0, 4.6), layout="constrained")
    spans = ((np.linspace(0.0, 10e-6, 200), 1e6, "µm"), (np.geomspace(1e-7, 1e-3, 300), 1e3, "mm"))
    for axes, (depths, unit, name) in zip(panels, spans, strict=True):
        for k, (label, elasticity) in enumerate(ELASTICITIES.items()):
            within = np.full(depths.shape, True)
            gap = cj.extend.Gap(0.0, 0.0, 10e-3, CLEARANCE)
            for limit in elasticity.limits(gap):
                if limit.quantity == "penetration":
                    within = depths <= 0.99 * float(limit.most)
            force = 1e-3 * elastic_force(elasticity, depths)
            axes.plot(unit * depths[within], force[within], label=label, **_line_style(k))
        style.dress(axes, f"penetration, {name}", "elastic force, kN")
    panels[0].set_xlim(0.0, 10.0)
    panels[0].set_ylim(0.0, 20.0)
    panels[1].set_xscale("log")
    panels[1].set_yscale("log")
    panels[1].set_ylim(1e-3, 1e5)
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, frameon=False)
    return figure


def _loops() -> dict[str, dict[str, cj.extend.AbstractContactLaw]]:
    """Return the laws of each panel, with a requested restitution of 0.5 where they take one."""
    k, c = STIFFNESS, 0.5
    linear = 1.5e8
    return {
        "damping by entry speed, K δ$^{1.5}$": {
            "Hertz": cj.laws.Hertz(k),
            "Lankarani–Nikravesh": cj.laws.LankaraniNikravesh(c, k),
            "Hunt–Crossley": cj.laws.HuntCrossley(c, k),
            "exact restitution": cj.laws.ExactRestitution(c, k),
            "Flores 2011": cj.laws.Flores2011(c, k),
            "Gharib–Hurmuzlu": cj.laws.GharibHurmuzlu(c, k),
        },
        "fixed damping, K δ$^{1.5}$": {
            "Hertz": cj.laws.Hertz(k),
            "Tsuji": cj.laws.Tsuji(c, k, MASS),
            "Jankowski": cj.laws.Jankowski(c, k, MASS),
            "Kuwabara–Kono, D = 2·10⁶ N s/m$^{1.5}$": cj.laws.KuwabaraKono(k, 2e6),
            "Ristow, D = 5·10³ N s/m": cj.laws.Ristow(k, 5e3),
            "IMPACT, D = 10⁴ N s/m, full at 3 µm": cj.laws.ImpactFunction(k, 1e4, 3e-6),
        },
        "fixed damping, K δ": {
            "spring": cj.laws.Hertz(linear, exponent=1.0),
            "Kelvin–Voigt": cj.laws.KelvinVoigt(c, linear, MASS),
            "Flores' variant": cj.laws.FloresKelvinVoigt(c, linear),
            "ElastoGap, D = 10⁴ N s/m": cj.laws.ElastoGap(linear, 1e4),
        },
    }


def loops(quick: bool) -> Figure:
    """Draw force against penetration in free impacts."""
    figure, panels = plt.subplots(1, 3, figsize=(12.0, 5.2), layout="constrained", sharey=True)
    steps = 400 if quick else 4000
    for axes, (title, laws) in zip(panels, _loops().items(), strict=True):
        for k, (label, law) in enumerate(laws.items()):
            if quick and k > 1:
                continue
            depth, force = loop(law, steps)
            axes.plot(1e6 * depth, 1e-3 * force, label=label, **_line_style(k))
        style.dress(axes, "penetration, µm", "normal force, kN" if axes is panels[0] else "")
        axes.set_title(title, fontsize=10)
        axes.set_xlim(left=0.0)
        axes.set_ylim(bottom=0.0)
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), frameon=False, fontsize=9)
    figure.suptitle(f"free impacts of {MASS:g} kg at {SPEED:g} m/s; restitution 0.5 requested")
    return figure


def restitution(quick: bool) -> Figure:
    """Draw delivered against requested restitution of all laws, and the difference."""
    figure, panels = plt.subplots(1, 2, figsize=(11.0, 6.6), layout="constrained")
    requested = np.linspace(0.02, 1.0, 6 if quick else 50)
    panels[0].plot([0.0, 1.0], [0.0, 1.0], color="0.7", linewidth=4.0, label="exact restitution")
    panels[1].axhline(0.0, color="0.7", linewidth=4.0)
    for k, name in enumerate((*FACTORS, *VISCOUS)):
        found = delivered(name, requested)
        panels[0].plot(requested, found, label=name, **_line_style(k))
        panels[1].plot(requested, found - requested, **_line_style(k))
    if not quick:
        few = np.linspace(0.1, 0.9, 9)
        found, markers = jankowski(few), {"color": "black", "marker": "o", "markersize": 4}
        panels[0].plot(few, found, linestyle="", label="Jankowski", **markers)
        panels[1].plot(few, found - few, linestyle="", **markers)
    style.dress(panels[0], "requested restitution", "delivered restitution of a free impact")
    style.dress(panels[1], "requested restitution", "delivered minus requested restitution")
    for axes in panels:
        axes.set_xlim(0.0, 1.0)
    panels[0].set_ylim(0.0, 1.0)
    panels[1].set_ylim(-0.06, 0.06)
    figure.legend(loc="outside lower center", ncols=4, frameon=False, fontsize=9)
    return figure

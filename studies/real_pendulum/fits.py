"""Fits and predictions of measured swings, as tables and a figure."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import clearjoint as cj
from studies.common.report import markdown
from studies.real_pendulum.pendulum import GRAVITY
from studies.real_pendulum.swing_files import Swing, read_swings
from studies.real_pendulum.swing_fits import (
    SwingFit,
    fit_frictions,
    fit_start,
    identified,
    period,
    roughly,
)

ALL = "all three"
MODELS = {
    "viscous": ("viscous",),
    "viscous, Coulomb": ("viscous", "coulomb"),
    "Coulomb, quadratic": ("coulomb", "quadratic"),
    ALL: ("viscous", "coulomb", "quadratic"),
}
SAMPLES = 40
"""Samples in a period; more add no information where residuals are correlated over periods."""
QUICK_SAMPLES, QUICK_PERIODS = 20, 8.0
BLUE = "#0072B2"
LINES = (("#999999", "-"), ("#D55E00", "--"), ("#009E73", "-"), (BLUE, "--"))
"""Colours and dashes of the models; dashes show lower curves where two coincide."""


@dataclass(frozen=True)
class Fitted:
    """Fits of the first swing by model, their tests on other swings, and for comparison fits of all
    frictions to these. `identified`: `cj.identify` on the first swing.
    """

    swing: Swing
    fits: dict[str, SwingFit]
    others: list[Swing]
    tests: dict[str, list[SwingFit]]
    own: list[SwingFit]
    identified: cj.results.Fit


def study(swings: list[Swing]) -> Fitted:
    """Fit the first swing, and test the fits on the others."""
    first, *others = swings
    rough = roughly(first)
    fits = {name: fit_frictions(first, rough, frictions) for name, frictions in MODELS.items()}
    tests = {
        name: [fit_start(other, found.pendulum) for other in others] for name, found in fits.items()
    }
    own = [fit_frictions(other, roughly(other), MODELS[ALL]) for other in others]
    return Fitted(first, fits, others, tests, own, identified(first, fits[ALL], rough))


def prepared(path: Path, quick: bool) -> list[Swing]:
    """Return the free swings of a file with fewer samples."""
    swings = []
    for swing in read_swings(path):
        free = swing.free()
        length = period(free)
        if quick:
            inside = free.times - free.times[0] <= QUICK_PERIODS * length
            free = Swing(free.name, free.times[inside], free.angles[inside])
        swings.append(free.thinned(length / (QUICK_SAMPLES if quick else SAMPLES)))
    return swings


def table(fitted: Fitted) -> str:
    """Return the table of estimates and residuals of each model."""
    head = ("friction", "length, m", "viscous, 10⁻³ s", "Coulomb, 10⁻³", "quadratic, 10⁻³ s²")
    predicted = [f"predicted rms {k}" for k, _ in enumerate(fitted.others, 2)]
    rows: list[tuple[str, ...]] = [(*head, "rms, mrad", "correlation", *predicted)]
    for name, found in fitted.fits.items():
        tests = [f"{1e3 * test.rms:.2f}" for test in fitted.tests[name]]
        rows.append((name, *_estimates(found), *tests))
    for k, found in enumerate(fitted.own, 2):
        rows.append((f"{ALL}, own fit of {k}", *_estimates(found), *("" for _ in fitted.own)))
    names = [f"{k}: {swing.name}" for k, swing in enumerate([fitted.swing, *fitted.others], 1)]
    return "\n".join([*names, "", markdown(rows), ""])


def _estimates(found: SwingFit) -> tuple[str, ...]:
    return (
        _shown(found, "length", 1.0, 6),
        _shown(found, "viscous", 1e3, 3),
        _shown(found, "coulomb", 1e3, 3),
        _shown(found, "quadratic", 1e3, 4),
        f"{1e3 * found.rms:.2f}",
        f"{found.correlation:.2f}",
    )


def _shown(found: SwingFit, name: str, scale: float, digits: int) -> str:
    if name not in found.errors:
        return "0"
    value, error = (scale * x for x in (getattr(found.pendulum, name), found.errors[name]))
    return f"{value:.{digits}f} ± {error:.{digits}f}"


def error_table(fitted: Fitted) -> str:
    """Return the table of standard errors of the last model, with and without correlation of
    residuals.
    """
    found = fitted.fits[ALL]
    rows = [("of all three", "estimate", "standard error", "if residuals were independent")]
    for name in found.names:
        errors = [
            f"{known[name]:.2g}" if name in known else "at its bound"
            for known in (found.errors, found.naive)
        ]
        rows.append((name, f"{getattr(found.pendulum, name):.6g}", errors[0], errors[1]))
    rate = 2.0 * np.pi * np.sqrt(found.pendulum.length / GRAVITY)
    rows.append(("period of small swings, s", f"{rate:.6g}", "", ""))
    return markdown(rows) + "\n"


def figure(fitted: Fitted) -> Figure:
    """Draw each swing with the fit or test of the last model, and below the residuals of all
    models.
    """
    swings = [fitted.swing, *fitted.others]
    drawn = Figure(figsize=(max(6.0, 4.2 * len(swings)), 6.4), layout="constrained")
    axes = drawn.subplots(2, len(swings), squeeze=False, sharex="col")
    for k, (swing, (top, bottom)) in enumerate(zip(swings, axes.T, strict=True)):
        fits = {
            name: found if k == 0 else fitted.tests[name][k - 1]
            for name, found in fitted.fits.items()
        }
        last = fits[ALL]
        top.plot(swing.times, np.degrees(swing.angles), ".", color="black", markersize=2.5,
                 label="measured")  # fmt: skip
        top.plot(swing.times, np.degrees(swing.angles - last.residuals), color=BLUE,
                 linewidth=0.8, label=ALL)  # fmt: skip
        top.set_title(f"{'fitted' if k == 0 else 'predicted'}\n{swing.name}", fontsize="small")
        for (colour, dashes), (name, found) in zip(LINES, fits.items(), strict=True):
            style = {"color": colour, "linestyle": dashes, "linewidth": 0.9, "label": name}
            bottom.plot(swing.times, 1e3 * found.residuals, **style)
        bottom.set_xlabel("time, s")
    axes[0, 0].set_ylabel("angle, °")
    axes[1, 0].set_ylabel("measured less fitted, mrad")
    handles, labels = axes[1, 0].get_legend_handles_labels()
    drawn.legend(
        handles,
        labels,
        loc="outside lower center",
        ncols=4 if len(swings) > 1 else 2,
        frameon=False,
    )
    return drawn

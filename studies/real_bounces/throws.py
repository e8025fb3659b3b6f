"""Fits of balls, and simulations of their throws."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import clearjoint as cj
from studies.common.report import markdown
from studies.real_bounces.ball import (
    GRAVITY,
    RestitutionOverSpeed,
    scene,
    simulated_intervals,
)
from studies.real_bounces.bounce_files import Measured
from studies.real_bounces.bounce_fit import (
    LAWS,
    Fit,
    Points,
    fit,
    from_drops,
    from_intervals,
    requested,
    whole,
)

AIR_DENSITY, DRAG_COEFFICIENT = 1.2, 0.47
STIFFNESS = 1e8
"""Stiffness, N/m^1.5, which intervals do not determine. Simulated contacts last half a millisecond
at most; those of soft balls last some milliseconds, a hundredth of an interval.
"""
BLUE, VERMILLION, GREY = "#0072B2", "#D55E00", "0.6"


@dataclass(frozen=True)
class Ball:
    """Name, mass, kg, and diameter, m, of a ball, and whether these are known."""

    name: str
    mass: float
    diameter: float
    has_drag: bool = True

    @property
    def terminal(self) -> float:
        """Terminal speed in air, m/s; infinite without drag."""
        if not self.has_drag:
            return np.inf
        area = 0.25 * np.pi * self.diameter**2
        return float(np.sqrt(2.0 * self.mass * GRAVITY / (AIR_DENSITY * DRAG_COEFFICIENT * area)))


BALLS = {
    1: Ball("table tennis", 2.7e-3, 40e-3),
    2: Ball("blue ball", 20e-3, 40e-3, has_drag=False),
    3: Ball("tennis", 57.7e-3, 67e-3),
    4: Ball("golf", 45.9e-3, 42.7e-3),
}
"""Balls by their number in the files, whose comments name them, with nominal masses and diameters.
"""


@dataclass(frozen=True)
class Studied:
    """Points and fits of a ball: of its intervals with drag (`fit`, `constant`) and without
    (`vacuum`), and of its drop heights (`drops`).
    """

    ball: Ball
    measured: Measured
    points: Points
    fit: Fit
    constant: Fit
    vacuum_points: Points
    vacuum: Fit
    drop_points: Points | None
    drops: Fit | None


def study(measured: Measured) -> Studied:
    """Fit one ball with intervals."""
    ball = BALLS.get(measured.number, Ball(f"ball {measured.number}", 20e-3, 40e-3, False))
    points = from_intervals(measured.series, ball.terminal)
    vacuum = from_intervals(measured.series, np.inf)
    dropped = None if measured.drops is None else from_drops(measured.drops, ball.terminal)
    return Studied(
        ball,
        measured,
        points,
        fit(points, constant=False),
        fit(points, constant=True),
        vacuum,
        fit(vacuum, constant=False),
        dropped,
        None if dropped is None else fit(dropped, constant=False),
    )


def chains(studied: Studied, quick: bool) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
    """Yield the number of the series, and measured and simulated intervals of each throw.

    The simulation uses the first interval of the throw and the law of all throws.
    """
    ball, terminal = studied.ball, studied.ball.terminal
    law = RestitutionOverSpeed(*studied.fit.values, cj.laws.Hertz(STIFFNESS))
    made = scene(law, ball.mass, ball.diameter, terminal)
    for number, series in enumerate(studied.measured.series):
        for throw in series.T[:1] if quick else series.T:
            measured = whole(throw)
            found = simulated_intervals(made, measured[0], terminal, len(measured))
            yield number, measured, found


def deviations(studied: Studied, pairs: list[tuple[int, np.ndarray, np.ndarray]]) -> np.ndarray:
    """Return the logarithm of measured over simulated intervals, relative to its expected scatter.

    After n impacts an interval scatters by sqrt(n) times the scatter of a restitution.
    """
    found = []
    for _, measured, simulated in pairs:
        count = np.arange(1, len(simulated))
        expected = studied.points.scatter / studied.fit.at(np.array([2.0]))[0] * np.sqrt(count)
        found.append(np.log(measured[1 : len(simulated)] / simulated[1:]) / expected)
    return np.concatenate(found)


def _shown(found: Fit) -> str:
    (loss, power), (loss_error, power_error) = found.values, found.errors
    return f"{loss:.4f} ± {loss_error:.4f} | {power:.2f} ± {power_error:.2f}"


def fit_table(studies: list[Studied]) -> str:
    """Return the table of e = 1 - loss v^power of each ball, from intervals with and without drag,
    and from drops.
    """
    rows: list[tuple[str, ...]] = [
        ("ball", "from", "points", "speeds, m/s", "scatter of e", "loss", "power", "chi²/N",
         "Akaike over constant")
    ]  # fmt: skip
    for studied in studies:
        kinds = [
            ("intervals", studied.points, studied.fit),
            ("intervals, no drag", studied.vacuum_points, studied.vacuum),
            ("drops", studied.drop_points, studied.drops),
        ]
        if not studied.ball.has_drag:
            del kinds[1]
        for kind, points, found in kinds:
            if points is None or found is None:
                continue
            constant = fit(points, constant=True)
            rows.append(
                (
                    studied.ball.name,
                    kind,
                    f"{len(points.speed)}",
                    f"{points.speed.min():.2f} to {points.speed.max():.2f}",
                    f"{points.scatter:.4f}",
                    _shown(found),
                    f"{found.chi2 / found.degrees_of_freedom:.2f}",
                    f"{found.akaike - constant.akaike:+.1f}",
                )
            )
    return markdown(rows) + "\n"


def request_table(studies: list[Studied]) -> str:
    """Return the table of restitutions to request of each law for the restitution at 2 m/s."""
    rows = [("ball", "e at 2 m/s", *(law.__name__ for law in LAWS))]
    for studied in studies:
        speed = np.array([2.0])
        delivered, error = studied.fit.at(speed)[0], studied.fit.error_at(speed)[0]
        requests = [requested(law, delivered) for law in LAWS]
        rows.append(
            (
                studied.ball.name,
                f"{delivered:.4f} ± {error:.4f}",
                *("cannot" if value is None else f"{value:.4f}" for value in requests),
            )
        )
    return markdown(rows) + "\n"


def chain_table(
    studies: list[Studied], simulated: list[list[tuple[int, np.ndarray, np.ndarray]]]
) -> str:
    """Return the table of deviations of measured from simulated intervals."""
    rows = [("ball", "throws", "intervals", "rms deviation, %", "rms in scatters", "within 2")]
    for studied, pairs in zip(studies, simulated, strict=True):
        ratios = np.concatenate([np.log(m[1 : len(s)] / s[1:]) for _, m, s in pairs])
        scatters = deviations(studied, pairs)
        rows.append(
            (
                studied.ball.name,
                f"{len(pairs)}",
                f"{len(ratios)}",
                f"{100 * np.sqrt(np.mean(ratios**2)):.2f}",
                f"{np.sqrt(np.mean(scatters**2)):.2f}",
                f"{100 * np.mean(np.abs(scatters) < 2.0):.0f} %",
            )
        )
    return markdown(rows) + "\n"


def restitution_figure(studies: list[Studied]) -> Figure:
    """Draw restitution over speed, points of all methods and the fit, with residuals below."""
    figure = Figure(figsize=(3.4 * len(studies), 5.6), layout="constrained")
    axes = figure.subplots(2, len(studies), sharex="col", height_ratios=(2, 1), squeeze=False)
    for studied, (top, bottom) in zip(studies, axes.T, strict=True):
        _draw_points(studied, top, bottom)
        top.set_title(studied.ball.name)
        bottom.set_xlabel("impact speed, m/s")
        bottom.axhline(0.0, color="black", linewidth=0.8)
    axes[0, 0].set_ylabel("restitution")
    axes[1, 0].set_ylabel("residual, 10⁻³")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, frameon=False)
    return figure


def _draw_points(studied: Studied, top: Axes, bottom: Axes) -> None:
    kinds = [(studied.points, BLUE, "o", "intervals")]
    if studied.drop_points is not None:
        kinds.append((studied.drop_points, VERMILLION, "s", "drop heights"))
    if studied.ball.has_drag:
        speed, value, error = studied.vacuum_points.means()
        top.errorbar(speed, value, error, fmt="x", color=GREY, markersize=4, linewidth=0.8,
                     label="intervals, taken as in vacuum")  # fmt: skip
    for points, colour, marker, label in kinds:
        speed, value, error = points.means()
        style = {"fmt": marker, "color": colour, "markersize": 4, "linewidth": 1.0}
        top.errorbar(speed, value, error, label=label, **style)
        bottom.errorbar(speed, 1e3 * (value - studied.fit.at(speed)), 1e3 * error, **style)
    along = np.linspace(studied.points.speed.min(), studied.points.speed.max(), 100)
    value, error = studied.fit.at(along), studied.fit.error_at(along)
    top.plot(along, value, color="black", linewidth=1.2, label="fit to intervals, ± 2 errors")
    top.fill_between(along, value - 2 * error, value + 2 * error, color="black", alpha=0.15)


def chain_figure(
    studies: list[Studied], simulated: list[list[tuple[int, np.ndarray, np.ndarray]]]
) -> Figure:
    """Draw measured and simulated intervals by number, and below their deviations over twice the
    expected scatter.
    """
    figure = Figure(figsize=(3.4 * len(studies), 5.6), layout="constrained")
    axes = figure.subplots(2, len(studies), sharex="col", height_ratios=(2, 1), squeeze=False)
    for studied, pairs, (top, bottom) in zip(studies, simulated, axes.T, strict=True):
        for number in sorted({pair[0] for pair in pairs}):
            _draw_series([pair[1:] for pair in pairs if pair[0] == number], top, bottom)
        count = max(len(pair[1]) for pair in pairs)
        relative = studied.points.scatter / studied.fit.at(np.array([2.0]))[0]
        expected = 200 * relative * np.sqrt(np.arange(count))
        bottom.fill_between(np.arange(1, count + 1), -expected, expected, color="0.85")
        bottom.axhline(0.0, color="black", linewidth=0.8)
        top.set_title(studied.ball.name)
        bottom.set_xlabel("number of the interval")
    axes[0, 0].set_ylabel("interval, s")
    axes[1, 0].set_ylabel("deviation, %")
    axes[0, 0].legend(frameon=False)
    return figure


def _draw_series(pairs: list[tuple[np.ndarray, np.ndarray]], top: Axes, bottom: Axes) -> None:
    count = max(len(simulated) for _, simulated in pairs)
    measured, simulated = np.full((2, len(pairs), count), np.nan)
    for row, (found, computed) in enumerate(pairs):
        measured[row, : len(computed)], simulated[row, : len(computed)] = found, computed
    numbers = np.arange(1, count + 1)
    first = not top.get_legend_handles_labels()[1]
    style = {"fmt": "o", "color": BLUE, "markersize": 3.5, "linewidth": 1.0}
    scatter = np.nanstd(measured, axis=0, ddof=1) if len(pairs) > 1 else None
    top.errorbar(
        numbers, np.nanmean(measured, axis=0), scatter, label="measured" if first else None, **style
    )
    top.plot(
        numbers,
        np.nanmean(simulated, axis=0),
        color="black",
        linewidth=1.0,
        label="simulated" if first else None,
    )
    ratios = 100 * (measured / simulated - 1.0)
    bottom.plot(numbers, ratios.T, ".-", color=BLUE, linewidth=0.5, markersize=3, alpha=0.6)

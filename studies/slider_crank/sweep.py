"""Sweeps of the slider-crank over clearance and crank speed.

    python -m studies.slider_crank sweep [--quick] [--output FOLDER]

A run begins in the motion of the ideal mechanism. After a transient, slider and journal are sampled
once a revolution at the outer dead centre of the ideal slider: this stroboscopic Poincaré section
gives the bifurcation diagrams over clearance and crank speed, in which a motion with the crank's
period is one dot, and a chaotic motion a column of dots. Peaks after the transient are shown
relative to those of the ideal mechanism.

There is neither gravity nor friction. If impacts took no time, the crank speed would only scale the
time, and the motion over the crank angle would be the same at all speeds. The speed changes the
stiffness of the contact relative to the forces of inertia; hence higher speeds give calmer motions.
Peaks caused by impacts, relative to the ideal ones, scale with the speed to the power -0.8 by
Hertz's law.

Results are stored during the run: an interrupted command continues, and a finished one only draws
again.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import xarray as xr
from matplotlib.figure import Figure

import clearjoint as cj
from clearjoint import plot
from clearjoint.extend import Instant, Quantity, Scalar
from clearjoint.quantities import Acceleration, JournalOffset, Multiplier, Velocity
from studies.common.output import Output
from studies.slider_crank.runs import PIN, Settings, closed_form, simulate

RESTITUTION = 0.9
CLEARANCE, SPEED = 20e-6, 5000.0
"""Radial clearance of the diagram over the speed, m, and speed of that over the clearance, 1/min.
"""
CLEARANCES, SPEEDS = (5e-6, 0.5e-3), (1000.0, 8000.0)
"""Ranges of all diagrams, m and 1/min."""
ORBITS = ((20e-6, 7500.0), (20e-6, 1500.0), (0.5e-3, 5000.0))
"""Clearances, m, and crank speeds, 1/min, of the drawn orbits."""
LONGEST_PERIOD = 8
"""Largest number of revolutions of a periodic motion."""
REPEATS = 0.01
"""Distance of the journal, in clearances, below which a motion repeats."""
IMPACTS_ALONE = 0.2e-3
"""Clearance from which on impacts cause the peaks at all speeds, m."""


class Settled(eqx.Module):
    """Magnitude of a quantity after a number of revolutions of the crank; -inf before."""

    quantity: Quantity = eqx.field(static=True)
    revolutions: int = eqx.field(static=True)

    def __call__(self, now: Instant) -> Any:
        """Return the magnitude."""
        motor: Any = now.scene.joints["motor"]
        turned = now.time * motor.speed / (2.0 * np.pi)
        return jnp.where(turned < self.revolutions, -jnp.inf, jnp.abs(self.quantity(now)))


def pin_force(now: Instant) -> Any:
    """Return the sum of the normal forces of the pin's bases, N, which are parallel."""
    return sum(base.normal_force for base in now.contacts[PIN].values())


SECTION: dict[str, Quantity] = {
    "section_x": JournalOffset(PIN, "x"),
    "section_y": JournalOffset(PIN, "y"),
    "section_velocity": Velocity("slider", "x"),
    "section_acceleration": Acceleration("slider", "x"),
}
IDEAL = {"acceleration": "outer", "moment": "moment", "force": "force"}
"""Outputs of the peaks, and their names in the closed form."""


@dataclass(frozen=True)
class Course:
    """Numbers of revolutions of a run before the outputs, and in all."""

    transient: int
    revolutions: int

    def end_time(self, scene: cj.Scene) -> float:
        """Return a time just after the last revolution, s."""
        return (self.revolutions + 1e-6) * period(scene)

    def strobe(self, scene: cj.Scene) -> np.ndarray:
        """Return the times of the outer dead centre of the ideal slider, s."""
        return period(scene) * np.arange(self.transient, self.revolutions + 1)

    def sweep(self, clearances: Any, speeds: Any, path: Path) -> xr.Dataset:
        """Sweep peaks and sections over clearances in m and crank speeds in 1/min.

        The scene's default speed occurs in no sweep, so that all share a program.
        """
        scene, state = cj.mechanisms.slider_crank(restitution=RESTITUTION, speed=1.0)
        peaks = {
            "acceleration": (Acceleration("slider"), "m/s^2"),
            "moment": (Multiplier("motor", "angle"), "N m"),
            "force": (pin_force, "N"),
        }
        swept = cj.sweep(
            scene,
            state,
            self.end_time,
            {
                "clearance": cj.Axis(lambda scene: scene.joints[PIN].clearance, clearances),
                "crank_speed": cj.Axis.change(at_speed, speeds, "1/min"),
            },
            {
                **{
                    f"peak_{name}": cj.Peak(Settled(quantity, self.transient), unit)
                    for name, (quantity, unit) in peaks.items()
                },
                **SECTION,
                "impacts": cj.ImpactCount(PIN),
            },
            save=cj.Saving(self.strobe, states=False),
            path=path,
            chunk=64,
        )
        return with_ratios(swept)


def at_speed(scene: cj.Scene, state: cj.State, speed: Scalar) -> tuple[cj.Scene, cj.State]:
    """Return the scene at another crank speed in 1/min, and its state in the ideal motion."""
    del state
    speed = speed * np.pi / 30.0
    driven = cj.set_value(scene, lambda scene: scene.joints["motor"].speed, speed)
    return driven, cj.mechanisms.slider_crank(speed=speed)[1]


def period(scene: cj.Scene) -> float:
    """Return the duration of a revolution of the crank, s."""
    motor: Any = scene.joints["motor"]
    return 2.0 * np.pi / float(motor.speed)


def with_ratios(swept: xr.Dataset) -> xr.Dataset:
    """Add the ratios of peaks to the ideal ones, and the period of each lane in revolutions."""
    speed, clearance = swept["crank_speed"], swept["clearance"]
    unit_speed = closed_form(Settings(revolutions_a_minute=1.0))
    ratios = {
        f"peak_{name}_over_ideal": swept[f"peak_{name}"] / (unit_speed[ideal] * speed**2)
        for name, ideal in IDEAL.items()
    }
    ratios["section_acceleration_ratio"] = -swept["section_acceleration"] / (
        unit_speed["outer"] * speed**2
    )
    for name in ("x", "y"):
        ratios[f"section_relative_{name}"] = swept[f"section_{name}"] / clearance
    relative = [ratios[f"section_relative_{name}"].values for name in ("x", "y")]
    ratios["period"] = xr.DataArray(periods(np.stack(relative, axis=-1)), dims=swept["result"].dims)
    return swept.assign({name: ratio.assign_attrs(units="1") for name, ratio in ratios.items()})


def periods(sections: np.ndarray) -> np.ndarray:
    """Return the number of points after which each section repeats; NaN if it does not.

    `sections`: (..., points, coordinates).
    """
    found = np.full(sections.shape[:-2], np.nan)
    for period in range(min(LONGEST_PERIOD, sections.shape[-2] // 2), 0, -1):
        apart = np.abs(sections[..., period:, :] - sections[..., :-period, :]).max(axis=(-2, -1))
        found[apart < REPEATS] = period
    return found


def run(output: Output) -> list[str]:
    """Run and draw both diagrams, the map and the orbits, and return the findings."""
    course = Course(1, 3) if output.quick else Course(120, 200)
    points, side = (4, 2) if output.quick else (192, 16)
    clearances, speeds = np.geomspace(*CLEARANCES, points), np.linspace(*SPEEDS, points)

    def swept(name: str, clearances: Any, speeds: Any) -> xr.Dataset:
        return course.sweep(clearances, speeds, output.store(name))

    over_clearance = swept("clearance", clearances, [SPEED]).isel(crank_speed=0)
    over_speed = swept("speed", [CLEARANCE], speeds).isel(clearance=0)
    both = swept("map", np.geomspace(*CLEARANCES, side), np.geomspace(*SPEEDS, side))
    output.save(bifurcations(over_clearance, over_speed), "bifurcation")
    output.save(map_of_peaks(both), "map")
    output.save(orbits(course.revolutions), "orbits")
    return findings(over_clearance, over_speed, both)


def bifurcations(over_clearance: xr.Dataset, over_speed: xr.Dataset) -> Figure:
    """Draw journal and slider once a revolution, over the clearance and over the crank speed."""
    figure = Figure(figsize=(11.0, 6.4), layout="constrained")
    channels = {
        "relative_y": "journal across the slider's path\n/ clearance",
        "acceleration_ratio": "slider acceleration\n/ ideal joint's",
    }
    columns = (
        (over_clearance, "clearance", f"{SPEED:g} revolutions a minute"),
        (over_speed, "crank_speed", f"radial clearance {CLEARANCE * 1e6:g} µm"),
    )
    panels = figure.subplots(2, 2, sharex="col")
    for column, (swept, axis, title) in zip(panels.T, columns, strict=True):
        for axes, (channel, label) in zip(column, channels.items(), strict=True):
            plot.bifurcation(swept, "section", channel, axis, axes=axes)
            axes.set_ylabel(label)
        column[0].set_xlabel("")
        column[0].set_title(title, fontsize="medium")
    return figure


def map_of_peaks(swept: xr.Dataset) -> Figure:
    """Draw the ratios of peaks to the ideal ones over clearance and crank speed."""
    figure = Figure(figsize=(10.0, 4.0), layout="constrained")
    for name, axes in zip(("acceleration", "moment"), figure.subplots(1, 2), strict=True):
        plot.parameter_map(swept, f"peak_{name}_over_ideal", "clearance", "crank_speed", axes=axes)
    return figure


def orbits(revolutions: int) -> Figure:
    """Draw the path of the journal in the last two revolutions."""
    figure = Figure(figsize=(11.0, 4.4), layout="constrained")
    for (clearance, speed), axes in zip(ORBITS, figure.subplots(1, 3), strict=True):
        settings = Settings(clearance, RESTITUTION, speed)
        shown = simulate(settings, clearance, revolutions).shown
        plot.orbit_in_contact(shown, PIN, "V", clearance, section=plot.XY, axes=axes)
        axes.get_legend().remove()
        axes.set_title(f"{clearance * 1e6:g} µm, {speed:g} 1/min", fontsize="medium")
    handles = figure.axes[0].get_legend_handles_labels()
    figure.legend(*handles, loc="outside lower center", ncols=3, frameon=False)
    return figure


def findings(over_clearance: xr.Dataset, over_speed: xr.Dataset, both: xr.Dataset) -> list[str]:
    """Return the findings, measured on the diagrams and the map."""
    failed = sum(int((swept["result"] != 0).sum()) for swept in (over_clearance, over_speed, both))
    acceleration = both["peak_acceleration_over_ideal"]
    periodic = acceleration.where(both["period"] == 1.0)
    peaks = {name: _range(both[f"peak_{name}_over_ideal"].values) for name in IDEAL}
    return [
        f"{failed} lanes failed",
        f"{SPEED:g} 1/min, clearance in µm: {stretches(over_clearance, 'clearance', 1e6)}",
        f"{CLEARANCE * 1e6:g} µm, speed in 1/min: {stretches(over_speed, 'crank_speed', 1.0)}",
        f"peaks over the ideal joint's on the map: {', '.join(map(' '.join, peaks.items()))}; "
        f"acceleration {_range(periodic.values)} where the motion has the crank's period",
        f"peak acceleration over the ideal one, from {IMPACTS_ALONE * 1e3:g} mm on where the "
        f"motion does not repeat: as the speed to the power {speed_exponent(both):.2f}; "
        "-0.80 by Hertz's law",
    ]


def speed_exponent(swept: xr.Dataset) -> float:
    """Return the exponent of the crank speed in the ratio of peak accelerations caused by impacts,
    by least squares together with that of the clearance.
    """
    impacting = ((swept["clearance"] >= IMPACTS_ALONE) & swept["period"].isnull()).values
    names = ("peak_acceleration_over_ideal", "crank_speed", "clearance")
    columns = xr.broadcast(*(swept[name] for name in names))
    ratio, speed, clearance = (np.log(column.values[impacting]) for column in columns)
    system = np.stack([speed, clearance, np.ones_like(speed)], axis=1)
    return float(np.linalg.lstsq(system, ratio, rcond=None)[0][0])


def _range(values: np.ndarray) -> str:
    finite = values[np.isfinite(values)]
    return f"{finite.min():.3g} to {finite.max():.3g}" if finite.size else "nowhere"


def stretches(swept: xr.Dataset, axis: str, factor: float) -> str:
    """Return the ranges of periodic motion and their periods, as text."""
    places, found = swept[axis].values * factor, np.nan_to_num(swept["period"].values)
    edges = [0, *(np.flatnonzero(np.diff(found)) + 1), len(found)]
    parts = [
        f"{places[a]:.4g}–{places[b - 1]:.4g} period {found[a]:.0f}"
        for a, b in zip(edges, edges[1:], strict=False)
        if found[a] and b - a > 2
    ]
    share = float((found > 0).mean())
    return f"{'; '.join(parts) or 'no stretch is periodic'} (periodic lanes: {share:.0%})"

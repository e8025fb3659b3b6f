"""What the size of the clearance does to the paper's double pendulum.

The double pendulum of P. Flores, J. Ambrosio, J. C. P. Claro and H. M. Lankarani, "Spatial revolute
joints with clearances for dynamic analysis of multi-body systems" (2006), section 6, over its
clearance, over clearance and restitution, and towards no clearance at all:

    python -m studies.clearance_sweep sweep | map | limit [--quick] [--output FOLDER]

Results are stored as they come; a command that was interrupted continues, and one that was finished
only draws again. `clearjoint.open_sweep` reads the stores, as does `notebooks/clearance_sweep.ipynb`.
"""

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image

import clearjoint as cj
from clearjoint import plot
from clearjoint.quantities import (
    Acceleration,
    ContactForce,
    JournalOffset,
    Penetration,
    PenetrationRate,
    Position,
)

SHOULDER, END_ARM, BASE = "shoulder", "arm 3", "V"
GRAVITY = 9.81
DURATION = 0.5
"""End of all runs, s."""
FREE_FALLS = 12.0
"""Length of the saved orbits, in times of the journal's first free fall to the wall."""
ORBITS = (0.05e-3, 0.2e-3, 1e-3)
"""Clearances whose orbits are drawn, m."""
MEDIAN = 15
PROPORTIONAL = (5e-6, 0.3e-3)
"""Clearances over which the deviation from the ideal joint is proportional to them, m."""
COMPLIANT = (0.1e-6, 1e-6)
"""Clearances smaller than the penetration, m."""


@dataclass(frozen=True)
class Settings:
    """The folder for stores and figures, and whether to take few lanes and coarse pictures."""

    output: Path = Path("results/clearance_sweep")
    quick: bool = False

    @property
    def folder(self) -> Path:
        """Where this setting's stores and figures go."""
        return self.output / "quick" if self.quick else self.output

    def store(self, name: str) -> Path:
        """The store of a sweep; says what is there already."""
        path = self.folder / f"{name}.zarr"
        if path.exists():
            done = cj.open_sweep(path)["result"].values != -1
            print(f"{path} is there, with {done.sum()} of {done.size} lanes: computing the others.")
        path.parent.mkdir(parents=True, exist_ok=True)
        return path

    def save(self, figure: Figure, name: str) -> None:
        """Write a picture with a palette of 64 colours, which makes it a third as large."""
        file = self.folder / f"{name}.png"
        figure.savefig(file, dpi=80 if self.quick else 130)
        with Image.open(file) as picture:
            small = picture.convert("RGB").quantize(64)
        small.save(file, optimize=True)


def clearance_axis(values: Any) -> cj.Axis:
    """Radial clearances of the shoulder, m."""
    return cj.Axis(lambda scene: scene.joints[SHOULDER].clearance, values)


def restitution_axis(values: Any) -> cj.Axis:
    """Restitutions requested of the shoulder's contact law."""
    return cj.Axis(lambda scene: scene.joints[SHOULDER].law.restitution, values)


def free_fall(clearance: Any) -> Any:
    """Time of the journal's first fall from the centre to the wall, s."""
    return np.sqrt(2.0 * clearance / GRAVITY)


def orbit_times(scene: cj.Scene) -> np.ndarray:
    """Instants of the first impacts, in proportion to a lane's free fall, s."""
    clearance: Any = scene.joints[SHOULDER]
    return np.linspace(0.0, FREE_FALLS * free_fall(float(clearance.clearance)), 1201)


SUMMARY: dict[str, Any] = {
    "peak_force": cj.Peak(ContactForce(SHOULDER), "N"),
    "peak_acceleration": cj.Peak(Acceleration(END_ARM), "m/s^2"),
    "impacts": cj.ImpactCount(SHOULDER),
    "dissipated_energy": cj.DissipatedEnergy(),
}
IMPACTS = cj.Section(
    Penetration(SHOULDER, BASE), {"entry_speed": (PenetrationRate(SHOULDER, BASE), "m/s")}, count=80
)
"""Poincaré section of an impact oscillator: the states in which a base meets the wall."""
ORBIT = cj.Saved(orbit_times, {c: (JournalOffset(SHOULDER, c, BASE), "m") for c in ("x", "y")})
"""Path of a base across the bearing."""


def sweep(settings: Settings) -> list[str]:
    """Summaries, impacts and orbits over the clearance; returns the findings."""
    scene, state = cj.double_pendulum()
    values = np.geomspace(0.05e-3, 1e-3, 16 if settings.quick else 256)
    swept = cj.sweep(
        scene,
        state,
        DURATION,
        {"clearance": clearance_axis(values)},
        {**SUMMARY, "impact": IMPACTS, "orbit": ORBIT},
        ledger=True,
        path=settings.store("sweep"),
        chunk=32,
    )
    in_free_falls(swept)
    settings.save(_summary(swept), "summary")
    settings.save(_impacts(swept), "impacts")
    settings.save(_orbits(swept), "orbits")
    return sweep_findings(swept)


def in_free_falls(swept: xr.Dataset) -> None:
    """Add entry speeds and times of the impacts over those of the first one, a free fall."""
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
        plot.orbit(lane, "orbit", radius, axes=axes)
        axes.invert_yaxis()
        last = FREE_FALLS * free_fall(radius)
        axes.set_title(f"{radius * 1e3:.2g} mm, first {last * 1e3:.0f} ms", fontsize="medium")
    return figure


def sweep_findings(swept: xr.Dataset) -> list[str]:
    """What the sweep over the clearance shows, measured on its results."""
    low, high = (swept.isel(clearance=index) for index in (0, -1))
    speeds = swept["impact_relative_entry_speed"].values
    first = np.abs(speeds[:, 0] - 1.0).max()
    power = {name: plot.power_law_exponent(swept, name) for name in SUMMARY}
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
        f"peak acceleration {float(low['peak_acceleration']):.0f} to "
        f"{float(high['peak_acceleration']):.0f} m/s², as c^{power['peak_acceleration']:.2f}; it is "
        f"that of the first impact in {float(early.mean()):.0%} of the lanes",
        f"impacts: {_range(swept['impacts'].values, '.0f')}, without a trend "
        f"(c^{power['impacts']:.2f})",
        f"dissipated energy {float(low['dissipated_energy']):.2g} to "
        f"{float(high['dissipated_energy']):.2g} J, about as c^{power['dissipated_energy']:.2f}",
    ]


def shared_impacts(speeds: np.ndarray) -> int:
    """How many impacts have the same relative entry speed at all clearances, within 5 %.

    `speeds`: (lanes, impacts).
    """
    spread = np.ptp(speeds, axis=0) / np.median(speeds, axis=0)
    return int(np.argmin(spread < 0.05))


def restitution_map(settings: Settings) -> list[str]:
    """Summaries over clearance and restitution; returns the findings."""
    scene, state = cj.double_pendulum()
    columns, rows = (6, 4) if settings.quick else (32, 24)
    swept = cj.sweep(
        scene,
        state,
        DURATION,
        {
            "clearance": clearance_axis(np.geomspace(0.05e-3, 1e-3, columns)),
            "restitution": restitution_axis(np.linspace(0.1, 1.0, rows)),
        },
        SUMMARY,
        ledger=True,
        path=settings.store("map"),
        chunk=64,
    )
    figure = Figure(figsize=(12.0, 3.6), layout="constrained")
    shown = ("peak_force", "impacts", "dissipated_energy")
    for name, axes in zip(shown, figure.subplots(1, 3), strict=True):
        plot.parameter_map(swept, name, "clearance", "restitution", axes=axes)
    settings.save(figure, "map")
    return map_findings(swept)


def map_findings(swept: xr.Dataset) -> list[str]:
    """What the map shows, measured on its results: medians over the clearances."""
    medians = swept[["peak_force", "impacts", "dissipated_energy"]].median("clearance")
    least, most = (medians.isel(restitution=index) for index in (0, -1))
    energy = medians["dissipated_energy"]
    largest = float(energy["restitution"][int(energy.argmax())])
    shift = np.abs(np.log(swept["peak_force"] / swept["peak_force"].mean("restitution"))).max()
    return [
        f"{int((swept['result'] != 0).sum())} of {swept['result'].size} lanes failed",
        f"medians over the clearances at restitution {float(least['restitution']):g} and "
        f"{float(most['restitution']):g}: {float(least['impacts']):.0f} and "
        f"{float(most['impacts']):.0f} impacts, peaks of {float(least['peak_force']) / 1e3:.3g} and "
        f"{float(most['peak_force']) / 1e3:.3g} kN",
        f"restitution shifts the peak force by {float(np.expm1(shift)):.0%} at most from its mean "
        "at the same clearance",
        f"dissipated energy is largest at restitution {largest:.2g} (median over the clearances "
        f"{float(energy.max()):.2g} J); at restitution 1 it is "
        f"{float(np.abs(most['dissipated_energy'])):.0e} J",
    ]


def limit(settings: Settings) -> list[str]:
    """Deviation of the end arm from that with an ideal joint; returns the findings.

    The largest over the whole run, by axial policy: only a journal that is held along the axis
    tends to the ideal revolute joint; a free one tends to a cylindrical joint.
    """
    swept = {
        "held axially": _deviations(settings, "limit held", cj.FixedAxially()),
        "free axially (the paper)": _deviations(settings, "limit free", cj.FreeAxially()),
    }
    figure = Figure(figsize=(6.4, 4.6), layout="constrained")
    axes = figure.subplots()
    for (label, dataset), colour in zip(swept.items(), ("#0072B2", "#D55E00"), strict=True):
        plot.convergence(
            dataset, "deviation", within=PROPORTIONAL, label=label, colour=colour, axes=axes
        )
    _mark_compliance(swept["held axially"], axes)
    settings.save(figure, "limit")
    return limit_findings(*swept.values())


def _deviations(settings: Settings, name: str, axial: Any) -> xr.Dataset:
    times = np.linspace(0.0, DURATION, 251)
    ideal = cj.simulate(*cj.double_pendulum(None), DURATION, save_at=times, rtol=1e-10).saved
    assert ideal is not None
    scene, state = cj.double_pendulum(axial=axial)
    swept = cj.sweep(
        scene,
        state,
        DURATION,
        {"clearance": clearance_axis(np.geomspace(1e-7, 1e-3, 13 if settings.quick else 65))},
        {
            "path": cj.Saved(times, {c: (Position(END_ARM, c), "m") for c in "xyz"}),
            "penetration": cj.Peak(Penetration(SHOULDER, BASE), "m"),
        },
        path=settings.store(name),
        chunk=16,
    )
    path = np.stack([swept[f"path_{c}"].values for c in "xyz"], axis=-1)
    away = np.linalg.norm(path - np.asarray(ideal.states.bodies[END_ARM].position), axis=-1)
    swept["deviation"] = ("clearance", away.max(axis=1), {"units": "m"})
    return swept


def _mark_compliance(swept: xr.Dataset, axes: Axes) -> None:
    """A line where the penetration equals the clearance."""
    equal = equal_penetration(swept)
    axes.axvline(equal * 1e3, color="0.5", linewidth=1.0, linestyle="--")
    axes.annotate(
        "penetration = clearance",
        (equal * 1e3, 0.97),
        xycoords=("data", "axes fraction"),
        xytext=(-4, 0),
        textcoords="offset points",
        rotation=90,
        ha="right",
        va="top",
        color="0.4",
    )


def equal_penetration(swept: xr.Dataset) -> float:
    """Clearance at which the largest penetration is as large, m."""
    ratio = np.log(swept["penetration"] / swept["clearance"]).values
    return float(np.exp(np.interp(0.0, -ratio, np.log(swept["clearance"].values))))


def limit_findings(held: xr.Dataset, free: xr.Dataset) -> list[str]:
    """What the limit shows, measured on the deviations."""
    exponent = plot.power_law_exponent
    low, high = (value * 1e6 for value in PROPORTIONAL)
    compliant = exponent(held, "deviation", within=COMPLIANT)
    left = float(free["deviation"][0])
    return [
        f"held axially, the deviation over {DURATION} s goes with c^"
        f"{exponent(held, 'deviation', within=PROPORTIONAL):.2f} from {low:g} to {high:g} µm, and "
        f"is {float((held['deviation'] / held['clearance']).median()):.0f} clearances (median)",
        f"below {equal_penetration(held) * 1e6:.1f} µm the wall gives way by more than the "
        f"clearance, and it goes with c^{compliant:.2f} (penetration at constant load: c^0.33)",
        f"at 1 mm it is {float(held['deviation'][-1]) * 1e3:.0f} mm and levels off: the run ends "
        "before the journal has tilted across the clearance",
        f"free axially it tends to {left * 1e3:.0f} mm, not to zero: the arm slides along the "
        "journal, and the limit is a cylindrical joint",
    ]


def _range(values: np.ndarray, form: str) -> str:
    return f"{np.nanmin(values):{form}} to {np.nanmax(values):{form}}"


COMMANDS: dict[str, Callable[[Settings], list[str]]] = {
    "sweep": sweep,
    "map": restitution_map,
    "limit": limit,
}


def main(arguments: list[str] | None = None) -> None:
    """Run one command, and print its findings."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("command", choices=COMMANDS)
    parser.add_argument("--quick", action="store_true", help="few lanes and coarse pictures")
    parser.add_argument("--output", type=Path, default=Settings.output, help="folder")
    chosen = parser.parse_args(arguments)
    settings = Settings(chosen.output, chosen.quick)
    cj.configure()
    try:
        findings = COMMANDS[chosen.command](settings)
    except ValueError as error:
        raise SystemExit(f"error: {error}") from error
    print("\n".join(f"- {line}" for line in findings))
    print(f"Figures and stores: {settings.folder}")


if __name__ == "__main__":
    main()

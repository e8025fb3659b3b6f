"""Slider-crank at constant speed, with clearance and ideal: runs, figures and table."""

from dataclasses import dataclass

import jax
import numpy as np
from matplotlib.figure import Figure

import clearjoint as cj
from clearjoint import plot
from studies.common.output import Output

PIN, BASES = "slider pin", ("V", "W")
SHOWN = 2
"""Number of revolutions drawn, at the end of the run."""
INSTANTS = 1500
"""Number of instants saved in each of them."""


@dataclass(frozen=True)
class Settings:
    """Numbers of the simulation in SI units, except the crank speed in 1/min."""

    clearance: float = 0.5e-3
    restitution: float = 0.9
    revolutions_a_minute: float = 5000.0
    revolutions: int = 500
    rtol: float = 1e-6

    @property
    def speed(self) -> float:
        """Speed of the crank, rad/s."""
        return self.revolutions_a_minute * np.pi / 30.0

    @property
    def period(self) -> float:
        """Duration of a revolution, s."""
        return 2.0 * np.pi / self.speed


@dataclass(frozen=True)
class Run:
    """Observation and slider over the last revolutions, and once in every revolution."""

    shown: cj.results.Observation
    strobe: cj.results.Observation
    slider: cj.BodyState
    strobe_slider: cj.BodyState
    impacts: cj.results.Impacts | None

    @property
    def acceleration(self) -> np.ndarray:
        """Acceleration of the slider along X, m/s^2."""
        return self.shown.accelerations["slider"].linear[:, 0]

    @property
    def moment(self) -> np.ndarray:
        """Moment on the crank, N m."""
        return self.shown.reactions["motor"]["crank"].moment[:, 2]


@dataclass(frozen=True)
class Findings:
    """Closed-form values and results of the ideal joint, and ratios of peaks to the ideal ones.

    `table`: these and further effects of the clearance as text.
    """

    ideal: dict[str, tuple[float, float]]
    peak_ratios: dict[str, float]
    table: str


def run(settings: Settings, output: Output) -> Findings:
    """Simulate both mechanisms, write figures and table, and return the findings."""
    clearance = simulate(settings, settings.clearance, settings.revolutions)
    ideal = simulate(settings, None, SHOWN)
    for name, figure in {
        "motion": motion(settings, clearance, ideal),
        "orbit": orbit(settings, clearance),
        "poincare": poincare(settings, clearance),
    }.items():
        output.save(figure, name)
    found = find(settings, clearance, ideal)
    output.file("table.md").write_text(found.table, encoding="utf-8")
    return found


def simulate(settings: Settings, clearance: float | None, revolutions: int) -> Run:
    """Simulate a number of revolutions from the ideal motion at angle zero."""
    scene, state = cj.mechanisms.slider_crank(clearance, settings.restitution, speed=settings.speed)
    revolution = np.arange(1, revolutions - SHOWN)
    last = revolutions - SHOWN + np.linspace(0.0, SHOWN, SHOWN * INSTANTS + 1)
    solution = cj.simulate(
        scene,
        state,
        revolutions * settings.period,
        cj.Settings(rtol=settings.rtol, ledger=True),
        save=cj.Saving(
            settings.period * np.concatenate([revolution, last]), impacts=clearance is not None
        ),
    )
    shown = slice(len(revolution), None)
    once = np.concatenate([revolution - 1, len(revolution) + INSTANTS * np.arange(SHOWN + 1)])
    cycle, strobe = _part(solution, shown), _part(solution, once)
    return Run(
        cj.observe(scene, solution, cycle),
        cj.observe(scene, solution, strobe),
        cycle.states.bodies["slider"],
        strobe.states.bodies["slider"],
        solution.impacts,
    )


def _part(solution: cj.results.Solution, rows: slice | np.ndarray) -> cj.results.Trajectory:
    return jax.tree.map(lambda leaf: leaf[rows], solution.saved)


def motion(settings: Settings, clearance: Run, ideal: Run) -> Figure:
    """Draw slider and crank moment over the crank angle, with and without clearance."""
    figure = Figure(figsize=(10.0, 7.0), layout="constrained")
    panels = figure.subplots(2, 2, sharex=True)
    label = f"clearance {settings.clearance * 1e3:g} mm"
    runs = {label: clearance, "ideal joint": ideal}
    quantities = {
        "slider position, mm": lambda run: run.slider.position[:, 0] * 1e3,
        "slider velocity, m/s": lambda run: run.slider.velocity[:, 0],
        "slider acceleration, km/s²": lambda run: run.acceleration * 1e-3,
        "crank moment, N m": lambda run: run.moment,
    }
    for axes, (quantity, values) in zip(panels.flat, quantities.items(), strict=True):
        curves = {name: (_angle(settings, run), values(run)) for name, run in runs.items()}
        plot.over_angle(curves, quantity, axes=axes)
    for axes in panels[0]:
        axes.set_xlabel("")
    handles = panels[0, 0].get_legend_handles_labels()
    figure.legend(*handles, loc="outside upper center", ncols=2, frameon=False)
    return figure


def _angle(settings: Settings, run: Run) -> np.ndarray:
    """Return the crank angle since the first drawn instant, rad."""
    return settings.speed * (run.shown.times - run.shown.times[0])


def orbit(settings: Settings, clearance: Run) -> Figure:
    """Draw the orbit of the journal in the bearing, whose axes stay parallel to the global ones."""
    figure = Figure(figsize=(4.8, 5.0), layout="constrained")
    axes = figure.subplots()
    plot.orbit_in_contact(clearance.shown, PIN, "V", settings.clearance, section=plot.XY, axes=axes)
    return figure


def poincare(settings: Settings, clearance: Run) -> Figure:
    """Draw the positions of slider and journal once a revolution, at the outer dead centre of the
    ideal slider.
    """
    figure = Figure(figsize=(10.0, 4.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    velocity = clearance.strobe_slider.velocity[:, 0]
    acceleration = clearance.strobe.accelerations["slider"].linear[:, 0] * 1e-3
    labels = ("slider velocity, m/s", "slider acceleration, km/s²")
    plot.poincare_map(velocity, acceleration, labels, axes=left)
    x, y = plot.eccentricity_vectors(clearance.strobe, PIN, "V", plot.XY).T * 1e3
    labels = ("eccentricity along X, mm", "eccentricity along Y, mm")
    plot.poincare_map(x, y, labels, axes=right)
    plot.clearance_circle(right, settings.clearance)
    title = f"once a revolution at crank angle 0, {len(velocity)} revolutions, later ones darker"
    figure.suptitle(title, fontsize=11)
    return figure


def closed_form(settings: Settings) -> dict[str, float]:
    """Return the extremes of the ideal mechanism in closed form; the moment is the rate of the
    kinetic energy over the speed.
    """
    angle = np.linspace(0.0, 2.0 * np.pi, 200_001)
    r, l, w = cj.mechanisms.CRANK_LENGTH, cj.mechanisms.ROD_LENGTH, settings.speed
    scene, _ = cj.mechanisms.slider_crank(None)
    rod, slider = scene.bodies["rod"], scene.bodies["slider"]
    tilt = np.arcsin(r * np.sin(angle) / l)
    tilt_rate = r * np.cos(angle) / (l * np.cos(tilt))
    velocity = -r * np.sin(angle) - l * np.sin(tilt) * tilt_rate
    centre = -r * np.sin(angle) - 0.5 * l * np.sin(tilt) * tilt_rate, 0.5 * r * np.cos(angle)
    inertia = slider.mass * velocity**2 + rod.mass * (centre[0] ** 2 + centre[1] ** 2)
    inertia = inertia + rod.inertia[2] * tilt_rate**2
    return {
        "outer": r * w**2 * (1.0 + r / l),
        "inner": r * w**2 * (1.0 - r / l),
        "velocity": w * np.abs(velocity).max(),
        "stroke": 2.0 * r,
        "force": float(slider.mass) * r * w**2 * (1.0 + r / l),
        "moment": 0.5 * w**2 * np.gradient(inertia, angle).max(),
    }


def find(settings: Settings, clearance: Run, ideal: Run) -> Findings:
    """Compare the ideal joint with the closed form, and the clearance with the ideal joint."""
    exact = closed_form(settings)
    position, velocity = ideal.slider.position[:, 0], ideal.slider.velocity[:, 0]
    force = np.linalg.norm(ideal.shown.reactions[PIN]["rod"].force, axis=1)
    values = {
        "slider acceleration, outer dead centre, m/s²": (exact["outer"], -ideal.acceleration[0]),
        "slider acceleration, inner dead centre, m/s²": (
            exact["inner"],
            ideal.acceleration[INSTANTS // 2],
        ),
        "largest slider velocity, m/s": (exact["velocity"], np.abs(velocity).max()),
        "stroke, m": (exact["stroke"], np.ptp(position)),
        "largest pin force, N": (exact["force"], force.max()),
        "largest crank moment, N m": (exact["moment"], ideal.moment.max()),
    }
    pin_force = sum(clearance.shown.contacts[PIN][base].normal_force for base in BASES)
    peaks = {
        "slider acceleration": (clearance.acceleration, ideal.acceleration),
        "crank moment": (clearance.moment, ideal.moment),
        "pin force": (pin_force, force),
    }
    ratios = {
        name: _largest(found) / _largest(expected) for name, (found, expected) in peaks.items()
    }
    lines = ["| Ideal joint | closed form | found |", "|---|---|---|"]
    lines += [
        f"| {name} | {expected:.6g} | {found:.6g} |" for name, (expected, found) in values.items()
    ]
    lines += ["", f"| Clearance {settings.clearance * 1e3:g} mm | |", "|---|---|"]
    lines += [f"| peak {name} over the ideal one | {ratio:.3g} |" for name, ratio in ratios.items()]
    lines += [f"| {name} | {value} |" for name, value in _effects(clearance, ideal)]
    return Findings(values, ratios, "\n".join(lines) + "\n")


def _effects(clearance: Run, ideal: Run) -> list[tuple[str, str]]:
    shown, impacts = clearance.shown, clearance.impacts
    assert impacts is not None
    onsets = impacts.of(PIN, "V").onset
    strikes = np.count_nonzero((onsets >= shown.times[0]) & (onsets < shown.times[-1]))
    touching = shown.modes[PIN] != cj.results.MotionMode.FREE_FLIGHT
    losses = shown.energies["normal damping"]
    offset = np.abs(clearance.slider.position[:, 0] - ideal.slider.position[:, 0]).max()
    return [
        ("largest distance of the slider from its ideal motion", f"{offset * 1e3:.4f} mm"),
        ("impacts a revolution", f"{strikes / SHOWN:g}"),
        ("fraction of the time in contact", f"{touching.mean():.0%}"),
        ("energy lost a revolution", f"{(losses[-1] - losses[0]) / SHOWN:.3g} J"),
        (
            "change of the energy error",
            f"{np.ptp(shown.ledger_residual()):.1g} J",
        ),
    ]


def _largest(values: np.ndarray) -> float:
    vectors = values.reshape(len(values), -1)
    return float(np.linalg.norm(vectors, axis=1).max())

"""The paper's demonstration: a double pendulum with a clearance joint, against an ideal one.

Draws figures 13 to 17 of P. Flores, J. Ambrosio, J. C. P. Claro and H. M. Lankarani, "Spatial
revolute joints with clearances for dynamic analysis of multi-body systems" (2006), section 6,
animates the journal, and sets the paper's statements beside what came out:

    python -m studies.double_pendulum
    python -m studies.double_pendulum --quick
"""

import argparse
from dataclasses import dataclass
from pathlib import Path

import diffrax
import numpy as np
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

import clearjoint as cj
from clearjoint import plot
from studies.output import save_picture

SOLVERS = {
    "bosh3": diffrax.Bosh3,
    "tsit5": diffrax.Tsit5,
    "dopri5": diffrax.Dopri5,
    "dopri8": diffrax.Dopri8,
}
SHOULDER, ELBOW, ARM, END_ARM = "shoulder", "elbow", "arm 2", "arm 3"
UPWARDS = {"X": (1.0, 0.0, 0.0), "−Y (upwards)": (0.0, -1.0, 0.0)}
SAVED = 4001
"""Instants saved in every run: always as many, so that all runs share one compiled program."""
IMPACT_INSTANTS, EARLY_INSTANTS = 200, 1400
QUICK_DURATION = 0.25


@dataclass(frozen=True)
class Settings:
    """What to simulate, in SI units, and the folder for the results."""

    clearance: float = 0.5e-3
    restitution: float = 0.9
    solver: str = "tsit5"
    rtol: float = 1e-6
    duration: float = 4.0
    output: Path = Path("results/double_pendulum")
    quick: bool = False

    @property
    def early(self) -> float:
        """End of the first instants, s: twelve times the journal's free fall to the wall."""
        return min(12.0 * (2.0 * self.clearance / 9.81) ** 0.5, self.duration)


@dataclass(frozen=True)
class Run:
    """One simulation: states and observation at the saved instants, observation along every
    accepted step, and the finished contacts."""

    trajectory: cj.Trajectory
    saved: cj.Observation
    steps: cj.Observation
    impacts: cj.Impacts

    def of(self, base: str) -> cj.Impacts:
        """The impacts of one base."""
        return self.impacts.of(SHOULDER, base)


@dataclass(frozen=True)
class Findings:
    """What the study finds, in SI units; arrays hold one entry an impact.

    - `reaction_share`: peak of the elbow's reaction over the peak force at base V, first impact.
    - `peak_forces`: N at base V, first four impacts. `peak_reactions`: N at the elbow,
      `loop_energies`: J and `rebounds`: m at base V, first three.
    - `onset_gaps`: s between the bases' onsets of the same impact, until one base strikes alone.
    - `lone_strike`: s, begin of the first contact during which the other base stays in flight.
    - `acceleration`, `ideal_acceleration`: m/s^2, largest of the end arm's centre along Y.
    - `slides`: m along the bearing, by instant in s.
    - `dissipated`, `ledger_residual`: J, at the end. `contact_share`: of the duration.
    - `impacts`: number of finished contacts, both bases.
    """

    reaction_share: float
    peak_forces: np.ndarray
    peak_reactions: np.ndarray
    loop_energies: np.ndarray
    rebounds: np.ndarray
    onset_gaps: np.ndarray
    lone_strike: float | None
    acceleration: float
    ideal_acceleration: float
    slides: dict[float, float]
    dissipated: float
    ledger_residual: float
    contact_share: float
    impacts: int


def run(settings: Settings) -> Findings:
    """Simulate both pendulums, write all figures into the output folder, and return the findings.

    **Raises:** `ValueError` if the duration is too short for three impacts.
    """
    clearance, ideal = simulate_clearance(settings), simulate_ideal(settings)
    settings.output.mkdir(parents=True, exist_ok=True)
    for name, figure in figures(settings, clearance, ideal).items():
        save_picture(figure, settings.output / f"{name}.png", 100 if settings.quick else 150)
    plot.animate_journal(
        clearance.saved,
        SHOULDER,
        settings.clearance,
        settings.output / "journal.gif",
        _animated_instants(settings, clearance),
        section=UPWARDS,
    )
    findings = find(settings, clearance, ideal)
    (settings.output / "claims.md").write_text(report(findings), encoding="utf-8")
    return findings


def simulate_clearance(settings: Settings) -> Run:
    """The pendulum with clearance; a first pass over the early part tells where impacts are."""
    scene, state = cj.double_pendulum(settings.clearance, settings.restitution)
    early = _simulate(settings, scene, state, np.linspace(0.0, settings.early, SAVED))
    assert early.impacts is not None
    impacts = early.impacts.of(SHOULDER, "V")
    if len(impacts) < 3:
        raise ValueError(
            f"duration = {settings.duration} s holds {len(impacts)} impacts of base V, but the "
            "figures show three: raise --duration."
        )
    return _observed(scene, _simulate(settings, scene, state, _instants(settings, impacts)))


def simulate_ideal(settings: Settings) -> Run:
    """The pendulum with an ideal joint in place of the clearance joint."""
    scene, state = cj.double_pendulum(clearance=None)
    instants = np.linspace(0.0, settings.duration, SAVED)
    return _observed(scene, _simulate(settings, scene, state, instants))


def _simulate(
    settings: Settings, scene: cj.Scene, state: cj.State, instants: np.ndarray
) -> cj.Solution:
    return cj.simulate(
        scene,
        state,
        instants[-1],
        save_at=instants,
        rtol=settings.rtol,
        solver=SOLVERS[settings.solver](),
        ledger=True,
        record_steps=True,
        record_impacts=True,
    )


def _observed(scene: cj.Scene, solution: cj.Solution) -> Run:
    assert solution.saved is not None and solution.impacts is not None
    return Run(
        trajectory=solution.saved,
        saved=cj.observe(scene, solution),
        steps=cj.observe(scene, solution, solution.steps),
        impacts=solution.impacts,
    )


def _instants(settings: Settings, impacts: cj.Impacts) -> np.ndarray:
    """Instants to save: close together in the first three impacts, wide apart in the late part."""
    spans = zip(impacts.onset[:3], impacts.separation[:3], strict=True)
    inside = [np.linspace(*span, IMPACT_INSTANTS) for span in spans]
    early = np.linspace(0.0, settings.early, EARLY_INSTANTS)
    late_count = SAVED - EARLY_INSTANTS - 3 * IMPACT_INSTANTS
    late = np.linspace(settings.early, settings.duration, late_count)
    return np.sort(np.concatenate([early, late, *inside]))


def figures(settings: Settings, clearance: Run, ideal: Run) -> dict[str, Figure]:
    """The paper's figures by file name, and the orbit of the journal."""
    return {
        "figure_13": _figure_13(clearance),
        "figure_14": _figure_14(settings, clearance, ideal),
        "figure_15": _figure_15(settings, clearance, ideal),
        "figure_16": _figure_16(settings, clearance),
        "figure_17": plot.journal_frames(
            clearance.saved,
            SHOULDER,
            settings.clearance,
            _frame_instants(clearance),
            section=UPWARDS,
        ),
        "orbit": _orbit(settings, clearance),
    }


def _figure_13(clearance: Run) -> Figure:
    figure = Figure(figsize=(10.0, 4.0), layout=ConstrainedLayoutEngine(wspace=0.05))
    left, right = figure.subplots(1, 2)
    impacts = clearance.of("V")
    margin = 0.2 * impacts.duration[0]
    plot.contact_and_reaction(
        clearance.saved,
        (SHOULDER, "V"),
        (ELBOW, END_ARM),
        axes=left,
        window=(impacts.onset[0] - margin, impacts.separation[0] + margin),
    )
    plot.hysteresis(clearance.saved, impacts, axes=right)
    left.set_title("(a) first impact")
    right.set_title("(b) first three impacts, base V")
    return figure


def _labels(settings: Settings) -> tuple[str, str]:
    return f"clearance {settings.clearance * 1e3:g} mm", "ideal joint"


def _figure_14(settings: Settings, clearance: Run, ideal: Run) -> Figure:
    figure = Figure(figsize=(10.0, 4.0), layout=ConstrainedLayoutEngine(wspace=0.05))
    left, right = figure.subplots(1, 2)
    with_clearance, without = _labels(settings)
    trajectories = {with_clearance: clearance.trajectory, without: ideal.trajectory}
    plot.position(trajectories, END_ARM, axes=left)
    observations = {with_clearance: clearance.steps, without: ideal.saved}
    plot.acceleration(observations, END_ARM, axes=right)
    left.set_title("(a)", loc="left")
    right.set_title("(b)", loc="left")
    return figure


def _figure_15(settings: Settings, clearance: Run, ideal: Run) -> Figure:
    figure = Figure(figsize=(9.0, 4.4), layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    runs = zip(_labels(settings), (clearance, ideal), strict=True)
    trajectories = {label: run.trajectory for label, run in runs}
    window = (0.0, min(3.0, settings.duration))
    for axes, across in zip(panels, ("X", "Z"), strict=True):
        plot.path(trajectories, END_ARM, (across, "Y"), window=window, axes=axes)
        axes.plot(0.0, 0.0, "k+", markersize=9, label="bearing")
        axes.label_outer()
    panels[0].invert_yaxis()
    panels[0].get_gridspec().set_width_ratios([np.ptp(axes.get_xlim()) for axes in panels])
    panels[0].set_title("view along Z, the shoulder's axis")
    panels[1].set_title("view along X")
    curves = panels[0].get_legend_handles_labels()
    figure.legend(*curves, loc="outside lower center", ncols=4, frameon=False)
    return figure


def _figure_16(settings: Settings, clearance: Run) -> Figure:
    figure = Figure(figsize=(8.0, 3.6), layout="constrained")
    plot.eccentricities(
        clearance.saved,
        SHOULDER,
        settings.clearance,
        window=(0.0, settings.early),
        axes=figure.subplots(),
    )
    return figure


def _orbit(settings: Settings, clearance: Run) -> Figure:
    figure = Figure(figsize=(4.8, 5.0), layout="constrained")
    plot.journal_orbit(
        clearance.saved,
        SHOULDER,
        settings.clearance,
        section=UPWARDS,
        window=(0.0, settings.early),
        axes=figure.subplots(),
    )
    return figure


def _frame_instants(clearance: Run) -> np.ndarray:
    """The start, and eight strikes of the journal with the rebounds between them."""
    peaks = np.sort(clearance.impacts.peak_time)
    apart = np.diff(peaks, prepend=0.0) > 0.1 * peaks[0]
    strikes = peaks[apart][:8]
    rebounds = 0.5 * (strikes[:-1] + strikes[1:])
    return np.sort(np.concatenate([[0.0], strikes, rebounds]))


def _animated_instants(settings: Settings, clearance: Run) -> np.ndarray:
    """Even steps through the first instants, and a halt of a few frames at every strike."""
    frames, halt = (16, 1) if settings.quick else (100, 3)
    peaks = clearance.impacts.peak_time
    strikes = np.repeat(peaks[peaks < settings.early], halt)
    return np.sort(np.concatenate([np.linspace(0.0, settings.early, frames), strikes]))


def find(settings: Settings, clearance: Run, ideal: Run) -> Findings:
    """Evaluate everything that the paper states and leaves open."""
    impacts, saved, steps = clearance.of("V"), clearance.saved, clearance.steps
    reactions = [_peak_reaction(saved, impacts, k) for k in range(3)]
    touching = steps.modes[SHOULDER][:-1] != cj.MotionMode.FREE_FLIGHT
    end = settings.duration
    return Findings(
        reaction_share=reactions[0] / impacts.peak_force[0],
        peak_forces=impacts.peak_force[:4],
        peak_reactions=np.array(reactions),
        loop_energies=np.array([plot.enclosed_energy(saved, impacts, k) for k in range(3)]),
        rebounds=_rebounds(settings, saved, impacts),
        onset_gaps=_onset_gaps(clearance),
        lone_strike=_lone_strike(clearance),
        acceleration=_largest_acceleration(steps),
        ideal_acceleration=_largest_acceleration(ideal.saved),
        slides={t: _slide(saved, t) for t in (0.1, 0.2, end) if t <= end},
        dissipated=float(steps.energies["normal damping"][-1]),
        ledger_residual=float(steps.ledger_residual()[-1]),
        contact_share=float(np.diff(steps.times)[touching].sum() / end),
        impacts=len(clearance.impacts),
    )


def _peak_reaction(seen: cj.Observation, impacts: cj.Impacts, index: int) -> float:
    during = (seen.times >= impacts.onset[index]) & (seen.times <= impacts.separation[index])
    return float(np.linalg.norm(seen.reactions[ELBOW][END_ARM].force[during], axis=1).max())


def _rebounds(settings: Settings, seen: cj.Observation, impacts: cj.Impacts) -> np.ndarray:
    """How far base V leaves the wall after each of the first impacts, m."""
    eccentricity = np.asarray(seen.contacts[SHOULDER]["V"].eccentricity)
    flights = zip(impacts.separation[:3], impacts.onset[1:4], strict=False)
    between = [(seen.times >= begin) & (seen.times <= end) for begin, end in flights]
    return np.array([settings.clearance - eccentricity[flight].min() for flight in between])


def _onset_gaps(run: Run) -> np.ndarray:
    """Time between the onsets of both bases in the impacts that they share, s."""
    v, w = run.of("V"), run.of("W")
    count = min(len(v), len(w))
    shared = (v.onset[:count] < w.separation[:count]) & (w.onset[:count] < v.separation[:count])
    first = count if shared.all() else int(np.argmin(shared))
    return np.abs(v.onset[:first] - w.onset[:first])


def _lone_strike(run: Run) -> float | None:
    v, w = run.of("V"), run.of("W")
    strikes = [
        float(onset)
        for one, other in ((v, w), (w, v))
        for onset, separation in zip(one.onset, one.separation, strict=True)
        if not np.any((other.onset < separation) & (onset < other.separation))
    ]
    return min(strikes, default=None)


def _largest_acceleration(seen: cj.Observation) -> float:
    return float(np.abs(seen.accelerations[END_ARM].linear[:, 1]).max())


def _slide(seen: cj.Observation, instant: float) -> float:
    """Axial displacement of the journal's centre, m: the mean of its bases'."""
    bases = seen.contacts[SHOULDER].values()
    axial = np.mean([base.point_on_journal[:, 2] for base in bases], axis=0)
    return float(np.interp(instant, seen.times, axial))


def report(findings: Findings) -> str:
    """The paper's statements against the findings, as a Markdown table."""
    rows = [("The paper says", "Found"), *_stated(findings), *_left_open(findings)]
    width = max(len(left) for left, _ in rows)
    lines = [f"| {left:<{width}} | {right} |" for left, right in rows]
    return "\n".join([lines[0], f"|{'-' * (width + 2)}|---|", *lines[1:]]) + "\n"


def _stated(found: Findings) -> list[tuple[str, str]]:
    ratio = found.acceleration / found.ideal_acceleration
    gaps = ", ".join(f"{gap * 1e6:.3g}" for gap in found.onset_gaps)
    rising = found.peak_forces[3:][found.peak_forces[3:] > found.peak_forces[2]]
    alone = "not in this run" if found.lone_strike is None else f"{found.lone_strike * 1e3:.1f} ms"
    return [
        (
            "The elbow's reaction is about 50 % of the contact force",
            f"{found.reaction_share:.1%} of the force at one base: {found.peak_reactions[0]:.0f} N "
            f"of {found.peak_forces[0]:.0f} N, first impact",
        ),
        (
            "The contact force decreases from impact to impact",
            f"{_list(found.peak_forces[:3], '.0f')} N at base V in the first three"
            + "".join(f", but {force:.0f} N in the fourth" for force in rising),
        ),
        (
            "Each impact dissipates energy: the area of its hysteresis loop",
            f"{_list(found.loop_energies * 1e3, '.3g')} mJ at base V",
        ),
        ("The first impacts of both bases coincide", f"onsets differ by {gaps} µs"),
        ("Then only one base touches at a time", f"first strike of one base alone: {alone}"),
        ("Rebounds get lower", f"{_list(found.rebounds * 1e3, '.3f')} mm off the wall"),
        (
            "Impacts make very high acceleration peaks",
            f"{found.acceleration:.0f} m/s² against {found.ideal_acceleration:.1f} m/s² with the "
            f"ideal joint: {ratio:.0f} times",
        ),
    ]


def _left_open(found: Findings) -> list[tuple[str, str]]:
    slides = ", ".join(f"{slide * 1e3:.3g} mm by {t:g} s" for t, slide in found.slides.items())
    return [
        ("(left open) Nothing holds arm 2 along the journal's axis", f"it slides {slides}"),
        (
            "(left open) Energy dissipated at the joint",
            f"{found.dissipated:.3g} J; the ledger closes to {abs(found.ledger_residual):.1g} J",
        ),
        (
            "(left open) How long the bases touch",
            f"{found.contact_share:.0%} of the time, in {found.impacts} contacts",
        ),
    ]


def _list(values: np.ndarray, form: str) -> str:
    return ", ".join(f"{value:{form}}" for value in values)


def parse(arguments: list[str] | None) -> Settings:
    """The settings from a command line."""
    default = Settings()
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--quick", action="store_true", help="short run and coarse pictures")
    parser.add_argument("--clearance", type=float, default=default.clearance, help="radial, m")
    parser.add_argument("--restitution", type=float, default=default.restitution)
    parser.add_argument("--solver", choices=sorted(SOLVERS), default=default.solver)
    parser.add_argument("--rtol", type=float, default=default.rtol, help="relative tolerance")
    parser.add_argument(
        "--duration", type=float, help=f"s; {default.duration:g}, quick {QUICK_DURATION:g}"
    )
    parser.add_argument("--output", type=Path, default=default.output, help="folder")
    chosen = vars(parser.parse_args(arguments))
    if chosen["duration"] is None:
        chosen["duration"] = QUICK_DURATION if chosen["quick"] else default.duration
    return Settings(**chosen)


def main(arguments: list[str] | None = None) -> None:
    """Run the study from a command line, and print its table."""
    settings = parse(arguments)
    cj.configure()
    try:
        print(report(run(settings)))
    except ValueError as error:
        raise SystemExit(f"error: {error}") from error
    print(
        "The motion is chaotic: from about 0.15 s on (0.5 mm, 0.9), what depends on single impacts "
        "holds for this run only."
    )
    print(f"Figures, animation and table: {settings.output}")


if __name__ == "__main__":
    main()

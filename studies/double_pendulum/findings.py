"""Comparison of the paper's statements with the results."""

from dataclasses import dataclass

import numpy as np

import clearjoint as cj
from clearjoint import plot
from studies.double_pendulum.runs import ELBOW, END_ARM, SHOULDER, Run, Settings


@dataclass(frozen=True)
class Findings:
    """Results in SI units; arrays have one entry for each impact.

    - `reaction_share`: peak of the elbow's reaction over the peak force at base V, first impact.
    - `peak_forces`: of the first four impacts at base V, N. `peak_reactions`: of the first three at
      the elbow, N.
    - `loop_energies`, `rebounds`: of the first three impacts at base V, J and m.
    - `onset_gaps`: time between the bases' onsets of the same impact, s, until one base strikes
      alone.
    - `lone_strike`: begin of the first contact during which the other base is in flight, s.
    - `acceleration`, `ideal_acceleration`: largest of the end arm's centre along Y, m/s^2.
    - `slides`: displacement along the bearing, m, by time in s.
    - `dissipated`, `ledger_residual`: at the end, J. `contact_share`: fraction of the duration.
    - `impacts`: number of finished contacts of both bases.
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


def find(settings: Settings, clearance: Run, ideal: Run) -> Findings:
    """Evaluate the paper's statements, and the quantities that it leaves open."""
    impacts, saved, steps = clearance.of("V"), clearance.saved, clearance.steps
    reactions = [_peak_reaction(saved, impacts, k) for k in range(3)]
    touching = steps.modes[SHOULDER][:-1] != cj.results.MotionMode.FREE_FLIGHT
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


def _peak_reaction(
    observation: cj.results.Observation, impacts: cj.results.Impacts, index: int
) -> float:
    during = (observation.times >= impacts.onset[index]) & (
        observation.times <= impacts.separation[index]
    )
    return float(np.linalg.norm(observation.reactions[ELBOW][END_ARM].force[during], axis=1).max())


def _rebounds(
    settings: Settings, observation: cj.results.Observation, impacts: cj.results.Impacts
) -> np.ndarray:
    """Return the distance of base V from the wall after each of the first impacts, m."""
    eccentricity = np.asarray(observation.contacts[SHOULDER]["V"].eccentricity)
    flights = zip(impacts.separation[:3], impacts.onset[1:4], strict=False)
    between = [(observation.times >= begin) & (observation.times <= end) for begin, end in flights]
    return np.array([settings.clearance - eccentricity[flight].min() for flight in between])


def _onset_gaps(run: Run) -> np.ndarray:
    """Return the time between the onsets of both bases in their common impacts, s."""
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


def _largest_acceleration(observation: cj.results.Observation) -> float:
    return float(np.abs(observation.accelerations[END_ARM].linear[:, 1]).max())


def _slide(observation: cj.results.Observation, instant: float) -> float:
    """Return the axial displacement of the journal's centre, m: the mean of its bases."""
    bases = observation.contacts[SHOULDER].values()
    axial = np.mean([base.point_on_journal[:, 2] for base in bases], axis=0)
    return float(np.interp(instant, observation.times, axial))


def report(findings: Findings) -> str:
    """Return the table of the paper's statements and the results."""
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

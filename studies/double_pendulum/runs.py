"""Settings and runs of the double pendulum, with clearance and ideal."""

import warnings
from dataclasses import dataclass

import diffrax
import numpy as np

import clearjoint as cj

SOLVERS = {
    "bosh3": diffrax.Bosh3,
    "tsit5": diffrax.Tsit5,
    "dopri5": diffrax.Dopri5,
    "dopri8": diffrax.Dopri8,
}
SHOULDER, ELBOW, ARM, END_ARM = "shoulder", "elbow", "arm 2", "arm 3"
SAVED = 4001
"""Number of saved instants, the same in every run, so that all runs share a program."""
IMPACT_INSTANTS, EARLY_INSTANTS = 200, 1400
QUICK_DURATION = 0.25


@dataclass(frozen=True)
class Settings:
    """Numbers of the simulation in SI units; a `quick` one animates a short part."""

    clearance: float = 0.5e-3
    restitution: float = 0.9
    solver: str = "tsit5"
    rtol: float = 1e-6
    duration: float = 4.0
    quick: bool = False

    @property
    def early(self) -> float:
        """End of the early motion, s: twelve times the free fall of the journal to the wall."""
        return min(12.0 * (2.0 * self.clearance / 9.81) ** 0.5, self.duration)


@dataclass(frozen=True)
class Run:
    """States and observation at the saved instants, observation at every accepted step, and the
    finished contacts of a run.
    """

    trajectory: cj.results.Trajectory
    saved: cj.results.Observation
    steps: cj.results.Observation
    impacts: cj.results.Impacts

    def of(self, base: str) -> cj.results.Impacts:
        """Return the impacts of one base."""
        return self.impacts.of(SHOULDER, base)


def simulate_clearance(settings: Settings) -> Run:
    """Simulate the pendulum with clearance, after a short run that finds the first impacts."""
    scene, state = cj.mechanisms.double_pendulum(settings.clearance, settings.restitution)
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
    """Simulate the pendulum with an ideal joint."""
    scene, state = cj.mechanisms.double_pendulum(clearance=None)
    instants = np.linspace(0.0, settings.duration, SAVED)
    return _observed(scene, _simulate(settings, scene, state, instants))


def _simulate(
    settings: Settings, scene: cj.Scene, state: cj.State, instants: np.ndarray
) -> cj.results.Solution:
    with warnings.catch_warnings():
        # The paper's joint is axially free; the study's table says how far arm 2 slides.
        warnings.simplefilter("ignore", cj.LeftBearingWarning)
        return cj.simulate(
            scene,
            state,
            instants[-1],
            cj.Settings(solver=SOLVERS[settings.solver](), rtol=settings.rtol, ledger=True),
            save=cj.Saving(instants, steps=True, impacts=True),
        )


def _observed(scene: cj.Scene, solution: cj.results.Solution) -> Run:
    assert solution.saved is not None and solution.impacts is not None
    return Run(
        trajectory=solution.saved,
        saved=cj.observe(scene, solution),
        steps=cj.observe(scene, solution, solution.steps),
        impacts=solution.impacts,
    )


def _instants(settings: Settings, impacts: cj.results.Impacts) -> np.ndarray:
    """Return the saved instants: dense in the first three impacts, sparse in the late motion."""
    spans = zip(impacts.onset[:3], impacts.separation[:3], strict=True)
    inside = [np.linspace(*span, IMPACT_INSTANTS) for span in spans]
    early = np.linspace(0.0, settings.early, EARLY_INSTANTS)
    late_count = SAVED - EARLY_INSTANTS - 3 * IMPACT_INSTANTS
    late = np.linspace(settings.early, settings.duration, late_count)
    return np.unique(np.concatenate([early, late, *inside]))

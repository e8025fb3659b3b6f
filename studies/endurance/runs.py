"""Long runs of a pendulum and a top: what drifts, and what memory they take."""

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import diffrax
import numpy as np
import psutil
from matplotlib.figure import Figure

import clearjoint as cj
from clearjoint.plot import style

DAY, MOST_STEPS, SAVED = 86_400.0, 100_000_000, 1441
GRAVITY, LENGTH = 9.81, 1.0
INERTIA = (1e-3, 1.0 / 12.0, 1.0 / 12.0)
MEGABYTE = 1e6


def pendulum(clearance: float | None = None) -> tuple[cj.Scene, cj.State]:
    """The rod, horizontal and at rest, on a pin about Z at its end."""
    half, axis = 0.5 * LENGTH, (0.0, 0.0, 1.0)
    pin: Any = cj.RevoluteJoint("ground", "rod", (0.0, 0.0, 0.0), (-half, 0.0, 0.0), axis, axis)
    if clearance is not None:
        pin = cj.ClearanceJoint(
            "ground",
            "rod",
            journal_point=(-half, 0.0, 0.0),
            bearing_radius=10e-3,
            clearance=clearance,
            journal_length=20e-3,
            axial=cj.FixedAxially(),
            law=cj.laws.LankaraniNikravesh(
                restitution=0.9, stiffness=cj.laws.RavnStiffness(207e9, 0.3)
            ),
        )
    scene = cj.Scene({"rod": cj.Body(1.0, INERTIA)}, {"pin": pin}, gravity=(0.0, -GRAVITY, 0.0))
    return scene, cj.State({"rod": cj.body_state((half, 0.0, 0.0))})


def top() -> tuple[cj.Scene, cj.State]:
    """A body that tumbles freely, three different moments of inertia."""
    scene = cj.Scene({"rod": cj.Body(1.0, (1.0, 2.0, 2.5))})
    return scene, cj.State({"rod": cj.body_state((0.0, 0.0, 0.0), spin=(0.3, 2.0, 0.5))})


def clearance_pendulum() -> tuple[cj.Scene, cj.State]:
    """The rod with 0.5 mm of clearance."""
    return pendulum(0.5e-3)


@dataclass(frozen=True)
class Case:
    """A scene and how to run it."""

    name: str
    make: Callable[[], tuple[cj.Scene, cj.State]]
    rtol: float = 1e-4
    settings: cj.Settings = cj.presets.default


ABSOLUTE = cj.Settings(coordinates=cj.AbsoluteCoordinates())
PROJECTED = replace(ABSOLUTE, stabilisation=cj.Projection())
EIGHTH = cj.Settings(solver=diffrax.Dopri8())
CASES = (
    Case("ideal", pendulum),
    Case("ideal", pendulum, 1e-6),
    Case("ideal", pendulum, 1e-9),
    Case("ideal, Dopri8", pendulum, 1e-9, EIGHTH),
    Case("ideal, Dopri8", pendulum, 1e-12, EIGHTH),
    Case("ideal, absolute, Baumgarte", pendulum, 1e-4, ABSOLUTE),
    Case("ideal, absolute, Baumgarte", pendulum, 1e-9, ABSOLUTE),
    Case("ideal, absolute, projection", pendulum, 1e-4, PROJECTED),
    Case("free top", top),
    Case("free top", top, 1e-9),
    Case("clearance 0.5 mm", clearance_pendulum, 1e-4, cj.Settings(ledger=True)),
)  # fmt: skip


@dataclass(frozen=True)
class Outcome:
    """What a run left.

    - `time` s, `attempts`, `seconds`: how far it came, in how many steps and how long.
    - `energy`: (N,) what mechanical energy and ledger don't account for at the `instants` saved, s,
      and `mechanical` the mechanical energy gained, in parts of the fall's or the top's.
    - `residuals`: (N,) largest of the ideal joints, if there are any; `norm`: by how much the Euler
      parameters' ever differs from one.
    - `times` s, `memory` bytes: samples while it ran.
    """

    case: Case
    time: float
    attempts: int
    seconds: float
    instants: np.ndarray
    energy: np.ndarray
    mechanical: np.ndarray
    residuals: np.ndarray | None
    norm: float
    times: np.ndarray
    memory: np.ndarray

    @property
    def growth(self) -> float:
        """Largest memory after the first quarter of the run less the largest in it, bytes."""
        first = max(1, len(self.memory) // 4)
        return float(self.memory[first:].max() - self.memory[:first].max())


class MemoryWatch:
    """The process's memory, sampled in a thread while a block runs."""

    def __init__(self, interval: float = 0.5):
        self._interval, self._over = interval, threading.Event()
        self.samples: list[tuple[float, int]] = []

    def __enter__(self) -> "MemoryWatch":
        self._thread = threading.Thread(target=self._watch)
        self._sample()
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()
        self._sample()

    def _watch(self) -> None:
        while not self._over.wait(self._interval):
            self._sample()

    def _sample(self) -> None:
        self.samples.append((time.perf_counter(), psutil.Process().memory_info().rss))


def run(case: Case, span: float, most_steps: int) -> Outcome:
    """Run a case after a short one that compiles."""
    scene, state = case.make()
    instants = np.linspace(0.0, span, SAVED)

    def simulate(steps: int) -> cj.results.Solution:
        settings = replace(case.settings, rtol=case.rtol, max_steps=steps)
        save = cj.Saving(instants)
        return cj.simulate(scene, state, span, settings, save, throw=False, progress=False)

    simulate(100)
    begin = time.perf_counter()
    with MemoryWatch() as watch:
        solution = simulate(most_steps)
    seconds = time.perf_counter() - begin
    observed = cj.observe(scene, solution)
    whole = 0.5 * GRAVITY * LENGTH if scene.joints else float(observed.energies["kinetic"][0])
    energy, mechanical = observed.ledger_residual() / whole, observed.energies["mechanical"]
    times, memory = np.array(watch.samples).T
    residuals = np.max([*observed.drift.values()], axis=0) if observed.drift else None
    norms = np.linalg.norm(solution.states.bodies["rod"].orientation, axis=-1)
    return Outcome(
        case, float(solution.time), int(solution.attempts), seconds, solution.times, energy,
        (mechanical - mechanical[0]) / whole, residuals, float(np.abs(norms - 1.0).max()),
        times - begin, memory,
    )  # fmt: skip


COLUMNS = (
    "run", "rtol", "simulated, h", "steps", "s", "µs a step", "residuals", "norm - 1",
    "mechanical energy", "unaccounted for", "memory, MB", "its growth, MB",
)  # fmt: skip


def row(outcome: Outcome) -> tuple[str, ...]:
    """A row of the table."""
    residuals = ""
    if outcome.residuals is not None:
        first, *_, last = np.array_split(outcome.residuals, 4)
        residuals = f"{first.max():.0e}, {last.max():.0e}"
    return (
        outcome.case.name,
        f"{outcome.case.rtol:.0e}",
        f"{outcome.time / 3600.0:.3g}",
        f"{outcome.attempts:.3g}",
        f"{outcome.seconds:.3g}",
        f"{1e6 * outcome.seconds / outcome.attempts:.2g}",
        residuals,
        f"{outcome.norm:.0e}",
        f"{outcome.mechanical[-1]:.1e}",
        f"{outcome.energy[-1]:.1e}",
        f"{outcome.memory.max() / MEGABYTE:.0f}",
        f"{outcome.growth / MEGABYTE:.1f}",
    )


def late_start(rtols: tuple[float, ...] = (1e-4, 1e-6, 1e-9)) -> list[tuple[str, ...]]:
    """What a start after 24 h changes of 0.1 s of the double pendulum: a row each tolerance."""
    rows: list[tuple[str, ...]] = [
        ("rtol", "steps", "position of arm 2, m", "entry speeds, relative", "onsets, s")
    ]
    scene, state = cj.mechanisms.double_pendulum()
    save = cj.Saving(impacts=True)
    for rtol in rtols:
        settings = cj.Settings(rtol=rtol, first_step=1e-7)
        early, late = (
            cj.simulate(scene, state, t + 0.1, settings, save, start_time=t, progress=False)
            for t in (0.0, DAY)
        )
        assert early.impacts is not None and late.impacts is not None
        here, there = (s.final.bodies["arm 2"].position for s in (early, late))
        speeds = late.impacts.entry_speed / early.impacts.entry_speed - 1.0
        onsets = (late.impacts.onset - DAY) - early.impacts.onset
        changes = (np.asarray(there) - here, speeds, onsets)
        rows.append((
            f"{rtol:.0e}",
            f"{int(early.attempts)}, {int(late.attempts)}",
            *(f"{np.abs(change).max():.0e}" for change in changes),
        ))  # fmt: skip
    return rows


COLOURS = {
    "ideal": style.BLUE,
    "ideal, Dopri8": style.GREEN,
    "free top": style.PURPLE,
    "clearance 0.5 mm": style.VERMILLION,
}
STYLES = {1e-4: "-", 1e-6: "--", 1e-9: "-.", 1e-12: ":"}


def figure(outcomes: list[Outcome]) -> Figure:
    """Energy over simulated time, and memory over the time taken by the longest run."""
    drawn = Figure(figsize=(9.0, 4.2), layout="constrained")
    left, right = drawn.subplots(1, 2, width_ratios=(3, 2))
    for outcome in outcomes:
        case = outcome.case
        if case.name in COLOURS:
            left.loglog(
                outcome.instants[1:] / 3600.0,
                np.abs(outcome.energy[1:]),
                color=COLOURS[case.name],
                linestyle=STYLES[case.rtol],
                linewidth=1.2,
                label=f"{case.name}, rtol {case.rtol:.0e}",
            )
    drawn.legend(loc="outside lower center", ncols=4, fontsize=8)
    longest = max(outcomes, key=lambda one: one.seconds)
    right.plot(longest.times, longest.memory / MEGABYTE, color=style.VERMILLION)
    right.set_ylim(0.0, 1.3 * longest.memory.max() / MEGABYTE)
    right.set_title(f"{longest.case.name}, {longest.attempts / 1e6:.3g} million steps", fontsize=9)
    style.dress(left, "simulated time, h", "energy unaccounted for / energy of the swing")
    style.dress(right, "time taken, s", "memory of the process, MB")
    return drawn

"""Drift and memory of long runs of a pendulum and a top, each in one call of `simulate`.

Runs take 24 h of simulated time or 1e8 steps, whichever comes first.
"""

import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import diffrax
import numpy as np
import psutil
from matplotlib.figure import Figure

import clearjoint as cj
from clearjoint.plot import style

DAY, MAX_STEPS, SAVED = 86_400.0, 100_000_000, 1441
GRAVITY, LENGTH = 9.81, 1.0
INERTIA = (1e-3, 1.0 / 12.0, 1.0 / 12.0)
MEGABYTE = 1e6


def pendulum(clearance: float | None = None) -> tuple[cj.Scene, cj.State]:
    """Return a horizontal rod at rest on a pin about Z, ideal or with a clearance in m."""
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
    """Return a freely tumbling body with three different moments of inertia."""
    scene = cj.Scene({"rod": cj.Body(1.0, (1.0, 2.0, 2.5))})
    return scene, cj.State({"rod": cj.body_state((0.0, 0.0, 0.0), spin=(0.3, 2.0, 0.5))})


def clearance_pendulum() -> tuple[cj.Scene, cj.State]:
    """Return the rod with 0.5 mm of clearance."""
    return pendulum(0.5e-3)


@dataclass(frozen=True)
class Case:
    """A scene and its settings."""

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
QUICK = ((CASES[0], CASES[8]), 60.0)
"""Cases of a quick study, and their simulated time, s."""


@dataclass(frozen=True)
class Outcome:
    """Results of a run that saved N instants.

    - `time`: simulated time, s; `attempts`: attempted steps; `seconds`: time taken, s.
    - `instants` (N,): saved times, s.
    - `energy` (N,): energy missing in the balance, as a fraction of the energy of the swing or top.
    - `mechanical` (N,): mechanical energy gained, as such a fraction.
    - `residuals` (N,): largest residual of the ideal joints, m or rad, if there are any.
    - `norm`: largest deviation of the norm of the Euler parameters from one.
    - `times`, `memory`: samples of the process's memory while it ran, s and bytes.
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
        """Growth of the memory after the first quarter of the run, bytes."""
        first = max(1, len(self.memory) // 4)
        return float(self.memory[first:].max() - self.memory[:first].max())


class MemoryWatch:
    """Context manager that samples the memory of the process in a thread."""

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


def run(case: Case, span: float, max_steps: int) -> Outcome:
    """Run a case up to a time, s, or a number of steps, after a short run that compiles."""
    scene, state = case.make()
    instants = np.linspace(0.0, span, SAVED)

    def simulate(steps: int) -> cj.results.Solution:
        settings = replace(case.settings, rtol=case.rtol, max_steps=steps)
        save = cj.Saving(instants)
        return cj.simulate(scene, state, span, settings, save, throw=False, progress=False)

    simulate(100)
    begin = time.perf_counter()
    with MemoryWatch() as watch:
        solution = simulate(max_steps)
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


def table(outcomes: Sequence[Outcome]) -> list[tuple[str, ...]]:
    """Return the table of runs as text."""
    head = (
        "run", "rtol", "simulated, h", "steps", "s", "µs a step", "residuals", "norm - 1",
        "mechanical energy", "energy error", "memory, MB", "growth, MB",
    )  # fmt: skip
    return [head, *map(_cells, outcomes)]


def _cells(outcome: Outcome) -> tuple[str, ...]:
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


@dataclass(frozen=True)
class LateStart:
    """Largest differences of 0.1 s of the double pendulum started at 24 h from a start at zero.

    `position`: of arm 2 at the end, m; `entry_speed`: relative; `onset`: s.
    """

    rtol: float
    position: float
    entry_speed: float
    onset: float


def late_starts(rtols: Sequence[float] = (1e-4, 1e-6, 1e-9)) -> list[LateStart]:
    """Compare a start after 24 h with a start at time zero, for each tolerance."""
    scene, state = cj.mechanisms.double_pendulum()
    found = []
    for rtol in rtols:
        settings = cj.Settings(rtol=rtol, first_step=1e-7)
        early, late = (
            cj.simulate(
                scene, state, t + 0.1, settings, cj.Saving(impacts=True), start_time=t,
                progress=False,
            )
            for t in (0.0, DAY)
        )  # fmt: skip
        assert early.impacts is not None and late.impacts is not None
        positions = [np.asarray(s.final.bodies["arm 2"].position) for s in (early, late)]
        differences = (
            positions[1] - positions[0],
            late.impacts.entry_speed / early.impacts.entry_speed - 1.0,
            (late.impacts.onset - DAY) - early.impacts.onset,
        )
        found.append(LateStart(rtol, *(float(np.abs(change).max()) for change in differences)))
    return found


def late_start_table(rows: Sequence[LateStart]) -> list[tuple[str, ...]]:
    """Return the table of late starts as text."""
    head = ("rtol", "position of arm 2, m", "entry speeds, relative", "onsets, s")
    cells = [
        tuple(f"{x:.0e}" for x in (row.rtol, row.position, row.entry_speed, row.onset))
        for row in rows
    ]
    return [head, *cells]


COLOURS = {
    "ideal": style.BLUE,
    "ideal, Dopri8": style.GREEN,
    "free top": style.PURPLE,
    "clearance 0.5 mm": style.VERMILLION,
}
STYLES = {1e-4: "-", 1e-6: "--", 1e-9: "-.", 1e-12: ":"}


def figure(outcomes: Sequence[Outcome]) -> Figure:
    """Draw the energy error over simulated time, and the memory during the longest run."""
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
    longest = max(outcomes, key=lambda outcome: outcome.seconds)
    right.plot(longest.times, longest.memory / MEGABYTE, color=style.VERMILLION)
    right.set_ylim(0.0, 1.3 * longest.memory.max() / MEGABYTE)
    right.set_title(f"{longest.case.name}, {longest.attempts / 1e6:.3g} million steps", fontsize=9)
    style.dress(left, "simulated time, h", "energy error / energy of the swing")
    style.dress(right, "time taken, s", "memory of the process, MB")
    return drawn

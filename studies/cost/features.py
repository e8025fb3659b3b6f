"""Time of an attempted step for scenes that each have one more feature than the one before."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median

from matplotlib.figure import Figure

import clearjoint as cj
from clearjoint.plot import style

STEPS, QUICK_STEPS = 200_000, 2_000
ROUNDS = 5
END = 1e6
"""End time of every run, s; the number of steps ends them long before."""
FRICTION = cj.frictions.RegularisedCoulomb(0.1)
END_PLAY = cj.EndPlay(1e-3, cj.laws.Hertz(1e8))


@dataclass(frozen=True)
class Case:
    """A scene with its initial state and settings."""

    scene: cj.Scene
    state: cj.State
    settings: cj.Settings = cj.presets.default


@dataclass(frozen=True)
class Cost:
    """Median time of an attempted step, s."""

    name: str
    seconds: float


def _free_body() -> Case:
    scene, _ = cj.mechanisms.double_pendulum()
    state = cj.State({"arm 2": cj.body_state((0.5, 0.0, 0.0), spin=(1.0, 3.0, 0.5))})
    return Case(cj.Scene({"arm 2": scene.bodies["arm 2"]}), state)


def _pendulum() -> Case:
    scene, state = cj.mechanisms.double_pendulum(None)
    bodies, joints = {"arm 2": scene.bodies["arm 2"]}, {"shoulder": scene.joints["shoulder"]}
    state = cj.State({"arm 2": state.bodies["arm 2"]})
    return Case(cj.Scene(bodies, joints, gravity=scene.gravity), state)


def cases() -> dict[str, Case]:
    """Return the scenes by name; each has one more feature than the one before."""
    double_pendulum = cj.mechanisms.double_pendulum
    all_contacts = double_pendulum(friction=FRICTION, axial=END_PLAY)
    return {
        "free body": _free_body(),
        "pendulum, ideal joint": _pendulum(),
        "+ second rod on an ideal joint": Case(*double_pendulum(None)),
        "+ clearance at the shoulder": Case(*double_pendulum()),
        "+ friction": Case(*double_pendulum(friction=FRICTION)),
        "+ end play": Case(*all_contacts),
        "+ energy ledger": Case(*all_contacts, cj.Settings(ledger=True)),
    }


def _run(case: Case, steps: int) -> float:
    """Return the processor time of a run with that number of attempted steps, s."""
    settings = cj.Settings(max_steps=steps, ledger=case.settings.ledger)
    begun = time.process_time()
    solution = cj.simulate(case.scene, case.state, END, settings, throw=False, progress=False)
    seconds = time.process_time() - begun
    assert int(solution.attempts) == steps
    return seconds


def measure(quick: bool) -> list[Cost]:
    """Measure all cases, or the first two if `quick`."""
    chosen = dict(list(cases().items())[: 2 if quick else None])
    steps, rounds = (QUICK_STEPS, 1) if quick else (STEPS, ROUNDS)
    for case in chosen.values():
        _run(case, steps)  # compiles
    samples: dict[str, list[float]] = {name: [] for name in chosen}
    # The cases alternate, so that other load on the machine disturbs all of them alike.
    for _ in range(rounds):
        for name, case in chosen.items():
            samples[name].append((_run(case, 2 * steps) - _run(case, steps)) / steps)
    return [Cost(name, median(times)) for name, times in samples.items()]


def table(costs: Sequence[Cost]) -> list[tuple[str, ...]]:
    """Return the table as text."""
    rows = [(cost.name, f"{1e9 * cost.seconds:.0f}") for cost in costs]
    return [("scene", "attempted step, ns"), *rows]


def figure(costs: Sequence[Cost]) -> Figure:
    """Draw the time of an attempted step of each case."""
    drawn = Figure(figsize=(7.0, 3.2), layout="constrained")
    axes = drawn.subplots()
    bars = axes.barh([c.name for c in costs], [1e9 * c.seconds for c in costs], color=style.BLUE)
    axes.bar_label(bars, fmt="{:.0f}", padding=3, fontsize=8)
    axes.invert_yaxis()
    axes.margins(x=0.1)
    style.dress(axes, "time of an attempted step, ns", "")
    return drawn

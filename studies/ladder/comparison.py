"""Models of one joint side by side: errors, cost, statistics and derivatives."""

import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

import clearjoint as cj
from clearjoint.plot import style
from studies.ladder.models import (
    ARMS,
    BASES,
    MODELS,
    AbstractModel,
    Compliant,
    Rigid,
    grid,
    lowered,
)

REFERENCE = Path(__file__).resolve().parents[2] / "tests" / "data" / "reference"
FILE = "double_pendulum_c0.0005_e0.9.csv.gz"
HORIZON, EARLY = 0.15, 0.05
"""Until which double precision can follow the reference, and some impacts before, s."""
DURATION, RUNS, APART = 4.0, 8, 1e-9
FINE = "rigid, h = 2e-5 s"
"""The model left out there: to see its impacts, each of 200 000 steps would have to be saved."""
FAST = 0.01
"""Entry speed from which on an impact is counted, m/s."""
INSTANT, SLOPE, DIFFERENCES = 0.025, -1.552556927e-4, (1e-3, 5e-2)
"""Of the derivative: s, the reference's m, and steps of the logarithm."""

Rows = Iterator[tuple[str, ...]]


def reference() -> dict[str, np.ndarray]:
    """Positions (N, 3) of both arms every millisecond up to the horizon, m, and eccentricity of
    base V every 0.1 ms, m."""
    columns = np.genfromtxt(REFERENCE / FILE, delimiter=",", names=True)
    rows = columns[: round(HORIZON / 1e-4) + 1]
    found = {
        arm: np.stack([rows[f"r{number}{axis}"] for axis in "xyz"], axis=1)[::10]
        for arm, number in zip(ARMS, "23", strict=True)
    }
    return {**found, "eccentricity": rows["eV"]}


def error(model: AbstractModel, truth: dict[str, np.ndarray]) -> np.ndarray:
    """Largest error of an arm's position at each instant, m."""
    solution = model.run(*model.scene(), HORIZON, cj.Saving(grid(HORIZON)))
    bodies = solution.saved.states.bodies
    apart = [np.linalg.norm(bodies[arm].position - truth[arm], axis=1) for arm in ARMS]
    return np.max(apart, axis=0)


def cost(model: AbstractModel, duration: float) -> tuple[int, float]:
    """Steps, and the least time of three runs after one that compiles, s."""
    scene, state = model.scene()

    def timed() -> tuple[float, Any]:
        start = time.perf_counter()
        solution = model.run(scene, state, duration)
        return time.perf_counter() - start, solution

    _, solution = timed()
    return model.steps(solution), min(timed()[0] for _ in range(3))


def accuracy_rows(
    models: tuple[AbstractModel, ...], truth: dict[str, np.ndarray], duration: float
) -> Rows:
    """Cost and error of each model."""
    for model in models:
        apart = error(model, truth)
        early = apart[: round(EARLY / 1e-3) + 1].max()
        steps, seconds = cost(model, duration)
        yield (
            model.name,
            f"{steps}",
            f"{1e3 * seconds:.3g}",
            f"{1e6 * seconds / steps:.2g}",
            f"{1e6 * early:.2g}",
            f"{1e6 * apart.max():.2g}",
        )


def statistics_rows(models: tuple[AbstractModel, ...], duration: float, runs: int) -> Rows:
    """What each model tells of a run beyond the horizon: mean and standard deviation of runs."""
    for model in models:
        scene, state = model.scene()
        found = []
        for k in range(runs if isinstance(model, Rigid | Compliant) else 1):
            shocks = model.shocks(scene, lowered(state, k * APART), duration)
            fast = shocks.speeds[shocks.speeds > FAST]
            force = np.nan if shocks.forces is None else shocks.forces.max()
            found.append((shocks.lost, len(fast) / len(BASES), fast.max(initial=0), force))
        lost, impacts, fastest, force = np.array(found).T
        yield (
            model.name,
            _spread(lost, "{:.2f}"),
            _spread(impacts, "{:.0f}"),
            _spread(fastest, "{:.2f}"),
            _spread(force / 1e3, "{:.3g}"),
        )


def _spread(values: np.ndarray, form: str) -> str:
    if np.isnan(values).any():
        return "none"
    mean = form.format(values.mean())
    return mean if len(values) == 1 else f"{mean} ± {form.format(values.std(ddof=1))}"


def slope_rows(models: tuple[AbstractModel, ...]) -> Rows:
    """The derivative by the logarithm of the clearance, by `jax.jvp` and by differences."""
    for model in models:
        if model.moves:
            height = jax.jit(_height(model))
            cells = _forward(height), *(_difference(height, h) for h in DIFFERENCES), SLOPE
            yield model.name, *(f"{1e6 * value:.4g}" for value in cells)


def _forward(height: Callable[[Any], Any]) -> float:
    return float(jax.jvp(height, (jnp.zeros(()),), (jnp.ones(()),))[1])


def _difference(height: Callable[[Any], Any], step: float) -> float:
    above, below = (float(height(jnp.asarray(sign * step))) for sign in (1.0, -1.0))
    return (above - below) / (2.0 * step)


def _height(model: AbstractModel) -> Callable[[Any], Any]:
    if isinstance(model, Compliant):
        model = replace(model, settings=cj.presets.derivatives)

    def height(logarithm: Any) -> Any:
        scene, state = model.varied(logarithm)
        solution = model.run(scene, state, INSTANT)
        return solution.final.bodies["arm 2"].position[1]

    return height


def markdown(columns: tuple[str, ...], rows: Rows) -> str:
    """A table."""
    lines = [columns, ("---",) * len(columns), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


SHOWN = ("massless link", "rigid, h = 1e-4 s", "compliant, no memory")


def figure(truth: dict[str, np.ndarray]) -> Figure:
    """Eccentricity of base V during the first impacts, and error against cost."""
    drawing, (left, right) = plt.subplots(1, 2, figsize=(10.0, 4.0), layout="constrained")
    times = np.arange(0, 1001) * 1e-4
    reference_curve = 1e3 * truth["eccentricity"][:1001]
    left.plot(1e3 * times, reference_curve, color=style.GREY, lw=3, label="reference")
    shown = [model for model in MODELS if model.name in SHOWN]
    for model, (colour, line) in zip(shown, style.lines(), strict=False):
        scene, state = model.scene()
        solution = model.run(scene, state, times[-1], cj.Saving(times))
        journal = _journal(solution)
        left.plot(1e3 * times, 1e3 * journal, color=colour, ls=line, label=model.name)
    style.dress(left, "time in ms", "eccentricity of base V in mm")
    left.set_ylim(0.0, 0.62)
    left.legend(ncols=2, loc="upper center", fontsize=8)
    _work_and_error(right, truth)
    return drawing


def _journal(solution: Any) -> np.ndarray:
    """Distance of base V from the bearing's axis, m."""
    arm = solution.saved.states.bodies["arm 2"]
    turn = jax.vmap(_rotated)(jnp.asarray(arm.orientation))
    return np.linalg.norm(np.asarray(arm.position + turn)[:, :2], axis=1)


def _rotated(orientation: Any) -> Any:
    """Base V from arm 2's centre, global, m."""
    scalar, vector = orientation[0], orientation[1:]
    point = jnp.array([-0.5, 0.0, -10e-3])
    swing = jnp.cross(vector, point)
    return point + 2.0 * (scalar * swing + jnp.cross(vector, swing))


def _work_and_error(axes: Any, truth: dict[str, np.ndarray]) -> None:
    families: dict[str, list[AbstractModel]] = {
        "ideal joint": [MODELS[0]],
        "massless link": [MODELS[1]],
        "rigid, steps 2e-4 to 5e-6 s": [Rigid("", h) for h in (2e-4, 1e-4, 2e-5, 5e-6)],
        "compliant, no memory": [MODELS[5]],
        "compliant, impact memory, rtol 1e-3 to 1e-8": [
            Compliant("", cj.Settings(rtol=rtol)) for rtol in (1e-3, 1e-4, 1e-5, 1e-6, 1e-8)
        ],
    }
    marks = zip(families.items(), "osD^v", strict=True)
    colours = (style.DARK, style.BLUE, style.VERMILLION, style.PURPLE, style.GREEN)
    for ((name, models), mark), colour in zip(marks, colours, strict=True):
        apart = [1e6 * error(model, truth)[:51].max() for model in models]
        work = [1e3 * cost(model, EARLY * 20)[1] for model in models]
        axes.loglog(work, apart, marker=mark, color=colour, label=name)
    style.dress(axes, "time of 1 s of motion in ms", "largest error up to 50 ms in µm")
    axes.set_xlim(2.0, 300.0)
    axes.set_ylim(1e-11, 2e3)
    axes.legend(fontsize=8, loc="lower left")


ACCURACY = (
    "model", "steps", "time, ms", "µs a step", "error to 50 ms, µm", "to 150 ms, µm",
)  # fmt: skip
STATISTICS = (
    "model", "energy lost, J", "impacts > 1 cm/s a base", "fastest, m/s", "peak force, kN",
)  # fmt: skip
SLOPES = (
    "model", "jvp, µm", "differences over 0.1 %, µm", "over 5 %, µm", "reference, µm",
)  # fmt: skip

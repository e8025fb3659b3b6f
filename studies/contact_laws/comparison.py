"""Comparison of the models of a joint: errors, cost, statistics and derivatives."""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from scipy.spatial.transform import Rotation

import clearjoint as cj
from clearjoint.plot import style
from clearjoint.testing import optimise_programs
from studies.contact_laws.models import (
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
"""End of the comparison with the reference before chaos, and an earlier time, s."""
DURATION, RUNS, APART = 4.0, 8, 1e-9
NO_STATISTICS = ("rigid, h = 2e-4 s", "rigid, h = 2e-5 s")
"""Models without statistics: runs of the first may fail, the second has too many steps to save."""
FAST = 0.01
"""Least entry speed of a counted impact, m/s."""
INSTANT, SLOPE, DIFFERENCES = 0.025, -1.552556927e-4, (1e-3, 5e-2)
"""Time of the derivative, s, the reference's derivative, m, and steps of the differences."""

ACCURACY_HEAD = (
    "model", "steps", "time, ms", "µs a step", "error to 50 ms, µm", "to 150 ms, µm",
)  # fmt: skip
STATISTICS_HEAD = (
    "model", "energy lost, J", "impacts over 1 cm/s a base", "fastest, m/s", "peak force, kN",
)  # fmt: skip
SLOPES_HEAD = (
    "model", "jvp, µm", "differences over 0.1 %, µm", "over 5 %, µm", "reference, µm",
)  # fmt: skip


@dataclass(frozen=True)
class Accuracy:
    """Cost of a run, and largest errors of an arm's position early and before chaos, m."""

    model: str
    steps: int
    seconds: float
    early_error: float
    error: float

    def cells(self) -> tuple[str, ...]:
        """Return the row as text."""
        return (
            self.model,
            f"{self.steps}",
            f"{1e3 * self.seconds:.3g}",
            f"{1e6 * self.seconds / self.steps:.2g}",
            f"{1e6 * self.early_error:.2g}",
            f"{1e6 * self.error:.2g}",
        )


@dataclass(frozen=True)
class Statistics:
    """Energy lost, J, fast impacts a base, fastest entry speed, m/s, and peak force, N, (runs,)."""

    model: str
    lost: np.ndarray
    impacts: np.ndarray
    fastest: np.ndarray
    force: np.ndarray

    def cells(self) -> tuple[str, ...]:
        """Return the row as text."""
        return (
            self.model,
            _spread(self.lost, "{:.2f}"),
            _spread(self.impacts, "{:.0f}"),
            _spread(self.fastest, "{:.2f}"),
            _spread(self.force / 1e3, "{:.3g}"),
        )


@dataclass(frozen=True)
class Slope:
    """Derivatives of arm 2's height by the logarithm of the clearance, m.

    `forward`: by `jax.jvp`; `differences`: by central differences over the two `DIFFERENCES`.
    """

    model: str
    forward: float
    differences: tuple[float, float]

    def cells(self) -> tuple[str, ...]:
        """Return the row as text."""
        values = (self.forward, *self.differences, SLOPE)
        return self.model, *(f"{1e6 * value:.4g}" for value in values)


def reference() -> dict[str, np.ndarray]:
    """Return the reference up to the horizon.

    Positions (N, 3) of both arms every millisecond, m, and the eccentricity of base V every 0.1 ms,
    m.
    """
    columns = np.genfromtxt(REFERENCE / FILE, delimiter=",", names=True)
    rows = columns[: round(HORIZON / 1e-4) + 1]
    found = {
        arm: np.stack([rows[f"r{number}{axis}"] for axis in "xyz"], axis=1)[::10]
        for arm, number in zip(ARMS, "23", strict=True)
    }
    return {**found, "eccentricity": rows["eV"]}


def error(model: AbstractModel, truth: dict[str, np.ndarray]) -> np.ndarray:
    """Return the larger error of the arms' positions at each instant, m."""
    solution = model.run(*model.scene(), HORIZON, cj.Saving(grid(HORIZON)))
    bodies = solution.saved.states.bodies
    distances = [np.linalg.norm(bodies[arm].position - truth[arm], axis=1) for arm in ARMS]
    return np.max(distances, axis=0)


def cost(model: AbstractModel, duration: float) -> tuple[int, float]:
    """Return the steps and the least processor time of three runs after one that compiles, s."""
    scene, state = model.scene()

    def timed() -> tuple[float, Any]:
        start = time.process_time()
        solution = model.run(scene, state, duration)
        return time.process_time() - start, solution

    _, solution = timed()
    optimise_programs()
    return model.steps(solution), min(timed()[0] for _ in range(3))


def accuracies(
    models: Sequence[AbstractModel], truth: dict[str, np.ndarray], duration: float
) -> Iterator[Accuracy]:
    """Measure cost and error of each model."""
    for model in models:
        errors = error(model, truth)
        early = errors[: round(EARLY / 1e-3) + 1].max()
        yield Accuracy(model.name, *cost(model, duration), float(early), float(errors.max()))


def statistics(models: Sequence[AbstractModel], duration: float, runs: int) -> Iterator[Statistics]:
    """Compute the statistics of each model over runs with slightly different starts."""
    for model in models:
        scene, state = model.scene()
        found = []
        for k in range(runs if isinstance(model, Rigid | Compliant) else 1):
            impacts = model.impacts(scene, lowered(state, k * APART), duration)
            fast = impacts.speeds[impacts.speeds > FAST]
            force = np.nan if impacts.forces is None else impacts.forces.max()
            found.append((impacts.lost, len(fast) / len(BASES), fast.max(initial=0), force))
        yield Statistics(model.name, *np.array(found).T)


def _spread(values: np.ndarray, form: str) -> str:
    if np.isnan(values).any():
        return "none"
    mean = form.format(values.mean())
    return mean if len(values) == 1 else f"{mean} ± {form.format(values.std(ddof=1))}"


def slopes(models: Sequence[AbstractModel]) -> Iterator[Slope]:
    """Differentiate by the logarithm of the clearance, in forward mode and by differences."""
    for model in models:
        if model.moves:
            height = jax.jit(_height(model))
            forward = float(jax.jvp(height, (jnp.zeros(()),), (jnp.ones(()),))[1])
            near, far = (_difference(height, step) for step in DIFFERENCES)
            yield Slope(model.name, forward, (near, far))


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


SHOWN = ("massless link", "rigid, h = 1e-4 s", "compliant, fixed damping")


def figure(truth: dict[str, np.ndarray]) -> Figure:
    """Draw the eccentricity of base V during the first impacts, and error against cost."""
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
    """Return the distance of base V from the axis of the bearing, m."""
    arm = solution.saved.states.bodies["arm 2"]
    rotation = Rotation.from_quat(np.asarray(arm.orientation), scalar_first=True)
    base = np.asarray(arm.position) + rotation.apply([-0.5, 0.0, -10e-3])
    return np.linalg.norm(base[:, :2], axis=1)


def _work_and_error(axes: Any, truth: dict[str, np.ndarray]) -> None:
    families: dict[str, list[AbstractModel]] = {
        "ideal joint": [MODELS[0]],
        "massless link": [MODELS[1]],
        "rigid, steps 2e-4 to 5e-6 s": [Rigid("", h) for h in (2e-4, 1e-4, 2e-5, 5e-6)],
        "compliant, fixed damping": [MODELS[5]],
        "compliant, paper's law, rtol 1e-3 to 1e-8": [
            Compliant("", cj.Settings(rtol=rtol)) for rtol in (1e-3, 1e-4, 1e-5, 1e-6, 1e-8)
        ],
    }
    marks = zip(families.items(), "osD^v", strict=True)
    colours = (style.DARK, style.BLUE, style.VERMILLION, style.PURPLE, style.GREEN)
    for ((name, models), mark), colour in zip(marks, colours, strict=True):
        errors = [1e6 * error(model, truth)[:51].max() for model in models]
        work = [1e3 * cost(model, EARLY * 20)[1] for model in models]
        axes.loglog(work, errors, marker=mark, color=colour, label=name)
    style.dress(axes, "time of 1 s of motion in ms", "largest error up to 50 ms in µm")
    axes.set_xlim(2.0, 300.0)
    axes.set_ylim(1e-11, 2e3)
    axes.legend(fontsize=8, loc="lower left")

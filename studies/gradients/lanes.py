"""Cost of the gradients of a batch of runs, by `jax.vmap`, compared with as many single calls."""

import time
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import clearjoint as cj
from clearjoint.testing import optimise_programs
from studies.gradients.accuracy import END, NAME, OUTPUT, SETTINGS, paths_of, rod

RUNS, QUICK_RUNS = 64, 3
SPREAD = 0.1
"""Range of the parameters over a batch, relative to their values."""
WIDTHS, QUICK_WIDTHS = (0, 2), (0,)
"""Widths of the network, as in `accuracy`."""


class Row(NamedTuple):
    """Processor times of value and gradient, s for each run, in single calls and in a batch; and
    whether both have the same bits."""

    scene: str
    runs: int
    single: float
    batch: float
    same_bits: bool


def measure(quick: bool) -> list[Row]:
    """Measure value and gradient of the height of the rod, and of the position of an arm."""
    count, end = (QUICK_RUNS, 0.03) if quick else (RUNS, END)
    rows = []
    for width in QUICK_WIDTHS if quick else WIDTHS:
        scene, state = rod(width)
        times = [0.5 * end, end]
        predict = cj.predictor(scene, state, end, paths_of(width), OUTPUT, times, SETTINGS)
        numbers = sum(map(np.size, jax.tree.leaves(predict.values)))
        rows.append(row(f"rod, p = {numbers}", predict, count))
    if not quick:
        scene, state = cj.mechanisms.double_pendulum()
        paths = {
            "clearance": lambda scene: scene.joints["shoulder"].clearance,
            "mass": lambda scene: scene.bodies["arm 3"].mass,
        }
        output = {NAME: cj.quantities.Position("arm 3", "y")}
        predict = cj.predictor(scene, state, 0.1, paths, output, [0.05, 0.1], SETTINGS)
        rows.append(row("double pendulum, p = 2", predict, count))
    return rows


def row(scene: str, predict: cj.Predictor, count: int) -> Row:
    """Measure runs at parameters that are spread over a range."""
    gradient = jax.value_and_grad(lambda values: predict(values)[NAME][-1])
    in_batch = jax.vmap(gradient)
    factors = 1.0 + SPREAD * np.linspace(-0.5, 0.5, count)

    def starts(shift: float) -> dict:
        return jax.tree.map(
            lambda leaf: jnp.stack([(factor + shift) * leaf for factor in factors]), predict.values
        )

    def singly(batch: dict) -> list:
        return [gradient(jax.tree.map(lambda leaf, k=k: leaf[k], batch)) for k in range(count)]

    # Each batch has other parameters, because the predictor keeps the latest runs.
    singly(starts(1e-4))
    in_batch(starts(2e-4))
    optimise_programs()
    in_batch(starts(3e-4))
    single, _ = timed(lambda: singly(starts(4e-4)))
    batch, together = timed(lambda: in_batch(starts(5e-4)))
    expected = singly(starts(5e-4))
    same = all(
        np.array_equal(leaf, np.stack(leaves))
        for leaf, *leaves in zip(
            jax.tree.leaves(together),
            *(jax.tree.leaves(of_run) for of_run in expected),
            strict=True,
        )
    )
    return Row(scene, count, single / count, batch / count, same)


def timed(function: Callable) -> tuple[float, object]:
    """Return the processor time of a call, s, and its result."""
    begun = time.process_time()
    result = function()
    return time.process_time() - begun, result


def table(rows: list[Row]) -> list[tuple[str, ...]]:
    """Return the table as text."""
    head = "scene", "runs", "single call, ms", "in a batch, ms", "ratio", "same bits"
    cells = [
        (
            r.scene, f"{r.runs}", f"{1e3 * r.single:.1f}", f"{1e3 * r.batch:.1f}",
            f"{r.batch / r.single:.2f}", "yes" if r.same_bits else "no",
        )
        for r in rows
    ]  # fmt: skip
    return [head, *cells]

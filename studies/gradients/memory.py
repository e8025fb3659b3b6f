"""Memory of a gradient along a million steps, and times of first gradients."""

import resource
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace

import jax
import jax.numpy as jnp

import clearjoint as cj
from studies.benchmark.ladder_scenes import SCENES
from studies.common.fresh_process import lines_of_process

FIRST = "import sys; from studies.gradients.memory import print_first; print_first(sys.argv[1:])"
STEPS = (10_000, 1_000_000)
"""Numbers of accepted steps, at least."""
STEP = 1e-3
"""Length of a step, s."""


def oscillator() -> tuple[cj.Scene, cj.State]:
    """Return a ball on a spring."""
    spring = cj.SpringDamper("ground", "ball", (0, 0, 0), (0, 0, 0), stiffness=100.0)
    scene = cj.Scene({"ball": cj.Body(1.0, (1e-3, 1e-3, 1e-3))}, forces={"spring": spring})
    return scene, cj.State({"ball": cj.body_state((0.1, 0, 0))})


def pendulum() -> tuple[cj.Scene, cj.State]:
    """Return the paper's double pendulum."""
    return cj.mechanisms.double_pendulum()


def four_bar() -> tuple[cj.Scene, cj.State]:
    """Return a four-bar with two plays."""
    return cj.mechanisms.four_bar({"crank pin": 1e-4, "rocker foot": 2e-4})


def chain() -> tuple[cj.Scene, cj.State]:
    """Return thirty joints with backlash."""
    return SCENES["backlash"](30)


MECHANISMS: dict[str, Callable[[], tuple[cj.Scene, cj.State]]] = {
    "double pendulum": pendulum,
    "four-bar": four_bar,
    "30 joints with backlash": chain,
}


def print_first(arguments: list[str]) -> None:
    """Print the processor time, s, of the first gradient by the masses of all bodies in this
    process, with nothing kept."""
    with tempfile.TemporaryDirectory() as folder:
        cj.configure(cache=folder)
        scene, state = MECHANISMS[" ".join(arguments)]()
        bodies = list(scene.bodies)
        masses = {f"m{k}": lambda s, b=b: s.bodies[b].mass for k, b in enumerate(bodies)}
        output = {"x": cj.quantities.Position(bodies[-1], "x")}
        begun = time.process_time()
        predict = cj.predictor(scene, state, 1e-3, masses, output, [1e-3])
        jax.grad(lambda values: jnp.sum(predict(values)["x"]))(predict.values)
        print(time.process_time() - begun)


def firsts(quick: bool) -> list[tuple[str, str]]:
    """Return rows of mechanism and time of the first gradient in a fresh process."""
    rows = [("first gradient by the masses, nothing kept", "processor time")]
    for name in list(MECHANISMS)[: 1 if quick else None]:
        lines, _ = lines_of_process(FIRST, *name.split())
        rows.append((name, f"{float(lines[-1]):.1f} s"))
    return rows


def megabytes() -> float:
    """Return the largest memory of this process so far."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def long_run(quick: bool) -> list[tuple[str, ...]]:
    """Return rows of steps, memory beyond that of the first run, and time of value and gradient."""
    scene, state = oscillator()
    path = {"stiffness": lambda scene: scene.forces["spring"].stiffness}
    output = {"x": cj.quantities.Position("ball", "x")}
    rows: list[tuple[str, ...]] = [("accepted steps", "memory, MB", "value and gradient, s")]
    first = None
    for steps in STEPS[:1] if quick else STEPS:
        # Settings have no largest length of a step: this tolerance makes steps about as long.
        end = STEP * steps
        settings = replace(cj.presets.derivatives, rtol=1e-13, max_steps=10_000_000)
        predict = cj.predictor(scene, state, end, path, output, [end], settings)
        begun = time.process_time()
        jax.grad(lambda values, p=predict: jnp.sum(p(values)["x"]))(predict.values)
        seconds = time.process_time() - begun
        accepted = cj.simulate(scene, state, end, settings, progress=False).accepted
        first = megabytes() if first is None else first
        rows.append((f"{int(accepted)}", f"{megabytes() - first:.0f}", f"{seconds:.1f}"))
    return rows

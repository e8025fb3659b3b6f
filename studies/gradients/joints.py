"""Gradients by four numbers of each of thirty joints with backlash.

Rotors turn links through joints with play, in a chain (see `studies.benchmark.backlash_chain`). The
parameters are play, stiffness and restitution of each joint, and the mass of its link; the output
is the sum of the coordinates of the last link at the end.
"""

import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from itertools import count

import jax
import numpy as np
from jaxtyping import PyTree

import clearjoint as cj
from studies.benchmark.backlash_chain import SPAN, chain
from studies.common.fresh_process import lines_of_process
from studies.gradients.accuracy import central_difference, product, seconds

JOINTS, QUICK_JOINTS = 30, 1
SETTINGS = replace(cj.presets.derivatives, rtol=1e-9)
TIGHT = replace(SETTINGS, rtol=1e-12)
COMPARED = 8
"""Number of derivatives that are compared with forward mode, at most."""
FIRST = "import sys; from studies.gradients.joints import print_first; print_first(sys.argv[1])"


def parameters_of(joints: int) -> dict[str, cj.Parameter]:
    """Return play, stiffness and restitution of each joint, and the mass of its link."""
    found = {}
    for k in range(1, joints + 1):
        play, link = f"play {k}", f"link {k}"
        stiffness = lambda s, j=play: s.joints[j].law.stiffness.stiffness  # noqa: E731
        found |= {
            play: cj.Parameter(lambda s, j=play: s.joints[j].play, cj.Log()),
            f"stiffness {k}": cj.Parameter(stiffness, cj.Log()),
            f"restitution {k}": cj.Parameter(lambda s, j=play: s.joints[j].law.restitution),
            f"mass {k}": cj.Parameter(lambda s, b=link: s.bodies[b].mass, cj.Log()),
        }
    return found


@dataclass(frozen=True)
class Problem:
    """A chain of a number of joints, and the sum of the last link's coordinates at the end."""

    joints: int

    def mechanism(self) -> tuple[cj.Scene, cj.State]:
        """Return the chain and its initial state."""
        return chain(self.joints)

    def outputs(self) -> dict[str, cj.extend.Quantity]:
        """Return the coordinates of the last link."""
        return {axis: cj.quantities.Position(f"link {self.joints}", axis) for axis in ("x", "y")}

    def predictor(self, settings: cj.Settings) -> cj.Predictor:
        """Return the coordinates as a function of the parameters."""
        chosen = parameters_of(self.joints)
        return cj.predictor(*self.mechanism(), SPAN, chosen, self.outputs(), [SPAN], settings)

    def scalar(self, settings: cj.Settings) -> tuple[Callable[[PyTree], jax.Array], PyTree]:
        """Return the sum as a function of the parameters, and their values."""
        predict = self.predictor(settings)

        def total(values: PyTree) -> jax.Array:
            found = predict(values)
            return (found["x"] + found["y"])[0]

        return total, predict.values

    def forward(self, names: list[str], settings: cj.Settings) -> np.ndarray:
        """Return derivatives of the sum by some parameters, SI, in forward mode."""
        every = parameters_of(self.joints)
        chosen = {name: every[name] for name in names}
        run = cj.sensitivities(
            *self.mechanism(), SPAN, chosen, self.outputs(), [SPAN], settings, progress=False
        )
        by_coordinate = run.derivatives["x"][0] + run.derivatives["y"][0]
        _, values = self.scalar(settings)
        scales = [every[name].scale for name in names]
        slopes = [s.slope(s.coordinate(values[n])) for s, n in zip(scales, names, strict=True)]
        return np.asarray(by_coordinate) / np.asarray(slopes, float)


def print_first(joints: str) -> None:
    """Print the processor time, s, of the first gradient in this process, with nothing kept."""
    with tempfile.TemporaryDirectory() as folder:
        cj.configure(cache=folder)
        problem = Problem(int(joints))
        begun = time.process_time()
        total, values = problem.scalar(SETTINGS)
        jax.grad(total)(values)
        print(time.process_time() - begun)


def table(quick: bool) -> list[tuple[str, str]]:
    """Measure a gradient of a chain, and return rows of quantity and value."""
    problem = Problem(QUICK_JOINTS if quick else JOINTS)
    total, values = problem.scalar(SETTINGS)
    gradient = jax.grad(total)(values)
    scale_of = {name: abs(float(value)) for name, value in values.items()}
    # By relative changes, so that derivatives by numbers of all units can be compared.
    largest = max(abs(float(gradient[name])) * scale_of[name] for name in values)

    random = np.random.default_rng(5)
    names = [str(n) for n in random.permutation(list(values))[:COMPARED]]
    reverse = np.array([gradient[name] for name in names])
    scales = np.array([scale_of[name] for name in names])
    same, tight = (problem.forward(names, settings) for settings in (SETTINGS, TIGHT))
    direction = {n: 1e-3 * scale_of[n] * random.standard_normal() for n in values}
    along = product(gradient, direction)
    difference = central_difference(problem.scalar(TIGHT)[0], values, direction)

    run = cj.simulate(*problem.mechanism(), SPAN, SETTINGS, cj.Saving(impacts=True), progress=False)
    assert run.impacts is not None
    rounds = count(1)

    def value_and_gradient() -> None:
        # Runs of values that were computed before are kept.
        share = 1.0 + 1e-12 * next(rounds)
        jax.grad(total)({name: value * share for name, value in values.items()})

    plain = seconds(partial(cj.simulate, *problem.mechanism(), SPAN, SETTINGS, progress=False))
    both = seconds(value_and_gradient)
    few = seconds(partial(problem.forward, names, SETTINGS))
    (*_, first), _ = lines_of_process(FIRST, str(problem.joints))
    return [
        ("joints; parameters", f"{problem.joints}; {len(values)}"),
        ("impacts; accepted steps", f"{len(run.impacts)}; {int(run.accepted)}"),
        ("plain run", f"{1e3 * plain:.0f} ms"),
        ("value and gradient", f"{both / plain:.1f} runs"),
        (f"forward mode by {len(names)} of the parameters", f"{few / plain:.1f} runs"),
        (
            "difference from forward mode",
            f"{np.abs((reverse - same) * scales).max() / largest:.0e}",
        ),
        (
            "error; of forward mode",
            f"{np.abs((reverse - tight) * scales).max() / largest:.0e}; "
            f"{np.abs((same - tight) * scales).max() / largest:.0e}",
        ),
        ("error along a direction", f"{abs(along - difference) / abs(difference):.0e}"),
        ("first gradient in a process, nothing kept", f"{float(first):.1f} s of processor time"),
    ]

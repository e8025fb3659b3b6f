"""Accuracy and cost of gradients by 1 to 1000 numbers across a hundred impacts.

A rod in a vertical guide falls with its journal onto the wall of a bearing and bounces, under a
force that a network computes from its height and speed. The parameters are the clearance and the
network's weights.
"""

import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import count
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree
from typing_extensions import override

import clearjoint as cj
from clearjoint.testing import optimise_programs

CLEARANCE, RESTITUTION, END = 0.5e-3, 0.99, 1.0
"""Clearance, m, restitution, and end of the runs, s."""
WIDTHS = (0, 2, 25, 250)
"""Widths w of the network's hidden layer, with 4 w + 1 weights; 0 for no network."""
SETTINGS = replace(cj.presets.derivatives, rtol=1e-9)
TIGHT = replace(SETTINGS, rtol=1e-12)
CHECKED = 16
"""Number of derivatives that are compared with forward mode, if there are more."""
REPEATS = 5
HEIGHT = cj.quantities.Position("rod", "y")
NAME, STEP = "height", 1e-4
"""Name of the output, and step of central differences, in units of the direction."""
OUTPUT = {NAME: HEIGHT}


class NetworkForce(cj.extend.AbstractForce):
    """A force along Y, N, on the rod."""

    network: eqx.nn.MLP

    @override
    def body_names(self):
        return ("rod",)

    @override
    def wrenches(self, motions, t):
        rod = motions["rod"]
        force = self.network(jnp.stack([rod.position.y / CLEARANCE, 10.0 * rod.velocity.y]))
        return {"rod": cj.extend.Wrench(cj.extend.Vector(0.0, force, 0.0), cj.extend.ZERO)}


def rod(width: int) -> tuple[cj.Scene, cj.State]:
    """Return a rod of 1 kg in a bearing of steel, with a network of a width."""
    joint = cj.ClearanceJoint(
        "ground",
        "rod",
        journal_point=(0.0, 0.0, 0.0),
        bearing_radius=10e-3,
        clearance=CLEARANCE,
        journal_length=20e-3,
        law=cj.laws.LankaraniNikravesh(restitution=RESTITUTION, stiffness=cj.mechanisms.STEEL),
    )
    forces = {}
    if width:
        network = eqx.nn.MLP(2, "scalar", width, 1, jax.nn.tanh, key=jax.random.key(1))
        forces = {"network": NetworkForce(network)}
    # Without the guide, the rod would tilt: its fall onto both ends of the bearing is unstable.
    guide = cj.PrismaticJoint("ground", "rod", (0, 0, 0), (0, 0, 0), axis=(0, 1, 0))
    bodies, joints = {"rod": cj.Body(1.0, (1e-5, 3e-3, 3e-3))}, {"guide": guide, "pin": joint}
    scene = cj.Scene(bodies, joints, forces, gravity=(0.0, -9.81, 0.0))
    return scene, cj.State({"rod": cj.body_state((0.0, 0.0, 0.0))})


def paths_of(width: int) -> dict[str, Callable]:
    """Return the parameters."""
    paths = {"clearance": lambda scene: scene.joints["pin"].clearance}
    if width:
        paths["network"] = lambda scene: scene.forces["network"].network
    return paths


class Row(NamedTuple):
    """Results for p parameters: numbers of impacts and of accepted steps; processor times of a
    plain run, s, and, in plain runs, of value and gradient and of forward mode; errors of the
    gradient and of forward mode, relative to the largest derivative; and relative errors along a
    direction of the gradient, and of derivatives of the computed steps."""

    parameters: int
    impacts: int
    steps: int
    plain: float
    reverse: float
    forward: float | None
    reverse_error: float
    forward_error: float
    along: float
    of_steps: float


def measure(quick: bool) -> list[Row]:
    """Measure gradients by all numbers of parameters."""
    return [row(width, 0.03 if quick else END) for width in (WIDTHS[:2] if quick else WIDTHS)]


def row(width: int, end: float) -> Row:
    """Measure the gradient of the height at the end of a run."""
    scene, state = rod(width)
    paths, times = paths_of(width), [0.5 * end, end]
    predict = cj.predictor(scene, state, end, paths, OUTPUT, times, SETTINGS)
    height = lambda values: predict(values)["height"][-1]  # noqa: E731
    gradient = jax.grad(height)
    slopes = gradient(predict.values)
    leaves, structure = jax.tree.flatten(predict.values)
    flat = np.concatenate([np.ravel(leaf) for leaf in jax.tree.leaves(slopes)])
    size = float(np.abs(flat).max())

    # Central differences of runs at a far smaller tolerance, along a direction.
    random = np.random.default_rng(3)
    direction = jax.tree.unflatten(
        structure, [1e-3 * np.abs(leaf) * random.standard_normal(leaf.shape) for leaf in leaves]
    )
    along = product(slopes, direction)
    tight = cj.predictor(scene, state, end, paths, OUTPUT, times, TIGHT)
    difference = central_difference(
        lambda values: tight(values)["height"][-1], predict.values, direction
    )
    of_steps = derivative_of_steps(scene, state, end, paths, predict.values, direction)

    places, found, expected, forward = forward_mode(scene, state, end, predict.values, len(flat))
    saved = cj.Saving(impacts=True)
    run = cj.simulate(scene, state, end, SETTINGS, saved, progress=False)
    assert run.impacts is not None
    rounds = count(1)

    def value_and_gradient() -> None:
        # Runs of values that were computed before are kept.
        share = 1.0 + 1e-12 * next(rounds)
        gradient(jax.tree.map(lambda leaf: leaf * share, predict.values))

    plain = seconds(partial(cj.simulate, scene, state, end, SETTINGS, progress=False))
    return Row(
        parameters=len(flat),
        impacts=len(run.impacts),
        steps=int(run.accepted),
        plain=plain,
        reverse=seconds(value_and_gradient) / plain,
        forward=None if forward is None else forward / plain,
        reverse_error=float(np.abs(flat[places] - expected).max()) / size,
        forward_error=float(np.abs(found - expected).max()) / size,
        along=abs(along - difference) / abs(difference),
        of_steps=abs(of_steps - difference) / abs(difference),
    )


def product(first: PyTree, second: PyTree) -> float:
    """Return the sum of the products of the numbers of two trees."""
    return sum(jax.tree.leaves(jax.tree.map(lambda a, b: float(np.sum(a * b)), first, second)))


def central_difference(
    function: Callable[[PyTree], jax.Array], values: PyTree, direction: PyTree
) -> float:
    """Return the derivative of a function along a direction, by steps of `STEP` of it."""
    above, below = (
        float(function(jax.tree.map(lambda a, b, s=s: a + s * b, values, direction)))
        for s in (STEP, -STEP)
    )
    return (above - below) / (2.0 * STEP)


def derivative_of_steps(
    scene: cj.Scene,
    state: cj.State,
    end: float,
    paths: dict[str, Callable],
    values: PyTree,
    direction: PyTree,
) -> float:
    """Return the derivative of the steps that a run computes, without control of its error, as
    other differentiable simulators do, by `jax.jvp` of `simulate`."""

    def height(values: PyTree) -> jax.Array:
        changed = eqx.tree_at(paths["clearance"], scene, values["clearance"])
        if "network" in values:
            network = eqx.combine(values["network"], paths["network"](scene))
            changed = eqx.tree_at(paths["network"], changed, network)
        return cj.simulate(changed, state, end, SETTINGS).final.bodies["rod"].position[1]

    values, direction = jax.tree.map(jnp.asarray, (values, direction))
    return float(jax.jit(lambda v, d: jax.jvp(height, (v,), (d,))[1])(values, direction))


def forward_mode(
    scene: cj.Scene, state: cj.State, end: float, values: PyTree, number: int
) -> tuple[list[int], np.ndarray, np.ndarray, float | None]:
    """Return places in the flat gradient, the derivatives there by `sensitivities` and those of a
    far smaller tolerance, and the time, s, of those by all parameters, if they are few."""
    clearance = cj.Parameter(lambda s: s.joints["pin"].clearance)
    parameters = [clearance]
    for k, layer in enumerate(values["network"].layers if "network" in values else ()):
        for field in ("weight", "bias"):
            for index in np.ndindex(np.shape(getattr(layer, field))):
                path = lambda s, place=(k, field, index): weight(s, *place)  # noqa: E731
                parameters.append(cj.Parameter(path))
    assert len(parameters) == number
    few, places = number <= 128, list(range(number))
    if number > CHECKED:
        places = [0, *sorted(np.random.default_rng(4).choice(places[1:], CHECKED - 1, False))]

    def call(chosen: list[int], settings: cj.Settings) -> np.ndarray:
        named = {f"p{k}": parameters[k] for k in chosen}
        arguments = named, OUTPUT, [end], settings
        run = cj.sensitivities(scene, state, end, *arguments, progress=False)
        return run.derivatives["height"][0]

    found, expected = call(places, SETTINGS), call(places, TIGHT)
    every = partial(call, list(range(number)), SETTINGS)
    return places, found, expected, seconds(every) if few else None


def weight(scene: cj.Scene, layer: int, field: str, index: tuple[int, ...]) -> jax.Array:
    """Return a number of the network."""
    force = scene.forces["network"]
    return getattr(force.network.layers[layer], field)[index]  # pyright: ignore


def seconds(call: Callable[[], object]) -> float:
    """Return the processor time of a call after one that compiles, s."""
    call()
    optimise_programs()
    begun = time.process_time()
    for _ in range(REPEATS):
        call()
    return (time.process_time() - begun) / REPEATS


def table(rows: list[Row]) -> list[tuple[str, ...]]:
    """Return rows of text with a heading."""
    heading = (
        *("parameters", "impacts", "steps", "plain run", "value and gradient", "forward mode"),
        *("error", "of forward mode", "along a direction", "of derivatives of steps"),
    )
    return [heading] + [
        (
            f"{row.parameters}",
            f"{row.impacts}",
            f"{row.steps}",
            f"{1e3 * row.plain:.1f} ms",
            f"{row.reverse:.1f} runs",
            "" if row.forward is None else f"{row.forward:.1f} runs",
            f"{row.reverse_error:.0e}",
            f"{row.forward_error:.0e}",
            f"{row.along:.0e}",
            f"{row.of_steps:.0e}",
        )
        for row in rows
    ]

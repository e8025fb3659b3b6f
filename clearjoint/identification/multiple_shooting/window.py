"""One window of multiple shooting: a run from a free start, and where it leads."""

from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from ...dynamics.contact_forces import Memory
from ...dynamics.coordinates import AbstractCoordinates
from ...math.rotations import normalised
from ...math.vectors import EulerParameters, Scalar
from ...model.bodies import State
from ...model.scene import Scene
from ...parametrisation.parametrised_scene import AbstractFamily, ParametrisedScene
from ...simulation.batch.reductions import Quantity
from ...simulation.method import Scheme
from ...simulation.sensitivities import Sampled, followed
from ...simulation.step_state import Step


class FreeStart(AbstractFamily):
    """A scene over its parameters and over the state that a window starts from.

    `values`: (p + 2 n + m,) coordinates of the parameters; small motions and changes of speed along
    the n speeds of the system (m, rad; m/s, rad/s), away from the `nominal` variables; logarithms
    of the factors by which the m entry speeds differ from the nominal `memory`.
    """

    values: Any
    base: ParametrisedScene
    coordinates: AbstractCoordinates
    nominal: Any
    memory: Memory

    def scene(self, values: Any) -> Scene:
        """The scene of the parameters."""
        return self.base.scene(values[: len(self.base.changes)])

    def start(self, values: Any) -> State:
        """The start, moved and kicked away from the nominal one."""
        scene, rest = self.scene(values), list(values[len(self.base.changes) :])
        entries, structure = jax.tree.flatten(self.memory)
        factors = rest[len(rest) - len(entries) :]
        memory = [entry * jnp.exp(factor) for entry, factor in zip(entries, factors, strict=True)]
        speeds = (len(rest) - len(entries)) // 2
        moved = self.coordinates.mechanics(scene, self.nominal).moved(rest[:speeds])
        kicked = self.coordinates.mechanics(scene, moved).kicked(rest[speeds : 2 * speeds])
        bodies = self.coordinates.decode(scene, kicked)
        return State(bodies, jax.tree.unflatten(structure, memory))


class Shot(eqx.Module):
    """A window's run: what was measured on it, and variables and memory at its ends.

    `start` and `end` are (d,) rows, with derivatives (d, P) along all of the window's unknowns.
    `reached` holds variables and memory at the end, from which a window may start.
    """

    sampled: Sampled
    start: jax.Array
    start_along: jax.Array
    end: jax.Array
    end_along: jax.Array
    reached: tuple[Any, Memory]


@eqx.filter_jit
def shot(
    scheme: Scheme,
    family: AbstractFamily,
    outputs: Mapping[str, Quantity],
    times: Any,
    t0: Any,
    t_end: Any,
    first_step: Any,
    max_steps: Any,
) -> Shot:
    """Run a window from its start to its end."""
    found, first, last = followed(scheme, family, outputs, times, t0, t_end, first_step, max_steps)
    ends = [_row(family, step) for step in (first, last)]
    return Shot(found, *ends[0], *ends[1], (last.y.motion, last.memory))


def _row(family: AbstractFamily, step: Step) -> tuple[jax.Array, jax.Array]:
    """Variables and memory in a row, Euler parameters of unit norm, and the row's derivatives."""

    def row(scene: Scene, motion: Any, memory: Memory) -> tuple[jax.Array, None]:
        del scene
        unit = jax.tree.map(_of_unit_norm, motion, is_leaf=_is_orientation)
        parts: list[Scalar] = jax.tree.leaves((unit, memory))
        return jnp.stack(parts), None

    assert step.tangents is not None
    along = step.tangents.y.motion, step.tangents.memory
    value, _, derivatives = family.pushed(row, (step.y.motion, step.memory), along)
    return value, derivatives.T


def _is_orientation(node: Any) -> bool:
    return isinstance(node, EulerParameters)


def _of_unit_norm(node: Any) -> Any:
    return normalised(node) if _is_orientation(node) else node

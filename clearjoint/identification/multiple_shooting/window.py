"""One window of multiple shooting: a run from a start that is estimated, and its end."""

from collections.abc import Mapping

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Float, PyTree

from ...compilation import Compiled
from ...dynamics.contact_forces import Memory
from ...dynamics.coordinates import AbstractCoordinates
from ...math.rotations import normalised
from ...math.vectors import EulerParameters, Scalar
from ...model.bodies import State
from ...model.scene import Scene
from ...parametrisation.parametrised_scene import AbstractFamily, Coordinates, ParametrisedScene
from ...quantities.base import Quantity
from ...simulation.method import Scheme
from ...simulation.sampling import Sampled, followed
from ...simulation.step_state import Step


class FreeStart(AbstractFamily):
    """A scene and the state that a window starts from as functions of all that is estimated.

    `values`, (p + 2 n + m,), are in this order

    - the coordinates of the p parameters,
    - displacements along the n speeds of the system, m or rad, from the `nominal` variables,
    - changes of these speeds, m/s or rad/s,
    - logarithms of the ratios of the m entry speeds to those in the nominal `memory`.
    """

    values: Coordinates
    base: ParametrisedScene
    coordinates: AbstractCoordinates
    nominal: PyTree
    memory: Memory

    def scene(self, values: Coordinates) -> Scene:
        """The scene, which depends on the parameters only."""
        return self.base.scene(values[: len(self.base.changes)])

    def start(self, values: Coordinates) -> State:
        """The nominal state, displaced and with its speeds changed."""
        scene, rest = self.scene(values), list(values[len(self.base.changes) :])
        entries, structure = jax.tree.flatten(self.memory)
        factors = rest[len(rest) - len(entries) :]
        memory = [entry * jnp.exp(factor) for entry, factor in zip(entries, factors, strict=True)]
        speeds = (len(rest) - len(entries)) // 2
        displaced = self.coordinates.mechanics(scene, self.nominal).after_displacement(
            rest[:speeds]
        )
        variables = self.coordinates.mechanics(scene, displaced).after_speed_change(
            rest[speeds : 2 * speeds]
        )
        bodies = self.coordinates.decode(scene, variables)
        return State(bodies, jax.tree.unflatten(structure, memory))


class WindowRun(eqx.Module):
    """The run of a window.

    - `sampled`: the outputs at its samples.
    - `start`, `end`: variables and memory at its ends, in a row.
    - `start_along`, `end_along`: derivatives of these along the window's P unknowns.
    - `final`: variables and memory at the end as the run has them, from which the next window may
      start.
    """

    sampled: Sampled
    start: Float[jax.Array, " d"]
    start_along: Float[jax.Array, "d P"]
    end: Float[jax.Array, " d"]
    end_along: Float[jax.Array, "d P"]
    final: tuple[PyTree, Memory]


@Compiled
def run_window(
    scheme: Scheme,
    family: AbstractFamily,
    outputs: Mapping[str, Quantity],
    times: jax.Array,
    t0: Scalar,
    t_end: Scalar,
    first_step: Scalar,
    max_steps: Scalar,
) -> WindowRun:
    """Run a window from `t0` to `t_end`, s, with derivatives along all of its unknowns."""
    run, first, last = followed(scheme, family, outputs, times, t0, t_end, first_step, max_steps)
    ends = [_row(family, step) for step in (first, last)]
    return WindowRun(run, *ends[0], *ends[1], (last.y.motion, last.memory))


def _row(family: AbstractFamily, step: Step) -> tuple[jax.Array, jax.Array]:
    """Variables and memory in a row, Euler parameters of unit norm, and the row's derivatives."""

    def row(scene: Scene, motion: PyTree, memory: Memory) -> tuple[jax.Array, None]:
        del scene
        unit = jax.tree.map(_of_unit_norm, motion, is_leaf=_is_orientation)
        parts: list[Scalar] = jax.tree.leaves((unit, memory))
        return jnp.stack(parts), None

    assert step.tangents is not None
    along = step.tangents.y.motion, step.tangents.memory
    value, _, derivatives = family.pushed(row, (step.y.motion, step.memory), along)
    return value, derivatives.T


def _is_orientation(node: object) -> bool:
    return isinstance(node, EulerParameters)


def _of_unit_norm(node: PyTree) -> PyTree:
    return normalised(node) if _is_orientation(node) else node

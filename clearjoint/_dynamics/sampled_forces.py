"""Memories of sampled forces in the course of a run: initial values, and forces that hold them."""

from collections.abc import Mapping

import equinox as eqx
import jax.numpy as jnp
from typing_extensions import override

from .._fields.checks import nearest, require
from .._math.vectors import IDENTITY, ZERO, Scalar, unpack
from .._model.bodies import NO_WRENCH, Motion, Wrench
from .._model.joints.base import AbstractForce, Motions
from .._model.joints.sampled_force import AbstractSampledForce, ForceMemory
from .._model.scene import Scene
from .coordinates import MotionVariables
from .kinds import Kinds
from .system import System

Memories = Mapping[str, ForceMemory]
"""Memory of each sampled force of a scene, by name."""
NO_MEMORIES: Memories = {}


class HeldForce(AbstractForce):
    """A sampled force between two instants, with its `memory`. An entry (before, after, s) of
    `changes`, with the memories before and after an instant, adds s times the change of the
    wrenches. Derivatives by s, at zero, give the jump of the rates at the instant."""

    force: AbstractSampledForce
    memory: dict[str, Scalar]
    changes: tuple[tuple[dict[str, Scalar], dict[str, Scalar], Scalar], ...] = ()

    @override
    def body_names(self) -> tuple[str, ...]:
        return self.force.body_names()

    @override
    def wrenches(self, motions: Motions, t: Scalar) -> dict[str, Wrench]:
        total = self.force.held_wrenches(self.memory, motions, t)
        for before, after, share in self.changes:
            # The share times the wrenches with the memory after less those with the memory before.
            for memory, factor in ((after, share), (before, -share)):
                for name, wrench in self.force.held_wrenches(memory, motions, t).items():
                    total[name] = total.get(name, NO_WRENCH) + wrench * factor
        return total


def sampled_forces(scene: Scene) -> dict[str, AbstractSampledForce]:
    forces = scene.forces.items()
    return {name: force for name, force in forces if isinstance(force, AbstractSampledForce)}


def memory_names(scene: Scene) -> dict[str, list[str]]:
    """Return the names of the numbers in each sampled force's memory. `scene` is not unpacked."""
    # The names do not depend on the motion.
    still = Motion(ZERO, IDENTITY, ZERO, ZERO)
    return {
        name: list(force.initial_memory(dict.fromkeys(force.body_names(), still), 0.0))
        for name, force in sampled_forces(unpack(scene)).items()
    }


def initial_memories(
    system: System, variables: MotionVariables, t: Scalar, given: Memories
) -> dict[str, dict[str, Scalar]]:
    """Return the memory of each sampled force: the numbers in `given` and, where `given` lacks one,
    the number with which a run from the positions and velocities `variables` at the time t starts.
    Raise a `ValueError` if `given` has an unknown name."""
    forces = sampled_forces(system.scene)
    remedy = "correct the name, or leave it out of the state"
    for name in given:
        expected = f"of sampled forces of the scene, {sorted(forces)}"
        require(name in forces, "state.memory", name, expected, nearest(name, forces, remedy))
    if not forces:
        return {}
    kinds, motions, memories = Kinds(system.scene), system.motions(variables), {}
    for name, force in forces.items():
        # The method of the class is the same object for all its forces, as `Kinds` requires.
        memory = kinds.evaluate(type(force).initial_memory, force, motions, system.scene_time(t))
        given_numbers = given.get(name, {})
        for key in given_numbers:
            expected, advice = f"one of {sorted(memory)}", nearest(key, memory, remedy)
            require(key in memory, f"state.memory[{name!r}]", key, expected, advice)
        numbers = {**memory, **given_numbers}
        memories[name] = {key: jnp.asarray(numbers[key], dtype=float) for key in memory}
    return memories


def updated_memory(
    force: AbstractSampledForce, motions: Motions, name: str, memory: ForceMemory, t: Scalar
) -> ForceMemory:
    """Return the memory of a force after its instant `name` at the time t, s, checked for the same
    keys. `Kinds.evaluate` can call this function, since its arguments begin with force, motions."""
    updated = force.updated_memory(name, memory, motions, t)
    argument = f"{type(force).__name__}.updated_memory"
    expected, remedy = f"the same numbers, {sorted(memory)}", "return {**memory, ...}"
    require(updated.keys() == memory.keys(), argument, sorted(updated), expected, remedy)
    return updated


def holding(system: System, memories: Memories) -> System:
    """Return the system with each sampled force replaced by a `HeldForce` with its memory in
    `memories`; the same system if there are none."""
    if not memories:
        return system
    held = {
        name: HeldForce(force, dict(memories[name]))
        for name, force in sampled_forces(system.scene).items()
    }
    return with_forces(system, held)


def with_forces(system: System, forces: Mapping[str, AbstractForce]) -> System:
    scene = eqx.tree_at(lambda s: s.forces, system.scene, {**system.scene.forces, **forces})
    return system.with_scene(scene)

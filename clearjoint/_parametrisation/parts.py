"""Parts of a scene, from a number to an element, or numbers of its state, and their setters."""

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree
from typing_extensions import override

from .._fields.checks import require, require_names
from .._model.bodies import State
from .._model.scene import Scene
from .parameter import Parameter
from .paths import Number, marked, value_at
from .variations import AbstractLeafSetter, Change, SceneNumber, require_apart

Part = Callable[[Scene], PyTree] | Parameter
"""A function of a scene that selects a number, an array or a whole element, or a `Parameter`."""
_EXAMPLE = 'pass for example {"clearance": lambda scene: scene.joints["pin"].clearance}'


@dataclass(frozen=True)
class PartSetter(AbstractLeafSetter):
    """A `Change` that sets a scene's arrays, located by `numbers`, to the leaves of a value."""

    numbers: tuple[Number, ...]
    in_scene: ClassVar[bool] = True

    @override
    def set_in(self, scene: list[PyTree], state: list[PyTree], value: PyTree) -> None:
        for number, array in zip(self.numbers, jax.tree.leaves(value), strict=True):
            scene[number.leaf] = array


def parts_of(
    scene: Scene, state: State, paths: Mapping[str, Part]
) -> tuple[dict[str, PyTree], tuple[tuple[str, Change], ...]]:
    """Return the numbers, SI, that `paths` select, by name of the path, and pairs of this name and
    the function that sets the numbers. The numbers of an element are its arrays of floats.

    **Raises:** `ValueError` for a path that selects no number, and for a `Parameter` that has no
    `value` and is not a number of the scene or of the initial state.
    """
    require_names("paths", paths, _EXAMPLE)
    require(len(paths) > 0, "paths", {}, "not empty", _EXAMPLE)
    numbers: dict[str, PyTree] = {}
    changes: list[tuple[str, Change]] = []
    for name, path in paths.items():
        argument = f"paths[{name!r}]"
        if isinstance(path, Parameter):
            coordinate = path.coordinate_in(scene, state)
            numbers[name] = np.asarray(path.scale.value(coordinate), float)
            # The example 0.0 says that the value is a single number.
            changes.append((name, path.variation.setter(scene, state, 0.0)))
            continue
        expected = "a function of a scene or a Parameter"
        require(callable(path), argument, path, expected, _EXAMPLE)
        numbers[name], change = _selected(scene, state, path, argument)
        changes.append((name, change))
    require_apart("paths", dict(changes), scene, state)
    return numbers, tuple(changes)


def _selected(
    scene: Scene, state: State, path: Callable[[Scene], PyTree], argument: str
) -> tuple[PyTree, Change]:
    """Return the numbers that a path selects, and their setter. Errors mention the `argument`."""
    # The path runs on a scene with a `Number`, its location, in place of each array. If it raises
    # an error, it runs again in `value_at`, which raises the error with a remedy.
    element = None
    with suppress(AttributeError, KeyError, IndexError, TypeError):
        element = path(marked(jax.tree.structure(scene)))
    # One number or array, or several tied ones, as for a `Parameter`.
    if element is None or isinstance(element, Number | list | tuple):
        value = jnp.asarray(value_at(scene, path), float)
        return np.asarray(value), SceneNumber(path).setter(scene, state, value)
    # A whole element, whose leaves must be whole arrays of the scene.
    places, structure = jax.tree.flatten(element)
    leaves = jax.tree.leaves(scene)
    stored = all(isinstance(place, Number) and not place.component for place in places)
    remedy = "return a number, an array or an element of the scene, not a value computed from them"
    require(stored and bool(places), argument, element, "a part of the scene", remedy)
    chosen = tuple(place for place in places if eqx.is_inexact_array(leaves[place.leaf]))
    require(bool(chosen), argument, element, "a part with numbers", remedy)
    value = jax.tree.unflatten(structure, [leaves[place.leaf] for place in places])
    floats = eqx.filter(value, eqx.is_inexact_array)
    return jax.tree.map(lambda leaf: np.asarray(leaf, float), floats), PartSetter(chosen)


def guard_direction(paths: Mapping[str, Part], numbers: Mapping[str, PyTree]) -> dict[str, PyTree]:
    """Return a random direction in which to change the `numbers` of `paths`, in the same form. Runs
    in reverse mode have one tangent, the guard, along it, which chooses the steps.

    The components are normally distributed, from a fixed seed. The standard deviation is, for a
    `Parameter`, the slope of its scale; for an array, its root mean square, or 1 if it is zero."""
    random = np.random.default_rng(0)

    # Random components for the numbers of an array.
    def of_array(array: np.ndarray) -> np.ndarray:
        size = float(np.sqrt(np.mean(np.square(array)))) if array.size else 0.0
        return (size or 1.0) * random.standard_normal(array.shape)

    directions: dict[str, PyTree] = {}
    for name, path in paths.items():
        if isinstance(path, Parameter):
            slope = path.scale.slope(path.scale.coordinate(numbers[name]))
            directions[name] = np.asarray(slope * random.standard_normal(), float)
        else:
            directions[name] = jax.tree.map(of_array, numbers[name])
    return directions

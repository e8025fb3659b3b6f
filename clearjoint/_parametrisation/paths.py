"""Paths of numbers: find, list and replace the numbers of a scene or a state.

A path is a function such as ``lambda scene: scene.joints["pin"].clearance``. It may return one
component (``scene.gravity[1]``), or several numbers, which ties them: they get the same value.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields
from functools import lru_cache
from types import EllipsisType
from typing import NoReturn

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from .._fields.checks import as_number, concrete, nearest, require
from .._fields.leaves import with_leaves

NumberPath = Callable[[PyTree], PyTree]
"""Function of a scene or a state that returns one of its numbers, or several tied numbers."""
Index = int | slice | EllipsisType
"""Part of an index into an array: for one axis or, as an ellipsis, for several axes."""
Leaf = jax.Array | np.ndarray | float


@dataclass(frozen=True)
class Number:
    """Location of a number in a scene or a state: index of the array in the list of
    `jax.tree.leaves`, and indices into that array, empty for the whole array. ``location[1]`` is
    that of one component, ``location[0:2]`` that of several, which can't be indexed further."""

    leaf: int
    component: tuple[Index, ...] = ()

    # Without this, Python would iterate by `__getitem__`, which accepts every index: [*number]
    # would never end.
    __iter__ = None

    def __getitem__(self, key: Index | tuple[Index, ...]) -> "Number":
        keys = key if isinstance(key, tuple) else (key,)
        # In NumPy, an index after a slice, as in inertia[0:2][1], counts along the slice. Here all
        # indices are applied to the array at once, which would select something else.
        only_integers = all(isinstance(index, int | np.integer) for index in self.component)
        expected, remedy = "indexed no further after a slice", "give one index, as in inertia[1]"
        require(only_integers, "path", [*self.component, *keys], expected, remedy)
        return Number(self.leaf, (*self.component, *keys))


def numbers_at(tree: PyTree, path: NumberPath) -> list[Number]:
    """Return the locations of the numbers that a path selects; raise a `ValueError` for unknown
    names, computed values and whole elements. Whether a component exists is not checked."""
    try:
        # The path runs on a tree whose leaves are their own locations, so that it returns
        # locations instead of values.
        result = path(marked(jax.tree.structure(tree)))
        numbers: list[PyTree] = [*result] if isinstance(result, list | tuple) else [result]
    except (AttributeError, KeyError) as error:
        _refuse_missing(tree, error)
    except IndexError as error:
        raise ValueError(
            "Argument `path` must be a function that leads to numbers stored in the tree, but "
            "indexes beyond the end of a tuple or list: count from 0."
        ) from error
    except TypeError as error:
        # The path computes with a location, which supports no arithmetic. The check below refuses
        # everything that is not a location, and shows this error.
        numbers = [error]
    are_stored = bool(numbers) and all(isinstance(number, Number) for number in numbers)
    shown = [n if isinstance(n, Number | Exception) else type(n).__name__ for n in numbers]
    expected = "a function that returns numbers stored in the tree, not values computed from them"
    remedy = "see parameters(tree) for all numbers, e.g. lambda s: s.joints['pin'].clearance"
    require(are_stored, "path", shown, expected, remedy)
    return numbers


@lru_cache(maxsize=256)
def marked(structure: jax.tree_util.PyTreeDef) -> PyTree:  # pyright: ignore
    return jax.tree.unflatten(structure, [Number(k) for k in range(structure.num_leaves)])


def _refuse_missing(tree: PyTree, error: AttributeError | KeyError) -> NoReturn:
    """Raise the `ValueError` for a path with an unknown name, and suggest the nearest one."""
    missing = error.name if isinstance(error, AttributeError) else error.args[0]
    paths = [path for path, _ in jax.tree_util.tree_leaves_with_path(tree)]
    names = {getattr(key, "key", getattr(key, "name", "")) for path in paths for key in path}
    otherwise = (
        "see cj.parameters(scene), or cj.parameters(state) for Axis.initial and Parameter.initial, "
        "for all numbers"
    )
    raise ValueError(
        "Argument `path` must be a function that leads to numbers stored in the tree, but names "
        f"{missing!r}, which does not exist: {nearest(missing, map(str, names), otherwise)}."
    ) from error


def set_value(tree: PyTree, path: NumberPath, value: Leaf) -> PyTree:
    """Return a copy of a scene or state with another value, SI, of the number, or of all tied
    numbers, at a path. Checks of constructors, such as that a mass is positive, are not repeated.

    **Raises:** `ValueError` if the path leads to no number or to a component that the array does
    not have, and if the value has another shape than the number that it replaces.

    >>> scene, _ = cj.mechanisms.double_pendulum()
    >>> wider = cj.set_value(scene, lambda s: s.joints["shoulder"].clearance, 1e-3)
    >>> float(wider.joints["shoulder"].clearance)
    0.001
    """
    leaves = jax.tree.leaves(tree)
    set_in_leaves(leaves, numbers_at(tree, path), value)
    return with_leaves(tree, leaves)


def set_in_leaves(leaves: list[PyTree], numbers: Sequence[Number], value: Leaf) -> None:
    value = as_number(value)
    require_fits(leaves, numbers, value)
    for number in numbers:
        leaves[number.leaf] = _replaced(leaves[number.leaf], number.component, value)


def require_fits(leaves: list[PyTree], numbers: Sequence[Number], value: Leaf) -> None:
    """Raise a `ValueError` unless the `numbers`, which are locations, exist in `leaves` and have
    the shape of `value`."""
    for number in numbers:
        shape = _shape(leaves[number.leaf], number.component)
        expected = f"of shape {shape}, as the number it replaces"
        require(np.shape(value) == shape, "value", value, expected, "pass one value of that shape")


def value_at(tree: PyTree, path: NumberPath) -> Leaf:
    """Return the value that a path selects in a scene or state; the first of tied numbers."""
    number = numbers_at(tree, path)[0]
    leaf = jax.tree.leaves(tree)[number.leaf]
    _shape(leaf, number.component)  # refuses a missing component
    return leaf[number.component] if number.component else leaf


def _shape(leaf: PyTree, component: tuple[Index, ...]) -> tuple[int, ...]:
    """Return the shape of a leaf, or of its component, which must exist."""
    shape = np.shape(leaf)
    try:
        # NumPy refuses an index that is out of range, whereas JAX would silently accept it. The
        # array only serves this check, and `broadcast_to` makes it without taking memory.
        return np.broadcast_to(0.0, shape)[component].shape
    except IndexError as error:
        raise ValueError(
            f"Argument `path` must lead to an existing component, but leads to {list(component)} "
            f"of an array of shape {shape}: count from 0."
        ) from error


def _replaced(leaf: Leaf, component: tuple[Index, ...], value: Leaf) -> Leaf:
    if not component:
        return value
    # Numbers that JAX traces can only be set by JAX. Other numbers are set by NumPy, which compiles
    # nothing.
    if concrete(leaf) is None or concrete(value) is None:
        return jnp.asarray(leaf).at[component].set(value)
    array = np.array(leaf)
    array[component] = value
    return array


def unit_at(tree: PyTree, path: NumberPath) -> str:
    """Return the SI unit of the first number that a path selects; "1" for a number without unit."""
    index = numbers_at(tree, path)[0].leaf
    return list(_named_leaves(tree, ""))[index][2]


def parameters(tree: PyTree) -> dict[str, tuple[Leaf, str]]:
    """Return all numbers of a scene or state by name, each as a pair (value, SI unit as text).

    The name is a Python expression, such as "joints['shoulder'].clearance".

    >>> scene, _ = cj.mechanisms.double_pendulum()
    >>> [name for name in cj.parameters(scene) if "clearance" in name]
    ["joints['shoulder'].clearance"]
    """
    return {name: (value, unit) for name, value, unit in _named_leaves(tree, "")}


def _named_leaves(tree: PyTree, name: str, unit: str = "1") -> Iterator[tuple[str, PyTree, str]]:
    """Yield name, value and unit of each number of `tree`, a part of a scene or state, in the order
    of `jax.tree.leaves`. `name`: of the part, with which names of its numbers begin; `unit`: of
    numbers that are in no field of a module in the part, since fields declare their own units."""
    # As in JAX, static fields are no leaves.
    if isinstance(tree, eqx.Module):
        for field in fields(tree):
            if not field.metadata.get("static", False):
                inner = getattr(tree, field.name)
                unit = field.metadata.get("unit", "1")
                yield from _named_leaves(inner, f"{name}.{field.name}".lstrip("."), unit)
    elif isinstance(tree, dict):
        for key in sorted(tree):  # the order in which JAX flattens a dictionary
            yield from _named_leaves(tree[key], f"{name}[{key!r}]", unit)
    elif isinstance(tree, list | tuple):
        for index, inner in enumerate(tree):
            yield from _named_leaves(inner, f"{name}[{index}]", unit)
    elif tree is not None:
        yield name, tree, unit

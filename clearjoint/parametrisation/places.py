"""Parameters by place: naming, listing and replacing the numbers of a scene or a state.

A place is a function such as ``lambda scene: scene.joints["pin"].clearance``. It may return one
component (``scene.gravity[1]``), or several numbers, which ties them: they get the same value.
"""

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..fields.checks import as_number, concrete, require

Place = Callable[[Any], Any]


@dataclass(frozen=True)
class Number:
    """Where a number is: index of its leaf in the PyTree, and of its component, if it is one."""

    leaf: int
    component: tuple[Any, ...] = ()

    __iter__ = None
    """Not iterable: the protocol that falls back on indices would never end."""

    def __getitem__(self, key: Any) -> "Number":
        return Number(self.leaf, (*self.component, key))


def numbers_at(tree: Any, place: Place) -> list[Number]:
    """The numbers that a place names.

    **Raises:** `ValueError` if it returns anything else.
    """
    structure = jax.tree.structure(tree)
    marked = jax.tree.unflatten(structure, [Number(k) for k in range(structure.num_leaves)])
    try:
        named = place(marked)
        found: list[Any] = [*named] if isinstance(named, list | tuple) else [named]
    except (AttributeError, KeyError, TypeError) as error:
        found = [error]
    require(
        bool(found) and all(isinstance(number, Number) for number in found),
        "place",
        [n if isinstance(n, Number | Exception) else type(n).__name__ for n in found],
        "a function that returns numbers stored in the tree, not values computed from them",
        "see parameters(tree) for what there is, e.g. lambda s: s.joints['pin'].clearance",
    )
    return found


def put(tree: Any, place: Place, value: Any) -> Any:
    """The tree with another value at a place; nothing is checked (see `fields.recheck`).

    **Raises:** `ValueError` if the value has another shape than what it replaces.
    """
    return put_numbers(tree, numbers_at(tree, place), value)


def put_numbers(tree: Any, numbers: list[Number], value: Any) -> Any:
    """`put` for numbers already found."""
    leaves, structure = jax.tree.flatten(tree)
    value = as_number(value)
    for number in numbers:
        leaf = leaves[number.leaf]
        shape = _shape(leaf, number.component)
        require(
            jnp.shape(value) == shape,
            "value",
            value,
            f"of shape {shape}, as the number it replaces",
            "pass one value of that shape",
        )
        leaves[number.leaf] = _replaced(leaf, number.component, value)
    return jax.tree.unflatten(structure, leaves)


def value_at(tree: Any, place: Place) -> Any:
    """The value at a place; of tied numbers, the first's."""
    number = numbers_at(tree, place)[0]
    leaf = jax.tree.leaves(tree)[number.leaf]
    return leaf[number.component] if number.component else leaf


def _shape(leaf: Any, component: tuple[Any, ...]) -> tuple[int, ...]:
    try:
        return jnp.shape(leaf[component] if component else leaf)
    except IndexError as error:
        raise ValueError(
            f"Argument `place` must name a component that is there, but is {list(component)} of an "
            f"array of shape {jnp.shape(leaf)}: count from 0."
        ) from error


def _replaced(leaf: Any, component: tuple[Any, ...], value: Any) -> Any:
    if not component:
        return value
    if concrete(leaf) is None or concrete(value) is None:
        return jnp.asarray(leaf).at[component].set(value)
    changed = np.array(leaf)
    changed[component] = value
    return changed


def unit_at(tree: Any, place: Place) -> str:
    """The unit of the numbers at a place, "1" for pure numbers and where none is declared."""
    index = numbers_at(tree, place)[0].leaf
    return list(_named_leaves(tree, ""))[index][2]


def parameters(tree: Any) -> dict[str, tuple[Any, str]]:
    """All numbers of a scene or state by name: value and unit."""
    return {name: (value, unit) for name, value, unit in _named_leaves(tree, "")}


def _named_leaves(tree: Any, name: str, unit: str = "1") -> Any:
    """Name, value and unit of each leaf, in the order of the PyTree."""
    if isinstance(tree, eqx.Module):
        for field in fields(tree):
            if not field.metadata.get("static", False):
                inner = getattr(tree, field.name)
                unit = field.metadata.get("unit", "1")
                yield from _named_leaves(inner, f"{name}.{field.name}".lstrip("."), unit)
    elif isinstance(tree, dict):
        for key in sorted(tree):
            yield from _named_leaves(tree[key], f"{name}[{key!r}]", unit)
    elif isinstance(tree, list | tuple):
        for place, inner in enumerate(tree):
            yield from _named_leaves(inner, f"{name}[{place}]", unit)
    elif tree is not None:
        yield name, tree, unit

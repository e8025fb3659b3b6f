"""Modules whose fields convert themselves, so that a class of one's own needs only annotations."""

import inspect
from collections.abc import Callable
from dataclasses import Field, fields
from functools import lru_cache
from types import MappingProxyType
from typing import ClassVar, get_origin

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import PyTree

from .checks import as_number
from .readable import AbstractReadable
from .types import ArrayLike

NAMES = (str, bool, "str", "bool")
"""Annotations of what can't be a number: such fields are static."""


class AbstractConverting(AbstractReadable):
    """A PyTree that takes plain numbers, and stores arrays.

    A field that a subclass merely annotates becomes

    - static if it is annotated as `str` or `bool`: the name of a body, say;
    - else a 64-bit array, or several, of the numbers, tuples and lists that it is given. No number
      is then part of the program: another value compiles nothing anew.

    `clearjoint.extend.quantity("N m")` in its place also declares unit, shape and range, and with
    ``table=True`` that it is a table, which stays an array. A number that the program's form
    depends on, such as how often something is repeated, and a function are declared with
    ``equinox.field(static=True)``.
    """

    def __init_subclass__(cls, **options: object):
        super().__init_subclass__(**options)
        for name, annotation in inspect.get_annotations(cls).items():
            if not _is_no_field(annotation):
                setattr(cls, name, _declared(cls, name, annotation))

    @classmethod
    def field_converter(cls, name: str) -> Callable[[PyTree], PyTree]:
        """What turns the value given to a field into the one stored, where the field does not tell
        by itself."""
        del name
        return as_numbers


def as_numbers(value: PyTree) -> PyTree:
    """The value with its Python numbers, and tuples and lists of them, as 64-bit arrays."""
    if isinstance(value, int | float | np.number | np.ndarray) and not isinstance(value, bool):
        return as_number(value)
    if isinstance(value, dict):
        return {key: as_numbers(inner) for key, inner in value.items()}
    if not isinstance(value, tuple | list) or type(value) not in (tuple, list):
        return value
    parts = [as_numbers(part) for part in value]
    shapes = {part.shape if isinstance(part, np.ndarray | jax.Array) else None for part in parts}
    if len(shapes) != 1 or None in shapes:
        return type(value)(parts)
    library = jnp if any(isinstance(part, jax.Array) for part in parts) else np
    return library.stack(parts)


def with_arrays(tree: PyTree) -> PyTree:
    """The tree with its numbers as arrays of 64-bit floats, whatever types they were put in as.

    A Python number that `equinox.tree_at` puts into a scene would be part of the program, which
    then is compiled anew for each value. Numbers that JAX traces stay, and so do those in modules
    of other packages which convert none: they may be there to be part of the program.
    """
    leaves, structure = jax.tree.flatten(tree)
    if all(map(_is_float_array, leaves)):
        return tree
    numbers = _number_fields(structure)
    return jax.tree.unflatten(
        structure,
        [
            np.asarray(leaf, np.float64) if k in numbers and _is_other_number(leaf) else leaf
            for k, leaf in enumerate(leaves)
        ],
    )


def _is_float_array(leaf: PyTree) -> bool:
    if type(leaf) is np.ndarray:
        return leaf.dtype == np.float64
    return isinstance(leaf, jax.Array) and jnp.issubdtype(leaf.dtype, jnp.floating)


def _is_other_number(leaf: PyTree) -> bool:
    if isinstance(leaf, np.ndarray | np.generic | jax.Array):
        return leaf.dtype.kind in "biuf" and not isinstance(leaf, Tracer)
    return isinstance(leaf, int | float)


@lru_cache(maxsize=256)
def _number_fields(structure: jax.tree_util.PyTreeDef) -> set[int]:  # pyright: ignore
    """Which leaves are in fields for numbers: all of this package's modules, and of others those
    with a converter."""
    numbers: set[int] = set()

    def visit(node: PyTree, is_number: bool) -> None:
        if isinstance(node, eqx.Module):
            own = type(node).__module__.split(".")[0] == __name__.split(".")[0]
            for field in fields(node):
                if not field.metadata.get("static", False):
                    visit(getattr(node, field.name), own or "converter" in field.metadata)
        elif isinstance(node, dict | list | tuple):
            for part in node.values() if isinstance(node, dict) else node:
                visit(part, is_number)
        elif is_number:
            numbers.update(jax.tree.leaves(node))

    visit(jax.tree.unflatten(structure, range(structure.num_leaves)), True)
    return numbers


def on_device(value: ArrayLike, dtype: type[float] | type[int] = float) -> jax.Array:
    """The value as an array of JAX, for which nothing is compiled: `jax.numpy.asarray` makes a
    small program for each shape of Python's and numpy's numbers."""
    return jnp.asarray(value if isinstance(value, jax.Array) else np.asarray(value, dtype), dtype)


def _is_no_field(annotation: object) -> bool:
    if isinstance(annotation, str):
        return "ClassVar" in annotation
    return annotation is ClassVar or get_origin(annotation) in (
        ClassVar,
        eqx.AbstractVar,
        eqx.AbstractClassVar,
    )


def _declared(cls: type[AbstractConverting], name: str, annotation: object) -> Field:
    """The field as its class declares it, with a converter unless that says what it is."""
    given = cls.__dict__.get(name)
    field = given if isinstance(given, Field) else _plain_field(cls, name)
    if "converter" in field.metadata or field.metadata.get("static", False):
        return field
    added = {"static": True} if annotation in NAMES else {"converter": cls.field_converter(name)}
    field.metadata = MappingProxyType({**field.metadata, **added})
    return field


def _plain_field(cls: type[AbstractConverting], name: str) -> Field:
    return eqx.field(default=cls.__dict__[name]) if name in cls.__dict__ else eqx.field()

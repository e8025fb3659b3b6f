"""Base class of elements and laws, whose fields convert the numbers that users give to arrays.

User-defined subclasses need only annotate their fields.
"""

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

from .checks import as_number, is_of_package
from .readable import AbstractReadable
from .types import ArrayLike

NAMES = (str, bool, "str", "bool")
"""Annotations of fields that hold no numbers. These become static: part of a PyTree's structure."""


class AbstractConverting(AbstractReadable):
    """Base class of PyTree classes that accept Python numbers and store arrays.

    A field of a subclass that has only an annotation is

    - static if it is annotated as `str` or `bool`, as for the name of a body;
    - otherwise numeric: numbers, tuples and lists are converted to 64-bit arrays, so that a change
      of a number compiles nothing again.

    `clearjoint.extend.quantity("N m")` also declares unit, shape and range. In compiled programs,
    where the element computes, an array of three numbers becomes a `Vector`; a field declared with
    ``table=True`` stays an array. Declare functions, and numbers that determine the structure of a
    program, such as a number of repetitions, by ``equinox.field(static=True)``.
    """

    def __init_subclass__(cls, **options: object):
        super().__init_subclass__(**options)
        for name, annotation in inspect.get_annotations(cls).items():
            if not _is_no_field(annotation):
                setattr(cls, name, _declared(cls, name, annotation))

    @classmethod
    def field_converter(cls, name: str) -> Callable[[PyTree], PyTree]:
        """Return the function that converts the values given for the field `name`.

        It is called when a class is defined, for each field that is not static and does not declare
        a converter. A subclass may override this method, which returns `as_numbers` by default.
        """
        del name
        return as_numbers


def as_numbers(value: PyTree) -> PyTree:
    """Return a value with its Python numbers, and tuples and lists of numbers, as float64 arrays.

    Tuples and lists of numbers, or of arrays of equal shape, are stacked to one array.
    Dictionaries, and other tuples and lists, are converted entry by entry. All other values are
    unchanged.
    """
    if isinstance(value, int | float | np.number | np.ndarray) and not isinstance(value, bool):
        return as_number(value)
    if isinstance(value, dict):
        return {key: as_numbers(inner) for key, inner in value.items()}
    # A named tuple is a structure of its own, which must keep its type.
    if not isinstance(value, tuple | list) or type(value) not in (tuple, list):
        return value
    parts = [as_numbers(part) for part in value]
    shapes = {part.shape if isinstance(part, np.ndarray | jax.Array) else None for part in parts}
    if len(shapes) != 1 or None in shapes:
        return type(value)(parts)
    # All parts are arrays of one shape. Traced numbers can be stacked by JAX only.
    library = jnp if any(isinstance(part, jax.Array) for part in parts) else np
    return library.stack(parts)


def with_arrays(tree: PyTree) -> PyTree:
    """Return a PyTree, such as a scene and a state, with its numbers as float64 arrays.

    It is called before each run. A Python number that `equinox.tree_at` has put into a scene would
    otherwise be part of the program, which would be compiled for each of its values. Traced numbers
    are not converted, nor are numbers in Equinox modules of other packages in fields without a
    converter, since these may be meant as parts of the program.
    """
    leaves, structure = jax.tree.flatten(tree)
    # Usually nothing is left to convert.
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
    """Return the indices of the leaves that hold numbers to convert, in JAX's order of leaves.

    In Equinox modules of this package, these are the leaves in all fields that are not static; in
    other modules, those in fields with a converter. Leaves outside of all modules count too.
    """
    # The tree is visited with the indices of its leaves in place of the leaves.
    numbers: set[int] = set()

    def visit(node: PyTree, is_number: bool) -> None:
        if isinstance(node, eqx.Module):
            ours = is_of_package(node)
            for field in fields(node):
                if not field.metadata.get("static", False):
                    visit(getattr(node, field.name), ours or "converter" in field.metadata)
        elif isinstance(node, dict | list | tuple):
            for part in node.values() if isinstance(node, dict) else node:
                visit(part, is_number)
        elif is_number:
            numbers.update(jax.tree.leaves(node))

    visit(jax.tree.unflatten(structure, range(structure.num_leaves)), True)
    return numbers


def on_device(value: ArrayLike, dtype: type[float] | type[int] = float) -> jax.Array:
    """Return a value as a JAX array of the given type.

    It is converted to a NumPy array first, because `jax.numpy.asarray` of Python's and NumPy's
    numbers compiles a small program for each shape.
    """
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
    """Return the dataclass field `name` of a class, static or with a converter.

    A field that declares neither becomes static if its annotation is in `NAMES`, and gets the
    converter of `field_converter` otherwise.
    """
    # The class may have declared a field, or only a default value, or neither.
    given = cls.__dict__.get(name)
    if isinstance(given, Field):
        field = given
    else:
        field = eqx.field(default=given) if name in cls.__dict__ else eqx.field()
    if "converter" in field.metadata or field.metadata.get("static", False):
        return field
    added = {"static": True} if annotation in NAMES else {"converter": cls.field_converter(name)}
    field.metadata = MappingProxyType({**field.metadata, **added})
    return field

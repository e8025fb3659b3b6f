"""Objects whose fields are declared, checked, converted to arrays and printed."""

import inspect
from collections.abc import Callable
from dataclasses import KW_ONLY, Field, FrozenInstanceError, dataclass, fields
from functools import cache, lru_cache, partial
from types import MappingProxyType, ModuleType
from typing import Any, ClassVar, get_origin

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import PyTree
from typing_extensions import override

from .._result_codes import RESULTS
from . import checks
from .cautions import warns
from .leaves import with_leaves
from .types import ArrayLike

Check = Callable[[str, ArrayLike], None]
"""Function of a field's name and value that raises a ``ValueError`` for an invalid value."""
_COUNTS = {(): "a single number", (3,): "three components", (4,): "four components"}


@dataclass(frozen=True)
class Declaration:
    """Allowed and usual values of a field: the arguments of `quantity`."""

    unit: str
    shape: tuple[int, ...] | None = None
    positive: bool = False
    zero: bool = False
    within: tuple[float, float] | None = None
    usual: tuple[float, float] | None = None
    check: Check | None = None
    remedy: str = ""

    def check_value(self, name: str, value: ArrayLike) -> None:
        """Check a value of the field `name`, and warn of an unusual one."""
        if self.check is not None:
            self.check(name, value)
        if self.shape is not None:
            in_unit = "" if self.unit == "1" else f" in {self.unit}"
            checks.require_shape(name, value, self.shape, f"pass {_COUNTS[self.shape]}{in_unit}")
        # The other checks are for single numbers.
        remedy = self.remedy or f"give it in {self.unit}"
        if self.positive:
            checks.require_positive(name, value, remedy, zero=self.zero)
        if self.within is not None:
            checks.require_range(name, value, *self.within, remedy)
        if self.usual is not None:
            checks.caution_outside(name, value, self.unit, *self.usual, remedy)


def quantity(
    unit: str,
    *,
    shape: tuple[int, ...] | None = None,
    positive: bool = False,
    zero: bool = False,
    within: tuple[float, float] | None = None,
    usual: tuple[float, float] | None = None,
    check: Check | None = None,
    remedy: str = "",
    table: bool = False,
    **options: Any,
) -> Any:
    """Declare a field of a user-defined element, law or quantity that holds a number or an array.

    Numbers of Python and NumPy are converted to NumPy arrays of 64-bit floats; JAX arrays stay as
    they are. Values are checked when an object is made and again before runs. Of values that JAX
    traces, only the shape is checked; but a sweep checks the numbers of all its runs.

    **Arguments:**

    - `unit`: SI unit of the value, "1" for a number without unit.
    - `shape`: (), (3,) or (4,), with finite components; any shape unless given.
    - `positive`: whether the value must be a single positive number; with `zero`, it may be zero.
    - `within`: closed interval in which the value, a single number, must be.
    - `usual`: interval of a single number outside which an `UnusualValueWarning` is given.
    - `check`: a function of name and value that raises a ``ValueError``, such as `require_axis`.
    - `remedy`: advice in error messages; the default is to give the value in its unit.
    - `table`: whether methods get an array of any shape as an array, for instance for
      `jax.numpy.interp`. By default, in compiled programs, an array of shape (3,) becomes a
      `Vector`, of (4,) `EulerParameters` and of (3, 3) a `Matrix`.
    - `options`: options of `equinox.field`, such as `default`.

    >>> class Blade(extend.AbstractFriction):
    ...     coefficient: float = extend.quantity("1", positive=True, zero=True)
    ...     def ratio(self, slip_speed):
    ...         return self.coefficient * jnp.tanh(slip_speed / 1e-3)
    >>> Blade(0.1)
    Blade(coefficient=0.1)
    """
    declared = Declaration(unit, shape, positive, zero, within, usual, check, remedy)
    metadata = {"unit": unit, "table": table, "declared": declared}
    return eqx.field(**{"converter": checks.as_number, "metadata": metadata, **options})


def optional_quantity(unit: str, **options: Any) -> Any:
    """Declare a field as `quantity` does, but with the default ``None``: an effect that is absent
    and not computed.

    >>> class Damper(extend.AbstractForce):
    ...     damping: float | None = extend.optional_quantity("N s/m", positive=True)
    ...     def body_names(self):
    ...         return ()
    ...     def wrenches(self, motions, t):
    ...         return {}
    >>> Damper().damping is None
    True
    """
    return quantity(unit, converter=_as_optional_number, default=None, **options)


def _as_optional_number(
    value: object, argument: str = "value", unit: str = "1"
) -> np.ndarray | jax.Array | None:
    return None if value is None else checks.as_number(value, argument, unit)


def described(unit: str, text: str = "") -> Any:
    """Declare a field of a result, with its unit and a description for tables."""
    return eqx.field(metadata={"unit": unit, "text": text})


@cache
def _declarations(kind: type[eqx.Module]) -> list[tuple[str, Declaration]]:
    return [(f.name, f.metadata["declared"]) for f in fields(kind) if "declared" in f.metadata]


@cache
def _flags(kind: type[eqx.Module]) -> list[str]:
    """Return the names of the static fields that are annotated as `bool`."""
    flags = (f for f in fields(kind) if f.type in (bool, "bool"))
    return [f.name for f in flags if f.metadata.get("static", False)]


LONGEST = 16
"""Number of entries above which an array is printed by its shape alone."""


class AbstractReadable(eqx.Module):
    """Base class of PyTree classes whose fields are checked and whose `repr` is readable.

    When an object is made, each field except ``None`` is checked against its declaration, such as
    ``quantity("m", positive=True)``; then `_check_together` and `_caution_together` are called.
    """

    def __init_subclass__(cls, **options: object):
        super().__init_subclass__(**options)
        # Give converters that take them the units and names of their fields; `quantity` does not
        # know the names. Thus the error for a value that is no number names its field.
        for name, field in list(vars(cls).items()):
            converter = field.metadata.get("converter") if isinstance(field, Field) else None
            if not inspect.isfunction(converter):
                continue
            code = converter.__code__
            if "argument" in code.co_varnames[: code.co_argcount]:
                unit = {"unit": field.metadata["unit"]} if "unit" in field.metadata else {}
                named = partial(converter, argument=name, **unit)
                field.metadata = MappingProxyType({**field.metadata, "converter": named})

    # Equinox makes a PyTree of a method each time it is looked up, which takes ten times as long as
    # most methods of elements. Nothing here needs PyTrees of methods.
    __getattribute__ = object.__getattribute__

    def __check_init__(self):
        # Equinox calls it when an object has been made.
        for name in _flags(type(self)):
            value, remedy = getattr(self, name), "pass a bool"
            is_flag = isinstance(value, bool | np.bool_)
            checks.require(is_flag, name, value, "True or False", remedy)
        for name, declared in _declarations(type(self)):
            if (value := getattr(self, name)) is not None:
                declared.check_value(name, value)
        self._check_together()
        if warns():
            self._caution_together()

    def _check_together(self) -> None:
        """Raise a ``ValueError`` if the values of several fields don't fit together."""

    def _caution_together(self) -> None:
        """Issue a warning if the values of several fields are unusual together."""

    @override
    def __setattr__(self, name: str, value: object) -> None:
        # Equinox sets fields in `__init__`; later it raises the error, which gets a remedy here.
        try:
            super().__setattr__(name, value)
        except FrozenInstanceError as error:
            raise FrozenInstanceError(
                f"{error}: a {type(self).__name__} cannot be changed; make a copy with another "
                f"number, cj.set_value(it, lambda it: it.{name}, value), or a new one."
            ) from None

    @override
    def __repr__(self) -> str:
        # A result code prints its name only while its number is an array: it is left unchanged.
        plain = jax.tree.map(_plain, self, is_leaf=lambda node: isinstance(node, RESULTS))
        return eqx.tree_pformat(plain)


def without_modules(namespace: dict[str, object], *public: str) -> Callable[[], list[str]]:
    """Return a function ``__dir__`` for a package, by which the tab key shows the names in
    `namespace`, but of its modules only those with the names `public`."""
    return lambda: sorted(
        name
        for name, value in namespace.items()
        if name in public or not isinstance(value, ModuleType)
    )


def _plain(leaf: object) -> object:
    """Return a short array as a number or a list of numbers; any other leaf as it is."""
    is_array = isinstance(leaf, np.ndarray | np.generic | jax.Array)
    if not is_array or isinstance(leaf, Tracer) or np.size(leaf) > LONGEST:
        return leaf
    return checks.as_shown(np.asarray(leaf))


NAMES = (str, bool, "str", "bool")
"""Annotations of fields that hold no numbers, and are static: part of a PyTree's structure."""


class AbstractConverting(AbstractReadable):
    """Base class of PyTree classes that accept Python numbers and store arrays.

    A field of a subclass that declares neither ``static=True`` nor a converter is

    - static if it is annotated as `str` or `bool`, as for the name of a body;
    - otherwise numeric: numbers, tuples and lists are converted to 64-bit arrays, so that a change
      of a number compiles nothing again.

    `clearjoint.extend.quantity("N m")` also declares unit, shape and range. Declare functions, and
    numbers that determine the structure of a program, such as a number of repetitions, by
    ``equinox.field(static=True)``.
    """

    def __init_subclass__(cls, **options: object):
        super().__init_subclass__(**options)
        for name, annotation in inspect.get_annotations(cls).items():
            if not _is_no_field(annotation):
                setattr(cls, name, _declared(cls, name, annotation))

    @classmethod
    def field_converter(cls, name: str) -> Callable[[PyTree], PyTree]:
        """Return the converter of a field that declares none; by default `as_numbers`."""
        del name
        return as_numbers


def as_numbers(value: PyTree) -> PyTree:
    """Return a value with float64 arrays in place of Python and NumPy numbers.

    Tuples and lists of numbers, or of arrays of equal shape, are stacked to one array.
    Dictionaries, and other tuples and lists, are converted entry by entry. All other values are
    unchanged, such as JAX arrays, texts and bools.

    **Raises:** `ValueError` for a NumPy array of anything but numbers.
    """
    if isinstance(value, int | float | np.number | np.ndarray) and not isinstance(value, bool):
        return checks.as_number(value)
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
    return (jnp if any(isinstance(part, jax.Array) for part in parts) else np).stack(parts)


def with_arrays(tree: PyTree) -> PyTree:
    """Return a PyTree, such as a scene and a state, with its numbers as float64 arrays.

    A Python number that `equinox.tree_at` has put into a scene would otherwise be part of the
    program, which would be compiled for each of its values. Traced numbers and Python's bools are
    not converted, nor are, in Equinox modules of other packages, fields without a converter, since
    their numbers may be meant as parts of the program.
    """
    leaves, structure = jax.tree.flatten(tree)
    arrays = array_leaves(leaves, structure)
    return tree if arrays is leaves else with_leaves(tree, arrays, structure)


def array_leaves(
    leaves: list[PyTree],
    structure: jax.tree_util.PyTreeDef,  # pyright: ignore
) -> list[PyTree]:
    """Return the `leaves` of a tree of the given `structure` with numbers replaced by float64
    arrays, in the same cases as in `with_arrays`; the same list if nothing is to be replaced."""
    # Usually few leaves are not yet NumPy arrays. These few are found by comparisons without a
    # function call, because a scene of thirty joints has a thousand leaves.
    others = [
        k for k, x in enumerate(leaves) if type(x) is not np.ndarray or x.dtype is not _FLOAT64
    ]
    if all(is_float_array(leaves[k]) for k in others):
        return leaves
    numbers, arrays = _number_fields(structure), leaves.copy()
    for k in others:
        if k in numbers and _is_other_number(leaves[k]):
            arrays[k] = np.asarray(leaves[k], np.float64)
    return arrays


_FLOAT64 = np.dtype(np.float64)


def is_float_array(leaf: PyTree) -> bool:
    if type(leaf) is np.ndarray:
        return leaf.dtype == _FLOAT64
    return isinstance(leaf, jax.Array) and jnp.issubdtype(leaf.dtype, jnp.floating)


def _is_other_number(leaf: PyTree) -> bool:
    if isinstance(leaf, np.ndarray | np.generic | jax.Array):
        return leaf.dtype.kind in "biuf" and not isinstance(leaf, Tracer)
    return isinstance(leaf, int | float) and not isinstance(leaf, bool)


@lru_cache(maxsize=256)
def _number_fields(structure: jax.tree_util.PyTreeDef) -> set[int]:  # pyright: ignore
    """Return the indices of the leaves that `with_arrays` may convert in a tree of a structure."""
    # The tree is visited with the indices of its leaves in place of the leaves.
    numbers: set[int] = set()

    def visit(node: PyTree, is_number: bool) -> None:
        # `is_number`: whether the field in which the node is may hold numbers.
        if isinstance(node, eqx.Module):
            # In this package, all fields that are not static hold numbers.
            of_package = checks.is_of_package(type(node))
            for field in fields(node):
                if not field.metadata.get("static", False):
                    visit(getattr(node, field.name), of_package or "converter" in field.metadata)
        elif isinstance(node, dict | list | tuple):
            for part in node.values() if isinstance(node, dict) else node:
                visit(part, is_number)
        elif is_number:
            numbers.update(jax.tree.leaves(node))

    visit(jax.tree.unflatten(structure, range(structure.num_leaves)), True)
    return numbers


def on_device(value: ArrayLike, dtype: type[float] | type[int] = float) -> jax.Array:
    """Return a value as a JAX array, by way of NumPy: for Python and NumPy numbers,
    `jax.numpy.asarray` would compile a small program for each shape."""
    return jnp.asarray(value if isinstance(value, jax.Array) else np.asarray(value, dtype), dtype)


def _is_no_field(annotation: object) -> bool:
    if isinstance(annotation, str):
        return "ClassVar" in annotation
    origins = ClassVar, eqx.AbstractVar, eqx.AbstractClassVar
    return annotation in (ClassVar, KW_ONLY) or get_origin(annotation) in origins


def _declared(cls: type[AbstractConverting], name: str, annotation: object) -> Field:
    """Return the field `name`, by default static if `annotation` is in `NAMES`, else converted."""
    # The class may have declared a field, or only a default value, or neither.
    field = vars(cls).get(name, eqx.field())
    if not isinstance(field, Field):
        field = eqx.field(default=field)
    if "converter" in field.metadata or field.metadata.get("static", False):
        return field
    added = {"static": True} if annotation in NAMES else {"converter": cls.field_converter(name)}
    field.metadata = MappingProxyType({**field.metadata, **added})
    return field

"""Checks of values, whose errors all have the form of `require`.

Numbers are stored as 64-bit NumPy arrays, which do not start a JAX backend when a scene is built. A
check of a traced value, whose numbers are unknown, passes. But while `conditions_of` calls a check,
it collects the condition, so that a compiled program can evaluate it for the numbers of one run, or
for those of all runs of a sweep.
"""

from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import fields
from difflib import get_close_matches
from functools import lru_cache, reduce
from types import UnionType
from typing import Any, TypeAlias, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import PyTree

from .cautions import UnusualValueWarning, caution, quiet
from .types import ArrayLike

T = TypeVar("T")
LONGEST = 400
"""Largest number of characters of a value in a message, and of entries of an array or list."""
Path: TypeAlias = tuple[str | int, ...]
"""Path to a part of a PyTree: names of fields, and keys or indices of containers."""
EPSILON = float(np.finfo(float).eps)
ROUNDINGS = 16.0
"""`as_shown` rounds to 14 digits if the relative change is at most `ROUNDINGS * EPSILON`."""
_CONDITIONS: ContextVar[list[jax.Array] | None] = ContextVar("conditions", default=None)
"""Conditions that `conditions_of` is collecting; ``None`` if it isn't running."""


def as_number(value: object, argument: str = "value", unit: str = "1") -> np.ndarray | jax.Array:
    """Return numbers as a float64 NumPy array or, if they are JAX arrays or traced, as a JAX array.

    **Raises:** `ValueError`, with the name and unit of the value, for anything but numbers, such as
    texts, bools, dates, complex numbers and ``None``. In a list that also contains numbers, NumPy
    takes a bool as 0 or 1, without an error.
    """
    if isinstance(value, jax.Array) and jnp.issubdtype(value.dtype, jnp.number):
        if jnp.isrealobj(value):
            return value
    elif isinstance(value, list | tuple):
        # NumPy can't make an array of traced numbers. Testing each type once, instead of each
        # number, is faster for long lists.
        kinds = {type(leaf) for leaf in jax.tree.leaves(value)}
        if any(issubclass(kind, Tracer) for kind in kinds):
            return jnp.asarray(value, dtype=float)
    try:
        # NumPy would convert strings, bools, dates and complex numbers to floats without an error,
        # and ``None`` in a list to NaN.
        array = np.asarray(value)
        unfit = array.dtype.kind in "USbcmM" or (array.dtype.kind == "O" and None in array.ravel())
        numbers = None if unfit else np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        numbers = None
    if numbers is None:
        in_unit = "" if unit == "1" else f", in {unit}"
        raise ValueError(
            f"Argument `{argument}` must be a number or an array of numbers, but is "
            f"{_shown(value)}: pass a float, a list of floats or an array{in_unit}."
        )
    return numbers


def concrete(value: object) -> np.ndarray | None:
    """Return the value as a NumPy array, or ``None`` if JAX traces it."""
    return None if isinstance(value, Tracer) else np.asarray(value)


def as_shown(value: Any) -> Any:
    """Return NumPy numbers and arrays as Python numbers and nested lists, for printing, without the
    rounding errors of conversions of units: 0.3 for 0.30000000000000004."""
    if isinstance(value, list | tuple) and type(value) in (list, tuple):
        return type(value)(map(as_shown, value))
    if isinstance(value, np.ndarray | np.generic):
        plain = value.tolist()  # a Python number, but for a `longdouble` still one of NumPy
        return as_shown(float(plain) if isinstance(plain, np.floating) else plain)
    if not isinstance(value, float) or not np.isfinite(value):
        return value
    short = float(f"{value:.14g}")
    return short if abs(short - value) <= ROUNDINGS * EPSILON * abs(value) else value


def checkable(*values: object) -> list[Any] | None:
    """Return values as arrays for a check of several of them, or ``None`` if it must be omitted.

    It must be omitted if JAX traces one of the values, except in a run that checks traced numbers
    in its compiled program: the arrays are then traced. Therefore, combine conditions by ``&`` and
    ``|``, and pass the result to `require` without calling `bool`, which tracers do not support.

    >>> numbers = extend.checkable(0.3, 0.1)
    >>> if numbers is not None:
    ...     static, kinetic = numbers
    ...     extend.require(static >= kinetic, "static", static, "at least kinetic", "swap them")
    """
    if not any(isinstance(value, Tracer) for value in values):
        return [np.asarray(value) for value in values]
    return None if _CONDITIONS.get() is None else [jnp.asarray(value) for value in values]


def conditions_of(check: Callable[[], None]) -> list[jax.Array]:
    """Return the traced booleans () that must be true for a check to pass. If known values fail the
    check, its error is raised."""
    conditions: list[jax.Array] = []
    token = _CONDITIONS.set(conditions)
    try:
        check()
    finally:
        _CONDITIONS.reset(token)
    return conditions


def require(
    condition: bool | np.bool_ | jax.Array, argument: str, value: object, expected: str, remedy: str
) -> None:
    """Raise an error unless a condition on an argument is true.

    `value` is what was passed, `expected` what it must be, `remedy` advice on how to correct it. A
    traced condition raises no error; a run tests it in its compiled program, see `checkable`.

    **Raises:** `ValueError` "Argument `argument` must be `expected`, but is `value`: `remedy`."

    >>> extend.require(False, "teeth", 3, "at least 5", "count them")
    Traceback (most recent call last):
        ...
    ValueError: Argument `teeth` must be at least 5, but is 3: count them.
    """
    if isinstance(condition, Tracer):
        if (conditions := _CONDITIONS.get()) is not None:
            conditions.append(condition)
    elif not condition:
        message = f"Argument `{argument}` must be {expected}, but is {_shown(value)}: {remedy}."
        raise ValueError(message)


def require_numbers(
    condition: Callable[..., bool], argument: str, values: tuple, expected: str, remedy: str
) -> None:
    """Raise a `ValueError` by `require` unless ``condition(*values)`` holds. `argument` names the
    first of the `values`. In `expected`, `{0}`, `{1}` and so on stand for the values."""
    if (arrays := checkable(*values)) is not None:
        try:
            holds = condition(*arrays)
        except TypeError:
            # Comparisons need numbers: for a text or ``None``, this raises the error.
            as_number(values[0], argument)
            raise
        # Numbers are written out for an error only: a run checks all numbers of its scene.
        if isinstance(holds, Tracer) or not holds:
            require(holds, argument, arrays[0], expected.format(*map(as_shown, arrays)), remedy)


@contextmanager
def errors_about(subject: object) -> Iterator[None]:
    """Return a context in which messages of `ValueError` begin with `subject` and a colon."""
    try:
        yield
    except ValueError as error:
        raise ValueError(f"{subject}: {error}") from error


def _shown(value: object) -> str:
    """Return a value as text for a message: long texts cut off, long arrays as their shapes."""
    if isinstance(value, np.ndarray) and value.size > LONGEST:
        return f"an array of shape {value.shape}"
    if isinstance(value, list | tuple) and len(value) > LONGEST:
        return f"a row of {len(value)} entries"
    text = repr(as_shown(value))
    return text if len(text) <= LONGEST else f"{text[:LONGEST]}... ({len(text)} characters)"


def require_shape(argument: str, value: ArrayLike, shape: tuple[int, ...], remedy: str) -> None:
    """Raise a ``ValueError`` unless an array has the given shape and only finite values.

    >>> extend.require_shape("inertia", np.eye(3), (3, 3), "give it so")  # else raises
    """
    require(np.shape(value) == shape, argument, value, f"an array of shape {shape}", remedy)
    require_finite(argument, value)


def require_finite(argument: str, value: object) -> None:
    """Raise a ``ValueError`` for what is no number, or for a NaN or infinity in an array.

    >>> extend.require_finite("times", [0.0, 1.0])  # raises for NaN
    """
    remedy = "replace the NaN or infinite entries"
    require_numbers(_all_finite, argument, (as_number(value, argument),), "finite", remedy)


def _all_finite(array: np.ndarray | jax.Array) -> bool:
    return array.__array_namespace__().isfinite(array).all()


def require_positive(argument: str, value: ArrayLike, remedy: str, *, zero: bool = False) -> None:
    """Raise a ``ValueError`` unless a value is one finite number that is positive, or zero if the
    flag `zero` allows it.

    >>> extend.require_positive("radius", 1.0, "give it in m")  # else raises
    """
    require_shape(argument, value, (), "pass a single number")
    expected = "zero or positive" if zero else "positive"
    require_numbers(lambda x: x >= 0 if zero else x > 0, argument, (value,), expected, remedy)


def require_count(argument: str, value: object, remedy: str, *, zero: bool = False) -> None:
    least, expected = (0, "zero or positive") if zero else (1, "positive")
    valid = isinstance(value, int | np.integer) and not isinstance(value, bool) and value >= least
    require(bool(valid), argument, value, f"a whole number, {expected}", remedy)


def require_type(
    argument: str, value: object, kind: type | UnionType, expected: str, remedy: str
) -> None:
    require(isinstance(value, kind), argument, type(value).__name__, expected, remedy)


def require_types(
    argument: str, given: Mapping[str, object], kind: type | UnionType, expected: str, remedy: str
) -> None:
    require_names(argument, given, remedy)
    for name, value in given.items():
        require_type(f"{argument}[{name!r}]", value, kind, expected, remedy)


def require_names(argument: str, given: Mapping[str, T], remedy: str) -> None:
    require_type(argument, given, Mapping, "a dictionary by name", remedy)
    for name in given:
        is_name = isinstance(name, str) and name != ""
        require(is_name, argument, name, "named by non-empty strings", "name every element")


def require_array_names(argument: str, given: Mapping[str, T], remedy: str) -> None:
    """Raise a ``ValueError`` unless a value is a dictionary whose keys can name arrays in a Zarr
    store, that is, folders."""
    require_names(argument, given, remedy)
    for name in given:
        is_folder = "/" not in name and "\\" not in name and not name.startswith((".", "__"))
        expected = 'named without a slash, and with neither "." nor "__" in front'
        require(is_folder, f"{argument}[{name!r}]", name, expected, "rename it")


def named(argument: str, given: Mapping[str, T], remedy: str) -> dict[str, T]:
    """Return a mapping as a dictionary, after `require_names` has checked its keys."""
    # JAX sorts the keys of a dictionary in a module, and its error for keys of mixed types would
    # not name the argument.
    require_names(argument, given, remedy)
    return dict(given)


def require_range(argument: str, value: ArrayLike, lower: float, upper: float, remedy: str) -> None:
    """Raise a ``ValueError`` unless a value is one finite number in [lower, upper].

    >>> extend.require_range("restitution", 0.9, 0.0, 1.0, "give c")  # else raises
    """
    require_shape(argument, value, (), "pass a single number")
    expected = f"in [{lower}, {upper}]"
    require_numbers(lambda x: (lower <= x) & (x <= upper), argument, (value,), expected, remedy)


def caution_unless(
    condition: bool, argument: str, value: float, unit: str, expected: str, remedy: str
) -> None:
    """Issue an `UnusualValueWarning` about a number unless a condition holds. `expected`: the usual
    range with its unit, such as "at most 1 m"; `remedy`: advice on how to correct the number."""
    if not condition:
        advice = f"where {expected} is usual: {remedy}."
        number = f"{float(value):.6g} {unit}"
        caution(f"Argument `{argument}` is {number}, {advice}", UnusualValueWarning)


def caution_outside(
    argument: str, value: object, unit: str, least: float, most: float, remedy: str
) -> None:
    """Issue an `UnusualValueWarning` about an untraced number not from `least` to `most`."""
    number = concrete(value)
    if number is not None:
        at_least, at_most = f"at least {least:g} {unit}", f"at most {most:g} {unit}"
        # With `not`, NaN gives no warning: other checks refuse it.
        caution_unless(not number < least, argument, number.item(), unit, at_least, remedy)
        caution_unless(not number > most, argument, number.item(), unit, at_most, remedy)


def require_point(argument: str, value: ArrayLike) -> None:
    """Raise a ``ValueError`` unless a point or vector has three finite coordinates, (3,).

    >>> extend.require_point("journal_point", (-0.5, 0, 0))  # raises for other shapes
    """
    require_shape(argument, value, (3,), "pass three coordinates in m")


def require_axis(argument: str, value: ArrayLike) -> None:
    """Raise a ``ValueError`` unless a direction has three finite components and length above 1e-12.

    >>> extend.require_axis("axis", (0, 0, 1))  # else raises
    """
    require_shape(argument, value, (3,), "pass three components")
    expected, remedy = "a vector of non-zero length", "give a direction, for example (0, 0, 1)"
    # A length below 1e-12 is the rounding error of a difference of two points.
    require_numbers(lambda x: (x**2).sum() > 1e-24, argument, (value,), expected, remedy)


def require_euler_parameters(argument: str, value: ArrayLike) -> None:
    require_shape(argument, value, (4,), "pass four Euler parameters, scalar part first")
    expected = "Euler parameters of unit norm, scalar part first"
    remedy = "divide them by their norm"

    # The margin allows for parameters that are given with seven digits.
    require_numbers(
        lambda x: abs((x**2).sum() ** 0.5 - 1.0) < 1e-6, argument, (value,), expected, remedy
    )


def recheck(tree: PyTree) -> None:
    """Repeat the checks that constructors make, in all Equinox modules of a PyTree, without
    warnings: `equinox.tree_at` may have replaced values."""
    with quiet():
        _check_here(tree)
        for part in _children(tree):
            recheck(part)


def recheck_changes(tree: PyTree, structure: Hashable, changed: tuple[bool, ...]) -> None:
    """Repeat checks as `recheck` does, but faster: only in modules that contain a changed leaf.

    `structure` is the structure of `tree`; `changed` tells of each leaf whether it has changed.
    Modules of this package that contain changed leaves only through a dictionary, list or tuple are
    left out, since their checks don't depend on the numbers in these containers.
    """
    with quiet():
        for path in _paths_to_changed(structure, changed):
            _check_here(reduce(_child, path, tree))


def is_of_package(kind: type) -> bool:
    return kind.__module__.split(".")[0] == __name__.split(".")[0]


@lru_cache(maxsize=256)
def _paths_to_changed(structure: Hashable, changed: tuple[bool, ...]) -> list[Path]:
    """Return the paths of the modules that `recheck_changes` checks if it gets this `structure` and
    `changed`, inner ones first."""
    paths: list[Path] = []

    def collect(tree: PyTree, path: Path) -> tuple[bool, bool]:
        """Add to `paths` the paths of the modules to check in `tree`, which is at `path`. Return
        whether a leaf has changed that no dictionary, list or tuple in `tree` contains, and whether
        any leaf at all has changed."""
        if isinstance(tree, eqx.Module):
            names = [f.name for f in fields(tree) if not f.metadata.get("static", False)]
            changes = [collect(getattr(tree, name), (*path, name)) for name in names]
            near = any(is_near for is_near, _ in changes)
            anywhere = any(is_anywhere for _, is_anywhere in changes)
            # The checks of a user-defined class may read the entries of its dictionaries and lists.
            if near or (anywhere and not is_of_package(type(tree))):
                paths.append(path)
            return near, anywhere
        if isinstance(tree, dict | list | tuple):
            keys = list(tree) if isinstance(tree, dict) else range(len(tree))
            changes = [collect(tree[key], (*path, key)) for key in keys]
            return False, any(is_anywhere for _, is_anywhere in changes)
        # In place of a leaf, this tree has the truth value of whether the leaf has changed.
        return tree is True, tree is True

    collect(jax.tree.unflatten(structure, changed), ())
    return paths


def _child(tree: PyTree, key: str | int) -> PyTree:
    return getattr(tree, str(key)) if isinstance(tree, eqx.Module) else tree[key]


def _check_here(tree: PyTree) -> None:
    """Call the checks of an Equinox module's class and its base classes, but not of its fields;
    there are none if `tree` is no such module. While `conditions_of` runs, a check is omitted if it
    fails because it needs known values."""
    if isinstance(tree, eqx.Module):
        for cls in type(tree).__mro__:
            if check := vars(cls).get("__check_init__"):
                try:
                    check(tree)
                except (jax.errors.ConcretizationTypeError, jax.errors.TracerArrayConversionError):
                    if _CONDITIONS.get() is None:
                        raise


def _children(tree: PyTree) -> list[PyTree]:
    if isinstance(tree, eqx.Module):
        return [getattr(tree, field.name) for field in fields(tree)]
    if isinstance(tree, dict):
        return list(tree.values())
    return list(tree) if isinstance(tree, list | tuple) else []


ALIKE = 0.66
"""Least similarity, from 0 to 1 by `difflib`, of a known name that a message suggests."""


def nearest(name: object, known: Iterable[str], otherwise: str) -> str:
    """Return the remedy for an unknown name, which ends an error message: the advice `otherwise`,
    after a question with the most similar `known` name, if one is similar when case is ignored."""
    by_lower = {other.lower(): other for other in known}
    similar = get_close_matches(str(name).lower(), list(by_lower), n=1, cutoff=ALIKE)
    return f"did you mean {by_lower[similar[0]]!r}? If not, {otherwise}" if similar else otherwise

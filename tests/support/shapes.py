"""Shapes that annotations give, checked whenever the package is called in a test.

`jaxtyping`'s import hook decorates the functions and dataclasses of the modules that have shapes;
in all modules it would slow tracing down by four. Those without a shape are left as they are, and
what it hands to the type checker is reduced to the shapes: other annotations are pyright's, which
needs no run for them.
"""

import inspect
import re
from collections.abc import Callable
from functools import partial
from types import UnionType
from typing import Annotated, Any, TypeVar, Union, get_args, get_origin

import beartype
import jaxtyping

from tests.support.rooms import module_paths

SHAPE = re.compile(r"\b(Float|Bool|Int)\[(?!Any\b)")
T = TypeVar("T", bound=Callable)


def check_shapes() -> None:
    """Have the package's shapes checked from its import on."""
    jaxtyping.jaxtyped = partial(decorated, jaxtyping.jaxtyped)
    jaxtyping.install_import_hook(modules_with_shapes(), f"{__name__}.checking")


def decorated(jaxtyped: Callable, *function: Any, **options: Any) -> Any:
    """What `jaxtyped` makes of a function or a class, or itself if no annotation says a shape."""
    if not function:
        return partial(decorated, jaxtyped, **options)
    called = function[0].__init__ if inspect.isclass(function[0]) else function[0]
    if inspect.isfunction(called) and not shapes_of(called):
        return function[0]
    return jaxtyped(*function, **options)


def modules_with_shapes() -> list[str]:
    """The modules whose annotations say shapes, of arrays of known kind."""
    paths = module_paths().items()
    return [f"clearjoint.{name}" for name, path in paths if SHAPE.search(path.read_text())]


def checking(function: T) -> T:
    """The function with those of its annotations checked that say a shape; itself if none does."""
    shapes = shapes_of(function)
    if not shapes:
        return function
    function.__annotations__ = {name: shapes.get(name, Any) for name in function.__annotations__}
    return beartype.beartype(function)


def shapes_of(function: Callable) -> dict[str, Any]:
    """The annotations of a function that say a shape, by argument."""
    annotations = inspect.get_annotations(function)
    return {name: hint for name, hint in annotations.items() if has_shape(hint)}


def has_shape(hint: object) -> bool:
    """Whether an annotation is an array of `jaxtyping`, or a choice or a collection with one.

    Fields of elements are left to their own checks: they are arrays, or vectors of scalars where
    elements compute, which stand as arrays of ``Any``.
    """
    if inspect.isclass(hint) and issubclass(hint, jaxtyping.AbstractArray):
        return hint.array_type is not Any
    choice = get_origin(hint) in (Union, UnionType, Annotated, tuple, dict)
    return choice and any(has_shape(part) for part in get_args(hint))

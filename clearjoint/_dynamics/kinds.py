"""Functions of elements, traced once for all elements of a kind.

Elements are of one kind if they differ only in the names of their bodies and in the numbers of
their arrays. For many elements of a class, a program calls one function for each kind, so that the
compilation time hardly grows with their number. The functions of few elements are written out in
the program, which is then faster, because what several elements have in common is computed once.
"""

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import fields
from typing import TypeVar

import equinox as eqx
import jax

from .._compilation.xla import NotSharedError, are_many, traced_for_a_kind
from .._fields.leaves import Module, with_fields
from .._model.bodies import GROUND
from .._model.joints.base import AbstractElement, Motions
from .._model.scene import Scene

Element = TypeVar("Element", bound=AbstractElement)
Result = TypeVar("Result")
_PROBE = "<probe>"
NOT_RENAMED = (
    ArithmeticError,
    AttributeError,
    LookupError,
    NotImplementedError,
    NotSharedError,
    TypeError,
    ValueError,
)
"""Errors that elements may raise with other names of bodies, such as a look-up of a body on which
they don't act. Other errors are raised at once, such as a `TimeoutError` of a signal's handler."""


class Kinds:
    """Evaluates functions of the elements of a scene. The number of elements of a class, not of a
    kind, decides whether they share functions: kinds depend on which numbers are folded as
    constants, which may differ between a sweep and a single run, but the results must not."""

    def __init__(self, scene: Scene):
        elements = [*scene.joints.values(), *scene.forces.values()]
        self._counts = Counter(map(type, elements))

    def evaluate(
        self,
        function: Callable[..., Result],
        element: AbstractElement,
        motions: Motions,
        *others: object,
    ) -> Result:
        """Return ``function(element, motions, *others)``, traced once for each kind of elements if
        the class has many.

        The function must be the same object in all calls, for instance one of a module. It may be
        called with other names of bodies (see `with_common_names`). In its result, names of bodies
        may be leaves, where the true ones are put back, but not keys of dictionaries. `others` have
        no names of bodies.
        """
        if are_many(self._counts[type(element)]):
            # An error that only the other names cause is avoided by calling the function with the
            # true names; any other error is raised again by this call.
            try:
                renamed, common_names = with_common_names(element)
                renamed_motions = {new: motions[old] for old, new in common_names.items()}
                result = traced_for_a_kind(function, renamed, renamed_motions, *others)
            except NOT_RENAMED:
                return function(element, motions, *others)
            true_names = {new: old for old, new in common_names.items()}
            return jax.tree.map(
                lambda leaf: true_names.get(leaf, leaf) if isinstance(leaf, str) else leaf, result
            )
        return function(element, motions, *others)


def with_common_names(element: Element) -> tuple[Element, dict[str, str]]:
    """Return an element whose bodies have names that all elements of its kind have in common, and
    a dictionary from the true names to the common ones.

    **Raises:** `NotSharedError` if a body's name is in no field of the element or of its parts.
    """
    names = {
        name: name if name == GROUND else f"<body {k}>"
        for k, name in enumerate(dict.fromkeys(element.body_names()))
    }
    renamed = element
    for path, name in list(_texts(element)):
        # A text that equals a name of a body may have another meaning, such as an axis "x". It is a
        # name of a body if `_PROBE`, put in its place, appears among the element's bodies.
        if name in names and _PROBE in _changed(element, path, _PROBE).body_names():
            renamed = _changed(renamed, path, names[name])
    expected = tuple(names[name] for name in element.body_names())
    if renamed.body_names() != expected:
        raise NotSharedError
    return renamed, names


def _texts(node: eqx.Module) -> Iterator[tuple[tuple[str, ...], str]]:
    """Yield path (names of fields) and value of each field with a text, also in nested objects."""
    for field in fields(node):
        value = getattr(node, field.name, None)
        if isinstance(value, str):
            yield (field.name,), value
        elif isinstance(value, eqx.Module):
            for path, text in _texts(value):
                yield (field.name, *path), text


def _changed(node: Module, path: tuple[str, ...], text: str) -> Module:
    field, *inner_path = path
    value = _changed(getattr(node, field), tuple(inner_path), text) if inner_path else text
    return with_fields(node, {field: value})

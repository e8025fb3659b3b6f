"""The base of what users build: it checks what its fields declare, and prints their numbers."""

from collections.abc import Callable
from dataclasses import FrozenInstanceError
from types import ModuleType

import equinox as eqx
import jax
import numpy as np
from jax.core import Tracer

from ..result_codes import RESULTS
from .cautions import warns
from .checks import as_shown
from .declarations import check_declared, name_conversions

LONGEST = 16
"""Numbers up to which an array is printed whole; of a longer one type and shape."""


class AbstractReadable(eqx.Module):
    """A module that checks what its fields declare (see `quantity`), and whose `repr` shows numbers
    and short arrays as they were given.

    What fields must satisfy together a subclass checks in `_check_together`, for which each is
    known to be right by itself; what is unusual of them it says in `_caution_together`, which is
    left out where nothing warns.
    """

    def __init_subclass__(cls, **options: object):
        super().__init_subclass__(**options)
        name_conversions(cls)

    def __check_init__(self):
        # Methods by their class: those of an instance Equinox wraps at each look into a PyTree.
        check_declared(self)
        type(self)._check_together(self)
        if warns():
            type(self)._caution_together(self)

    def _check_together(self) -> None:
        """Raise a ``ValueError`` if the fields don't fit each other."""

    def _caution_together(self) -> None:
        """Warn if the fields are unusual beside each other."""

    def __setattr__(self, name: str, value: object) -> None:
        try:
            super().__setattr__(name, value)
        except FrozenInstanceError as error:
            raise FrozenInstanceError(
                f"{error}: a {type(self).__name__} does not change; take a copy with another "
                f"number, cj.set_value(it, lambda it: it.{name}, value), or make another one."
            ) from None

    def __repr__(self) -> str:
        return eqx.tree_pformat(jax.tree.map(_plain, self, is_leaf=_is_result))


def without_modules(namespace: dict[str, object], *public: str) -> Callable[[], list[str]]:
    """The ``__dir__`` of a package: its names without those of the modules that it consists of,
    but for the `public` ones."""

    def names() -> list[str]:
        return sorted(
            name
            for name, value in namespace.items()
            if name in public or not isinstance(value, ModuleType)
        )

    return names


def _is_result(node: object) -> bool:
    return isinstance(node, RESULTS)


def _plain(leaf: object) -> object:
    """A number or a list of numbers in the place of a short array; all else as it is."""
    known = isinstance(leaf, np.ndarray | np.generic | jax.Array)
    if not known or isinstance(leaf, Tracer) or np.size(leaf) > LONGEST:
        return leaf
    return as_shown(np.asarray(leaf))

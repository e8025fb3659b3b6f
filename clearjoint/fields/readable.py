"""Base class of elements, which checks the declarations of its fields and prints its numbers."""

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
"""Largest number of entries of an array that is printed with its entries; of a larger array, dtype
and shape are printed."""


class AbstractReadable(eqx.Module):
    """PyTree class that checks the declarations of its fields (see `quantity`) and has a readable
    `repr`.

    The `repr` shows numbers and short arrays as they were given. A subclass may define two further
    checks, which run after each field has been checked: `_check_together` for conditions on several
    fields, and `_caution_together` for warnings about unusual combinations.
    """

    def __init_subclass__(cls, **options: object):
        super().__init_subclass__(**options)
        name_conversions(cls)

    def __check_init__(self):
        # By the class, since Equinox wraps methods of instances at each access.
        check_declared(self)
        type(self)._check_together(self)
        if warns():
            type(self)._caution_together(self)

    def _check_together(self) -> None:
        """Raise a ``ValueError`` if the combination of the fields is not allowed; nothing by
        default."""

    def _caution_together(self) -> None:
        """Issue a warning if the combination of the fields is unusual; nothing by default."""

    def __setattr__(self, name: str, value: object) -> None:
        try:
            super().__setattr__(name, value)
        except FrozenInstanceError as error:
            raise FrozenInstanceError(
                f"{error}: a {type(self).__name__} cannot be changed; make a copy with another "
                f"number, cj.set_value(it, lambda it: it.{name}, value), or a new one."
            ) from None

    def __repr__(self) -> str:
        return eqx.tree_pformat(
            jax.tree.map(_plain, self, is_leaf=lambda node: isinstance(node, RESULTS))
        )


def without_modules(namespace: dict[str, object], *public: str) -> Callable[[], list[str]]:
    """Return a function ``__dir__`` for a package that lists its names without those of its
    modules.

    **Arguments:** `namespace`: ``globals()`` of the package; `public`: names of modules to be
    listed all the same.
    """

    def names() -> list[str]:
        return sorted(
            name
            for name, value in namespace.items()
            if name in public or not isinstance(value, ModuleType)
        )

    return names


def _plain(leaf: object) -> object:
    """Return a short array as a number or a list of numbers, any other leaf unchanged."""
    is_array = isinstance(leaf, np.ndarray | np.generic | jax.Array)
    if not is_array or isinstance(leaf, Tracer) or np.size(leaf) > LONGEST:
        return leaf
    return as_shown(np.asarray(leaf))

"""Base class of the package's classes with numbers: it checks their fields and prints them."""

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
    """Base class of PyTree classes whose fields are checked and whose `repr` is readable.

    When an object is made, the value of each field is checked against its declaration, such as
    ``quantity("m", positive=True)``. A subclass may define two further checks, which run
    afterwards: `_check_together` for conditions on several fields, and `_caution_together` for
    warnings about unusual combinations. The `repr` shows numbers and short arrays as they were
    given.
    """

    def __init_subclass__(cls, **options: object):
        super().__init_subclass__(**options)
        name_conversions(cls)

    def __check_init__(self):
        # Equinox calls it when an object has been made.
        check_declared(self)
        # The methods are taken from the class, because Equinox wraps those of an instance at each
        # access, which takes time.
        type(self)._check_together(self)
        if warns():
            type(self)._caution_together(self)

    def _check_together(self) -> None:
        """Raise a ``ValueError`` if the values of several fields don't fit together.

        By default there is no such condition.
        """

    def _caution_together(self) -> None:
        """Issue a warning if the values of several fields are unusual together; by default none."""

    def __setattr__(self, name: str, value: object) -> None:
        # Equinox sets fields in `__init__`; later it raises the error, which gets a remedy here.
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

    Importing a package adds its modules to its names, where they would hide the classes and
    functions from users who complete a name.

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
    """Return a short array as a number or a list of numbers, and any other leaf unchanged.

    Short arrays have at most `LONGEST` entries. Traced numbers are unchanged too.
    """
    is_array = isinstance(leaf, np.ndarray | np.generic | jax.Array)
    if not is_array or isinstance(leaf, Tracer) or np.size(leaf) > LONGEST:
        return leaf
    return as_shown(np.asarray(leaf))

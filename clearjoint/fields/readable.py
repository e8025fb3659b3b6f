"""Modules that print the numbers they hold."""

from typing import Any

import equinox as eqx
import jax
import numpy as np
from jax.core import Tracer

from ..results import RESULTS

LONGEST = 16
"""Numbers up to which an array is printed whole; of a longer one type and shape."""


class AbstractReadable(eqx.Module):
    """A module whose `repr` shows numbers and short arrays as they were given."""

    def __repr__(self) -> str:
        return eqx.tree_pformat(jax.tree.map(_plain, self, is_leaf=_is_result))


def _is_result(node: Any) -> bool:
    return isinstance(node, RESULTS)


def _plain(leaf: Any) -> Any:
    """A number or a list of numbers in the place of a short array; all else as it is."""
    known = isinstance(leaf, np.ndarray | np.generic | jax.Array)
    if not known or isinstance(leaf, Tracer) or np.size(leaf) > LONGEST:
        return leaf
    return np.asarray(leaf).tolist()

"""Declaration of immutable dataclasses that are PyTrees, such as a force with a moment."""

from dataclasses import dataclass, field
from typing import TypeVar, dataclass_transform

import jax

T = TypeVar("T")
STATIC = {"static": True}
"""Metadata of a field that is part of a PyTree's structure."""


@dataclass_transform(frozen_default=True, field_specifiers=(field,))
def tree_dataclass(kind: type[T]) -> type[T]:
    """Make a class a frozen dataclass with slots, and a PyTree node with its fields as children."""
    return jax.tree_util.register_dataclass(dataclass(frozen=True, slots=True)(kind))

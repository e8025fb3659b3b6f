"""Fields that declare what they hold: unit, shape, sign and range, checked at construction."""

from collections.abc import Callable
from dataclasses import Field, dataclass, fields
from functools import cache, partial
from types import MappingProxyType
from typing import Any

import equinox as eqx
import jax
import numpy as np

from .checks import (
    as_number,
    caution_above,
    caution_below,
    require_positive,
    require_range,
    require_shape,
)
from .types import ArrayLike

Check = Callable[[str, ArrayLike], None]
"""Raises a ``ValueError`` for a field's name and a value that it can't have."""
_COUNTS = {(): "a single number", (3,): "three components", (4,): "four components"}


@dataclass(frozen=True)
class Declaration:
    """What a field may hold. `quantity` explains the attributes."""

    unit: str
    shape: tuple[int, ...] | None = None
    positive: bool = False
    zero: bool = False
    within: tuple[float, float] | None = None
    usual: tuple[float, float] | None = None
    check: Check | None = None
    remedy: str = ""

    def check_value(self, name: str, value: ArrayLike) -> None:
        """Raise a ``ValueError`` if the field can't have the value; warn if few machines have."""
        if self.check is not None:
            self.check(name, value)
        if self.shape is not None:
            in_unit = "" if self.unit == "1" else f" in {self.unit}"
            require_shape(name, value, self.shape, f"pass {_COUNTS[self.shape]}{in_unit}")
        remedy = self.remedy or f"give it in {self.unit}"
        if self.positive:
            require_positive(name, value, remedy, zero=self.zero)
        if self.within is not None:
            require_range(name, value, *self.within, remedy)
        if self.usual is not None:
            least, most = self.usual
            caution_below(name, value, self.unit, least, remedy)
            caution_above(name, value, self.unit, most, remedy)


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
    """A field that holds a number or an array in the given SI unit ("1" if it has none).

    What it declares is checked whenever an object is made, and again before runs; values that JAX
    traces are checked by their shape alone.

    **Arguments:**

    - `shape`: (), (3,) or (4,), with finite components; anything unless given.
    - `positive`: whether it is a positive number; with `zero`, it may be zero too.
    - `within`: the closed interval that it must be in.
    - `usual`: least and most that machines have, in the unit; outside, an `UnusualValueWarning`.
    - `check`: a function of the field's name and value that raises a ``ValueError``, such as
      `require_axis`.
    - `remedy`: what the messages tell to do; to give it in its unit, unless given.
    - `table`: whether it stays an array wherever the element computes, of whatever length, as
      `jax.numpy.interp` needs it; else three numbers are a `Vector` there.
    - `options`: of `equinox.field`, such as its `default`.

    >>> class Blade(extend.AbstractFriction):
    ...     coefficient: float = extend.quantity("1", positive=True, zero=True)
    ...     def ratio(self, slip_speed):
    ...         return self.coefficient * jnp.tanh(slip_speed / 1e-3)
    >>> Blade(0.1)
    Blade(coefficient=0.1)
    """
    declared = Declaration(unit, shape, positive, zero, within, usual, check, remedy)
    metadata = {"unit": unit, "table": table, "declared": declared}
    return eqx.field(**{"converter": as_number, "metadata": metadata, **options})


def optional_quantity(unit: str, **options: Any) -> Any:
    """A `quantity` that may be ``None``: absent, and then without cost.

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
    return None if value is None else as_number(value, argument, unit)


def name_conversions(cls: type) -> None:
    """Have the errors of a class's own `quantity` fields that are given no numbers name the
    field."""
    for name, field in list(vars(cls).items()):
        own = field.metadata.get("converter") if isinstance(field, Field) else None
        if own is not None and own in (as_number, _as_optional_number):
            named = partial(own, argument=name, unit=field.metadata["unit"])
            field.metadata = MappingProxyType({**field.metadata, "converter": named})


def check_declared(module: eqx.Module) -> None:
    """Check each field against what it declares, one by one.

    **Raises:** `ValueError` that names the field, its value, what it must be, and a remedy.
    """
    for name, declared in _declarations(type(module)):
        if (value := getattr(module, name)) is not None:
            declared.check_value(name, value)


@cache
def _declarations(kind: type[eqx.Module]) -> list[tuple[str, Declaration]]:
    """What the fields of a class declare, by their names, of those that declare anything."""
    return [(f.name, f.metadata["declared"]) for f in fields(kind) if "declared" in f.metadata]

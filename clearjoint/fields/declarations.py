"""Declarations of fields: unit, shape, sign and range, which are checked when objects are made."""

from collections.abc import Callable
from dataclasses import Field, dataclass, fields
from functools import cache, partial
from types import MappingProxyType
from typing import Any

import equinox as eqx
import jax
import numpy as np

from .checks import as_number, caution_outside, require_positive, require_range, require_shape
from .types import ArrayLike

Check = Callable[[str, ArrayLike], None]
"""Function of a field's name and value that raises a ``ValueError`` for an invalid value."""
_COUNTS = {(): "a single number", (3,): "three components", (4,): "four components"}


@dataclass(frozen=True)
class Declaration:
    """Allowed and usual values of a field.

    The attributes are the arguments of `quantity` with the same names.
    """

    unit: str
    shape: tuple[int, ...] | None = None
    positive: bool = False
    zero: bool = False
    within: tuple[float, float] | None = None
    usual: tuple[float, float] | None = None
    check: Check | None = None
    remedy: str = ""

    def check_value(self, name: str, value: ArrayLike) -> None:
        """Check a value of the field `name` against the declaration.

        **Raises:** `ValueError` for a value that is not allowed.
        **Warns:** `UnusualValueWarning` for an unusual value.
        """
        if self.check is not None:
            self.check(name, value)
        if self.shape is not None:
            in_unit = "" if self.unit == "1" else f" in {self.unit}"
            require_shape(name, value, self.shape, f"pass {_COUNTS[self.shape]}{in_unit}")
        # The other checks are for single numbers.
        remedy = self.remedy or f"give it in {self.unit}"
        if self.positive:
            require_positive(name, value, remedy, zero=self.zero)
        if self.within is not None:
            require_range(name, value, *self.within, remedy)
        if self.usual is not None:
            caution_outside(name, value, self.unit, *self.usual, remedy)


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

    Values are converted to arrays of 64-bit floats. They are checked against the declaration when
    an object is made and again before runs. Of values that JAX traces, only the shape is checked.

    **Arguments:**

    - `unit`: SI unit of the value, "1" for a number without unit.
    - `shape`: (), (3,) or (4,), with finite components; any shape unless given.
    - `positive`: whether the value must be a single positive number; with `zero`, it may be zero
      too.
    - `within`: closed interval in which the value, a single number, must be.
    - `usual`: smallest and largest usual value of a single number, in the unit; other values give
      an `UnusualValueWarning`.
    - `check`: a function of the field's name and value that raises a ``ValueError``, such as
      `require_axis`.
    - `remedy`: advice in error messages; the default is to give the value in its unit.
    - `table`: whether the value stays an array of any length in compiled programs, where the
      element computes, as `jax.numpy.interp` needs it; otherwise three numbers become a `Vector`.
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
    return eqx.field(**{"converter": as_number, "metadata": metadata, **options})


def optional_quantity(unit: str, **options: Any) -> Any:
    """Declare a field as `quantity` does, whose default is ``None``.

    ``None`` stands for an effect that is absent, and that compiled programs therefore don't
    compute. `unit` and `options` are those of `quantity`.

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
    """Give the converters of a class's `quantity` fields the names and units of these fields.

    A value that is no number then raises an error that names its field. Each class calls this
    function when it is defined, because `quantity` does not know the name of its field.
    """
    for name, field in list(vars(cls).items()):
        converter = field.metadata.get("converter") if isinstance(field, Field) else None
        if converter is not None and converter in (as_number, _as_optional_number):
            named = partial(converter, argument=name, unit=field.metadata["unit"])
            field.metadata = MappingProxyType({**field.metadata, "converter": named})


def check_declared(module: eqx.Module) -> None:
    """Check each field of an object against its declaration, except for fields that are ``None``.

    **Raises:** `ValueError` that names the field, its value, the allowed values and a remedy.
    """
    for name, declared in _declarations(type(module)):
        if (value := getattr(module, name)) is not None:
            declared.check_value(name, value)


@cache
def _declarations(kind: type[eqx.Module]) -> list[tuple[str, Declaration]]:
    """Return the fields of a class that have a declaration: the name and declaration of each."""
    return [(f.name, f.metadata["declared"]) for f in fields(kind) if "declared" in f.metadata]

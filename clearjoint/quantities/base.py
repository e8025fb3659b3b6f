"""Base class of the quantities, and checks of their arguments.

A quantity is a scalar function of an instant of a run, such as the signal of a sensor.
"""

import abc
from collections.abc import Callable, Collection
from typing import ClassVar, Literal, TypeVar, get_args

import equinox as eqx
import numpy as np

from ..fields.checks import as_number, errors_about, require
from ..fields.suggestions import nearest
from ..fields.types import ArrayLike
from ..math.smoothing import norm_and_direction
from ..math.vectors import Scalar, Vector
from ..model.scene import Scene
from .instant import Instant

T = TypeVar("T")
Component = Literal["x", "y", "z"]
"""Name of a vector component.

>>> probes = {axis: cj.quantities.JournalOffset("shoulder", axis) for axis in ("x", "y", "z")}
"""
Axes = Literal["global", "body"]
"""Axes in which a vector component is taken.

>>> sensor = cj.quantities.PointAcceleration("arm 2", (0.5, 0, 0), "x", axes="body")
"""
Quantity = Callable[[Instant], Scalar]
"""A scalar function of an instant, in SI units, such as those of `clearjoint.quantities`.

>>> def clock(now: extend.Instant) -> float:
...     return now.time
>>> outputs = {"latest": cj.Peak(clock, "s")}
"""


class AbstractQuantity(eqx.Module):
    """Base class of quantities: scalar functions of an instant of a run, with a unit and a check.

    - `unit`: SI unit of the value as text; ``None`` if it depends on the scene.
    - `period`: 2 pi for an angle, so that differences from measured angles are taken modulo 2 pi;
      otherwise ``None``.

    All fields of a subclass must be static, because a quantity is part of the compiled program.

    ```python
    from typing import ClassVar

    import clearjoint as cj
    import equinox as eqx

    class Height(cj.quantities.AbstractQuantity):
        body: str = eqx.field(static=True)
        unit: ClassVar[str] = "m"

        def __call__(self, now):
            return now.motions[self.body].position.z

        def check(self, scene):
            if self.body not in scene.bodies:
                raise ValueError(f"There is no body {self.body!r}.")

    outputs = {"top": cj.Peak(Height("arm 3"), "m")}
    ```
    """

    unit: ClassVar[str | None] = None
    period: ClassVar[float | None] = None

    @abc.abstractmethod
    def __call__(self, now: Instant) -> Scalar:
        """Return the value of the quantity at an instant, in the SI unit `unit`."""

    @abc.abstractmethod
    def check(self, scene: Scene) -> None:
        """Check that the scene has the elements that the quantity names.

        Runs, sweeps and fits call this before they start.

        **Raises:** `ValueError` with a list of the scene's names.
        """


def check_quantity(argument: str, function: object, scene: Scene) -> None:
    """Check that a scene has the elements that a quantity names.

    `function` may be any function of an instant; only an `AbstractQuantity` is checked.

    **Raises:** `ValueError` that begins with `argument`, the name under which the user passed the
    quantity, and lists the available names.
    """
    if isinstance(function, AbstractQuantity):
        with errors_about(argument):
            function.check(scene)


def require_quantity(argument: str, function: object) -> None:
    """Check that a value can be called with an instant, as a quantity or a function can.

    A class is refused, such as ``Position`` without its arguments.

    **Raises:** `ValueError` that begins with `argument`, the name of the user's argument.
    """
    remedy = 'pass for example cj.quantities.Position("arm", "x")'
    is_function = callable(function) and not isinstance(function, type)
    require(is_function, argument, function, "a scalar function of an Instant", remedy)


def require_known(argument: str, name: str, known: Collection[str]) -> None:
    """Check that a name is among the scene's names `known`.

    **Raises:** `ValueError` that begins with `argument` and suggests the nearest name.
    """
    if name not in known:
        expected = f"one of the scene's {sorted(known)}"
        remedy = nearest(name, known, "correct the name, or add it to the scene")
        require(False, argument, name, expected, remedy)


def one_of(argument: str, *allowed: T) -> Callable[[T], T]:
    """Return a converter for a field: a function that returns an allowed value unchanged, and
    raises a ``ValueError`` with the name `argument` for any other."""

    def checked(value: T) -> T:
        require(value in allowed, argument, value, f"one of {allowed}", "pass one of these")
        return value

    return checked


as_component: Callable[[Component], Component] = one_of("component", *get_args(Component))
component_or_none: Callable[[Component | None], Component | None] = one_of(
    "component", *get_args(Component), None
)
as_axes: Callable[[Axes], Axes] = one_of("axes", *get_args(Axes))
Numbers = tuple[float, ...]
"""Type of static fields with numbers. Unlike an array, a tuple compares and hashes by value."""


def numbers(values: ArrayLike) -> Numbers:
    """Return numbers, (N,), as a tuple; a single number gives a tuple of one.

    **Raises:** `ValueError` if the values are not numbers.
    """
    return tuple(np.atleast_1d(as_number(values)).tolist())


def optional_numbers(values: ArrayLike | None) -> Numbers | None:
    """Return numbers, (N,), as a tuple as `numbers` does, or ``None`` unchanged."""
    return None if values is None else numbers(values)


def component_or_magnitude(vector: Vector, component: Component | None) -> Scalar:
    """Return the component "x", "y" or "z" of a vector, or the vector's magnitude for ``None``."""
    return norm_and_direction(vector)[0] if component is None else getattr(vector, component)

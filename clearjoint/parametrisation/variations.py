"""What a sweep varies and a fit estimates: a number of the scene, one of the initial state, or
something from which a function makes both."""

import abc
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from ..fields.checks import require
from ..model.bodies import State
from ..model.scene import Scene
from .places import Number, Place, numbers_at, put_numbers, unit_at

Change = Callable[[Scene, State, Any], tuple[Scene, State]]


@dataclass(frozen=True)
class AbstractVariation(abc.ABC):
    """A way of putting a value into scene and state."""

    @property
    @abc.abstractmethod
    def function(self) -> Callable[..., Any]:
        """The user's function that tells what varies."""

    @abc.abstractmethod
    def unit_in(self, scene: Scene, state: State) -> str:
        """The unit of the value."""

    @abc.abstractmethod
    def setter(self, scene: Scene, state: State, example: Any) -> Change:
        """A function that puts values like the example into scenes and states of the structure of
        these. Setters of equal variations into like structures are equal.

        **Raises:** `ValueError` for a place that has no numbers, or of another shape.
        """


@dataclass(frozen=True)
class SceneNumber(AbstractVariation):
    """A number of the scene, or several that are tied, at a `place`."""

    place: Place
    unit: str | None = None

    def __post_init__(self) -> None:
        _require_function("place", self.place, "pass lambda scene: ...")

    @property
    def function(self) -> Place:
        """The place."""
        return self.place

    def unit_in(self, scene: Scene, state: State) -> str:
        """The given unit, or that of the place."""
        return unit_at(scene, self.place) if self.unit is None else self.unit

    def setter(self, scene: Scene, state: State, example: Any) -> Change:
        """Puts a value at the place."""
        setter = _Setter(tuple(numbers_at(scene, self.place)), True)
        setter(scene, state, example)
        return setter


@dataclass(frozen=True)
class StateNumber(AbstractVariation):
    """A number of the initial state, or several that are tied, at a `place`."""

    place: Place
    unit: str | None = None

    def __post_init__(self) -> None:
        _require_function("place", self.place, "pass lambda state: ...")

    @property
    def function(self) -> Place:
        """The place."""
        return self.place

    def unit_in(self, scene: Scene, state: State) -> str:
        """The given unit, or that of the place."""
        return unit_at(state, self.place) if self.unit is None else self.unit

    def setter(self, scene: Scene, state: State, example: Any) -> Change:
        """Puts a value at the place."""
        setter = _Setter(tuple(numbers_at(state, self.place)), False)
        setter(scene, state, example)
        return setter


@dataclass(frozen=True)
class MadeByFunction(AbstractVariation):
    """A value from which ``make(scene, state, value)`` makes scene and state."""

    make: Change
    unit: str = "1"

    def __post_init__(self) -> None:
        _require_function("make", self.make, "pass lambda scene, state, value: ...")

    @property
    def function(self) -> Change:
        """The function."""
        return self.make

    def unit_in(self, scene: Scene, state: State) -> str:
        """The given unit."""
        return self.unit

    def setter(self, scene: Scene, state: State, example: Any) -> Change:
        """The function."""
        del scene, state, example
        return self.make


@dataclass(frozen=True)
class _Setter:
    """Puts a value at numbers of the scene, or of the state."""

    numbers: tuple[Number, ...]
    in_scene: bool

    def __call__(self, scene: Scene, state: State, value: Any) -> tuple[Scene, State]:
        if self.in_scene:
            return put_numbers(scene, list(self.numbers), value), state
        return scene, put_numbers(state, list(self.numbers), value)


def _require_function(argument: str, value: Any, remedy: str) -> None:
    require(callable(value), argument, value, "a function", remedy)

"""What a sweep varies and a fit estimates: a number of the scene, one of the initial state, or
something from which a function makes both."""

import abc
from collections.abc import Callable
from dataclasses import dataclass

import jax
from jaxtyping import PyTree

from ..fields.checks import as_number, require
from ..math.vectors import Scalar
from ..model.bodies import State
from ..model.scene import Scene
from .paths import Number, Place, numbers_at, require_fits, set_values, unit_at

Change = Callable[[Scene, State, Scalar], tuple[Scene, State]]
"""From a scene, its initial state and a value to both with that value in them."""


@dataclass(frozen=True)
class AbstractVariation(abc.ABC):
    """A way of putting a value into scene and state."""

    @property
    @abc.abstractmethod
    def function(self) -> Callable[..., PyTree]:
        """The user's function that says what varies: a place, or one that makes the scene."""

    @abc.abstractmethod
    def unit_in(self, scene: Scene, state: State) -> str:
        """The unit of the value."""

    @abc.abstractmethod
    def setter(self, scene: Scene, state: State, example: Scalar) -> Change:
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
        _require_function("place", self.place, 'pass lambda scene: scene.joints["pin"].clearance')

    @property
    def function(self) -> Place:
        """The place of the number, a function of the tree that it stands in."""
        return self.place

    def unit_in(self, scene: Scene, state: State) -> str:
        """The given unit, or that of the place."""
        return unit_at(scene, self.place) if self.unit is None else self.unit

    def setter(self, scene: Scene, state: State, example: Scalar) -> Change:
        """Puts a value at the place."""
        return NumberSetter(_fitting(scene, self.place, example), True)


@dataclass(frozen=True)
class StateNumber(AbstractVariation):
    """A number of the initial state, or several that are tied, at a `place`."""

    place: Place
    unit: str | None = None

    def __post_init__(self) -> None:
        _require_function("place", self.place, 'pass lambda state: state.bodies["arm"].spin[2]')

    @property
    def function(self) -> Place:
        """The place of the number, a function of the tree that it stands in."""
        return self.place

    def unit_in(self, scene: Scene, state: State) -> str:
        """The given unit, or that of the place."""
        return unit_at(state, self.place) if self.unit is None else self.unit

    def setter(self, scene: Scene, state: State, example: Scalar) -> Change:
        """Puts a value at the place."""
        return NumberSetter(_fitting(state, self.place, example), False)


@dataclass(frozen=True)
class MadeByFunction(AbstractVariation):
    """A value from which ``make(scene, state, value)`` makes scene and state."""

    make: Change
    unit: str = "1"

    def __post_init__(self) -> None:
        _require_function(
            "make", self.make, "pass lambda scene, state, value: (scene, state), changed"
        )

    @property
    def function(self) -> Change:
        """The user's `make(scene, state, value)`."""
        return self.make

    def unit_in(self, scene: Scene, state: State) -> str:
        """The unit that the user gave, whatever the scene."""
        return self.unit

    def setter(self, scene: Scene, state: State, example: Scalar) -> Change:
        """`make` itself: it fits every scene."""
        del scene, state, example
        return self.make


@dataclass(frozen=True)
class SeriesDelay(AbstractVariation):
    """The delay of the time stamps of measured `series`, named. It is in no scene: only fits, which
    have measurements, can use it."""

    series: tuple[str, ...]

    @property
    def function(self) -> Callable[..., PyTree]:
        """What leaves the scene as it is."""
        return unchanged

    def unit_in(self, scene: Scene, state: State) -> str:
        """Seconds."""
        return "s"

    def setter(self, scene: Scene, state: State, example: Scalar) -> Change:
        """None.

        **Raises:** `ValueError`.
        """
        del scene, state, example
        series = ", ".join(map(repr, self.series))
        raise ValueError(
            f"A delay (of series {series}) is no number of a scene: only cj.identify, "
            "cj.identify_many and cj.minimise can use it. Leave it out here."
        )


def unchanged(scene: Scene, state: State, value: Scalar) -> tuple[Scene, State]:
    """The scene and the state themselves, whatever the value."""
    del value
    return scene, state


@dataclass(frozen=True)
class NumberSetter:
    """Puts a value at numbers of the scene, or of the state; a `Change`."""

    numbers: tuple[Number, ...]
    in_scene: bool

    def __call__(self, scene: Scene, state: State, value: Scalar) -> tuple[Scene, State]:
        """Scene and state with the value."""
        if self.in_scene:
            return set_values(scene, list(self.numbers), value), state
        return scene, set_values(state, list(self.numbers), value)


def _fitting(tree: PyTree, place: Place, example: Scalar) -> tuple[Number, ...]:
    """The numbers at a place, of the shape of an example."""
    numbers = numbers_at(tree, place)
    require_fits(jax.tree.leaves(tree), numbers, as_number(example))
    return tuple(numbers)


def _require_function(argument: str, value: object, remedy: str) -> None:
    require(callable(value), argument, value, "a function", remedy)

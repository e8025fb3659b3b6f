"""Variations: what the value of a sweep's axis or of a fit's parameter changes in a run."""

import abc
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import ClassVar, NoReturn

import jax
import numpy as np
from jaxtyping import PyTree
from typing_extensions import override

from .._fields.checks import as_number, require
from .._fields.leaves import with_leaves
from .._fields.objects import with_arrays
from .._math.vectors import Scalar
from .._model.bodies import State
from .._model.scene import Scene
from .paths import Number, NumberPath, numbers_at, require_fits, set_in_leaves, unit_at

Change = Callable[[Scene, State, Scalar], tuple[Scene, State]]
"""Function ``change(scene, state, value)`` that returns the pair (scene, state) with the value."""


@dataclass(frozen=True)
class AbstractVariation(abc.ABC):
    """What the value of a parameter or of an axis changes in a scene and its initial state."""

    @abc.abstractmethod
    def unit_in(self, scene: Scene, state: State) -> str:
        """Return the unit of the value. `scene` and `state` are those before the change."""

    @abc.abstractmethod
    def setter(self, scene: Scene, state: State, example: Scalar) -> Change:
        """Return the function that sets a value in scenes and states of the structure of `scene`
        and `state`, for values of the shape of `example`.

        Equal variations return equal functions for equal structures; JAX reuses compiled programs.

        **Raises:** `ValueError` for a path without numbers, or with numbers of another shape than
        `example`, and for an `AbstractSeriesVariation`, such as a bias, which changes no scene.
        """


@dataclass(frozen=True)
class AbstractNumber(AbstractVariation):
    """A number, or several tied numbers, that a path selects in the scene or the initial state.

    - `unit`: text that labels the value; ``None`` for the number's SI unit.
    - `in_scene`: whether the path leads through a scene, not through a state.
    - `example`: Python code of a typical path, for error messages.
    """

    path: NumberPath
    unit: str | None = None
    in_scene: ClassVar[bool]
    example: ClassVar[str]

    def __post_init__(self) -> None:
        require(callable(self.path), "path", self.path, "a function", f"pass {self.example}")

    def tree(self, scene: Scene, state: State) -> Scene | State:
        """Return the argument of `path`: the scene or the state."""
        return scene if self.in_scene else state

    @override
    def unit_in(self, scene: Scene, state: State) -> str:
        return unit_at(self.tree(scene, state), self.path) if self.unit is None else self.unit

    @override
    def setter(self, scene: Scene, state: State, example: Scalar) -> Change:
        tree = self.tree(scene, state)
        numbers = numbers_at(tree, self.path)
        require_fits(jax.tree.leaves(tree), numbers, as_number(example))
        return NumberSetter(tuple(numbers), self.in_scene)


@dataclass(frozen=True)
class SceneNumber(AbstractNumber):
    in_scene: ClassVar[bool] = True
    example: ClassVar[str] = 'lambda scene: scene.joints["pin"].clearance'


@dataclass(frozen=True)
class StateNumber(AbstractNumber):
    in_scene: ClassVar[bool] = False
    example: ClassVar[str] = 'lambda state: state.bodies["arm"].spin[2]'


@dataclass(frozen=True)
class MadeByFunction(AbstractVariation):
    """A value from which a user's function ``make(scene, state, value)`` makes scene and initial
    state. Two variations are equal only if they have the same function object."""

    make: Change
    unit: str = "1"

    def __post_init__(self) -> None:
        remedy = "pass lambda scene, state, value: (scene, state), changed"
        require(callable(self.make), "make", self.make, "a function", remedy)

    @override
    def unit_in(self, scene: Scene, state: State) -> str:
        return self.unit

    @override
    def setter(self, scene: Scene, state: State, example: Scalar) -> Change:
        return self

    def __call__(self, scene: Scene, state: State, value: Scalar) -> tuple[Scene, State]:
        # Users write whole numbers as integers, of which JAX has no derivatives.
        return with_arrays(self.make(scene, state, value))


@dataclass(frozen=True)
class AbstractSeriesVariation(AbstractVariation):
    """An error of the sensors of measured series, with an unknown value.

    It changes no scene: fits compare the samples with the reading of the sensor, which is the
    quantity plus its errors.

    - `series`: names of the series, or of the outputs or sensors of a prediction.
    - `neutral`: value of an ideal sensor.
    - `noun`: name of the kind of error, and of the method of `Parameter` that makes one.
    - `unit`: of the value, with "{}" in place of the unit of the series.
    - `users`: names of the functions that accept such an error, for error messages.
    """

    series: tuple[str, ...]
    neutral: ClassVar[float] = 0.0
    noun: ClassVar[str]
    unit: ClassVar[str]

    @abc.abstractmethod
    def error(self, value: Scalar, quantity: Scalar, elapsed: Scalar) -> Scalar:
        """Return what the error adds to the reading of the sensor, in the quantity's unit;
        `elapsed` is the time since the start of the run, s."""

    def unit_of(self, unit: str) -> str:
        """Return the unit of the value for series in the given unit."""
        return self.unit.format(unit)

    @override
    def unit_in(self, scene: Scene, state: State) -> str:
        self._refuse()  # The unit depends on the series, not on the scene.

    @override
    def setter(self, scene: Scene, state: State, example: Scalar) -> Change:
        self._refuse()

    def _refuse(self) -> NoReturn:
        series = ", ".join(map(repr, self.series))
        raise ValueError(
            f"A {self.noun} (of series {series}) is not a number of a scene: only {self.users} can "
            "use it. Leave it out here."
        )

    users: ClassVar[str] = (
        "cj.identify, cj.identify_many, cj.minimise, cj.posterior, cj.sensitivities, "
        "cj.identifiability and cj.fit_horizon"
    )


@dataclass(frozen=True)
class SeriesDelay(AbstractSeriesVariation):
    """Delay, s, of the time stamps of measured series."""

    noun: ClassVar[str] = "delay"
    unit: ClassVar[str] = "s"
    users: ClassVar[str] = "cj.identify, cj.identify_many, cj.minimise and cj.posterior"

    @override
    def error(self, value: Scalar, quantity: Scalar, elapsed: Scalar) -> Scalar:
        return 0.0


@dataclass(frozen=True)
class SeriesBias(AbstractSeriesVariation):
    """Bias of sensors: a constant that is added to the quantity, in its unit."""

    noun: ClassVar[str] = "bias"
    unit: ClassVar[str] = "{}"

    @override
    def error(self, value: Scalar, quantity: Scalar, elapsed: Scalar) -> Scalar:
        return value


@dataclass(frozen=True)
class SeriesGain(AbstractSeriesVariation):
    """Gain of sensors: the factor by which they multiply the quantity; 1 is ideal."""

    neutral: ClassVar[float] = 1.0
    noun: ClassVar[str] = "gain"
    unit: ClassVar[str] = "1"

    @override
    def error(self, value: Scalar, quantity: Scalar, elapsed: Scalar) -> Scalar:
        return (value - 1.0) * quantity


@dataclass(frozen=True)
class SeriesDrift(AbstractSeriesVariation):
    """Drift of sensors: constant rate at which their bias rises from zero at the run's start."""

    noun: ClassVar[str] = "drift"
    unit: ClassVar[str] = "{}/s"

    @override
    def error(self, value: Scalar, quantity: Scalar, elapsed: Scalar) -> Scalar:
        return value * elapsed


def unchanged(scene: Scene, state: State, value: Scalar) -> tuple[Scene, State]:
    return scene, state


class AbstractGroupedChange(abc.ABC):
    """A `Change` that is made in one call with neighbouring changes that have the same `make_all`.
    With sixty parameters, each program of a gradient takes half a second less to trace."""

    @staticmethod
    @abc.abstractmethod
    def make_all(
        scene: Scene, state: State, changes: Sequence[tuple[PyTree, PyTree]]
    ) -> tuple[Scene, State]:
        """Return the pair (scene, state) after changes, each with its value, in their order."""

    def __call__(self, scene: Scene, state: State, value: PyTree) -> tuple[Scene, State]:
        return self.make_all(scene, state, [(self, value)])


class AbstractLeafSetter(AbstractGroupedChange):
    """A `Change` that only sets numbers of the scene, if `in_scene` is true, or else of the state.
    `numbers`: their locations."""

    numbers: tuple[Number, ...]
    in_scene: bool

    @abc.abstractmethod
    def set_in(self, scene: list[PyTree], state: list[PyTree], value: PyTree) -> None:
        """Set the value in the lists of leaves of a scene and of a state."""

    @staticmethod
    @override
    def make_all(
        scene: Scene, state: State, changes: Sequence[tuple["AbstractLeafSetter", PyTree]]
    ) -> tuple[Scene, State]:
        leaves = jax.tree.leaves(scene), jax.tree.leaves(state)
        for setter, value in changes:
            setter.set_in(*leaves, value)
        return with_leaves(scene, leaves[0]), with_leaves(state, leaves[1])


def with_values(
    scene: Scene, state: State, values: Iterable[tuple[AbstractVariation, Scalar]]
) -> tuple[Scene, State]:
    """Return the pair (scene, state) after setting the `values`, pairs of a variation and its
    value, in their order. Errors of sensors change neither scene nor state."""
    in_scene = [(v, x) for v, x in values if not isinstance(v, AbstractSeriesVariation)]
    return changed(scene, state, [(v.setter(scene, state, x), x) for v, x in in_scene])


def changed(
    scene: Scene, state: State, changes: Iterable[tuple[Change, PyTree]]
) -> tuple[Scene, State]:
    """Return the pair (scene, state) after changes, each with its value, in their order."""
    pairs = [pair for _, pair in changed_in_steps(scene, state, changes)]
    return pairs[-1] if pairs else (scene, state)


def changed_in_steps(
    scene: Scene, state: State, changes: Iterable[tuple[Change, PyTree]]
) -> Iterator[tuple[int, tuple[Scene, State]]]:
    """Make changes in their order, neighbours with the same `make_all` by one call of it. After
    each call, yield the number of changes so far and the pair (scene, state)."""
    count = 0
    # Changes that are no `AbstractGroupedChange`, such as a user's function, have no `make_all`.
    for make_all, neighbours in groupby(changes, lambda pair: getattr(pair[0], "make_all", None)):
        pairs = [*neighbours]
        if make_all is not None:
            scene, state = make_all(scene, state, pairs)
            count += len(pairs)
            yield count, (scene, state)
            continue
        for change, value in pairs:
            scene, state = change(scene, state, value)
            count += 1
            yield count, (scene, state)


@dataclass(frozen=True)
class NumberSetter(AbstractLeafSetter):
    numbers: tuple[Number, ...]
    in_scene: bool

    @override
    def set_in(self, scene: list[PyTree], state: list[PyTree], value: Scalar) -> None:
        set_in_leaves(scene if self.in_scene else state, self.numbers, value)


def require_apart(argument: str, changes: Mapping[str, Change], scene: Scene, state: State) -> None:
    """Raise a `ValueError` if two of the `changes`, by name, set the same number: the earlier one
    would have no effect. Users' functions are not checked. `argument`: name for the message."""
    names = list(changes)
    # For each array that is changed, the position in `names` of the change of each of its numbers.
    owners: dict[tuple[bool, int], np.ndarray] = {}
    expected = "each of another number"
    remedy = "leave one out, or let one function set both: Axis.change, Parameter.change"
    for k, change in enumerate(changes.values()):
        if not isinstance(change, AbstractLeafSetter):
            continue
        leaves = jax.tree.leaves(scene if change.in_scene else state)
        for number in change.numbers:
            shape, place = np.shape(leaves[number.leaf]), (change.in_scene, number.leaf)
            owner = owners.setdefault(place, np.full(shape, -1))
            earlier = set(np.unique(owner[number.component]).tolist()) - {-1, k}
            both = [names[other] for other in earlier] + [names[k]]
            require(not earlier, argument, both, expected, remedy)
            owner[number.component] = k

"""What a sweep varies, and the lanes that come of it."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np

from ..bodies import State
from ..fields import recheck_changes, require, require_finite
from ..parameters import Place, numbers_at, put_numbers, unit_at
from ..scene import Scene

Change = Callable[[Scene, State, Any], tuple[Scene, State]]


@dataclass(frozen=True)
class Axis:
    """Values of one parameter.

    **Arguments:**

    - `place`: where in the scene it is, such as ``lambda scene: scene.joints["pin"].clearance``. A
      place that returns several numbers ties them.
    - `values`: (n,), in the unit of the place.
    - `unit`: a label; that of the place unless given.

    `Axis.initial` takes a place in the initial state, and `Axis.change` a function that makes scene
    and state of a value, for parameters that move several numbers, such as lengths.
    """

    place: Place
    values: Any
    unit: str | None = None
    kind: str = "scene"

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", np.asarray(self.values, dtype=float))
        require(
            self.values.ndim == 1 and self.values.size > 0,
            "values",
            self.values,
            "a row of numbers",
            "pass an array of shape (n,)",
        )
        require_finite("values", self.values)
        require(callable(self.place), "place", self.place, "a function", "pass lambda scene: ...")

    @classmethod
    def initial(cls, place: Place, values: Any, unit: str | None = None) -> "Axis":
        """Values of a number of the initial state."""
        return cls(place, values, unit, "state")

    @classmethod
    def change(cls, change: Change, values: Any, unit: str = "1") -> "Axis":
        """Values from which ``change(scene, state, value)`` makes the lane's scene and state."""
        return cls(change, values, unit, "change")

    def unit_in(self, scene: Scene, state: State) -> str:
        """The unit of the values."""
        if self.unit is not None:
            return self.unit
        return unit_at(scene if self.kind == "scene" else state, self.place)

    def applied(self, scene: Scene, state: State) -> Change:
        """A function that puts a value into scenes and states of this structure."""
        if self.kind == "change":
            return self.place
        if self.kind == "scene":
            numbers = numbers_at(scene, self.place)
            return lambda scene, state, value: (put_numbers(scene, numbers, value), state)
        numbers = numbers_at(state, self.place)
        return lambda scene, state, value: (scene, put_numbers(state, numbers, value))


@dataclass(frozen=True)
class Lanes:
    """The scenes and states of all lanes.

    - `scene`, `state`: those of the base; `varied`: which leaves of the scene vary (booleans).
    - `scenes`: the scene with the varied leaves only, lanes in front, ``None`` for the others;
      `states`: all leaves, lanes in front.
    - `bad`: message by lane of those whose values no scene can have.
    """

    scene: Scene
    state: State
    varied: Any
    scenes: Any
    states: Any
    bad: dict[int, str]

    def first(self) -> tuple[Scene, State]:
        """Scene and state of the first lane that is not bad."""
        good = set(range(len(jax.tree.leaves(self.states)[0]))) - set(self.bad)
        return self.of(min(good)) if good else (self.scene, self.state)

    def of(self, lane: int) -> tuple[Scene, State]:
        """Scene and state of a lane."""
        scene = jax.tree.map(
            lambda base, all_of: base if all_of is None else all_of[lane],
            self.scene,
            self.scenes,
            is_leaf=lambda node: node is None,
        )
        return scene, jax.tree.map(lambda leaf: leaf[lane], self.states)


def lanes_of(
    scene: Scene, state: State, axes: Mapping[str, Axis], values: Mapping[str, np.ndarray]
) -> Lanes:
    """Scene and state of every lane; `values[name]` are the lanes' values of each axis."""
    changes = {name: axis.applied(scene, state) for name, axis in axes.items()}
    count = len(next(iter(values.values())))
    structure = jax.tree.structure((scene, state))
    bad: dict[int, str] = {}
    rows: list[list[Any]] = []
    base = jax.tree.leaves((scene, state))
    for lane in range(count):
        try:
            here = scene, state
            for name, change in changes.items():
                here = change(*here, values[name][lane])
            recheck_changes(here, (scene, state))
            require(
                jax.tree.structure(here) == structure,
                "change",
                jax.tree.structure(here),
                "a scene and a state of the same structure in every lane",
                "change numbers only",
            )
            rows.append(jax.tree.leaves(here))
        except ValueError as error:
            bad[lane] = str(error)
            rows.append(base)
    return _stacked(scene, state, rows, base, bad)


def _stacked(
    scene: Scene, state: State, rows: Sequence[list[Any]], base: list[Any], bad: dict[int, str]
) -> Lanes:
    columns = list(zip(*rows, strict=True))
    varies = [
        any(leaf is not own for leaf in column) for column, own in zip(columns, base, strict=True)
    ]
    count = len(jax.tree.leaves(scene))
    structure = jax.tree.structure(scene)
    scenes = [np.stack(c) if v else None for c, v in zip(columns, varies, strict=True)][:count]
    states = [np.stack(np.broadcast_arrays(*column)) for column in columns[count:]]
    return Lanes(
        scene,
        state,
        jax.tree.unflatten(structure, varies[:count]),
        jax.tree.unflatten(structure, scenes),
        jax.tree.unflatten(jax.tree.structure(state), states),
        bad,
    )

"""What a sweep varies, and the lanes that come of it."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np

from ..dynamics.assembly import check_names
from ..fields.cautions import quiet
from ..fields.checks import as_number, recheck_changes, require, require_finite
from ..math.vectors import Vector, unpack
from ..model.bodies import State
from ..model.joints.base import AbstractContactJoint
from ..model.scene import Scene
from ..parametrisation.places import Place
from ..parametrisation.variations import (
    AbstractVariation,
    Change,
    MadeByFunction,
    SceneNumber,
    StateNumber,
)
from .store.notes import describe


@dataclass(frozen=True, eq=False, init=False)
class Axis:
    """Values of a number of the scene.

    **Arguments:**

    - `place`: where in the scene it is, such as ``lambda scene: scene.joints["pin"].clearance``. A
      place that returns several numbers ties them. Or another
      variation (`clearjoint.parametrisation.variations`).
    - `values`: (n,), in the unit of the place.
    - `unit`: a label; that of the place unless given.

    `Axis.initial` takes a place in the initial state, and `Axis.change` a function that makes scene
    and state of a value, for parameters that move several numbers, such as lengths.
    """

    variation: AbstractVariation
    values: np.ndarray

    def __init__(self, place: Place | AbstractVariation, values: Any, unit: str | None = None):
        variation = place if isinstance(place, AbstractVariation) else SceneNumber(place, unit)
        object.__setattr__(self, "variation", variation)
        object.__setattr__(self, "values", _row(values))

    @staticmethod
    def initial(place: Place, values: Any, unit: str | None = None) -> "Axis":
        """Values of a number of the initial state."""
        return Axis(StateNumber(place, unit), values)

    @staticmethod
    def change(make: Change, values: Any, unit: str = "1") -> "Axis":
        """Values from which ``make(scene, state, value)`` makes the lane's scene and state."""
        return Axis(MadeByFunction(make, unit), values)

    def unit_in(self, scene: Scene, state: State) -> str:
        """The unit of the values."""
        return self.variation.unit_in(scene, state)

    def setter(self, scene: Scene, state: State) -> Change:
        """A function that puts a value into scenes and states of the structure of these."""
        return self.variation.setter(scene, state, self.values[0])

    def described(self) -> str:
        """What is varied, for a reader."""
        return f"{type(self.variation).__name__} {describe(self.variation.function)}"


def _row(values: Any) -> np.ndarray:
    row = np.asarray(as_number(values))
    require(row.ndim == 1 and row.size > 0, "values", row, "a row of numbers", "pass shape (n,)")
    require_finite("values", row)
    return row


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

    def contact_joints(self) -> dict[str, AbstractContactJoint]:
        """The joints with contacts, in scalar form; numbers that vary have the lanes' values."""

        def scalar(base: Any, all_of: Any) -> Any:
            if all_of is None:
                return None if base is None else unpack(np.asarray(base))
            return Vector(*all_of.T) if all_of.shape[1:] == (3,) else all_of

        names = self.scene.contact_joints()
        scenes = {name: self.scenes.joints[name] for name in names}
        return jax.tree.map(scalar, names, scenes, is_leaf=lambda node: node is None)

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
    changes = {name: axis.setter(scene, state) for name, axis in axes.items()}
    count = len(next(iter(values.values())))
    bad: dict[int, str] = {}
    rows: list[list[Any]] = []
    base, structure = jax.tree.flatten((scene, state))
    for lane in range(count):
        here = scene, state
        try:
            for name, change in changes.items():
                with quiet():
                    here = change(*here, values[name][lane])
            leaves, own = jax.tree.flatten(here)
            _require_like(own == structure, leaves, base)
            recheck_changes(here, (scene, state))
            check_names(*here)
            rows.append(leaves)
        except ValueError as error:
            bad[lane] = str(error)
            rows.append(base)
    return _stacked(scene, state, rows, base, bad)


def touched(lanes: Lanes, axes: Mapping[str, Axis]) -> Any:
    """Which leaves of the scene vary or would with further values, as booleans."""
    scene, state = lanes.scene, lanes.state
    for axis in axes.values():
        with suppress(ValueError):
            scene, state = axis.setter(scene, state)(scene, state, axis.values[0])
    return jax.tree.map(
        lambda varies, new, base: varies or new is not base, lanes.varied, scene, lanes.scene
    )


def _require_like(same: bool, leaves: list[Any], base: list[Any]) -> None:
    """Check that nothing but numbers has changed."""
    pairs = zip(leaves, base, strict=False)
    require(
        same and all(a is b or np.shape(a) == np.shape(b) for a, b in pairs),
        "axes",
        "a change that makes others",
        "such that every lane has a scene and a state of the same structure",
        "change numbers only, and keep the shapes of arrays",
    )


def _stacked(
    scene: Scene, state: State, rows: Sequence[list[Any]], base: list[Any], bad: dict[int, str]
) -> Lanes:
    columns = list(zip(*rows, strict=True))
    varies = [
        any(leaf is not own and not np.array_equal(leaf, own) for leaf in column)
        for column, own in zip(columns, base, strict=True)
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

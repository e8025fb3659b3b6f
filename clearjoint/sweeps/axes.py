"""Axes of a sweep, and the scenes and states of its lanes."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass

import jax
import numpy as np
from jaxtyping import Float, PyTree

from ..datasets.provenance import describe
from ..dynamics.assembly import check_names
from ..fields.cautions import quiet
from ..fields.checks import as_number, recheck_changes, require, require_finite
from ..fields.types import ArrayLike
from ..math.vectors import unpack
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


@dataclass(frozen=True, eq=False, init=False)
class Axis:
    """A number of the scene and the values that a sweep gives it.

    **Arguments:**

    - `place`: of the number, such as ``lambda scene: scene.joints["pin"].clearance``. A place that
      returns several numbers gives all of them the same value. Or a variation
      (`clearjoint.parametrisation.variations`).
    - `values`: (n,), in the unit of the place.
    - `unit`: a label; that of the place unless given.

    `Axis.initial` takes a place in the initial state. `Axis.change` takes a function that makes
    scene and state from a value, for parameters on which several numbers depend, such as lengths.

    >>> axis = cj.Axis(lambda scene: scene.joints["pin"].clearance, np.geomspace(5e-5, 1e-3, 64))
    >>> axis.values.shape
    (64,)
    """

    variation: AbstractVariation
    values: Float[np.ndarray, " n"]

    def __init__(
        self, place: Place | AbstractVariation, values: ArrayLike, unit: str | None = None
    ):
        variation = place if isinstance(place, AbstractVariation) else SceneNumber(place, unit)
        object.__setattr__(self, "variation", variation)
        object.__setattr__(self, "values", _row(values))

    @staticmethod
    def initial(place: Place, values: ArrayLike, unit: str | None = None) -> "Axis":
        """A number of the initial state and its values (n,)."""
        return Axis(StateNumber(place, unit), values)

    @staticmethod
    def change(make: Change, values: ArrayLike, unit: str = "1") -> "Axis":
        """Values (n,) from which ``make(scene, state, value)`` makes the lane's scene and state."""
        return Axis(MadeByFunction(make, unit), values)

    def unit_in(self, scene: Scene, state: State) -> str:
        """The unit of the values."""
        return self.variation.unit_in(scene, state)

    def setter(self, scene: Scene, state: State) -> Change:
        """A function that puts a value into scenes and states of the structure of these."""
        return self.variation.setter(scene, state, self.values[0])

    def described(self) -> str:
        """The kind of variation and its function, as text."""
        return f"{type(self.variation).__name__} {describe(self.variation.function)}"


def _row(values: ArrayLike) -> np.ndarray:
    row = np.asarray(as_number(values, "values"))
    require(
        row.ndim == 1 and row.size > 0,
        "values",
        row,
        "a row of numbers",
        "pass shape (n,), one number at least",
    )
    require_finite("values", row)
    return row


@dataclass(frozen=True)
class Lanes:
    """The scenes and states of all lanes.

    - `scene`, `state`: those that the axes vary.
    - `varied`: the scene with a boolean in the place of each leaf: whether it differs between
      lanes.
    - `scenes`: the scene with the varied leaves only, lanes in front, and ``None`` for the others.
    - `states`: the state with all leaves, lanes in front.
    - `bad`: the error message by lane, of lanes whose values no scene can have.
    """

    scene: Scene
    state: State
    varied: PyTree[bool]
    scenes: PyTree
    states: PyTree
    bad: dict[int, str]

    def contact_joints(self) -> dict[str, AbstractContactJoint]:
        """The joints with contacts, in scalar form; their numbers are numpy arrays (lanes,)."""
        joints = self.scene.contact_joints()
        own = {name: self.scenes.joints[name] for name in joints}
        count = len(jax.tree.leaves(self.states)[0])

        def in_all(base: np.ndarray, in_lanes: np.ndarray | None) -> np.ndarray:
            return np.broadcast_to(base, (count, *np.shape(base))) if in_lanes is None else in_lanes

        return unpack(jax.tree.map(in_all, joints, own), leading=1)

    def of(self, lane: int) -> tuple[Scene, State]:
        """Scene and state of a lane."""
        scene = jax.tree.map(
            lambda base, in_lanes: base if in_lanes is None else in_lanes[lane],
            self.scene,
            self.scenes,
            is_leaf=lambda node: node is None,
        )
        return scene, jax.tree.map(lambda leaf: leaf[lane], self.states)


def lanes_of(
    scene: Scene, state: State, axes: Mapping[str, Axis], values: Mapping[str, np.ndarray]
) -> Lanes:
    """Scene and state of every lane; `values[name]` (lanes,) are those of the axis of that name."""
    changes = {name: axis.setter(scene, state) for name, axis in axes.items()}
    count = len(next(iter(values.values())))
    bad: dict[int, str] = {}
    rows: list[list[PyTree]] = []
    base, structure = jax.tree.flatten((scene, state))
    checked: State | None = None
    for lane in range(count):
        here = scene, state
        try:
            for name, change in changes.items():
                with quiet():
                    here = change(*here, values[name][lane])
            leaves, own = jax.tree.flatten(here)
            _require_like(own == structure, leaves, base)
            changed = tuple(a is not b for a, b in zip(leaves, base, strict=True))
            recheck_changes(here, structure, changed)
            if here[1] is not checked:
                check_names(*here)
                checked = here[1]
            rows.append(leaves)
        except ValueError as error:
            bad[lane] = str(error)
            rows.append(base)
    return _lanes_from_rows(scene, state, rows, base, bad)


def variable_leaves(lanes: Lanes, axes: Mapping[str, Axis]) -> PyTree[bool]:
    """The scene with a boolean in the place of each leaf: whether the axes can change it, be it by
    values that no lane has yet."""
    scene, state = lanes.scene, lanes.state
    for axis in axes.values():
        with suppress(ValueError):
            scene, state = axis.setter(scene, state)(scene, state, axis.values[0])
    return jax.tree.map(
        lambda varies, new, base: varies or new is not base, lanes.varied, scene, lanes.scene
    )


def _require_like(same: bool, leaves: list[PyTree], base: list[PyTree]) -> None:
    """Check that nothing but numbers has changed."""
    pairs = zip(leaves, base, strict=False)
    require(
        same and all(a is b or np.shape(a) == np.shape(b) for a, b in pairs),
        "axes",
        "a change that makes others",
        "such that every lane has a scene and a state of the same structure",
        "change numbers only, and keep the shapes of arrays",
    )


def _lanes_from_rows(
    scene: Scene,
    state: State,
    rows: Sequence[list[PyTree]],
    base: list[PyTree],
    bad: dict[int, str],
) -> Lanes:
    """Lanes from the leaves of each lane's scene and state; `base` are those of the sweep's."""
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

"""Axes of a sweep, and the scenes and states of its lanes."""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import reduce
from operator import and_

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, PyTree

from ..dynamics.assembly import check_names
from ..export.provenance import describe
from ..fields.cautions import quiet
from ..fields.checks import (
    as_number,
    conditions_of,
    conditions_of_changes,
    recheck_changes,
    require,
    require_finite,
)
from ..fields.types import ArrayLike
from ..math.vectors import Condition, unpack
from ..model.bodies import State
from ..model.joints.base import AbstractContactJoint
from ..model.scene import Scene
from ..native import NativeFunction, UnsupportedPrimitiveError
from ..parametrisation.paths import Place
from ..parametrisation.variations import (
    AbstractVariation,
    Change,
    MadeByFunction,
    NumberSetter,
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
    base, structure = jax.tree.flatten((scene, state))
    bad: dict[int, str] = {}
    if all(isinstance(change, NumberSetter) for change in changes.values()):
        columns = _columns_set(scene, base, changes, values)
    else:
        columns = _columns_made(scene, state, changes, values, bad)
    changed = tuple(column is not None for column in columns)
    count, own_leaves = len(next(iter(values.values()))), len(jax.tree.leaves(scene))
    for lane in np.flatnonzero(~_admissible(scene, state, columns)).tolist():
        pairs = zip(base, columns, strict=True)
        leaves = [own if c is None else np.asarray(c[lane]) for own, c in pairs]
        here = jax.tree.unflatten(structure, leaves)
        try:
            recheck_changes(here, structure, changed)
            if any(changed[own_leaves:]):
                check_names(*here)
        except ValueError as error:
            bad.setdefault(lane, str(error))
    for column, own in zip(columns, base, strict=True):
        if column is not None:
            column[list(bad)] = own
    differs = [
        column is not None and bool((column != own).any())
        for column, own in zip(columns, base, strict=True)
    ]
    scenes = [c if d else None for c, d in zip(columns, differs, strict=True)][:own_leaves]
    states = [
        np.broadcast_to(own, (count, *np.shape(own))) if c is None else c
        for c, own in zip(columns[own_leaves:], base[own_leaves:], strict=True)
    ]
    of_scene = jax.tree.structure(scene)
    return Lanes(
        scene,
        state,
        jax.tree.unflatten(of_scene, differs[:own_leaves]),
        jax.tree.unflatten(of_scene, scenes),
        jax.tree.unflatten(jax.tree.structure(state), states),
        dict(sorted(bad.items())),
    )


Columns = list[np.ndarray | None]
"""For each leaf of scene and state its values in all lanes, (lanes, ...), or ``None`` if no axis
changes it."""


def _columns_set(
    scene: Scene,
    base: list[PyTree],
    changes: Mapping[str, Change],
    values: Mapping[str, np.ndarray],
) -> Columns:
    """The columns where each axis puts its value at places."""
    columns: Columns = [None] * len(base)
    behind = len(jax.tree.leaves(scene))
    for name, setter in changes.items():
        assert isinstance(setter, NumberSetter)
        for number in setter.numbers:
            k = number.leaf if setter.in_scene else behind + number.leaf
            row, column = values[name], columns[k]
            if column is None:
                column = np.repeat(np.asarray(base[k], float)[None], len(row), axis=0)
            column[(slice(None), *number.component)] = row
            columns[k] = column
    return columns


def _columns_made(
    scene: Scene,
    state: State,
    changes: Mapping[str, Change],
    values: Mapping[str, np.ndarray],
    bad: dict[int, str],
) -> Columns:
    """The columns where functions make scenes and states; `bad` gets the errors of lanes."""
    base, structure = jax.tree.flatten((scene, state))
    rows: list[list[PyTree]] = []
    for lane in range(len(next(iter(values.values())))):
        here = scene, state
        try:
            for name, change in changes.items():
                with quiet():
                    here = change(*here, values[name][lane])
            leaves, own = jax.tree.flatten(here)
            _require_like(own == structure, leaves, base)
            rows.append(leaves)
        except ValueError as error:
            bad[lane] = str(error)
            rows.append(base)
    return [
        None
        if all(leaf is own or np.array_equal(leaf, own) for leaf in column)
        else np.stack(column)
        for column, own in zip(zip(*rows, strict=True), base, strict=True)
    ]


FEW = 16
"""Lanes that Python checks; of more of them, native code tells the good ones."""


def _admissible(scene: Scene, state: State, columns: Columns) -> np.ndarray:
    """(lanes,) Whether the numbers of each lane are known to pass their checks."""
    varied = [column for column in columns if column is not None]
    if not varied:
        return np.ones(0, bool)
    unknown = np.zeros(len(varied[0]), bool)
    if len(unknown) <= FEW:
        return unknown
    changed = tuple(column is not None for column in columns)
    # Trees of which one element is of a user's class or whose program can't be compiled are left to
    # the checks themselves, and so are errors that a check raises of something else than numbers.
    with suppress(UnsupportedPrimitiveError, ValueError):
        found = _checks.rows((scene, state, changed), [*columns, *[None] * len(changed)])
        return unknown if found is None else found
    return unknown


def _all_hold(scene: Scene, state: State, changed: tuple[bool, ...]) -> Condition | None:
    """Whether all checks hold of the modules with changed leaves; ``None`` if a check needs the
    values of numbers, which are unknown while JAX traces them."""
    tree, own = (scene, state), len(jax.tree.leaves(scene))
    conditions = conditions_of_changes(tree, jax.tree.structure(tree), changed)
    if conditions is not None and any(changed[own:]):
        conditions += conditions_of(lambda: check_names(scene, state))
    return None if conditions is None else reduce(and_, conditions, jnp.asarray(True))


_checks = NativeFunction(_all_hold)


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

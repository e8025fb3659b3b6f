"""Axes of a sweep, and the scenes and initial states of its lanes."""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Float, PyTree

from .._dynamics.constraint_report import check_names
from .._export.datasets import describe
from .._fields.cautions import quiet
from .._fields.checks import as_number, recheck_changes, require, require_finite
from .._fields.leaves import ordered_like
from .._fields.types import ArrayLike
from .._math.vectors import unpack
from .._model.bodies import State
from .._model.joints.base import AbstractContactJoint
from .._model.scene import Scene
from .._parametrisation import variations
from .._parametrisation.paths import NumberPath
from .._parametrisation.variations import AbstractVariation, Change, NumberSetter, require_apart

Values = Mapping[str, np.ndarray]
"""Value in every lane, (lanes,), of each axis by name."""
Columns = dict[int, np.ndarray]
"""Numbers in all lanes, (lanes, ...), of each leaf of (scene, state) that an axis changes, by the
index of the leaf in the order of `jax.tree.leaves`."""


@dataclass(frozen=True, eq=False, init=False)
class Axis:
    """A number of the scene, and the values that a sweep gives it.

    `Axis.initial` makes an axis of a number of the initial state, and `Axis.change` an axis of a
    parameter on which several numbers depend, such as a length.

    **Arguments:**

    - `path`: function that selects the number in a scene, such as ``lambda scene:
      scene.joints["pin"].clearance``. If it returns several numbers, all get the same value.
    - `values`: (n,), in the SI unit of the number.
    - `unit`: text that labels the values in the results and converts nothing; by default the
      number's SI unit.

    **Raises:** `ValueError` unless values are (n,) finite numbers, with n at least 1, and for a
    `path` that is not a function.

    >>> axis = cj.Axis(lambda scene: scene.joints["pin"].clearance, np.geomspace(5e-5, 1e-3, 64))
    >>> axis.values.shape
    (64,)
    """

    variation: AbstractVariation
    values: Float[np.ndarray, " n"]

    def __init__(
        self, path: NumberPath | AbstractVariation, values: ArrayLike, unit: str | None = None
    ):
        # `Axis.initial`, `Axis.change` and other callers pass a variation in place of a path.
        is_variation = isinstance(path, AbstractVariation)
        remedy = "leave it out, since the variation has its own unit"
        has_one_unit = unit is None or not is_variation
        require(has_one_unit, "unit", repr(unit), "None for a variation", remedy)
        variation = path if is_variation else variations.SceneNumber(path, unit)
        numbers = np.asarray(as_number(values, "values"))
        is_row = numbers.ndim == 1 and numbers.size > 0
        remedy = "pass shape (n,), one number at least"
        require(is_row, "values", numbers, "a row of numbers", remedy)
        require_finite("values", numbers)
        # The class is frozen, so its fields are set in the dictionary of the object.
        vars(self).update(variation=variation, values=numbers)

    @staticmethod
    def initial(path: NumberPath, values: ArrayLike, unit: str | None = None) -> "Axis":
        """Return an axis of a number of the initial state, selected by a function such as ``lambda
        state: state.bodies["arm"].spin[2]``."""
        return Axis(variations.StateNumber(path, unit), values)

    @staticmethod
    def change(make: Change, values: ArrayLike, unit: str = "1") -> "Axis":
        """Return an axis whose values change the scene and the initial state by a function.

        ``make(scene, state, value)`` gets a scene and a state in which the preceding axes have set
        their values, and returns both, changed. It may change numbers only, not names or shapes of
        arrays. A lane in which it changes more, or raises a `ValueError`, is not run.
        """
        return Axis(variations.MadeByFunction(make, unit), values)

    def unit_in(self, scene: Scene, state: State) -> str:
        """Return the unit of the values: the given unit, or that of the number in the scene or
        state; raise a `ValueError` if the path selects no number."""
        return self.variation.unit_in(scene, state)

    def setter(self, scene: Scene, state: State) -> Change:
        """Return the function ``change(scene, state, value)`` that returns the pair (scene, state)
        with a value of this axis, for scenes and states of the same structure.

        **Raises:** `ValueError` for a path that selects no number or a whole array, and for an axis
        of a parameter of a sensor's error, which only fits can use.
        """
        return self.variation.setter(scene, state, self.values[0])

    def described(self) -> str:
        """Return the description of the axis in a sweep's results."""
        of_function = isinstance(self.variation, variations.MadeByFunction)
        function = getattr(self.variation, "make" if of_function else "path")
        return f"{type(self.variation).__name__} {describe(function)}"


@dataclass(frozen=True)
class Lanes:
    """The scenes and initial states of all lanes of a sweep.

    - `scene`, `state`: as the user passed them.
    - `varied`: PyTree like `scene`, of bools: whether the leaf has, in at least one lane, other
      numbers than in `scene`.
    - `scenes`: PyTree like `scene`; a leaf is an array (lanes, ...) if `varied`, else ``None``.
    - `states`: PyTree like `state`; every leaf is an array (lanes, ...).
    - `bad`: error messages by number of the lane, for lanes that don't run because of their values.
      In `scenes` and `states`, lanes with invalid values have the numbers of `scene` and `state`,
      while lanes with nearly redundant constraints have their own numbers.
    """

    scene: Scene
    state: State
    varied: PyTree[bool]
    scenes: PyTree
    states: PyTree
    bad: dict[int, str]

    def contact_joints(self) -> dict[str, AbstractContactJoint]:
        """Return the joints with contacts by name. Each number of a joint is an array of its values
        in all lanes, (lanes, ...), so that one call of a method computes all lanes."""
        joints = self.scene.contact_joints()
        varied = {name: self.scenes.joints[name] for name in joints}
        return unpack(self.expanded(joints, varied), leading=1)

    def expanded(self, tree: PyTree, varied: PyTree) -> PyTree:
        """Return `tree`, a part of `scene`, with arrays (lanes, ...) as leaves. They are those of
        the argument `varied`, the same part of `scenes` (not of the field `varied`). Where it has
        ``None``, the leaf of `tree` is repeated for all lanes."""
        count = len(jax.tree.leaves(self.states)[0])
        numbers, others = eqx.partition(tree, eqx.is_array_like)
        same = jax.tree.map(lambda leaf: np.broadcast_to(leaf, (count, *np.shape(leaf))), numbers)
        return eqx.combine(varied, same, others)

    def of(self, lane: int) -> tuple[Scene, State]:
        varied, state = jax.tree.map(lambda leaf: leaf[lane], (self.scenes, self.states))
        return ordered_like((self.scene, self.state), (eqx.combine(varied, self.scene), state))


def lanes_of(scene: Scene, state: State, axes: Mapping[str, Axis], values: Values) -> Lanes:
    """Return all lanes, from the `values` of each axis in every lane. Lanes with values that a
    constructor or a function of `Axis.change` refuses have an error message in `Lanes.bad`."""
    changes = {name: axis.setter(scene, state) for name, axis in axes.items()}
    require_apart("axes", changes, scene, state)
    base, structure = jax.tree.flatten((scene, state))
    bad: dict[int, str] = {}
    # Axes that only set numbers, which is the usual case, need no loop over the lanes in Python.
    if all(isinstance(change, NumberSetter) for change in changes.values()):
        columns = _columns_by_setters(scene, base, changes, values)
    else:
        columns = _columns_by_functions(scene, state, changes, values, bad)
    changed = tuple(k in columns for k in range(len(base)))
    # `base` has the leaves of the scene first, then those of the state.
    scene_leaves = len(jax.tree.leaves(scene))
    count = len(next(iter(values.values())))
    # The constructors' checks run in Python, lane by lane, because their messages go to the user.
    # Without columns, all lanes have the numbers of `scene` and `state`, which have been checked.
    for lane in range(count if columns else 0):
        leaves = [
            np.asarray(columns[k][lane]) if k in columns else leaf for k, leaf in enumerate(base)
        ]
        scene_and_state = jax.tree.unflatten(structure, leaves)
        try:
            recheck_changes(scene_and_state, structure, changed)
            # A changed state must still be finite, with Euler parameters of about unit norm.
            if any(changed[scene_leaves:]):
                check_names(*scene_and_state)
        except ValueError as error:
            bad.setdefault(lane, str(error))
    # Bad lanes don't run. They get the base values, so that NaN doesn't reach computations for all
    # lanes, and a number that only bad lanes change counts as constant.
    for k, column in columns.items():
        column[list(bad)] = base[k]
    # A leaf of the scene that all lanes share is ``None``. Each leaf of the state is an array.
    differs = [k in columns and bool((columns[k] != leaf).any()) for k, leaf in enumerate(base)]
    in_scenes = [columns[k] if differs[k] else None for k in range(scene_leaves)]
    in_states = [
        columns.get(k, np.broadcast_to(leaf, (count, *np.shape(leaf))))
        for k, leaf in enumerate(base[scene_leaves:], scene_leaves)
    ]
    scene_structure, state_structure = map(jax.tree.structure, (scene, state))
    varied = jax.tree.unflatten(scene_structure, differs[:scene_leaves])
    scenes = jax.tree.unflatten(scene_structure, in_scenes)
    states = jax.tree.unflatten(state_structure, in_states)
    return Lanes(scene, state, varied, scenes, states, dict(sorted(bad.items())))


def _columns_by_setters(
    scene: Scene, base: list[PyTree], changes: Mapping[str, Change], values: Values
) -> Columns:
    """Return the numbers of the leaves that axes change, without a loop over lanes, for axes that
    only set numbers. `base`: all leaves of (scene, state)."""
    columns: Columns = {}
    scene_leaves = len(jax.tree.leaves(scene))
    for name, setter in changes.items():
        assert isinstance(setter, NumberSetter)
        for number in setter.numbers:
            # `base` has the leaves of the scene first, then those of the state.
            k = number.leaf if setter.in_scene else scene_leaves + number.leaf
            # All lanes begin with the base numbers, since the axis may set only one component of an
            # array.
            if k not in columns:
                columns[k] = np.repeat(np.asarray(base[k], float)[None], len(values[name]), axis=0)
            columns[k][(slice(None), *number.component)] = values[name]
    return columns


def _columns_by_functions(
    scene: Scene, state: State, changes: Mapping[str, Change], values: Values, bad: dict[int, str]
) -> Columns:
    """Return the numbers of the leaves that axes change, (lanes, ...), by index of the leaf. In
    every lane, call the `changes` with the `values` of their axes. If one raises a `ValueError`,
    or changes a structure or shape, the lane gets an error message in `bad`, and has the leaves of
    `scene` and `state`."""
    base, structure = jax.tree.flatten((scene, state))
    rows: list[list[PyTree]] = []
    for lane in range(len(next(iter(values.values())))):
        changed = scene, state
        try:
            # The functions make elements again for each lane, so that a warning of an unusual value
            # would be repeated in every lane.
            for name, change in changes.items():
                with quiet():
                    changed = change(*changed, values[name][lane])
            leaves, changed_structure = jax.tree.flatten(changed)
            # The numbers of leaves may differ here; then the structures differ too.
            new_and_old = zip(leaves, base, strict=False)
            # All lanes run in one compiled program, which needs equal structure and shapes.
            alike = changed_structure == structure and all(
                new is old or np.shape(new) == np.shape(old) for new, old in new_and_old
            )
            fault, expected = "a change of the structure", "functions that change numbers only"
            remedy = "keep the names, kinds and shapes of arrays of scene and state in all lanes"
            require(alike, "axes", fault, expected, remedy)
            rows.append(leaves)
        except ValueError as error:
            bad[lane] = str(error)
            rows.append(base)
    # A leaf that no function changes in any lane gets no column. Most leaves are still the same
    # objects, so that their numbers need not be compared.
    by_leaf = enumerate(zip(zip(*rows, strict=True), base, strict=True))
    return {
        k: np.stack(column)
        for k, (column, leaf) in by_leaf
        if not all(value is leaf or np.array_equal(value, leaf) for value in column)
    }


def variable_leaves(lanes: Lanes, axes: Mapping[str, Axis]) -> PyTree[bool]:
    """Return a PyTree like the scene, of bools: whether an axis can change the leaf.

    In contrast to `Lanes.varied`, this is true also for a leaf that an axis sets to equal numbers
    in all present lanes. Such leaves must be arguments of the programs, not constants, so that
    further values of an axis don't change the digests by which a store recognises its sweep.
    """
    scene, state = lanes.scene, lanes.state
    for axis in axes.values():
        # A user's function may refuse the value; the leaves that it varies are in `lanes.varied`.
        with suppress(ValueError):
            scene, state = axis.setter(scene, state)(scene, state, axis.values[0])
    # A leaf that an axis sets is another object than before, even if the numbers are equal.
    return jax.tree.map(
        lambda varies, new, base: varies or new is not base, lanes.varied, scene, lanes.scene
    )

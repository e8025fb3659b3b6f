"""Find the numbers of a scene or of its initial state that study files name.

A number is named by a text such as "joints.pin.clearance" or "state.bodies.arm.velocity.0", called
a written path. It consists of names and indices, separated by dots, and begins with "state" for
numbers of the initial state.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce

import numpy as np
from jaxtyping import PyTree

from ..fields.suggestions import nearest
from ..model.bodies import State
from ..model.scene import Scene
from ..parametrisation.paths import parameters
from ..scene_files.locations import FileLocation, Keys, keys_of, listed, written
from ..scene_files.reading import number_of_text


@dataclass(frozen=True)
class WrittenPath:
    """Function that returns the numbers of a scene, or of a state, at given paths.

    - `paths`: names and indices that lead to each number.
    """

    paths: tuple[Keys, ...]

    def __call__(self, tree: PyTree) -> PyTree:
        """Return the number, or a list of numbers if there are several paths."""
        values = [reduce(_entry, keys, tree) for keys in self.paths]
        return values[0] if len(values) == 1 else values


@dataclass(frozen=True)
class FoundPath:
    """A number that a written path names.

    - `path`: function of the scene, or of the state, that returns the number.
    - `in_state`: whether the number belongs to the state instead of the scene.
    - `unit`: SI unit of the number, or of all numbers if there are several.
    """

    path: WrittenPath
    in_state: bool
    unit: str

    def number(self, value: object, location: FileLocation) -> float:
        """Convert a value from a file, a number or a text with a unit, to a number in `unit`.

        **Arguments:** `location`: location of the value in the file, for messages.

        **Raises:** `ValueError` for other values.
        """
        if isinstance(value, str):
            return number_of_text(value, self.unit, location)
        if isinstance(value, bool) or not isinstance(value, int | float):
            location.refuse(value, f"a number in {self.unit}", "write one")
        return float(value)


def find_path(
    texts: str | Sequence[str], scene: Scene, state: State, location: FileLocation
) -> FoundPath:
    """Find the number at a written path, or the numbers at several paths, which then all get the
    same value.

    **Arguments:** `texts`: a written path, or several; `location`: their location in the file, for
    messages.

    **Raises:** `ValueError` for a name that does not exist, with the names that do, for paths of
    which some are in the scene and others in the state, and for numbers of different units.
    """
    with location.in_errors():
        paths = [keys_of(text) for text in ([texts] if isinstance(texts, str) else texts)]
    in_state = {keys[0] == "state" for keys in paths}
    if len(in_state) != 1:
        location.refuse(texts, "paths in the scene, or in the state", "name one or the other")
    (is_state,) = in_state
    # The first key, "state", is not one of the state itself.
    tree, paths = (state, [keys[1:] for keys in paths]) if is_state else (scene, paths)
    # The unit of each number, by its keys: an array has one entry for each component.
    units = {
        (*keys_of(name), *map(str, index)): unit
        for name, (value, unit) in parameters(tree).items()
        for index in np.ndindex(np.shape(value))
    }
    for keys in paths:
        _require_known(keys, units, location)
    # A value is given in one unit, from which it could not be converted to several.
    distinct = list(dict.fromkeys(units[keys] for keys in paths))
    if len(distinct) > 1:
        location.refuse(distinct, "paths of numbers with one unit", "write an entry for each unit")
    return FoundPath(WrittenPath(tuple(paths)), is_state, distinct[0])


def _require_known(keys: Keys, units: dict[tuple[str, ...], str], location: FileLocation) -> None:
    """Raise a `ValueError` unless `keys` lead to a number.

    **Arguments:** `units`: unit of each number, by the keys that lead to it; `location`: location
    of the path in the file.
    """
    # Follow the keys one by one, so that the message lists the names at the first unknown key.
    for depth in range(len(keys) + 1):
        known = [k[depth] for k in units if k[:depth] == keys[:depth] and len(k) > depth]
        names, parent = listed(dict.fromkeys(known)), written(keys[:depth]) or "the top"
        if depth == len(keys):
            if known:
                location.refuse(parent, "the path of one number", f"append one of {names}")
        elif keys[depth] not in known:
            otherwise = "`clearjoint check FILE --paths` lists all numbers"
            remedy = nearest(keys[depth], known, otherwise)
            location.refuse(keys[depth], f"one of {names} at {parent}", remedy)


def _entry(tree: PyTree, key: str | int) -> PyTree:
    """Return the entry of a dictionary, the field of an object, or the component of an array."""
    if isinstance(tree, dict):
        return tree[key]
    return getattr(tree, str(key)) if hasattr(tree, str(key)) else tree[int(key)]

"""Find the numbers that texts such as "joints.pin.clearance" or "state.bodies.arm.velocity.0" name.

Such a text is called a written path. It starts with "state" for numbers of the initial state.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, fields, is_dataclass

import numpy as np
from jaxtyping import PyTree

from ..fields.suggestions import nearest
from ..model.bodies import State
from ..model.scene import Scene
from ..parametrisation.paths import parameters, unit_at
from ..scene_files.locations import FileLocation, Keys, listed
from ..scene_files.reading import number_of_text

STATE = "state"
STEP = re.compile(r"""\[?(?:'([^']*)'|"([^"]*)"|([^.\[\]'"]+))\]?\.?""")


def keys_of(text: str, location: FileLocation) -> Keys:
    """Return the keys of a written path; names that contain dots must be in quotation marks.

    **Raises:** `ValueError` for a text that is not a path.
    """
    keys, at = [], 0
    while at < len(text):
        step = STEP.match(text, at)
        if step is None or step.end() == at:
            example = "names with dots between, such as joints.pin.clearance"
            location.refuse(text, example, "put names that contain dots into quotation marks")
        quoted, bare = (step[2] if step[1] is None else step[1]), step[3]
        keys.append(quoted if quoted is not None else int(bare) if bare.isdecimal() else bare)
        at = step.end()
    if not keys:
        location.refuse(text, "a path such as joints.pin.clearance", "write one")
    return tuple(keys)


def written(name: str) -> str:
    """Return the written path, "joints.pin.clearance", of a number that `parameters` calls
    "joints['pin'].clearance"."""
    parts = re.findall(r"\['([^']*)'\]|\[(\d+)\]|([^.\[\]]+)", name)
    words = [quoted or number or bare for quoted, number, bare in parts]
    return ".".join(f"'{word}'" if "." in word else word for word in words)


@dataclass(frozen=True)
class WrittenPath:
    """Function of a scene, or of a state, that returns the numbers at given paths.

    - `paths`: keys that lead to each number.
    """

    paths: tuple[Keys, ...]

    def __call__(self, tree: PyTree) -> PyTree:
        """Return the number, or the list of numbers if there are several paths."""
        values = [_at(tree, keys) for keys in self.paths]
        return values[0] if len(values) == 1 else values


@dataclass(frozen=True)
class FoundPath:
    """A number that a written path names.

    - `path`: function that returns the number.
    - `in_state`: whether the number belongs to the state instead of the scene.
    - `unit`: its SI unit.
    """

    path: WrittenPath
    in_state: bool
    unit: str

    def number(self, value: object, location: FileLocation) -> float:
        """Convert a value of a file, a number or a text with a unit, to a number in `unit`.

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
    """Find the number at a written path, or the numbers at several paths that shall all have the
    same value.

    **Raises:** `ValueError` that names the first unknown key and the known keys, or for paths that
    are partly in the scene and partly in the state.
    """
    paths = [keys_of(text, location) for text in ([texts] if isinstance(texts, str) else texts)]
    in_state = {keys[0] == STATE for keys in paths}
    if len(in_state) != 1:
        location.refuse(texts, "paths in the scene, or in the state", "name one or the other")
    if in_state == {True}:
        tree, paths = state, [keys[1:] for keys in paths]
    else:
        tree = scene
    for keys in paths:
        _require_number(tree, keys, location)
    path = WrittenPath(tuple(paths))
    return FoundPath(path, tree is state, unit_at(tree, path))


def _require_number(tree: PyTree, keys: Keys, location: FileLocation) -> None:
    node = tree
    for depth, key in enumerate(keys):
        known = _entries(node)
        if key not in known:
            parent = ".".join(map(str, keys[:depth])) or "the top"
            names = [str(name) for name in known]
            remedy = nearest(str(key), names, "`clearjoint check FILE --paths` lists all numbers")
            location.refuse(str(key), f"one of {listed(names)} at {parent}", remedy)
        node = _at(node, (key,))
    is_leaf = isinstance(node, int | float | np.ndarray | np.generic)
    if not is_leaf or np.ndim(node):
        entries = _entries(node) if is_leaf else map(written, parameters(node))
        text, remedy = ".".join(map(str, keys)), f"append one of {listed(map(str, entries))}"
        location.refuse(text, "the path of one number", remedy)


def _entries(node: PyTree) -> list[str | int]:
    """Return the keys of a node: names of entries or fields, or indices."""
    if isinstance(node, dict):
        return [*node]
    if isinstance(node, list | tuple):
        return [*range(len(node))]
    if is_dataclass(node):
        names = [f.name for f in fields(node) if not f.metadata.get("static", False)]
        return [name for name in names if getattr(node, name) is not None]
    return [*range(len(node))] if np.ndim(node) else []


def _at(tree: PyTree, keys: Keys) -> PyTree:
    for key in keys:
        is_entry = isinstance(key, int) or isinstance(tree, dict)
        tree = tree[key] if is_entry else getattr(tree, str(key))
    return tree

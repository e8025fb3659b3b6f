"""Places of numbers as they are written: "joints.pin.clearance", "state.bodies.arm.velocity.0"."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, fields, is_dataclass

import numpy as np
from jaxtyping import PyTree

from ..fields.suggestions import nearest
from ..model.bodies import State
from ..model.scene import Scene
from ..parametrisation.paths import parameters, unit_at
from ..scene_files.locations import FileLocation, listed
from ..scene_files.numbers import number_of_text

STATE = "state"
STEP = re.compile(r"""\[?(?:'([^']*)'|"([^"]*)"|([^.\[\]'"]+))\]?\.?""")
Keys = tuple[str | int, ...]


def keys_of(text: str, place: FileLocation) -> Keys:
    """The keys of a written place. Names with dots are put into quotation marks.

    **Raises:** `ValueError` for a text that is no place.
    """
    keys, at = [], 0
    while at < len(text):
        step = STEP.match(text, at)
        if step is None or step.end() == at:
            example = "names with dots between, such as joints.pin.clearance"
            place.refuse(text, example, "put names that have dots into quotation marks")
        quoted = step[1] if step[1] is not None else step[2]
        bare = step[3]
        keys.append(quoted if quoted is not None else int(bare) if bare.isdecimal() else bare)
        at = step.end()
    if not keys:
        place.refuse(text, "a place such as joints.pin.clearance", "write one")
    return tuple(keys)


def written(name: str) -> str:
    """A name of `parameters`, such as "joints['pin'].clearance", as it is written here."""
    parts = re.findall(r"\['([^']*)'\]|\[(\d+)\]|([^.\[\]]+)", name)
    words = [quoted or number or bare for quoted, number, bare in parts]
    return ".".join(f"'{word}'" if "." in word else word for word in words)


@dataclass(frozen=True)
class WrittenPlace:
    """A function from a scene, or a state, to what stands at some places."""

    paths: tuple[Keys, ...]

    def __call__(self, tree: PyTree) -> PyTree:
        """What stands there, or all that does."""
        found = [_at(tree, keys) for keys in self.paths]
        return found[0] if len(found) == 1 else found


@dataclass(frozen=True)
class FoundPlace:
    """A place in a scene or in its state, and the unit there."""

    place: WrittenPlace
    in_state: bool
    unit: str

    def number(self, found: object, where: FileLocation) -> float:
        """The number that a file gives for it, in the SI unit."""
        if isinstance(found, str):
            return number_of_text(found, self.unit, where)
        if isinstance(found, bool) or not isinstance(found, int | float):
            where.refuse(found, f"a number in {self.unit}", "write one")
        return float(found)


def find_place(
    texts: str | Sequence[str], scene: Scene, state: State, where: FileLocation
) -> FoundPlace:
    """The place, of one number or of several that are tied, that a file names.

    **Raises:** `ValueError` that names the first key that is not there, and what there is.
    """
    paths = [keys_of(text, where) for text in ([texts] if isinstance(texts, str) else texts)]
    heads = {keys[0] == STATE for keys in paths}
    if len(heads) != 1:
        where.refuse(texts, "places of the scene, or of the state", "name one or the other")
    in_state = heads == {True}
    tree = state if in_state else scene
    paths = [keys[1:] if in_state else keys for keys in paths]
    for keys in paths:
        _require_number(tree, keys, where)
    place = WrittenPlace(tuple(paths))
    return FoundPlace(place, in_state, unit_at(tree, place))


def _require_number(tree: PyTree, keys: Keys, where: FileLocation) -> None:
    here = tree
    for depth, key in enumerate(keys):
        known = _entries(here)
        if key not in known:
            so_far = ".".join(map(str, keys[:depth])) or "the top"
            names = [str(name) for name in known]
            remedy = nearest(str(key), names, "`clearjoint check FILE --places` lists all numbers")
            where.refuse(str(key), f"one of {listed(names)} at {so_far}", remedy)
        here = _at(here, (key,))
    if not _is_leaf(here) or np.ndim(here):
        inside = _entries(here) if _is_leaf(here) else map(written, parameters(here))
        text, remedy = ".".join(map(str, keys)), f"go on with one of {listed(map(str, inside))}"
        where.refuse(text, "the place of one number", remedy)


def _is_leaf(node: PyTree) -> bool:
    return isinstance(node, int | float | np.ndarray | np.generic)


def _entries(node: PyTree) -> list[str | int]:
    """What can follow a place."""
    if isinstance(node, dict):
        return [*node]
    if isinstance(node, list | tuple):
        return [*range(len(node))]
    if is_dataclass(node):
        there = [f.name for f in fields(node) if not f.metadata.get("static", False)]
        return [name for name in there if getattr(node, name) is not None]
    return [*range(len(node))] if np.ndim(node) else []


def _at(tree: PyTree, keys: Keys) -> PyTree:
    for key in keys:
        in_it = isinstance(key, int) or isinstance(tree, dict)
        tree = tree[key] if in_it else getattr(tree, str(key))
    return tree

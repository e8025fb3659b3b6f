"""A scene and its state on disk."""

import json
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from os import PathLike
from pathlib import Path
from typing import TypeAlias

import jax
import numpy as np

from ..dynamics.assembly import assemble, check_names
from ..fields.cautions import quiet
from ..fields.suggestions import nearest
from ..model.bodies import State
from ..model.scene import Scene
from .complaints import FilePlace, listed
from .formats import Document, parsed, read_document, suffix_of, text_of
from .guesses import guessed
from .kinds import Classes, require_classes
from .reading import Reader
from .schema import scene_schema
from .writing import Writer

ARRAYS = np.ndarray | np.generic | jax.Array


def first_difference(one: object, other: object, place: FilePlace) -> FilePlace | None:
    """Where two trees differ first; ``None`` if they are the same. Arrays of numpy and of JAX are
    the same if type and bits of their numbers are."""
    if isinstance(one, ARRAYS) and isinstance(other, ARRAYS):
        return None if _bits(one) == _bits(other) else place
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        return _first(dict(one), dict(other), place)
    if type(one) is not type(other):
        return place
    if is_dataclass(one) and not isinstance(one, type):
        names = [field.name for field in fields(one)]
        values = [{name: getattr(node, name, None) for name in names} for node in (one, other)]
        return _first(values[0], values[1], place)
    if isinstance(one, tuple | list) and isinstance(other, tuple | list):
        return _first(dict(enumerate(one)), dict(enumerate(other)), place)
    if isinstance(one, float):
        return None if _bits(one) == _bits(other) else place
    return None if one == other else place


def _first(ones: dict, others: dict, place: FilePlace) -> FilePlace | None:
    if set(ones) != set(others):
        return place
    for key in ones:
        found = first_difference(ones[key], others[key], place.at(key))
        if found is not None:
            return found
    return None


def _bits(value: object) -> tuple[object, ...]:
    array = np.asarray(value)
    return array.shape, array.dtype, array.tobytes()


FORMAT = 1
"""The version of the form of files."""
VERSION, STATE = "format", "state"
MOST_ASSEMBLED = 50
"""Bodies of a scene whose state may be left out: to assemble a chain of 20 takes 20 s, and the time
grows faster than their number."""
FilePath: TypeAlias = str | PathLike[str]


def save(scene: Scene, state: State, path: FilePath, *, schema: bool = False) -> None:
    """Write a scene and a state of it to a file, TOML or JSON by its suffix, as `load` reads it.

    What is read back is the same to the last bit, which is verified before anything is written.
    Numbers are in SI units; TOML says the units in comments. Objects of classes of your own are
    written with their module's and their own name ("my_laws:Quadratic") and their arguments.

    **Arguments:**

    - `path`: overwritten if it exists.
    - `schema`: whether to write the JSON Schema of such files beside it (`scene_schema`), by which
      editors complete and check: "pendulum.schema.json" for "pendulum.toml".

    **Raises:** `ValueError` that names the place of what a file can't hold: a function, NaN, or an
    object whose constructor does not make it anew from its fields.

    >>> cj.save(*cj.mechanisms.double_pendulum(), "pendulum.toml")
    >>> scene, state = cj.load("pendulum.toml")
    >>> list(scene.bodies)
    ['arm 2', 'arm 3']
    """
    check_names(scene, state)
    path = Path(path)
    suffix, writer, place = suffix_of(path), Writer(), FilePlace(str(path))
    document = {VERSION: FORMAT, **writer.table(scene, place)}
    document[STATE] = writer.table(state, place.at(STATE))
    beside = path.with_suffix(".schema.json")
    text = text_of(document, suffix, writer.units, beside.name if schema else None)
    _require_exact(text, (scene, state), writer.own_classes, path)
    path.write_text(text, encoding="utf-8")
    if schema:
        described = json.dumps(scene_schema(writer.own_classes), indent=2)
        beside.write_text(described + "\n", encoding="utf-8")


def load(path: FilePath, classes: Classes = ()) -> tuple[Scene, State]:
    """Read a scene and its state from a file, TOML or JSON by its suffix.

    ```toml
    gravity = [0, 9.81, 0]

    [bodies.arm]
    mass = "7020 g"
    inertia = [0.001, 0.5855, 0.5855]

    [joints.pin]
    kind = "ClearanceJoint"
    bearing_body = "ground"
    journal_body = "arm"
    journal_point = ["-50 cm", 0, 0]
    bearing_radius = "10 mm"
    clearance = "0.5 mm"
    journal_length = "20 mm"
    law = { kind = "Quadratic", stiffness = 1e9 }

    [state.bodies.arm]
    position = [0.5, 0, 0]
    ```

    Tables have the names and defaults of the Python classes' arguments, and `kind` names the class,
    or a method that makes one: ``kind = "Body.rod"``, ``kind = "Spline.through"``. In the place of
    an orientation's Euler parameters may stand ``{axis = [0, 0, 1], angle = "30 deg"}``.
    Numbers are in SI units; as text they may have another, of which pint knows. "none" stands for
    ``None``. Bodies whose state is left out are placed at rest by following the joints from the
    ground, and the state is then assembled.

    A class of your own is handed over: a file never imports or runs code by itself. Its fields'
    units may be declared by `quantity`. The file above goes with

    ```python
    import clearjoint as cj
    import jax.numpy as jnp

    class Quadratic(cj.extend.AbstractContactLaw):
        stiffness: float = cj.extend.quantity("N/m^2", positive=True)
        uses_entry_speed = False
        force_jumps = False

        def elastic_force(self, gap):
            return self.stiffness * jnp.maximum(gap.depth, 0.0) ** 2

        def force(self, gap, entry_speed):
            return self.elastic_force(gap)

        def stored_energy(self, gap):
            return self.stiffness * jnp.maximum(gap.depth, 0.0) ** 3 / 3

    scene, state = cj.load("pendulum.toml", classes=[Quadratic])
    ```

    **Arguments:** `classes`: those of your own that the file may name, "Quadratic" or
    "my_laws:Quadratic".

    **Raises:** `ValueError` with file, place, what was found and expected, and a remedy.
    """
    require_classes(classes)
    document, place = read_document(Path(path))
    return scene_of_document(document, classes, place)


def _require_exact(text: str, saved: tuple[Scene, State], classes: Classes, path: FilePath) -> None:
    """Check that a text gives what was saved."""
    place = FilePlace(str(path))
    with quiet():
        read = scene_of_document(parsed(text, suffix_of(Path(path)), str(path)), classes, place)
    for one, other, at in zip(saved, read, (place, place.at(STATE)), strict=True):
        found = first_difference(one, other, at)
        if found is not None:
            found.refuse(
                "what its class does not make anew from the arguments",
                "a field that its constructor fills with the argument of that name",
                "declare numbers by `quantity`, which stores arrays, and take tuples for lists",
            )


def scene_of_document(
    document: Document, classes: Classes, place: FilePlace
) -> tuple[Scene, State]:
    """The scene and its whole state, of a file's tables; `place`: of the tables, for messages."""
    _require_known_version(document.get(VERSION, FORMAT), place.at(VERSION))
    reader = Reader(classes)
    sections = {key: item for key, item in document.items() if key not in (VERSION, STATE)}
    given = document.get(STATE, {})
    if not isinstance(given, dict):
        place.at(STATE).refuse(given, "a table", "write [state.bodies.<name>] for each body")
    scene = reader.instance(Scene, sections, place, beside=(VERSION, STATE))
    state = reader.instance(State, {"bodies": {}} | given, place.at(STATE))
    known = list(scene.bodies)
    for name in state.bodies:
        if name not in known:
            at, remedy = place.at(STATE).at("bodies"), "add the body, or leave its state out"
            at.refuse(name, f"one of the scene's {listed(known)}", nearest(name, known, remedy))
    return scene, _completed(scene, state, place.at(STATE))


def _require_known_version(found: object, place: FilePlace) -> None:
    expected = f"a whole number from 1 to {FORMAT}"
    if isinstance(found, bool) or not isinstance(found, int) or found < 1:
        place.refuse(found, expected, f"write {VERSION} = {FORMAT}, or leave it out")
    if found > FORMAT:
        place.refuse(found, expected, "a newer clearjoint wrote this: update yours to read it")


def _completed(scene: Scene, state: State, place: FilePlace) -> State:
    """The state as it was given, or one assembled where it says nothing of some body."""
    missing = sorted(set(scene.bodies) - set(state.bodies))
    if not missing:
        return state
    if len(scene.bodies) > MOST_ASSEMBLED:
        place.refuse(
            f"no state of {len(missing)} bodies",
            f"one of each body in a scene of more than {MOST_ASSEMBLED} bodies",
            "give [state.bodies.<name>] a `position` (m) and an `orientation`",
        )
    try:
        return assemble(scene, guessed(scene, state))
    except ValueError as error:
        raise ValueError(
            f"{place}: found no state of {listed(missing)} by following the joints from the "
            f"ground, expected one in the file: give [state.bodies.<name>] a `position` (m) and "
            f"an `orientation` that nearly fit the joints. {error}"
        ) from error

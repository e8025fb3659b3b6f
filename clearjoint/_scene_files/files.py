"""Save scenes and states to TOML and JSON files, and load them."""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from enum import Enum
from os import PathLike
from pathlib import Path
from typing import TypeAlias

import jax
import numpy as np
from jax.core import Tracer
from jaxtyping import PyTree

from .._dynamics.assembly import assemble
from .._dynamics.constraint_report import check_names
from .._fields.cautions import quiet
from .._fields.checks import is_of_package, nearest
from .._model.bodies import State
from .._model.scene import Scene
from .classes import (
    ANYTHING,
    REQUIRED,
    Classes,
    Expectation,
    arguments,
    class_name,
    makers,
)
from .documents import (
    Document,
    FileLocation,
    Keys,
    format_document,
    listed,
    parse,
    read_document,
    suffix_of,
)
from .reading import ABSENT, KIND, Reader
from .schema import scene_schema


@dataclass(frozen=True)
class Writer:
    """Converts objects to tables. Collects `units` of values by their keys, and `user_classes`."""

    units: dict[Keys, str] = field(default_factory=dict)
    user_classes: set[type] = field(default_factory=set)

    def table(self, instance: PyTree, location: FileLocation) -> dict[str, object]:
        """Return the arguments with which the constructor makes an object again. Left out are
        arguments whose value and default are ``None`` or empty, or that have a default but no
        field. `location`: of the object's table in the file."""
        kind = type(instance)
        if not is_of_package(kind):
            self.user_classes.add(kind)
        if KIND in arguments(kind):  # the key of a table that names its class
            remedy = "rename it: `kind` names classes"
            location.at(KIND).refuse(KIND, "another name of the argument", remedy)
        # Values of arguments are known only from fields of the same name.
        stored = {entry.name: getattr(instance, entry.name) for entry in fields(instance)}
        entries: dict[str, object] = {}
        for name, expected in arguments(kind).items():
            if name in stored:
                value, default = stored[name], expected.default
                is_none = value is None and default is None
                is_empty = isinstance(value, Mapping) and not value and not default
                if not (is_none or is_empty):
                    entries[name] = self._value(value, expected, location.at(name))
            elif expected.default is REQUIRED:
                remedy = "store it in a field of the same name, or give it a default"
                location.at(name).refuse("no field of this name", "one for each argument", remedy)
        return entries

    def _value(self, value: object, expected: Expectation, location: FileLocation) -> object:
        if isinstance(value, Tracer):
            location.refuse(value, "a number", "call `save` outside functions that JAX transforms")
        self.units[location.keys] = expected.unit or "1"  # unused for texts and tables
        if isinstance(value, np.ndarray | np.generic | jax.Array):
            return self._value(np.asarray(value).tolist(), expected, location)
        if isinstance(value, Enum):
            return value.name
        if isinstance(value, Mapping):
            of_entry = expected.by_name or ANYTHING
            for key in value:
                if not isinstance(key, str):
                    location.refuse(key, "a name", "use text for the keys of dictionaries")
            return {k: self._value(item, of_entry, location.at(k)) for k, item in value.items()}
        if isinstance(value, tuple | list):
            # Without `item` the list is an array, whose rows are expected to be like the array.
            of_entry = expected.item or expected
            return [self._value(item, of_entry, location.at(k)) for k, item in enumerate(value)]
        # The table need not name its class if the argument allows only objects of this class.
        if is_dataclass(value) and not isinstance(value, type):
            is_known = expected.classes == (type(value),)
            class_entry = {} if is_known else {KIND: class_name(type(value))}
            return class_entry | self.table(value, location)
        if value is None:
            if expected.is_text:  # the reader would return the text "none"
                remedy = "leave it out, or make None the default of the argument"
                location.refuse(value, "a text", remedy)
            return ABSENT
        if isinstance(value, bool | int | str):
            return value
        if not isinstance(value, float):
            name = "a function" if callable(value) else f"a {type(value).__name__}"
            location.refuse(
                value,
                "numbers, names, or objects of classes with fields",
                f"{name} can't be saved; make a class whose fields hold its numbers and whose "
                "method (`__call__`, say) computes its result, and pass the class to `load`",
            )
        if math.isnan(value):
            location.refuse(value, "a number", "replace it: NaN is not saved")
        return value if math.isfinite(value) else str(value)  # JSON has no infinity


ARRAYS = np.ndarray | np.generic | jax.Array
FORMAT = 1
VERSION, STATE = "format", "state"
MOST_ASSEMBLED = 50
"""Largest number of bodies of a scene whose file may omit states: to assemble a chain of 20 bodies
takes 20 s, and the time grows faster than their number."""
FilePath: TypeAlias = str | PathLike[str]


def save(scene: Scene, state: State, path: FilePath, *, schema: bool = False) -> None:
    """Write a scene and its state to a TOML or JSON file, chosen by the suffix, for `load`.

    Scene and state are restored bit for bit; this is verified before anything is written. Numbers
    are in SI units; TOML has the units in comments. Objects of user-defined classes are written
    with the names of module and class ("my_laws:Quadratic") and with their arguments.

    **Arguments:**

    - `path`: with the suffix ".toml" or ".json"; an existing file is overwritten.
    - `schema`: whether to write the JSON Schema (`scene_schema`) to the same folder, by which
      editors complete and check the file: "pendulum.schema.json" for "pendulum.toml".

    **Raises:** `ValueError` for a state that does not suit the scene, and for a value that a file
    can't hold: a function, NaN, a traced number, or an object that its class does not make again
    from its fields. The message names its location. `OSError` if the file can't be written.

    >>> cj.save(*cj.mechanisms.double_pendulum(), "pendulum.toml")
    >>> scene, state = cj.load("pendulum.toml")
    >>> list(scene.bodies)
    ['arm 2', 'arm 3']
    """
    check_names(scene, state)
    path = Path(path)
    suffix, writer, location = suffix_of(path), Writer(), FileLocation(str(path))
    document = {VERSION: FORMAT, **writer.table(scene, location)}
    document[STATE] = writer.table(state, location.at(STATE))
    schema_path = path.with_suffix(".schema.json")
    text = format_document(document, suffix, writer.units, schema_path.name if schema else None)
    # Read the text and compare it with the scene: a class may change its arguments, or take others
    # than its fields, and its objects would then not be restored.
    with quiet():
        parsed = parse(text, suffix, str(path))
        read_scene, read_state = scene_of_document(parsed, writer.user_classes, location)
    in_scene = first_difference(scene, read_scene, location)
    difference = in_scene or first_difference(state, read_state, location.at(STATE))
    if difference is not None:
        difference.refuse(
            "a value that its class does not restore from arguments",
            "a field that its constructor fills with the argument of that name",
            "declare numbers by `quantity`, which stores arrays, and use tuples, not lists",
        )
    path.write_text(text, encoding="utf-8")
    if schema:
        content = json.dumps(scene_schema(writer.user_classes), indent=2)
        schema_path.write_text(content + "\n", encoding="utf-8")


def load(path: FilePath, classes: Classes = ()) -> tuple[Scene, State]:
    """Read a scene and its state from a TOML or JSON file, chosen by the suffix.

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

    Keys and defaults are those of the Python classes' arguments. `kind` names the class, or a
    static method that makes an object: ``kind = "Body.rod"``, ``kind = "Spline.through"``. ``{axis
    = [0, 0, 1], angle = "30 deg"}`` may replace the Euler parameters of an orientation. Numbers are
    in SI units, or texts with a unit that pint reads. "none" is ``None``.

    Bodies without a state are placed at rest by following the joints from the ground. If there are
    such bodies, `assemble` then closes loops, and corrects velocities that contradict the joints
    and drivers; it may also change the states that the file has. In a scene of more than 50 bodies,
    each body needs a state.

    User-defined classes are passed in `classes`: a file never imports or runs code. `quantity`
    declares the units of their fields. The file above needs

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

    **Arguments:** `classes`: user-defined classes that the file may name, as "Quadratic" or
    "my_laws:Quadratic".

    **Raises:** `ValueError` for a file of more than 200 MB, and for content that does not describe
    a scene. The message names the location in the file, the value found there, the expected values
    and a remedy. `OSError` for a file that can't be read.
    """
    makers((), classes)  # raises an error for wrong classes
    document, location = read_document(Path(path))
    return scene_of_document(document, classes, location)


def first_difference(first: object, second: object, location: FileLocation) -> FileLocation | None:
    """Return the location of the first difference between two objects at `location`; ``None`` if
    they are equal. Floats and arrays must agree bit by bit, arrays also in shape and dtype."""
    # An array of NumPy may equal one of JAX, and dictionaries of different types may be equal. All
    # other objects differ if their types do.
    are_arrays = isinstance(first, ARRAYS) and isinstance(second, ARRAYS)
    are_tables = isinstance(first, Mapping) and isinstance(second, Mapping)
    if not (are_arrays or are_tables or type(first) is type(second)):
        return location
    entries, others = _entries(first), _entries(second)
    if not (entries or others):  # two values without parts, or two empty containers
        if are_arrays or isinstance(first, float):
            # Bits also tell 0.0 from -0.0, and NaN equals itself.
            a, b = np.asarray(first), np.asarray(second)
            are_equal = (a.shape, a.dtype, a.tobytes()) == (b.shape, b.dtype, b.tobytes())
        else:
            are_equal = first == second
        return None if are_equal else location
    if set(entries) != set(others):
        return location
    pairs = ((entries[key], others[key], location.at(key)) for key in entries)
    return next((difference for pair in pairs if (difference := first_difference(*pair))), None)


def _entries(node: object) -> dict:
    if isinstance(node, Mapping):
        return dict(node)
    if isinstance(node, tuple | list):
        return dict(enumerate(node))
    if is_dataclass(node) and not isinstance(node, type):
        return {field.name: getattr(node, field.name, None) for field in fields(node)}
    return {}


def scene_of_document(
    document: Document, classes: Classes, location: FileLocation
) -> tuple[Scene, State]:
    version, remedy = document.get(VERSION, FORMAT), ""
    if isinstance(version, bool) or not isinstance(version, int) or version < 1:
        remedy = f"write {VERSION} = {FORMAT}, or leave it out"
    elif version > FORMAT:
        remedy = "a newer clearjoint wrote this file: update yours to read it"
    if remedy:
        location.at(VERSION).refuse(version, f"a whole number from 1 to {FORMAT}", remedy)
    reader = Reader(classes)
    # All other keys of the file are arguments of `Scene`.
    sections = {key: item for key, item in document.items() if key not in (VERSION, STATE)}
    state_table, state_location = document.get(STATE, {}), location.at(STATE)
    if not isinstance(state_table, dict):
        state_location.refuse(state_table, "a table", "write [state.bodies.<name>] for each body")
    # An error about an unknown key lists `other_keys` too, since a file may have these.
    scene = reader.instance(Scene, sections, location, other_keys=(VERSION, STATE))
    # A file may omit the state of any body, and the whole section. `_completed` computes the
    # missing states, by following the joints.
    state = reader.instance(State, {"bodies": {}} | state_table, state_location)
    bodies = list(scene.bodies)
    for name in state.bodies:
        if name not in bodies:
            remedy = nearest(name, bodies, "add the body, or leave its state out")
            state_location.at("bodies").refuse(name, f"one of the scene's {listed(bodies)}", remedy)
    return scene, _completed(scene, state, state_location)


def _completed(scene: Scene, state: State, location: FileLocation) -> State:
    missing = sorted(set(scene.bodies) - set(state.bodies))
    if not missing:
        return state
    if len(scene.bodies) > MOST_ASSEMBLED:
        location.refuse(
            f"no state of {len(missing)} bodies",
            f"one of each body in a scene of more than {MOST_ASSEMBLED} bodies",
            "give [state.bodies.<name>] a `position` (m) and an `orientation`",
        )
    from .._model.arrangement import arranged_state  # imports SciPy

    try:
        return assemble(scene, arranged_state(scene, state))
    except ValueError as error:
        raise ValueError(
            f"{location}: found no state of {listed(missing)} by following the joints from the "
            f"ground, expected one in the file: give [state.bodies.<name>] a `position` (m) and "
            f"an `orientation` that nearly fit the joints. {error}"
        ) from error

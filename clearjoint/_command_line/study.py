"""Study files: their sections, the numbers that they name, and how they are read.

The fields of the dataclasses are the keys of a file's tables. `Annotated[float, "s"]` declares the
unit of a number. A path is a text such as "joints.pin.clearance" or
"state.bodies.crank.position[0]" that names a number of the scene or of the initial state.
"""

import inspect
import re
import time
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import reduce
from operator import getitem
from pathlib import Path
from types import ModuleType
from typing import Annotated, Literal

import diffrax
import numpy as np
from jaxtyping import PyTree

from .. import quantities
from .._durability.wear_rates import WearRates
from .._dynamics.absolute_coordinates import AbsoluteCoordinates
from .._dynamics.formulation import Baumgarte, Projection, Unstabilised
from .._dynamics.joint_coordinates.coordinates import JointCoordinates
from .._fields.checks import nearest, require, require_count, require_positive
from .._identification.screening.screening import Screening
from .._identification.starts import Starts
from .._measurements.readers import Missing
from .._model.bodies import State
from .._model.scene import Scene
from .._parametrisation.parameter import AbstractScale, Bounded, Linear, Log
from .._parametrisation.paths import parameters
from .._scene_files import documents
from .._scene_files.files import scene_of_document
from .._scene_files.reading import KIND, Reader, number_of_text
from .._scene_files.schema import Catalogue, Schema, scene_properties
from .._simulation.reductions import joints
from .._simulation.reductions import quantities as of_quantities
from .._simulation.reductions.base import AbstractReduction
from .._simulation.run.outputs import RECORDED, Output, Requested
from .._simulation.run.saving import Saving
from .._simulation.run.sections import Section
from .._simulation.step import presets
from .._simulation.step.settings import Settings
from ..quantities.base import AbstractQuantity

FRAMES = 1000
"""Default number of equal intervals between the saved states of a run."""
Preset = Literal["preview", "default", "accurate", "reference", "derivatives", "identification"]


@dataclass(frozen=True)
class RunPart:
    """The section [run]: settings and outputs of a run.

    - `start`, `end`: first and last time, s. Without `end`, the command line must give it.
    - `save_every`: time between two saved states, s; by default a thousandth of the duration.
    - `preset`: name of settings in `clearjoint.presets`; `settings`: entries that replace some.
    - `outputs`: quantities, evaluated at the saved states, or reductions, sections and tables. For
      each force or acceleration, the largest and smallest value in the whole run are results too.
    - `sections`: further outputs that are sections, as in files of earlier versions.
    """

    end: Annotated[float | None, "s"] = None
    start: Annotated[float, "s"] = 0.0
    preset: Preset = "default"
    settings: Settings | None = None
    save_every: Annotated[float | None, "s"] = None
    outputs: Mapping[str, Output] = field(default_factory=dict)
    sections: Mapping[str, Section] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not (isinstance(self.outputs, Mapping) and isinstance(self.sections, Mapping)):
            return  # the reader refuses these, with their place in the file
        twice = sorted(set(self.outputs) & set(self.sections))
        expected = "names that `outputs` does not use"
        require(not twice, "sections", twice, expected, "rename the section")
        object.__setattr__(self, "outputs", {**self.outputs, **self.sections})

    def saved_times(self, end: float) -> np.ndarray:
        """Return the times (N,), s, at which states are saved, the last one not after `end`."""
        every = self.save_every
        if every is None:
            return np.linspace(self.start, end, FRAMES + 1)
        require_positive("save_every", every, "give it in s")
        duration = end - self.start
        shorter = f"at most the duration, {duration:g} s"
        require(every <= duration, "save_every", every, shorter, "save more often")
        # Rounding errors are allowed for: by the factor, the end is among the times if the duration
        # is a multiple of `every`; by the minimum, no time is after the end.
        count = int(np.floor(duration / every * (1.0 + 1e-12)))
        return np.minimum(self.start + every * np.arange(count + 1), end)


@dataclass(frozen=True)
class AxisPart:
    """The values of a number of the scene or of the initial state in a sweep.

    - `path`: of one number, or of several, which all get the same value.
    - `values`: numbers in SI units, or texts with units; without them `count` values from `start`
      to `stop`, at equal differences or, if `spacing` is "geometric", equal ratios.
    """

    path: str | Sequence[str]
    values: Sequence[float | str] | None = None
    start: float | str | None = None
    stop: float | str | None = None
    count: int = 10
    spacing: Literal["linear", "geometric"] = "linear"

    def __post_init__(self) -> None:
        require_count("count", self.count, "give a number of values")
        ends = [end for end in (self.start, self.stop) if end is not None]
        entries = {"values": self.values, "start": self.start, "stop": self.stop}
        expected = "either `values`, or `start` and `stop`"
        # Both ends are needed without `values`, and neither is allowed with `values`.
        is_complete = len(ends) == (2 if self.values is None else 0)
        require(is_complete, "values", entries, expected, "give one")
        if self.values is not None:
            is_row = isinstance(self.values, tuple | list) and len(self.values) > 0
            require(is_row, "values", self.values, "a list of values", "write [0.1, 0.2], say")


@dataclass(frozen=True)
class SweepPart:
    """The section [sweep]: runs with different numbers of the scene, and outputs of each.

    - `outputs`: quantities are evaluated at the times at which [run] saves states. The Poincaré
      sections of [run] are computed too. `end`, `preset`, `settings`: by default those of [run].
    - `zipped`: whether lane k has the k-th value of every axis, in place of all combinations.
    - `chunk`: number of lanes that are stored together; by default a sixteenth of all, at most 256.
    """

    axes: Mapping[str, AxisPart]
    outputs: Mapping[str, Output] = field(default_factory=dict)
    end: Annotated[float | None, "s"] = None
    preset: Preset | None = None
    settings: Settings | None = None
    zipped: bool = False
    chunk: int | None = None


@dataclass(frozen=True)
class ColumnPart:
    """A measured quantity, a column of the file of measurements: `unit`, if the header has none;
    `noise`, standard deviation as a number in this unit or a text with a unit."""

    quantity: AbstractQuantity
    noise: float | str
    unit: str | None = None


@dataclass(frozen=True)
class ParameterPart:
    """A number to estimate, or several with the same value: `path`, or paths; `scale` of the
    estimate; `guess`, a number in SI units or a text with a unit, by default the scene's number."""

    path: str | Sequence[str]
    scale: AbstractScale = field(default_factory=Linear)
    guess: float | str | None = None


@dataclass(frozen=True)
class FitPart:
    """The section [fit]: parameters to estimate from measurements.

    - `measurements`: path of a CSV file, relative to the study's folder. `time`, `time_unit`:
      column of the times, and its unit; `missing`: "drop" or "refuse" for samples that are not
      finite; `comment`: first character of comment lines, none by default.
    - `columns`: measured quantities, by the name of the column.
    - `grow`, `max_iterations`, `starts`: see `clearjoint.identify`.
    - `start`: time at which runs begin, s; `preset`, `settings`: as in [run].
    """

    measurements: str
    columns: Mapping[str, ColumnPart]
    parameters: Mapping[str, ParameterPart]
    time: str = "t"
    time_unit: str = "s"
    missing: Missing = "refuse"
    comment: str | None = None
    grow: Sequence[Annotated[float, "s"]] = ()
    max_iterations: int = 100
    starts: Starts | Screening | None = None
    start: Annotated[float, "s"] = 0.0
    preset: Preset = "identification"
    settings: Settings | None = None


@dataclass(frozen=True)
class WearPart:
    """The section [wear]: arguments of `clearjoint.wear`; `start`, the time at which runs begin, s;
    and `preset` and `settings`, as in [run]."""

    rates: Mapping[str, WearRates]
    cycle: Annotated[float, "s"]
    cycles: float = np.inf
    depth: Annotated[float | None, "m"] = None
    settle: int = 1
    measured: int = 2
    tolerance: float = 0.1
    stage_error: float = 0.01
    largest_change: Annotated[float | None, "m"] = None
    samples: int = 96
    stages: int = 10_000
    start: Annotated[float, "s"] = 0.0
    preset: Preset = "default"
    settings: Settings | None = None

    def __post_init__(self) -> None:
        has_end = self.cycles < np.inf or self.depth is not None
        remedy = 'write cycles = 1e6 or depth = "20 um"'
        require(has_end, "cycles", self.cycles, "a number, unless `depth` is given", remedy)


@dataclass(frozen=True)
class StudyParts:
    title: str = ""
    run: RunPart = field(default_factory=RunPart)
    sweep: SweepPart | None = None
    fit: FitPart | None = None
    wear: WearPart | None = None


def _concrete(module: ModuleType, family: type) -> list[type]:
    classes = [kind for kind in vars(module).values() if inspect.isclass(kind)]
    return [kind for kind in classes if issubclass(kind, family) and not inspect.isabstract(kind)]


CLASSES: tuple[type, ...] = (
    *_concrete(quantities, quantities.AbstractQuantity),
    *_concrete(of_quantities, AbstractReduction),
    *_concrete(joints, AbstractReduction),
    *(AbsoluteCoordinates, JointCoordinates, Baumgarte, Projection, Unstabilised),
    *(diffrax.Tsit5, diffrax.Dopri5, diffrax.Dopri8, diffrax.Bosh3, diffrax.Heun, diffrax.Euler),
    *(Linear, Log, Bounded),
)
"""Classes that a table of a study file may name under "kind", beside those in the annotation of a
field, such as `ImpactTable`."""


def study_schema() -> Schema:
    catalogue = Catalogue(CLASSES)
    scene = {"type": "object", "properties": scene_properties(catalogue), "required": ["bodies"]}
    properties = {"scene": {"anyOf": [{"type": "string"}, scene]}}
    properties |= catalogue.properties(StudyParts)
    return catalogue.document("study", properties, ["scene"])


@dataclass(frozen=True)
class WrittenPath:
    """Function of a scene or state that returns the number at a path, or a list for several."""

    paths: tuple[documents.Keys, ...]

    def __call__(self, tree: PyTree) -> PyTree:
        values = [reduce(_entry, keys, tree) for keys in self.paths]
        return values[0] if len(values) == 1 else values


@dataclass(frozen=True)
class FoundPath:
    """The number at a path of a file, or the numbers at several, which have one `unit`. `in_state`:
    whether `path` selects them from the state, instead of the scene."""

    path: WrittenPath
    in_state: bool
    unit: str

    def number(self, value: object, location: documents.FileLocation) -> float:
        if isinstance(value, str):
            return number_of_text(value, self.unit, location)
        if isinstance(value, bool) or not isinstance(value, int | float):
            location.refuse(value, f"a number in {self.unit}", "write one")
        return float(value)


def find_path(
    texts: str | Sequence[str], scene: Scene, state: State, location: documents.FileLocation
) -> FoundPath:
    """Find the number of the scene or its initial state at a path, or those at several paths.

    **Raises:** `ValueError` for a path that does not lead to one number (the message lists the
    existing names), for paths both in the scene and in the state, and for different units.
    """
    with location.in_errors():
        paths = [documents.keys_of(text) for text in ([texts] if isinstance(texts, str) else texts)]
    in_state = {keys[0] == "state" for keys in paths}
    if len(in_state) != 1:
        location.refuse(texts, "paths in the scene, or in the state", "name one or the other")
    (is_state,) = in_state
    # The first key, "state", is not one of the state itself.
    tree, paths = (state, [keys[1:] for keys in paths]) if is_state else (scene, paths)
    # The unit of each number, by its keys: an array has one entry for each component.
    units = {
        (*documents.keys_of(name), *map(str, index)): unit
        for name, (value, unit) in parameters(tree).items()
        for index in np.ndindex(np.shape(value))
    }
    for keys in paths:
        if keys not in units:
            # The message lists the names at the first unknown key or, if all keys are known, those
            # that follow, since the path then leads to several numbers. `known` is the number of
            # leading keys that are those of a number.
            known = max(n for n in range(len(keys) + 1) if any(k[:n] == keys[:n] for k in units))
            options = [k[known] for k in units if k[:known] == keys[:known] and len(k) > known]
            names, parent = (
                documents.listed({*options}),
                documents.written(keys[:known]) or "the top",
            )
            if known == len(keys):
                location.refuse(parent, "the path of one number", f"append one of {names}")
            otherwise = "`clearjoint check FILE --paths` lists all numbers"
            remedy = nearest(keys[known], options, otherwise)
            location.refuse(keys[known], f"one of {names} at {parent}", remedy)
    # All numbers get the same value, which would be ambiguous if their units differed.
    distinct = list(dict.fromkeys(units[keys] for keys in paths))
    if len(distinct) > 1:
        location.refuse(distinct, "paths of numbers with one unit", "write an entry for each unit")
    return FoundPath(WrittenPath(tuple(paths)), is_state, distinct[0])


def _entry(tree: PyTree, key: str | int) -> PyTree:
    if isinstance(tree, dict):
        return tree[key]
    return getattr(tree, str(key)) if hasattr(tree, str(key)) else tree[int(key)]


SCENE = "scene"
"""Key of a study file: the path of a scene file, or the scene as a table."""
PARTS = tuple(part.name for part in fields(StudyParts))


class AbstractStudy:
    """What was read from a study file: `parts`, a dataclass of its entries, such as `StudyParts`,
    with a `title`; the file's `location`, for errors; `started`, `time.perf_counter` then, s."""

    parts: PyTree
    location: documents.FileLocation
    started: float

    @property
    def path(self) -> Path:
        return Path(self.location.file)

    @property
    def title(self) -> str:
        return self.parts.title or self.path.stem


@dataclass(frozen=True)
class Study(AbstractStudy):
    """A scene with its initial state, and a study file; `document`: its tables without the scene,
    after the changes of the command line."""

    scene: Scene
    state: State
    parts: StudyParts
    location: documents.FileLocation
    document: Mapping[str, object]
    started: float = field(default_factory=time.perf_counter)

    def settings(self, section: str) -> Settings:
        """Return the settings of the section `section`, such as "run": the preset, changed by the
        entries of `settings`. A section [sweep] with neither preset nor settings has the settings
        of [run]. The energy ledger is on if an output of the section needs it."""
        part = getattr(self.parts, section)
        outputs = getattr(part, "outputs", {}).values()
        needs_ledger = any(getattr(output, "needs_ledger", False) for output in outputs)
        if section == "sweep" and part.preset is None and part.settings is None:
            section, part = "run", self.parts.run
        # `part.settings` has defaults for all settings that the section does not name; only those
        # that it names replace settings of the preset.
        table = self.document.get(section)
        entries = table.get("settings", {}) if isinstance(table, dict) else {}
        # The key `kind` names the class of a table; None stands for no settings.
        named = [] if part.settings is None else [key for key in entries if key != KIND]
        changes = {key: getattr(part.settings, key) for key in named}
        if needs_ledger:
            changes["ledger"] = True
        return replace(getattr(presets, part.preset or "default"), **changes)

    def end(self, section_end: float | None = None) -> float:
        """Return the end of runs, s: `section_end`, or by default that in [run]."""
        end = self.parts.run.end if section_end is None else section_end
        if end is None:
            self.location.at("run").refuse(None, "an `end`", 'write end = "1 s", or pass --end 1')
        with self.location.at("run" if section_end is None else "sweep", "end").in_errors():
            require(end > self.parts.run.start, "end", end, "after the start", "give it in s")
        return float(end)

    def check_elements(self, named: Mapping[str, Output], *keys: str) -> None:
        """Raise a `ValueError` if the scene lacks an element to which an output refers. `named`:
        the outputs by name. `keys` lead to their table in the file, as "run", "outputs"."""
        for name, entry in named.items():
            with self.location.at(*keys, name).in_errors():
                if isinstance(entry, AbstractQuantity | RECORDED):
                    entry.check(self.scene)

    def outputs_of_sweep(self, part: SweepPart) -> Requested:
        """Return the outputs of [sweep] and the sections of [run]. Quantities among them are to be
        evaluated at the times at which [run] saves states."""
        run = self.parts.run
        sections = {n: output for n, output in run.outputs.items() if isinstance(output, Section)}
        requested = Requested({**sections, **part.outputs}, Saving())
        if not requested.quantities:
            return requested
        return replace(requested, save=Saving(run.saved_times(self.end(part.end)), states=False))


def read_study(path: Path, changes: Iterable[str] = ()) -> Study:
    """Read a study file, or a scene file, which may have the sections of a study too, and make
    changes such as "joints.pin.clearance=0.2mm" in the scene or "run.end=2" in the study."""
    document, location = documents.read_document(path)
    if "bodies" in document:  # a scene file, which may have sections of a study
        study = {key: document.pop(key) for key in PARTS if key in document}
        tables, scene_location = document, location
    elif SCENE in document:  # a table, or the path of a scene file relative to the study file
        study, tables, scene_location = document, document.pop(SCENE), location.at(SCENE)
        if not isinstance(tables, dict):
            file = path.parent / str(tables)
            if not file.is_file():
                scene_location.refuse(tables, "the path of a scene file, or a table", "correct it")
            tables, scene_location = documents.read_document(file)
    else:
        remedy = 'a study file names one, scene = "four_bar.toml"; a scene file has [bodies.<name>]'
        location.refuse(sorted(document), "`scene` or `bodies`", remedy)
    for change in changes:
        is_in_study, keys = _set(study, tables, change)
        changed = location if is_in_study else scene_location
        if changed.source is not None:
            # With this entry, error messages about the value quote the change, not a line number.
            changed.source.changes[(*changed.keys, *keys)] = change
    scene, state = scene_of_document(tables, (), scene_location)
    # A message about an unknown key lists `scene` among the known ones.
    parts = Reader(CLASSES).instance(StudyParts, study, location, other_keys=(SCENE,))
    return Study(scene, state, parts, location, study)


def _set(
    study: documents.Document, scene: documents.Document, change: str
) -> tuple[bool, documents.Keys]:
    """Make a change, such as "run.end=2", in the study or the scene; return whether the study has
    been changed, and the keys of the value."""
    location = documents.FileLocation(f"--set {change}")
    # Names in quotation marks may contain equals signs.
    named = re.match(rf"((?:{documents.QUOTED}|[^='\"])*)(=)(.*)", change, re.DOTALL)
    path, equals, text = named.groups() if named else change.partition("=")
    if not equals:
        location.refuse(change, "a path and a value", "write joints.pin.clearance=0.2mm, say")
    with location.in_errors():
        keys = documents.keys_of(path.strip())
    is_in_study = keys[0] in PARTS
    if keys[0] == "run":  # a file need not have [run], which options such as --end change too
        study.setdefault("run", {})
    # Tables within a section, such as run.settings, are added too. The reader refuses wrong names.
    section = study.get(keys[0])
    for key in keys[1:-1]:
        if not isinstance(section, dict):
            break
        section = section.setdefault(key, {})
    try:
        value = tomllib.loads(f"value = {text.strip()}")["value"]
    except tomllib.TOMLDecodeError:
        value = text.strip()  # a text without quotation marks, such as 0.2mm
    # The keys before the last one must exist and lead to the table or list that is changed. The
    # last key may be new in a table, but not in a list. `steps` are the leading keys that exist,
    # with indices of lists as integers, and `table` is where those before the last one lead.
    tables = study if is_in_study else scene
    steps, last = documents.existing(tables, keys), len(keys) - 1
    table: PyTree = reduce(getitem, steps[:last], tables)  # pyright: ignore
    if len(steps) == last and isinstance(table, dict):
        steps = (*steps, keys[last])
    if len(steps) < len(keys):
        key, parent = keys[len(steps)], documents.written(steps) or "the top"
        names = list(table) if isinstance(table, dict) else []
        otherwise = f"add a section [{key}] to the file" if table is study else "see the file"
        location.refuse(
            key, f"one of {documents.listed(names)} at {parent}", nearest(key, names, otherwise)
        )
    table[steps[last]] = value
    return is_in_study, steps

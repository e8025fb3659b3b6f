"""Read study files and scene files, with the changes that the command line makes."""

import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, replace
from functools import reduce
from operator import getitem
from pathlib import Path
from typing import TypeAlias

from jaxtyping import PyTree

from ..fields.checks import require
from ..fields.suggestions import nearest
from ..model.bodies import State
from ..model.scene import Scene
from ..quantities.base import AbstractQuantity
from ..scene_files.files import scene_of_document
from ..scene_files.formats import Document, read_document
from ..scene_files.locations import FileLocation, Keys, existing, keys_of, listed, written
from ..scene_files.reading import Reader
from ..simulation.reductions.base import AbstractReduction
from ..simulation.run.sections import Section
from ..simulation.step import presets
from ..simulation.step.settings import Settings
from ..sweeps.outputs import ImpactTable
from .study_parts import CLASSES, StudyParts

Checkable: TypeAlias = AbstractQuantity | AbstractReduction | ImpactTable | Section
"""Parts of a study that name bodies, joints or forces of the scene."""
SCENE = "scene"
"""Key of the scene in a study file: its path, or a table."""
PARTS = tuple(part.name for part in fields(StudyParts))
"""Keys that a study file may have besides that of the scene: its title and its sections."""


@dataclass(frozen=True)
class Study:
    """A scene with its initial state, and what a study file says about runs, sweeps, fits and wear.

    - `scene`, `state`: the mechanism and its initial state.
    - `parts`: the sections of the study file.
    - `location`: the file, for messages.
    - `document`: tables of the file, as parsed, without the scene.
    """

    scene: Scene
    state: State
    parts: StudyParts
    location: FileLocation
    document: Mapping[str, object]

    @property
    def path(self) -> Path:
        """Path of the file."""
        return Path(self.location.file)

    @property
    def title(self) -> str:
        """Title of the study, or the name of its file without suffix."""
        return self.parts.title or self.path.stem

    def settings(self, section: str) -> Settings:
        """Return the settings of the integration in a section, "run", "sweep", "fit" or "wear":
        those of its preset with the changes that the section makes.

        A section [sweep] without preset and changes has the settings of [run]. The energy ledger is
        switched on if an output of the section needs it.
        """
        part = getattr(self.parts, section)
        needs_ledger = any(
            getattr(output, "needs_ledger", False)
            for output in getattr(part, "outputs", {}).values()
        )
        if section == "sweep" and part.preset is None and part.settings is None:
            section, part = "run", self.parts.run
        # `part.settings` has defaults for all settings that the section does not name; only those
        # that it names replace settings of the preset.
        table = self.document.get(section)
        given = table.get("settings", {}) if isinstance(table, dict) else {}
        changes = {key: getattr(part.settings, key) for key in given}
        if needs_ledger:
            changes["ledger"] = True
        return replace(getattr(presets, part.preset or "default"), **changes)

    def end(self, section_end: float | None = None) -> float:
        """Return the time at which runs end, s: `section_end` or, if that is None, the end in the
        section [run].

        **Raises:** `ValueError` if there is neither, and for an end that is not after the start.
        """
        end = self.parts.run.end if section_end is None else section_end
        if end is None:
            remedy = 'write end = "1 s", or pass --end 1'
            self.location.at("run").refuse(None, "an `end`", remedy)
        require(end > self.parts.run.start, "end", end, "after the start", "give it in s")
        return float(end)

    def check_elements(self, named: Mapping[str, Checkable], *keys: str) -> None:
        """Check that the scene has the bodies, joints and forces that outputs, Poincaré sections or
        quantities name.

        **Arguments:** `named`: the outputs, sections or quantities, by name; `keys`: keys of the
        table in the file that contains them.

        **Raises:** `ValueError` with the location in the file.
        """
        for name, one in named.items():
            with self.location.at(*keys, name).in_errors():
                one.check(self.scene)

    def sections(self) -> dict[str, Section]:
        """Return the Poincaré sections in the section [run], by name, for `Saving`."""
        return {
            name: Section(
                part.crossing,
                {key: (channel, channel.unit or "1") for key, channel in part.channels.items()},
                part.count,
                part.after,
            )
            for name, part in self.parts.run.sections.items()
        }


def read_study(path: Path, changes: Iterable[str] = ()) -> Study:
    """Read a study file, or a scene file as a study without sections.

    ```toml
    scene = "four_bar.toml"

    [run]
    end = "2 s"
    preset = "accurate"
    outputs.rocker = { kind = "Angle", body = "rocker", about = [0, 0, 1] }

    [sweep]
    outputs.peak = { kind = "Peak", quantity = { kind = "ContactForce", joint = "crank pin" } }

    [sweep.axes.clearance]
    path = "joints.crank pin.clearance"
    start = "0.05 mm"
    stop = "0.5 mm"
    count = 20
    ```

    **Arguments:** `changes`: changes of numbers or tables, such as "joints.pin.clearance=0.2mm" in
    the scene or "run.end=2" in the study.

    **Raises:** `ValueError` with the location, the value, the expected values and a remedy.
    """
    document, location = read_document(path)
    if "bodies" in document:  # a scene file, which may have sections of a study
        study = {key: document.pop(key) for key in PARTS if key in document}
        tables, scene_location = document, location
    elif SCENE in document:  # a table, or the path of a scene file relative to the study file
        study, tables, scene_location = document, document.pop(SCENE), location.at(SCENE)
        if not isinstance(tables, dict):
            file = path.parent / str(tables)
            if not file.is_file():
                expected = "the path of a scene file, or a table"
                scene_location.refuse(tables, expected, "correct it")
            tables, scene_location = read_document(file)
    else:
        remedy = 'a study file names one, scene = "four_bar.toml"; a scene file has [bodies.<name>]'
        location.refuse(sorted(document), "`scene` or `bodies`", remedy)
    for change in changes:
        is_in_study, keys = _set(study, tables, change)
        changed = location if is_in_study else scene_location
        if changed.source is not None:
            changed.source.changes[(*changed.keys, *keys)] = change
    scene, state = scene_of_document(tables, (), scene_location)
    parts = Reader(CLASSES).instance(StudyParts, study, location, other_keys=(SCENE,))
    return Study(scene, state, parts, location, study)


def _set(study: Document, scene: Document, change: str) -> tuple[bool, Keys]:
    """Make a change such as "run.end=2" in the tables of a study or of a scene.

    **Returns:** whether the study was changed instead of the scene, and the keys of the value.

    **Raises:** `ValueError` for a change without "=", and for unknown keys.
    """
    location = FileLocation(f"--set {change}")
    path, equals, text = change.partition("=")
    if not equals:
        location.refuse(change, "a path and a value", "write joints.pin.clearance=0.2mm, say")
    with location.in_errors():
        keys = keys_of(path.strip())
    is_in_study = keys[0] in PARTS
    if keys[0] == "run":  # the options --end and --preset work for files without this section, too
        study.setdefault("run", {})
    try:
        value = tomllib.loads(f"value = {text.strip()}")["value"]
    except tomllib.TOMLDecodeError:
        value = text.strip()  # a text without quotation marks, such as 0.2mm
    # The keys before the last one must exist and lead to the table, or list, that is changed. The
    # last key may be new in a table.
    tables = study if is_in_study else scene
    found, last = existing(tables, keys), len(keys) - 1
    table: PyTree = reduce(getitem, found[:last], tables)  # pyright: ignore
    if len(found) == last and isinstance(table, dict):
        found = (*found, keys[last])
    if len(found) < len(keys):
        key, parent = keys[len(found)], written(found) or "the top"
        known = list(table) if isinstance(table, dict) else []
        otherwise = f"add a section [{key}] to the file" if table is study else "see the file"
        location.refuse(key, f"one of {listed(known)} at {parent}", nearest(key, known, otherwise))
    table[found[last]] = value
    return is_in_study, found

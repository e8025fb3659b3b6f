"""Read study files and scene files, with the changes that the command line makes."""

import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path

from ..fields.checks import require
from ..fields.suggestions import nearest
from ..model.bodies import State
from ..model.scene import Scene
from ..scene_files.files import scene_of_document
from ..scene_files.formats import SUFFIXES, Document, read_document
from ..scene_files.locations import FileLocation, Keys, listed
from ..scene_files.reading import Reader
from ..simulation.run.sections import Section
from ..simulation.step import presets
from ..simulation.step.settings import Settings
from .paths import FoundPath, find_path, keys_of
from .study_parts import CLASSES, FitPart, RunPart, StudyParts, SweepPart

SCENE = "scene"
PARTS = tuple(part.name for part in fields(StudyParts))
PRESETS = [name for name, value in vars(presets).items() if isinstance(value, Settings)]


@dataclass(frozen=True)
class Study:
    """A scene with its initial state, and what a study file says about runs, sweeps and fits.

    - `scene`, `state`: the mechanism and its initial state.
    - `parts`: the sections of the study file.
    - `location`: the file, for messages.
    - `document`: tables of the file without the scene.
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

    def settings(self, part: RunPart | SweepPart | FitPart, section: str) -> Settings:
        """Return the settings of a section: those of its preset with the changes that it makes. A
        section [sweep] without preset and changes has the settings of [run].

        **Arguments:** `part`: content of the section; `section`: its name.

        **Raises:** `ValueError` for an unknown preset.
        """
        if section == "sweep" and part.preset is None and part.settings is None:
            return self.settings(self.parts.run, "run")
        name = part.preset or "default"
        if name not in PRESETS:
            remedy = nearest(name, PRESETS, "write one of these")
            self.location.at(section, "preset").refuse(name, f"one of {listed(PRESETS)}", remedy)
        given = _table(self.document.get(section, {})).get("settings", {})
        changes = {key: getattr(part.settings, key) for key in _table(given)}
        return replace(getattr(presets, name), **changes)

    def ledger_for(self, settings: Settings, outputs: Mapping[str, object]) -> Settings:
        """Return the settings, with the energy ledger switched on if one of the outputs needs
        it."""
        needed = any(getattr(output, "needs_ledger", False) for output in outputs.values())
        return replace(settings, ledger=True) if needed else settings

    def end(self, section_end: float | None = None) -> float:
        """Return the end of runs, s: `section_end`, or for None the end in the section [run].

        **Raises:** `ValueError` if there is neither, and for an end before the start.
        """
        end = self.parts.run.end if section_end is None else section_end
        if end is None:
            remedy = 'write end = "1 s", or pass --end 1'
            self.location.at("run").refuse(None, "an `end`", remedy)
        require(end > self.parts.run.start, "end", end, "after the start", "give it in s")
        return float(end)

    def sections(self) -> dict[str, Section]:
        """Return the Poincaré sections of the run, by name."""
        sections = {}
        for name, part in self.parts.run.sections.items():
            channels = {
                key: (channel, channel.unit or "1") for key, channel in part.channels.items()
            }
            sections[name] = Section(part.crossing, channels, part.count, part.after)
        return sections

    def find(self, texts: str | Iterable[str], location: FileLocation) -> FoundPath:
        """Find the number of the scene or of the state at a written path, see `find_path`."""
        names = texts if isinstance(texts, str) else tuple(texts)
        return find_path(names, self.scene, self.state, location)


def read_study(path: Path, settings: Iterable[str] = ()) -> Study:
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

    **Arguments:** `settings`: changes, such as "joints.pin.clearance=0.2mm" of the scene or
    "run.end=2" of the study.

    **Raises:** `ValueError` with the location, the value, the expected values and a remedy.
    """
    document, location = _document(path)
    if "bodies" in document:  # a scene file, which may have sections of a study
        known = {"title", *PARTS} & set(document)
        study = {key: document.pop(key) for key in known}
        scene_document, scene_location = document, location
    else:
        study, scene_document, scene_location = _parts_and_scene(document, location)
    for change in settings:
        in_study, keys = _set(study, scene_document, change)
        changed = location if in_study else scene_location
        if changed.source is not None:
            changed.source.changes[(*changed.keys, *keys)] = change
    scene, state = scene_of_document(scene_document, (), scene_location)
    parts = Reader(CLASSES).instance(StudyParts, study, location, other_keys=(SCENE,))
    return Study(scene, state, parts, location, study)


def _document(path: Path) -> tuple[Document, FileLocation]:
    location = FileLocation(str(path))
    if path.is_dir():
        location.refuse(path.name, "a file", "`clearjoint report` takes folders")
    if not path.exists():
        names = [other.name for other in path.parent.glob("*") if other.suffix in SUFFIXES]
        remedy = nearest(path.name, names, f"there {'is' if names else 'are'} {listed(names)}")
        location.refuse(path.name, "an existing file", remedy)
    return read_document(path)


def _parts_and_scene(
    document: Document, location: FileLocation
) -> tuple[Document, Document, FileLocation]:
    """Return the sections of a study file, and tables and location of the scene that the file
    contains or names."""
    if SCENE not in document:
        remedy = 'a study file names one, scene = "four_bar.toml"; a scene file has [bodies.<name>]'
        location.refuse(sorted(document), "`scene` or `bodies`", remedy)
    scene, study = document[SCENE], {k: v for k, v in document.items() if k != SCENE}
    if isinstance(scene, dict):
        return study, scene, location.at(SCENE)
    if not isinstance(scene, str):
        location.at(SCENE).refuse(scene, "the path of a scene file, or a table", "write one")
    return study, *_document(Path(location.file).parent / scene)


def _set(study: Document, scene: Document, change: str) -> tuple[bool, Keys]:
    """Make a change such as "run.end=2" in the tables of a study or of a scene.

    **Returns:** whether the study was changed instead of the scene, and the keys of the value.

    **Raises:** `ValueError` for a change without "=", and for unknown keys.
    """
    location = FileLocation(f"--set {change}")
    name, equals, text = change.partition("=")
    if not equals:
        location.refuse(change, "a path and a value", "write joints.pin.clearance=0.2mm, say")
    keys = keys_of(name.strip(), location)
    node: object = study if keys[0] in PARTS else scene
    for depth, key in enumerate(keys[:-1]):
        node = _entry(node, key, keys[:depth], study, location)
    try:
        value = tomllib.loads(f"value = {text.strip()}")["value"]
    except tomllib.TOMLDecodeError:
        value = text.strip()  # a text without quotation marks, such as 0.2mm
    if isinstance(node, list) and isinstance(keys[-1], int) and keys[-1] < len(node):
        node[keys[-1]] = value
    elif isinstance(node, dict):
        node[str(keys[-1])] = value
    else:
        location.refuse(node, f"a table with {keys[-1]!r}", "set the whole table or list")
    return keys[0] in PARTS, keys


def _entry(
    node: object, key: str | int, parents: Keys, study: Document, location: FileLocation
) -> object:
    """Return the entry of a table or list at `key`; a missing section [run] of the study is
    added."""
    if isinstance(node, dict):
        if node is study and key == "run":
            node.setdefault("run", {})
        if str(key) in node:
            return node[str(key)]
        otherwise = f"add a section [{key}] to the file" if node is study else "take one of these"
        remedy = nearest(str(key), node, otherwise)
        parent = ".".join(map(str, parents)) or "the top"
        location.refuse(str(key), f"one of {listed(node)} at {parent}", remedy)
    if isinstance(node, list) and isinstance(key, int) and key < len(node):
        return node[key]
    return location.refuse(str(key), "an existing key", "see the file")


def _table(content: object) -> dict:
    return content if isinstance(content, dict) else {}

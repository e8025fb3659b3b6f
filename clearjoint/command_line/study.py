"""Study files and scene files, read with all that the command line sets."""

import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path

from ..fields.checks import require
from ..fields.suggestions import nearest
from ..model.bodies import State
from ..model.scene import Scene
from ..quantities.base import AbstractQuantity
from ..scene_files.files import scene_of_document
from ..scene_files.formats import Document, read_document
from ..scene_files.locations import FileLocation, Keys, listed
from ..scene_files.reading import Reader
from ..simulation.results.channels import Channels
from ..simulation.run.sections import Section
from ..simulation.step import presets
from ..simulation.step.settings import Settings
from .paths import FoundPlace, find_place, keys_of
from .study_parts import FitPart, RunPart, StudyParts, SweepPart
from .vocabulary import CLASSES

SCENE = "scene"
PARTS = tuple(part.name for part in fields(StudyParts))
PRESETS = [name for name, value in vars(presets).items() if isinstance(value, Settings)]


@dataclass(frozen=True)
class Study:
    """A scene, its first state, and what is to be done with them.

    - `place`: of the file, for messages; `document`: its tables, without the scene's.
    """

    scene: Scene
    state: State
    parts: StudyParts
    place: FileLocation
    document: Mapping[str, object]

    @property
    def path(self) -> Path:
        """The file."""
        return Path(self.place.file)

    @property
    def title(self) -> str:
        """What the study is called."""
        return self.parts.title or self.path.stem

    def settings(self, part: RunPart | SweepPart | FitPart, section: str) -> Settings:
        """The settings of a section: a preset, with what the section sets itself; a sweep has those
        of the run unless it gives its own."""
        inherits = section == "sweep" and part.preset is None and part.settings is None
        if inherits:
            return self.settings(self.parts.run, "run")
        name, place = part.preset or "default", self.place.at(section)
        if name not in PRESETS:
            remedy = nearest(name, PRESETS, "write one of these")
            place.at("preset").refuse(name, f"one of {listed(PRESETS)}", remedy)
        given = _table(self.document.get(section, {})).get("settings", {})
        changed = {key: getattr(part.settings, key) for key in _table(given)}
        return replace(getattr(presets, name), **changed)

    def ledger_for(self, settings: Settings, outputs: Mapping[str, object]) -> Settings:
        """The settings, which keep the energy ledger if one of the outputs needs it."""
        needed = any(getattr(output, "needs_ledger", False) for output in outputs.values())
        return replace(settings, ledger=True) if needed else settings

    def end(self, own: float | None = None) -> float:
        """The end of runs, s: a section's own, or that of the run.

        **Raises:** `ValueError` if no end is given.
        """
        end = self.parts.run.end if own is None else own
        if end is None:
            self.place.at("run").refuse(None, "an `end`", 'write end = "1 s", or pass --end 1')
        require(end > self.parts.run.start, "end", end, "after the start", "give it in s")
        return float(end)

    def sections(self) -> dict[str, Section]:
        """The Poincaré sections of the run, by name."""
        return {
            name: Section(one.crossing, _channels(one.channels), one.count, one.after)
            for name, one in self.parts.run.sections.items()
        }

    def find(self, texts: str | Iterable[str], where: FileLocation) -> FoundPlace:
        """The place in the scene, or its state, that a section names."""
        names = texts if isinstance(texts, str) else tuple(texts)
        return find_place(names, self.scene, self.state, where)


def read_study(path: Path, settings: Iterable[str] = ()) -> Study:
    """Read a study file, or a scene file, of which a study is made.

    ```toml
    scene = "four_bar.toml"

    [run]
    end = "2 s"
    preset = "accurate"
    outputs.rocker = { kind = "Angle", body = "rocker", about = [0, 0, 1] }

    [sweep]
    outputs.peak = { kind = "Peak", quantity = { kind = "ContactForce", joint = "crank pin" } }

    [sweep.axes.clearance]
    place = "joints.crank pin.clearance"
    start = "0.05 mm"
    stop = "0.5 mm"
    count = 20
    ```

    **Arguments:** `settings`: changes of the file, such as "joints.pin.clearance=0.2mm" of the
    scene, or "run.end=2" of the study.

    **Raises:** `ValueError` with file, place, what was found and expected, and a remedy.
    """
    document, place = _document(path)
    if "bodies" in document:
        known = {"title", *PARTS} & set(document)
        study = {key: document.pop(key) for key in known}
        scene_document, scene_place = document, place
    else:
        study, scene_document, scene_place = _parts_and_scene(document, place)
    for change in settings:
        in_study, keys = _set(study, scene_document, change)
        where = place if in_study else scene_place
        if where.source is not None:
            where.source.changes[(*where.keys, *keys)] = change
    scene, state = scene_of_document(scene_document, (), scene_place)
    completed = _with_units(study)
    parts = Reader(CLASSES).instance(StudyParts, completed, place, beside=(SCENE,))
    return Study(scene, state, parts, place, completed)


def _channels(quantities: Mapping[str, AbstractQuantity]) -> Channels:
    return {name: (one, one.unit or "1") for name, one in quantities.items()}


def _document(path: Path) -> tuple[Document, FileLocation]:
    if path.is_dir():
        FileLocation(str(path)).refuse(path.name, "a file", "`clearjoint report` takes folders")
    if not path.exists():
        beside = [one.name for one in path.parent.glob("*") if one.suffix in (".toml", ".json")]
        remedy = nearest(path.name, beside, f"there {'is' if beside else 'are'} {listed(beside)}")
        FileLocation(str(path)).refuse(path.name, "a file that is there", remedy)
    return read_document(path)


def _parts_and_scene(
    document: Document, place: FileLocation
) -> tuple[Document, Document, FileLocation]:
    """The sections of a study file, and the scene that it names or holds."""
    if SCENE not in document:
        remedy = 'a study file names one, scene = "four_bar.toml"; a scene file has [bodies.<name>]'
        place.refuse(sorted(document), "`scene` or `bodies`", remedy)
    found, study = document[SCENE], {k: v for k, v in document.items() if k != SCENE}
    if isinstance(found, dict):
        return study, found, place.at(SCENE)
    if not isinstance(found, str):
        place.at(SCENE).refuse(found, "the path of a scene file, or a table", "write one")
    return study, *_document(Path(place.file).parent / found)


def _set(study: Document, scene: Document, change: str) -> tuple[bool, Keys]:
    """Set what stands at a place of a file's tables: whether it is the study's, and its keys."""
    place = FileLocation(f"--set {change}")
    name, equals, text = change.partition("=")
    if not equals:
        place.refuse(change, "a place and a value", "write joints.pin.clearance=0.2mm, say")
    keys = keys_of(name.strip(), place)
    here: object = study if keys[0] in PARTS else scene
    for depth, key in enumerate(keys[:-1]):
        here = _entry(here, key, keys[:depth], study, place)
    if isinstance(here, list) and isinstance(keys[-1], int) and keys[-1] < len(here):
        here[keys[-1]] = _value(text.strip())
    elif isinstance(here, dict):
        here[str(keys[-1])] = _value(text.strip())
    else:
        place.refuse(here, f"a table with {keys[-1]!r}", "set the whole table or list")
    return keys[0] in PARTS, keys


def _entry(
    here: object,
    key: str | int,
    before: tuple[str | int, ...],
    study: Document,
    place: FileLocation,
) -> object:
    """What stands under a key; a table of the study that is not there is added."""
    if isinstance(here, dict):
        if here is study and key == "run":
            here.setdefault("run", {})
        if str(key) in here:
            return here[str(key)]
        otherwise = f"add a section [{key}] to the file" if here is study else "take one of these"
        remedy = nearest(str(key), here, otherwise)
        so_far = ".".join(map(str, before)) or "the top"
        place.refuse(str(key), f"one of {listed(here)} at {so_far}", remedy)
    if isinstance(here, list) and isinstance(key, int) and key < len(here):
        return here[key]
    return place.refuse(str(key), "a key that is there", "see the file")


def _value(text: str) -> object:
    """A value as TOML writes it; any other text as such."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text


def _with_units(study: Document) -> Document:
    """The tables, in which reductions that name no unit have that of their quantity."""
    units = {kind.__name__: getattr(kind, "unit", None) for kind in CLASSES}
    for section in ("run", "sweep"):
        outputs = _table(study.get(section, {})).get("outputs", {})
        completed = {}
        for name, output in _table(outputs).items():
            quantity = output.get("quantity") if isinstance(output, dict) else None
            unit = units.get(quantity.get("kind", "")) if isinstance(quantity, dict) else None
            completed[name] = output if unit is None else {"unit": unit, **output}
        if completed:
            study = {**study, section: {**_table(study[section]), "outputs": completed}}
    return study


def _table(found: object) -> dict:
    return found if isinstance(found, dict) else {}

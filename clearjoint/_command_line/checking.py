"""The commands `clearjoint new` and `clearjoint check`."""

from collections.abc import Callable, Iterator
from pathlib import Path
from string import Template
from tempfile import TemporaryDirectory

import numpy as np

from .._dynamics.assembly import ACCEPTED_VIOLATION
from .._dynamics.constraint_report import ConstraintReport, constraint_report
from .._dynamics.journals import depths
from .._fields.cautions import quiet
from .._fields.checks import as_shown
from .._model.bodies import State
from .._model.clearance_joints.journal_bases import HasJournal
from .._model.contact.laws import whole_law
from .._model.mechanisms.double_pendulum import double_pendulum
from .._model.mechanisms.four_bars import four_bar
from .._model.mechanisms.slider_cranks import slider_crank
from .._model.scene import Scene
from .._parametrisation.paths import parameters
from .._scene_files.documents import FileLocation, keys_of, written
from .._scene_files.files import save
from .._simulation.run.run_checks import check_start
from .study import Study


def description(study: Study) -> Iterator[str]:
    """Yield the lines of text in which `clearjoint check` describes a study.

    **Raises:** `ValueError`, after the lines about the scene, if the scene can't run from its
    state, and for wrong entries of a section.
    """
    scene, state, start = study.scene, study.state, study.parts.run.start
    report = constraint_report(scene, state, start)
    # The lines about the scene come first, so that they are printed even if a check below raises an
    # error, whose cause they may show.
    yield from _elements(scene, report)
    yield from _contacts(scene, state)
    _require_satisfied(report)
    check_start(scene, state, start, study.settings("run").coordinates)
    yield from _sections(study)
    yield "ready to run"


def number_paths(study: Study) -> list[str]:
    """Return a line for each number of the scene and the state: path, value and unit."""
    numbers = {
        written((*prefix, *keys_of(name))): number
        for prefix, tree in (((), study.scene), (("state",), study.state))
        for name, number in parameters(tree).items()
    }
    width = max(map(len, numbers))
    return [
        f"{path:{width}}  {as_shown(np.asarray(value))} {'' if unit == '1' else unit}"
        for path, (value, unit) in numbers.items()
    ]


def _elements(scene: Scene, report: ConstraintReport) -> Iterator[str]:
    bodies = ", ".join(f"{n} ({float(np.asarray(b.mass)):g} kg)" for n, b in scene.bodies.items())
    yield f"bodies: {bodies}"
    for title, family in (("joints", scene.joints), ("forces", scene.forces)):
        if family:
            kinds = [f"{name} ({type(element).__name__})" for name, element in family.items()]
            yield f"{title}: {', '.join(kinds)}"
    gravity = "none" if scene.gravity is None else f"{as_shown(np.asarray(scene.gravity))} m/s^2"
    yield f"gravity: {gravity}"
    independent = len(report.names) - len(report.redundant)
    difference = f"{6 * len(scene.bodies)} of the bodies - {independent} constraints"
    yield f"degrees of freedom: {report.degrees_of_freedom()} ({difference})"
    yield f"redundant constraints: {', '.join(report.redundant) or 'none'}"
    if report.names:
        error, rate = np.abs(report.values).max(), np.abs(report.rates).max()
        yield f"largest constraint error: {error:.2g} m or rad, rate {rate:.2g} m/s or rad/s"


def _contacts(scene: Scene, state: State) -> Iterator[str]:
    with quiet():  # warnings of the scene's numbers were issued when the scene was read
        by_joint = depths(scene, state)
    for name, family in by_joint.items():
        joint = scene.contact_joints()[name]
        laws = ", ".join(sorted({type(whole_law(law)).__name__ for law in joint.laws().values()}))
        play = f"clearance {_length(joint.clearance)}, " if isinstance(joint, HasJournal) else ""
        gaps = ", ".join(
            f"{label} {_length(abs(depth))} {'deep' if depth > 0.0 else 'apart'}"
            for label, depth in family.items()
        )
        yield f"contacts of {name}: {play}{laws}; at the start {gaps}"


def _length(value: object) -> str:
    metres = float(np.asarray(value))
    return f"{metres * 1e3:.4g} mm" if abs(metres) >= 1e-4 else f"{metres * 1e6:.4g} µm"


def _require_satisfied(report: ConstraintReport) -> None:
    sizes = np.maximum(np.abs(report.values), np.abs(report.rates)).reshape(-1)
    # The message has at most the three largest errors.
    worst = [k for k in np.argsort(-sizes)[:3] if sizes[k] > ACCEPTED_VIOLATION]
    if worst:
        rows = ", ".join(f"{report.names[k]} ({sizes[k]:.2g})" for k in worst)
        remedy = "`clearjoint check FILE --assemble NEW.toml` writes a file with an assembled state"
        raise ValueError(f"the state does not satisfy the joints: {rows}. {remedy}.")


def _sections(study: Study) -> Iterator[str]:
    run, fit = study.parts.run, study.parts.fit
    study.check_elements(run.sections, "run", "sections")
    study.check_elements(run.outputs, "run", "outputs")
    # What a section needs is imported only if there is one: importing takes longer than checking.
    if run.end is not None:
        run.saved_times(study.end())  # raises an error for wrong times
        yield f"run: {run.start:g} s to {study.end():g} s"
    if (sweep := study.parts.sweep) is not None:
        from .sweeping import shape_of_lanes, sweep_axes

        axes = sweep_axes(study, sweep)
        # If neither section has an end, the command line must give it, and nothing is checked.
        if sweep.end is not None or run.end is not None:
            study.end(sweep.end)
        lanes = "x".join(map(str, shape_of_lanes(axes, sweep)))
        yield f"sweep: {lanes} lanes over {', '.join(axes)}"
    if fit is not None:
        from .fitting import fit_parameters

        fit_parameters(study, fit)  # raises an error for an unknown path
        quantities = {name: column.quantity for name, column in fit.columns.items()}
        study.check_elements(quantities, "fit", "columns")
        yield f"fit: {', '.join(fit.parameters)} from {fit.measurements}"
    if (wear := study.parts.wear) is not None:
        from .wearing import check_wear_section

        check_wear_section(study, wear)
        cycles = "cycles" if wear.cycles == np.inf else f"{wear.cycles:g} cycles"
        end = "" if wear.depth is None else f", to a depth of {_length(wear.depth)}"
        yield f"wear: {', '.join(wear.rates)} over {cycles} of {wear.cycle:g} s{end}"


TEMPLATES = [Path(__file__).parent / "templates" / name for name in ("scene.toml", "study.toml")]
"""Comments at the head of a scene file, and a study file, with placeholders ``$joint``."""
MECHANISMS: dict[str, Callable[[], tuple[Scene, State]]] = {
    "double_pendulum": double_pendulum,
    "four_bar": lambda: four_bar({"crank pin": 0.1e-3}, speed=30.0),
    "slider_crank": lambda: slider_crank(0.1e-3),
}
PLACEHOLDERS = {
    "double_pendulum": ("shoulder", "arm 2", "50 ms", "0.05 ms", "10 ms", "1 s"),
    "four_bar": ("crank pin", "coupler", "200 ms", "0.2 ms", "20 ms", "209.43951 ms"),
    "slider_crank": ("slider pin", "slider", "24 ms", "0.02 ms", "12 ms", "12 ms"),
}
"""Texts in place of ``$joint`` and so on, by mechanism: joint, body, end of the run, time between
saved states, end of the transient, and duration of a cycle."""


def example_texts(mechanism: str, scene: str, study: str) -> tuple[str, str]:
    """Return the texts of an example of a scene file and of a study file for one of `MECHANISMS`.
    `scene`, `study`: names of these files, which comments in the texts mention."""
    with TemporaryDirectory() as folder:  # `save` writes a file, of which the text is needed
        path = Path(folder) / "scene.toml"
        save(*MECHANISMS[mechanism](), path)
        saved = path.read_text(encoding="utf-8")
    names = {"scene": scene, "study": study, "title": mechanism.replace("_", " ").capitalize()}
    keys = "joint", "body", "end", "every", "after", "cycle"
    names |= zip(keys, PLACEHOLDERS[mechanism], strict=True)
    templates = (Template(path.read_text(encoding="utf-8")) for path in TEMPLATES)
    head, text = (template.substitute(names) for template in templates)
    return head + saved, text


def write_example(mechanism: str, folder: Path) -> tuple[Path, Path]:
    """Write an example of a scene file and of a study file into a folder, and return their paths;
    if one of them exists, raise a `ValueError` and write nothing."""
    names = f"{mechanism}.toml", f"{mechanism}_study.toml"
    scene, study = folder / names[0], folder / names[1]
    folder.mkdir(parents=True, exist_ok=True)
    for path in (scene, study):  # both are checked before the first is written
        if path.exists():
            remedy = "remove it, or choose another folder by --out"
            FileLocation(str(path)).refuse("a file", "no existing file", remedy)
    for path, text in zip((scene, study), example_texts(mechanism, *names), strict=True):
        path.write_text(text, encoding="utf-8")
    return scene, study

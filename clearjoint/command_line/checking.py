"""`clearjoint check`: describe a scene, and check that it can run."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..dynamics.assembly import ACCEPTED_VIOLATION, assemble
from ..dynamics.constraint_report import ConstraintReport, constraint_report
from ..dynamics.journals import depths
from ..fields.cautions import quiet
from ..fields.checks import as_shown
from ..model.bodies import State
from ..model.clearance_joints.journal_bases import HasJournal
from ..model.scene import Scene
from ..parametrisation.paths import parameters
from ..quantities.base import check_quantity
from ..scene_files.files import FilePath, save
from ..simulation.run.run_checks import check_start
from .paths import written
from .study import Study
from .sweeping import check_output, sweep_arguments

WORST = 3
"""Number of violated constraints that a message lists."""


@dataclass(frozen=True)
class Checked:
    """Result of `clearjoint check`.

    - `lines`: lines to print.
    - `refusal`: why the scene can't run, with a remedy; None if it can.
    """

    lines: list[str]
    refusal: str | None


def checked(study: Study) -> Checked:
    """Describe a study's scene, and check its initial state and its sections [run], [sweep] and
    [fit].

    **Raises:** `ValueError` for a section that names unknown elements or paths.
    """
    scene, state = study.scene, study.state
    report = constraint_report(scene, state, study.parts.run.start)
    lines = [*_elements(scene), *_constraints(scene, report), *_contacts(scene, state)]
    refusal = _refusal(study, report)
    if refusal is None:
        lines += _sections(study)
        lines.append("ready to run")
    return Checked(lines, refusal)


def number_paths(study: Study) -> list[str]:
    """Return a line for each number of the scene and the state, with its path, value and unit."""
    rows = [(written(n), value, unit) for n, (value, unit) in parameters(study.scene).items()]
    in_state = parameters(study.state)
    rows += [(f"state.{written(n)}", value, unit) for n, (value, unit) in in_state.items()]
    width = max(len(name) for name, _, _ in rows)
    return [
        f"{name:{width}}  {as_shown(np.asarray(value))} {'' if unit == '1' else unit}"
        for name, value, unit in rows
    ]


def save_assembled(study: Study, path: FilePath) -> None:
    """Write the scene to a file, with a state that is assembled so that it satisfies the joints."""
    save(study.scene, assemble(study.scene, study.state, study.parts.run.start), path)


def _elements(scene: Scene) -> Iterator[str]:
    bodies = ", ".join(f"{n} ({float(np.asarray(b.mass)):g} kg)" for n, b in scene.bodies.items())
    yield f"bodies: {bodies}"
    for title, family in (("joints", scene.joints), ("forces", scene.forces)):
        if family:
            kinds = [f"{name} ({type(element).__name__})" for name, element in family.items()]
            yield f"{title}: {', '.join(kinds)}"
    gravity = "none" if scene.gravity is None else f"{as_shown(np.asarray(scene.gravity))} m/s^2"
    yield f"gravity: {gravity}"


def _constraints(scene: Scene, report: ConstraintReport) -> Iterator[str]:
    count = report.degrees_of_freedom()
    speeds, rows = 6 * len(scene.bodies), len(report.names)
    independent = rows - len(report.redundant)
    yield f"degrees of freedom: {count} ({speeds} of the bodies - {independent} constraints)"
    redundant = ", ".join(report.redundant)
    yield f"redundant constraints: {redundant or 'none'}"
    if len(report.names):
        error, rate = float(np.abs(report.values).max()), float(np.abs(report.rates).max())
        yield f"largest constraint error: {error:.2g}, rate {rate:.2g} 1/s"


def _contacts(scene: Scene, state: State) -> Iterator[str]:
    with quiet():
        by_joint = depths(scene, state)
    for name, family in by_joint.items():
        joint = scene.contact_joints()[name]
        laws = {type(law).__name__ for law in joint.laws().values()}
        play = f"clearance {_length(joint.clearance)}, " if isinstance(joint, HasJournal) else ""
        gaps = ", ".join(f"{label} {_distance(depth)}" for label, depth in family.items())
        yield f"contacts of {name}: {play}{', '.join(sorted(laws))}; at the start {gaps}"


def _length(value: object) -> str:
    metres = float(np.asarray(value))
    return f"{metres * 1e3:.4g} mm" if abs(metres) >= 1e-4 else f"{metres * 1e6:.4g} µm"


def _distance(depth: float) -> str:
    return f"{_length(depth)} deep" if depth > 0.0 else f"{_length(-depth)} apart"


def _refusal(study: Study, report: ConstraintReport) -> str | None:
    """Return why the scene can't run, with a remedy; ``None`` if it can."""
    scene, state, start = study.scene, study.state, study.parts.run.start
    sizes = np.maximum(np.abs(report.values), np.abs(report.rates)) if report.names else []
    if len(sizes) and max(sizes) > ACCEPTED_VIOLATION:
        order = [k for k in np.argsort(sizes)[::-1][:WORST] if sizes[k] > ACCEPTED_VIOLATION]
        rows = ", ".join(f"{report.names[k]} ({sizes[k]:.2g})" for k in order)
        remedy = "`clearjoint check FILE --assemble NEW.toml` writes a file with an assembled state"
        return f"the state does not satisfy the joints: {rows}. {remedy}."
    try:
        settings = study.settings(study.parts.run, "run")
        check_start(scene, state, start, settings.coordinates)
    except ValueError as error:
        return str(error)
    return None


def _sections(study: Study) -> Iterator[str]:
    """Yield a line for each section of the study, and check that the scene has the elements and
    numbers that the section names."""
    run = study.parts.run
    for name, output in run.outputs.items():
        location = study.location.at("run", "outputs", name)
        check_quantity(f"{location}", output, study.scene)
        check_output(name, output, study.scene, location)
    for name, section in run.sections.items():
        location = study.location.at("run", "sections", name)
        for quantity in (section.crossing, *section.channels.values()):
            check_quantity(f"{location}", quantity, study.scene)
    if run.end is not None:
        yield f"run: {run.start:g} s to {study.end():g} s"
    if study.parts.sweep is not None:
        arguments = sweep_arguments(study, study.parts.sweep)
        lanes = "x".join(str(axis.values.size) for axis in arguments.axes.values())
        yield f"sweep: {lanes} lanes over {', '.join(arguments.axes)}"
    if study.parts.fit is not None:
        fit = study.parts.fit
        for name, parameter in fit.parameters.items():
            study.find(parameter.path, study.location.at("fit", "parameters", name))
        for name, column in fit.columns.items():
            location = study.location.at("fit", "columns", name)
            check_quantity(f"{location}", column.quantity, study.scene)
        yield f"fit: {', '.join(fit.parameters)} from {fit.measurements}"

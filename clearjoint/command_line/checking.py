"""`clearjoint check`: what a scene is, and whether it can run."""

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
"""Constraints of which violations are told."""


@dataclass(frozen=True)
class Checked:
    """What was found: lines to print, and why the scene can't run, if it can't."""

    lines: list[str]
    refusal: str | None


def checked(study: Study) -> Checked:
    """Look at a study's scene, its first state, and its sections."""
    scene, state = study.scene, study.state
    report = constraint_report(scene, state, study.parts.run.start)
    lines = [*_elements(scene), *_freedom(scene, report), *_contacts(scene, state)]
    refusal = _refusal(study, report)
    if refusal is None:
        lines += _sections(study)
        lines.append("ready to run")
    return Checked(lines, refusal)


def places(study: Study) -> list[str]:
    """Each number of scene and state: its place, value and unit."""
    rows = [(written(n), value, unit) for n, (value, unit) in parameters(study.scene).items()]
    inside = parameters(study.state)
    rows += [(f"state.{written(n)}", value, unit) for n, (value, unit) in inside.items()]
    width = max(len(name) for name, _, _ in rows)
    return [f"{name:{width}}  {as_shown(np.asarray(v))} {_shown(unit)}" for name, v, unit in rows]


def save_assembled(study: Study, path: FilePath) -> None:
    """Write the scene with a state that satisfies its joints."""
    save(study.scene, assemble(study.scene, study.state, study.parts.run.start), path)


def _shown(unit: str) -> str:
    return "" if unit == "1" else unit


def _elements(scene: Scene) -> Iterator[str]:
    bodies = ", ".join(f"{n} ({float(np.asarray(b.mass)):g} kg)" for n, b in scene.bodies.items())
    yield f"bodies: {bodies}"
    for title, family in (("joints", scene.joints), ("forces", scene.forces)):
        if family:
            kinds = [f"{name} ({type(one).__name__})" for name, one in family.items()]
            yield f"{title}: {', '.join(kinds)}"
    gravity = "none" if scene.gravity is None else f"{as_shown(np.asarray(scene.gravity))} m/s^2"
    yield f"gravity: {gravity}"


def _freedom(scene: Scene, report: ConstraintReport) -> Iterator[str]:
    free = report.degrees_of_freedom()
    speeds, rows = 6 * len(scene.bodies), len(report.names)
    yield f"degrees of freedom: {free}, {speeds} of the bodies less {rows - len(report.redundant)}"
    redundant = ", ".join(report.redundant)
    yield f"redundant constraints: {redundant or 'none'}"
    if len(report.names):
        worst = float(np.abs(report.values).max()), float(np.abs(report.rates).max())
        yield f"largest constraint error: {worst[0]:.2g}, rate {worst[1]:.2g} 1/s"


def _contacts(scene: Scene, state: State) -> Iterator[str]:
    with quiet():
        found = depths(scene, state)
    for name, family in found.items():
        joint = scene.contact_joints()[name]
        laws = {type(law).__name__ for law in joint.laws().values()}
        play = f"clearance {_length(joint.clearance)}, " if isinstance(joint, HasJournal) else ""
        gaps = ", ".join(f"{label} {_distance(depth)}" for label, depth in family.items())
        yield f"contacts of {name}: {play}{', '.join(sorted(laws))}; at the start {gaps}"


def _length(value: object) -> str:
    metres = float(np.asarray(value))
    return f"{metres * 1e3:.4g} mm" if abs(metres) >= 1e-4 else f"{metres * 1e6:.4g} µm"


def _distance(depth: float) -> str:
    return f"{_length(depth)} deep" if depth > 0.0 else f"{_length(-depth)} open"


def _refusal(study: Study, report: ConstraintReport) -> str | None:
    """Why no run can begin there, with the remedy."""
    scene, state, start = study.scene, study.state, study.parts.run.start
    sizes = np.maximum(np.abs(report.values), np.abs(report.rates)) if report.names else []
    if len(sizes) and max(sizes) > ACCEPTED_VIOLATION:
        order = [k for k in np.argsort(sizes)[::-1][:WORST] if sizes[k] > ACCEPTED_VIOLATION]
        rows = ", ".join(f"{report.names[k]} ({sizes[k]:.2g})" for k in order)
        remedy = "`clearjoint check FILE --assemble NEW.toml` writes a file with a state that does"
        return f"the state does not satisfy the joints: {rows}. {remedy}."
    try:
        settings = study.settings(study.parts.run, "run")
        check_start(scene, state, start, settings.coordinates)
    except ValueError as error:
        return str(error)
    return None


def _sections(study: Study) -> Iterator[str]:
    """What the study is to do; what it names is looked up in the scene."""
    run = study.parts.run
    for name, output in run.outputs.items():
        where = study.place.at("run").at("outputs").at(name)
        check_quantity(f"{where}", output, study.scene)
        check_output(name, output, study.scene, where)
    for name, section in run.sections.items():
        for one in (section.crossing, *section.channels.values()):
            check_quantity(f"{study.place.at('run').at('sections').at(name)}", one, study.scene)
    if run.end is not None:
        yield f"run: {run.start:g} s to {study.end():g} s"
    if study.parts.sweep is not None:
        arguments = sweep_arguments(study, study.parts.sweep)
        lanes = "x".join(str(axis.values.size) for axis in arguments.axes.values())
        yield f"sweep: {lanes} lanes over {', '.join(arguments.axes)}"
    if study.parts.fit is not None:
        fit = study.parts.fit
        for name, parameter in fit.parameters.items():
            study.find(parameter.place, study.place.at("fit").at("parameters").at(name))
        for name, column in fit.columns.items():
            where = study.place.at("fit").at("columns").at(name)
            check_quantity(f"{where}", column.quantity, study.scene)
        yield f"fit: {', '.join(fit.parameters)} from {fit.measurements}"

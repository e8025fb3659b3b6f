"""`clearjoint fit-robot`: fit a robot's joints to its log."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

from jaxtyping import PyTree

from .._identification.identify import FitInterrupted
from .._identification.levenberg_marquardt import Ending
from .._measurements.readers import Missing
from .._measurements.robot_logs import LogColumn, RobotLog
from .._model.drives.drivers import Motor
from .._model.drives.servo import Servo
from .._robot_fits.fit_robot import fit_robot
from .._robot_fits.problem import DrivenBy, Mode
from .._scene_files.classes import Expectation
from .._scene_files.documents import FileLocation, read_document
from .._scene_files.drive_train import Drive
from .._scene_files.reading import Reader
from .._scene_files.robot import Robot, load_robot
from .._scene_files.schema import Catalogue, Schema
from .endings import FAILED, INTERRUPTED, WELL, CommandResult, say
from .fitting import REPORT, iteration_line, write_fit
from .folders import write_summary, write_table
from .study import CLASSES, AbstractStudy

SERVO = Expectation(classes=(Servo, Motor))
TEMPLATE = Path(__file__).parent / "templates" / "robot_fit.toml"


@dataclass(frozen=True)
class RobotFitParts:
    """The file of the fit of a robot.

    - `find`: what to find of each joint, a list such as ["play", "friction"], or a table with
      starts. `driven_by`: how each joint is driven, a mode of `clearjoint.fit_robot`, or a servo as
      the table of a `Servo` or `Motor`, by default with the bodies and axis of the joint's motor.
    - `angles`, `torques`, `goals` (positions to which servos move): columns of the log by joint,
      "name [unit]" or the table of a `LogColumn`; `time`: column of the times. `header`: whether
      the log's first row has the columns' names; if not, columns are named by their numbers.
      `missing`: "drop" or "refuse" for samples that are not finite; `largest_gap`: longest time
      between samples, s, by default ten times the median.
    - `start`, `end`: part of the log that is used, s.
    - `drives`: drive trains by joint, see `clearjoint.Drive`; `play`: arguments of the clearance
      joints in place of the robot's joints, by joint, see `clearjoint.load_robot`.
    - `grow`: ends, s, of parts of the log that are fitted first; `max_iterations`: of the fit.
    """

    find: Mapping[str, Mapping[str, float | str] | Sequence[str]]
    driven_by: Mapping[str, Mode | Mapping[str, Any]]
    angles: Mapping[str, LogColumn | str]
    torques: Mapping[str, LogColumn | str] = field(default_factory=dict)
    goals: Mapping[str, LogColumn | str] = field(default_factory=dict)
    time: str = "t"
    header: bool = True
    missing: Missing = "refuse"
    largest_gap: Annotated[float | None, "s"] = None
    start: Annotated[float | None, "s"] = None
    end: Annotated[float | None, "s"] = None
    drives: Mapping[str, Drive] = field(default_factory=dict)
    play: Mapping[str, Mapping[str, float | str]] = field(default_factory=dict)
    grow: Sequence[Annotated[float, "s"]] | None = None
    max_iterations: int = 100
    title: str = ""


def robot_fit_schema() -> Schema:
    catalogue = Catalogue(CLASSES)
    properties = catalogue.properties(RobotFitParts)
    return catalogue.document("robot fit", properties, ["find", "driven_by", "angles"])


@dataclass(frozen=True)
class RobotFitStudy(AbstractStudy):
    robot: Robot
    log: RobotLog
    driven_by: DrivenBy
    parts: RobotFitParts
    location: FileLocation
    started: float = field(default_factory=time.perf_counter)


def read_robot_fit(robot_file: Path, log_file: Path, path: Path) -> RobotFitStudy:
    document, location = read_document(path)
    reader = Reader(CLASSES)
    parts: RobotFitParts = reader.instance(RobotFitParts, document, location)
    robot = load_robot(robot_file, play=parts.play)
    for joint, drive in parts.drives.items():
        with location.at("drives", joint).in_errors():
            robot = robot.with_drive(joint, drive)
    written: PyTree = document["driven_by"]
    driven_by: dict[str, PyTree] = dict(written)
    for joint, mode in written.items():
        if isinstance(mode, Mapping):  # the table of a servo, which may leave out where it acts
            with location.at("driven_by", joint).in_errors():
                first, second, axis = robot.motor_side(joint)
            table = {"first": first, "second": second, "axis": axis.tolist(), **mode}
            driven_by[joint] = reader.value(table, SERVO, location.at("driven_by", joint))
    is_parquet = log_file.suffix.lower() == ".parquet"  # its columns always have names
    options: dict[str, PyTree] = {} if parts.header or is_parquet else {"header": None}
    with location.in_errors():
        log = RobotLog.read(
            log_file,
            time=parts.time,
            angles=parts.angles,
            torques=parts.torques,
            goals=parts.goals,
            missing=parts.missing,
            largest_gap=parts.largest_gap,
            **options,
        )
        start = log.start if parts.start is None else parts.start
        end = log.end if parts.end is None else parts.end
        return RobotFitStudy(robot, log.between(start, end), driven_by, parts, location)


def fit_robot_of(study: RobotFitStudy, folder: Path) -> CommandResult:
    """Fit a robot and write the results to a folder; after Ctrl-C nothing is written."""
    parts = study.parts
    folder.mkdir(parents=True, exist_ok=True)  # before the fit, whose results would else be lost
    try:
        with study.location.in_errors():
            result = fit_robot(
                study.robot,
                study.log,
                parts.find,
                study.driven_by,
                grow=parts.grow,
                max_iterations=parts.max_iterations,
                progress=lambda iteration: say(iteration_line(iteration, parts.max_iterations)),
            )
    except FitInterrupted:
        return CommandResult(INTERRUPTED, "interrupted", wrote=False)
    from .reports import draw_robot_fit

    fit = result.fit
    summary = write_fit(fit, folder)
    summary["not_identifiable"] = ", ".join(result.undetermined) or "none"
    # These replace files of `write_fit`, which lack the intervals and the parameters that the log
    # does not determine.
    write_table(folder, "estimates", result.to_xarray())
    (folder / REPORT).write_text(f"{result}\n", encoding="utf-8")
    write_summary(folder, "fit of a robot", study, summary)
    draw_robot_fit(folder, result)
    for sentence in result.undetermined.values():
        say(f"note: {sentence}")
    estimates = [f"{name} {fit.estimates[name]:.5g} {fit.units[name]}" for name in fit.parameters]
    line = f"{fit.ending.value}, chi squared {fit.chi_squared:.4g}, {', '.join(estimates)}"
    return CommandResult(WELL if fit.ending is Ending.CONVERGED else FAILED, line)

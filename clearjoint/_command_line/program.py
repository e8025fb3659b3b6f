"""The program `clearjoint` and its commands.

Each command imports the modules with which it computes only when it runs, so that help is fast.
"""

from collections.abc import Callable
from inspect import getdoc
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import click

from .endings import CommandResult, understandable

if TYPE_CHECKING:
    from .study import Study

EXITS = """
Exit codes: 0 success; 1 a run, a sweep, a fit or wear failed (results so far are written); 2 the
input is wrong; 130 interrupted by Ctrl-C (results so far are written).
"""


def command(name: str, *examples: str) -> Callable[[Callable], click.Command]:
    """Return a decorator that makes a function a command, with docstring and `examples` as help."""
    lines = "\n".join(f"  {example}" for example in examples)

    def decorate(function: Callable) -> click.Command:
        # "\b" keeps click from joining the lines of the examples.
        text = f"{getdoc(function)}\n\n\b\nExamples:\n{lines}"
        return clearjoint.command(name, help=text)(understandable()(function))

    return decorate


@click.group(
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 88}, epilog=EXITS
)
@click.version_option(package_name="clearjoint")
def clearjoint() -> None:
    """Simulate mechanisms whose joints have clearance, from scene files and study files.

    A scene file (TOML or JSON) has bodies, joints and forces. A study file names a scene file and
    defines a run, a sweep, a fit and wear. `clearjoint new four_bar` writes both, with comments.

    \b
    Examples:
      clearjoint new four_bar
      clearjoint check four_bar.toml
      clearjoint run four_bar.toml --end 2
      clearjoint sweep study.toml
      clearjoint fit study.toml
      clearjoint fit-robot arm.urdf log.csv elbow.toml
      clearjoint wear study.toml
      clearjoint report results/study/run
    """


FOLDER = click.Path(path_type=Path, file_okay=False)
FILE = click.argument("file", type=click.Path(exists=True, dir_okay=False, path_type=Path))
SET = click.option(
    "--set",
    "changes",
    multiple=True,
    metavar="PATH=VALUE",
    help="Change a number or a table of the file, for example joints.pin.clearance=0.2mm. The "
    "option may be repeated.",
)
OUT = click.option(
    "--out",
    type=FOLDER,
    help="Folder of the results; by default results/<name of the file>/<command>.",
)
END = click.option("--end", metavar="SECONDS", help="End of the run, such as 2 or 500ms.")
PRESET = click.option(
    "--preset", help="Named settings: preview, default, accurate, reference (clearjoint.presets)."
)


@command(
    "check",
    "clearjoint check four_bar.toml",
    "clearjoint check study.toml --paths",
    "clearjoint check sketch.toml --assemble four_bar.toml",
)
@FILE
@SET
@click.option("--paths", is_flag=True, help="List every number that can be set, swept or fitted.")
@click.option(
    "--assemble",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Write the scene with an assembled state, which satisfies its joints, to this file.",
)
def check(file: Path, changes: tuple[str, ...], paths: bool, assemble: Path | None) -> None:
    """Check a scene file or a study file without running it.

    The command prints bodies, joints, degrees of freedom, constraint errors, contacts and warnings
    of unusual numbers, and tells whether the scene can run. For a study file, it also checks and
    prints the run, the sweep, the fit and the wear. With --paths or --assemble, the list or the
    file is the only output.
    """
    study = _read_study(file, changes)
    from .._dynamics.assembly import assemble as assembled
    from .._scene_files.files import save
    from .checking import description, number_paths

    if assemble is not None:
        save(study.scene, assembled(study.scene, study.state, study.parts.run.start), assemble)
        click.echo(f"wrote {assemble}")
        return
    for line in number_paths(study) if paths else description(study):
        click.echo(line)


@command(
    "run",
    "clearjoint run four_bar.toml --end 2",
    "clearjoint run four_bar.toml --end 500ms --save-every 0.1ms --preset accurate",
    "clearjoint run study.toml --set joints.pin.clearance=0.2mm --out results/wide",
)
@FILE
@END
@click.option("--save-every", metavar="SECONDS", help="Time between two saved states.")
@PRESET
@SET
@OUT
def run(file: Path, changes: tuple[str, ...], out: Path | None, **options: str | None) -> None:
    """Simulate a scene and write tables, figures and a page.

    The folder of the results contains tables in netCDF and CSV files: the motion, forces of
    contacts and joints, energies, impacts, the outputs that the study names, and the crossings of
    Poincaré sections. It also contains figures, the page index.html with all results, and
    reached.toml, the scene with its final state, from which the run can be continued.
    """
    from .running import run as run_study

    _compute("run", run_study, file, changes, out, **options)


@command(
    "sweep",
    "clearjoint sweep study.toml",
    "clearjoint sweep study.toml --set sweep.axes.clearance.count=64",
)
@FILE
@END
@PRESET
@SET
@OUT
def sweep(file: Path, changes: tuple[str, ...], out: Path | None, **options: str | None) -> None:
    """Simulate a scene for many values of its numbers.

    The section [sweep] of the study names the numbers and their values. The folder of the results
    contains sweep.zarr, sweep.csv with a row for each run, figures, and the page index.html. The
    same command continues an interrupted sweep.
    """
    from .sweeping import sweep as sweep_study

    _compute("sweep", sweep_study, file, changes, out, **options)


@command("fit", "clearjoint fit study.toml", "clearjoint fit study.toml --out results/second")
@FILE
@SET
@OUT
def fit(file: Path, changes: tuple[str, ...], out: Path | None) -> None:
    """Estimate numbers of a scene from measurements.

    The study's section [fit] names the CSV file of measurements, its columns and the parameters.
    The folder of results has report.txt, estimates.csv with errors and correlations, the fitted
    series, figures, the page index.html, and fitted.toml, the scene with the estimates.
    """
    from .fitting import fit as fit_study

    _compute("fit", fit_study, file, changes, out)


@command(
    "fit-robot",
    "clearjoint fit-robot arm.urdf log.csv elbow.toml",
    "clearjoint schema robot-fit --example > elbow.toml",
)
@click.argument("robot", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.argument("log", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@FILE
@OUT
def fit_robot(robot: Path, log: Path, file: Path, out: Path | None) -> None:
    """Estimate play, friction and inertia of a robot's joints from a log.

    ROBOT is a URDF or MJCF file, LOG a CSV or Parquet file. FILE, TOML or JSON, names the columns
    of the log, how joints are driven, and what to find. The folder of the results contains
    report.txt, which also says what the log cannot determine and why, estimates.csv with 95 %
    intervals, the fitted series, figures, among them the torque of each joint over its position,
    the page index.html, and fitted.toml, the scene with the estimates.
    """
    _prepare()
    from .robot_fitting import fit_robot_of, read_robot_fit

    folder = out or Path("results") / file.stem / "fit-robot"
    _end(fit_robot_of(read_robot_fit(robot, log, file), folder), folder)


@command(
    "wear",
    "clearjoint wear study.toml",
    'clearjoint wear study.toml --set wear.depth="20 um" --out results/deep',
)
@FILE
@PRESET
@SET
@OUT
def wear(file: Path, changes: tuple[str, ...], out: Path | None, **options: str | None) -> None:
    """Compute how joints wear over many cycles of a periodic motion.

    The section [wear] of the study names the joints with their wear rates, the duration of a cycle,
    and the number of cycles or the depth at which to end. The computation proceeds in stages of
    many cycles, and the command prints the depths before each of them. The folder of the results
    contains wear.zarr with all stages, stages.csv, profiles.csv with the worn profiles, figures,
    worn.toml, the scene with the worn profiles, and the page index.html. The same command continues
    an interrupted computation.
    """
    from .wearing import wear as wear_study

    _compute("wear", wear_study, file, changes, out, **options)


@command("report", "clearjoint report results/four_bar/run")
@click.argument("folder", type=FOLDER)
def report(folder: Path) -> None:
    """Draw the figures of a folder of results again, and write its page index.html.

    The figures of a fit stay as they are.
    """
    _prepare()
    from .folders import PAGE
    from .reports import write_report

    write_report(folder)
    click.echo(f"{folder / PAGE}")


@command(
    "schema",
    "clearjoint schema > scene.schema.json",
    "clearjoint schema study",
    "clearjoint schema study --example",
    "clearjoint schema robot-fit --example",
)
@click.argument("kind", type=click.Choice(["scene", "study", "robot-fit"]), default="scene")
@click.option("--example", is_flag=True, help="Print an example of a file instead.")
def schema(kind: str, example: bool) -> None:
    """Print the JSON Schema of scene files, study files or files of robot fits, with which editors
    complete and check them."""
    import json

    from .._scene_files.schema import scene_schema
    from .checking import example_texts
    from .study import study_schema

    if kind == "robot-fit":
        from .robot_fitting import TEMPLATE, robot_fit_schema

        text = TEMPLATE.read_text(encoding="utf-8")
        click.echo(text if example else json.dumps(robot_fit_schema(), indent=2), nl=not example)
    elif example:
        texts = example_texts("four_bar", "four_bar.toml", "four_bar_study.toml")
        click.echo(texts[kind == "study"], nl=False)  # the text of the scene is the first
    else:
        click.echo(json.dumps(scene_schema() if kind == "scene" else study_schema(), indent=2))


@command("new", "clearjoint new four_bar", "clearjoint new slider_crank --out press")
@click.argument("mechanism", type=click.Choice(["double_pendulum", "four_bar", "slider_crank"]))
@click.option(
    "--out", type=FOLDER, default=".", help="Folder of the files; by default the current one."
)
def new(mechanism: str, out: Path) -> None:
    """Write an example of a scene file and of a study file, with comments."""
    from .checking import write_example

    scene, study = write_example(mechanism, out)
    click.echo(f"wrote {scene} and {study}; next: clearjoint check {study}")


def main() -> None:
    clearjoint(prog_name="clearjoint")


def _prepare() -> None:
    import jax
    import matplotlib

    from .. import _runtime as runtime

    matplotlib.use("agg")  # draws files without a screen
    if not jax.config.jax_enable_x64:  # pyright: ignore
        runtime.configure()


def _read_study(file: Path, changes: tuple[str, ...]) -> "Study":
    _prepare()
    from .study import read_study

    return read_study(file, changes)


def _compute(
    command: str,
    function: Callable[["Study", Path], CommandResult],
    file: Path,
    changes: tuple[str, ...],
    out: Path | None,
    **options: str | None,
) -> None:
    """Call the `function` of a `command` with the study in `file` and the folder `out`, by default
    results/STUDY/COMMAND, and exit. `changes`, "path=value" each, replace entries of the study;
    `options` replace entries of the section with the command's name."""
    folder = out or Path("results") / file.stem / command
    given = {name: value for name, value in options.items() if value is not None}
    # The last change of an entry counts: an option prevails over --set.
    all_changes = *changes, *(f"{command}.{name}={value}" for name, value in given.items())
    _end(function(_read_study(file, all_changes), folder), folder)


def _end(result: CommandResult, folder: Path) -> NoReturn:
    """Write the page of results in a folder, print the line of `result`, and exit with its code."""
    from .folders import PAGE
    from .reports import write_report

    if result.wrote:
        write_report(folder, result.dataset)
    click.echo(f"{result.line}: {folder / PAGE if result.wrote else 'nothing was written'}")
    raise click.exceptions.Exit(result.code)

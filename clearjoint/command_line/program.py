"""The program `clearjoint` and its commands.

By click: one small package of no dependencies, whose help, messages and exit codes are what people
know from other programs. Commands import what they compute with when they run, so that help comes
without.
"""

from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, ParamSpec

import click

from .. import runtime
from .endings import CommandResult, end, shows_progress, understandable

if TYPE_CHECKING:
    from .study import Study

Options = ParamSpec("Options")
WIDTH = 88
EXITS = """
Exit codes: 0 all went well; 1 a run, a sweep or a fit failed (what was reached is kept); 2 the
input is wrong; 130 it was interrupted by Ctrl-C (what was computed is kept).
"""


def examples(*lines: str) -> str:
    """Examples for the help, as they are typed."""
    return "\b\nExamples:\n" + "\n".join(f"  {line}" for line in lines)


def command(name: str, *lines: str) -> Callable[[Callable], click.Command]:
    """A command of the program, with examples in its help."""

    def made(function: Callable) -> click.Command:
        text = f"{function.__doc__}\n\n{examples(*lines)}"
        return clearjoint.command(name, help=text)(_guarded(function))

    return made


def _guarded(function: Callable[Options, None]) -> Callable[Options, None]:
    """The function, whose errors are told as sentences."""

    @wraps(function)
    def call(*arguments: Options.args, **options: Options.kwargs) -> None:
        with understandable():
            function(*arguments, **options)

    return call


@click.group(
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": WIDTH},
    epilog=EXITS,
)
@click.version_option(package_name="clearjoint")
def clearjoint() -> None:
    """Simulate mechanisms whose joints have clearance, from scene files and study files.

    A scene file (TOML or JSON) holds bodies, joints and forces; a study file names one and says
    what to run, sweep and fit. `clearjoint new four_bar` writes both, with comments.

    \b
    Examples:
      clearjoint new four_bar
      clearjoint check four_bar.toml
      clearjoint run four_bar.toml --end 2
      clearjoint sweep study.toml
      clearjoint fit study.toml
      clearjoint report results/study/run
    """


FILE = click.argument("file", type=click.Path(path_type=Path))
SET = click.option(
    "--set",
    "changes",
    multiple=True,
    metavar="PLACE=VALUE",
    help="Change a number or table of the file: joints.pin.clearance=0.2mm. Repeatable.",
)
OUT = click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder of the results; results/<name of the file>/<command> unless given.",
)
END = click.option("--end", metavar="SECONDS", help="End of the run, such as 2 or 500ms.")
PRESET = click.option(
    "--preset", help="Named settings: preview, default, accurate, reference (clearjoint.presets)."
)


@command(
    "check",
    "clearjoint check four_bar.toml",
    "clearjoint check study.toml --places",
    "clearjoint check sketch.toml --assemble four_bar.toml",
)
@FILE
@SET
@click.option("--places", is_flag=True, help="List every number that can be set, swept or fitted.")
@click.option(
    "--assemble",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Write the scene with a state that satisfies its joints to this file.",
)
def check(file: Path, changes: tuple[str, ...], places: bool, assemble: Path | None) -> None:
    """Look at a file without running it.

    Tells bodies, joints, degrees of freedom, constraint errors, contacts and unusual numbers, and
    whether the scene can run; of a study file, also what it would run, sweep and fit.
    """
    study = _study(file, changes)
    from . import checking

    if places:
        click.echo("\n".join(checking.places(study)))
        return
    if assemble is not None:
        checking.save_assembled(study, assemble)
        click.echo(f"wrote {assemble}")
        return
    found = checking.checked(study)
    click.echo("\n".join(found.lines))
    if found.refusal is not None:
        raise ValueError(found.refusal)


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
def run(
    file: Path,
    end: str | None,
    save_every: str | None,
    preset: str | None,
    changes: tuple[str, ...],
    out: Path | None,
) -> None:
    """Simulate a scene and write tables, figures and a page.

    The folder holds netCDF and CSV files (motion, what is observed of contacts, joints and
    energies, impacts, outputs and sections of the study), figures, index.html with all of it, and
    reached.toml, from which a run can be continued.
    """
    options = {"end": end, "save_every": save_every, "preset": preset}
    given = [f"run.{name}={value}" for name, value in options.items() if value is not None]
    study = _study(file, (*changes, *given))
    from .running import run as run_study

    folder = _folder(file, out, "run")
    _ended(run_study(study, folder, shows_progress()), folder)


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
def sweep(
    file: Path, end: str | None, preset: str | None, changes: tuple[str, ...], out: Path | None
) -> None:
    """Simulate a scene for many values of its numbers.

    The study's [sweep] says which. The folder holds sweep.zarr, which the same command completes
    where it was stopped, sweep.csv with a row for each lane, figures and index.html.
    """
    options = {"end": end, "preset": preset}
    given = [f"sweep.{name}={value}" for name, value in options.items() if value is not None]
    study = _study(file, (*changes, *given))
    from .sweeping import sweep as sweep_study

    folder = _folder(file, out, "sweep")
    _ended(sweep_study(study, folder, shows_progress()), folder)


@command("fit", "clearjoint fit study.toml", "clearjoint fit study.toml --out results/second")
@FILE
@SET
@OUT
def fit(file: Path, changes: tuple[str, ...], out: Path | None) -> None:
    """Estimate numbers of a scene from measurements.

    The study's [fit] names the CSV file, its columns and the parameters. The folder holds
    report.txt, estimates.csv with errors and correlations, the fitted series, figures, index.html,
    and fitted.toml, the scene with the estimates.
    """
    study = _study(file, changes)
    from .fitting import fit as fit_study

    folder = _folder(file, out, "fit")
    _ended(fit_study(study, folder), folder)


@command("report", "clearjoint report results/four_bar/run")
@click.argument("folder", type=click.Path(path_type=Path))
def report(folder: Path) -> None:
    """Draw the figures of a folder of results anew and write its page."""
    _prepare()
    from .folders import PAGE, Folder
    from .reports import write_report

    write_report(Folder.found(folder))
    click.echo(f"{folder / PAGE}")


@command(
    "schema",
    "clearjoint schema > scene.schema.json",
    "clearjoint schema study",
    "clearjoint schema study --example",
)
@click.argument("kind", type=click.Choice(["scene", "study"]), default="scene")
@click.option("--example", is_flag=True, help="Print a whole file with comments instead.")
def schema(kind: str, example: bool) -> None:
    """Print the JSON Schema of scene files, or of study files, for editors that complete."""
    import json

    from .examples import example_texts
    from .schemas import schema_of

    if example:
        texts = example_texts("four_bar", "four_bar.toml", "four_bar_study.toml")
        click.echo(texts[kind == "study"], nl=False)
    else:
        click.echo(json.dumps(schema_of(kind), indent=2))


@command("new", "clearjoint new four_bar", "clearjoint new slider_crank --out press")
@click.argument("mechanism")
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    default=".",
    help="Folder of the files; the present one unless given.",
)
def new(mechanism: str, out: Path) -> None:
    """Write a scene and a study with comments, to begin with.

    MECHANISM is double_pendulum, four_bar or slider_crank.
    """
    from ..fields.checks import require
    from ..fields.suggestions import nearest
    from .examples import MECHANISMS, write_example

    remedy = nearest(mechanism, MECHANISMS, "name one of these")
    known = mechanism in MECHANISMS
    require(known, "mechanism", mechanism, f"one of {', '.join(MECHANISMS)}", remedy)
    scene, study = write_example(mechanism, out)
    click.echo(f"wrote {scene} and {study}; next: clearjoint check {study}")


def main() -> None:
    """Run the program with the arguments of the command line."""
    clearjoint(prog_name="clearjoint")


def _prepare() -> None:
    """Set what speed and accuracy need, unless it is set already."""
    import jax

    if not jax.config.jax_enable_x64:  # pyright: ignore
        runtime.configure()


def _study(file: Path, changes: tuple[str, ...]) -> "Study":
    _prepare()
    from .study import read_study

    return read_study(file, changes)


def _folder(file: Path, out: Path | None, command: str) -> Path:
    return Path("results") / file.stem / command if out is None else out


def _ended(ending: CommandResult, folder: Path) -> None:
    """Print the result in a line that ends with the path of the page, and end with the code."""
    from .folders import PAGE

    page = folder / PAGE
    click.echo(f"{ending.line}: {page if page.exists() else 'nothing was written'}")
    end(ending.code)

"""`clearjoint fit`: estimate parameters from measurements."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from .._export.datasets import Labelled, labelled_dataset
from .._identification.fit import Fit
from .._identification.identify import FitInterrupted, identify
from .._identification.levenberg_marquardt import Ending, Iteration
from .._measurements.readers import Channel, read_csv
from .._measurements.series import Measurements
from .._parametrisation.parameter import Parameter
from .._scene_files.documents import FileLocation
from .._scene_files.reading import number_of_text
from .endings import FAILED, INTERRUPTED, WELL, CommandResult, say
from .folders import remove_old, write_scene, write_summary, write_table
from .study import FitPart, Study, find_path

REPORT = "report.txt"
SERIES = "series "
"""Prefix of the names of the tables of fitted series."""


def fit(study: Study, folder: Path) -> CommandResult:
    """Fit the parameters of a study's section [fit]; write estimates, fitted scene and series,
    figures and a report. After Ctrl-C, write the best fit so far, if a run had ended."""
    part = study.parts.fit
    location = study.location.at("fit")
    if part is None:
        location.refuse(None, "a section [fit]", "add [fit.parameters.<name>]")
    measured = _measured(study, part, location)
    parameters, guess = fit_parameters(study, part)
    measured.check(study.scene)  # raises an error for sensors on unknown bodies or joints
    interrupted = False
    # Before the fit: where no folder can be made, the results of a long fit would be lost.
    folder.mkdir(parents=True, exist_ok=True)

    def say_iteration(iteration: Iteration) -> None:
        # Prints values in SI units: the coordinates of an iteration are on the parameters' scales.
        pairs = zip(parameters.items(), iteration.coordinates, strict=True)
        values = [f"{name} {float(parameter.scale.value(x)):.6g}" for (name, parameter), x in pairs]
        rejected = "" if iteration.accepted else " (rejected)"
        say(f"{iteration_line(iteration, part.max_iterations)}, {', '.join(values)}{rejected}")

    try:
        result = identify(
            study.scene,
            study.state,
            measured,
            parameters,
            study.settings("fit"),
            start_time=part.start,
            guess=guess or None,
            starts=part.starts,
            grow=part.grow,
            max_iterations=part.max_iterations,
            progress=say_iteration,
        )
    except FitInterrupted as stopped:
        if not stopped.fits:
            line = "interrupted before the first run ended"
            return CommandResult(INTERRUPTED, line, wrote=False)
        # `stopped.fits` contains the finished fits, if there were several starts, and, last, the
        # best result so far of the fit that was interrupted.
        interrupted, result = True, stopped.fits[-1]
    # Imported here, because it takes long and `clearjoint check` does not need it.
    from .reports import draw_fit

    summary = write_fit(result, folder) | ({"ended": "interrupted"} if interrupted else {})
    write_summary(folder, "fit", study, summary)
    draw_fit(folder, result)
    if interrupted:
        line = f"interrupted; the best fit so far is in {folder / REPORT}"
        return CommandResult(INTERRUPTED, line)
    converged = result.ending is Ending.CONVERGED
    if not converged:
        say(f"error: the fit did not converge: {result.ending.value}")
    estimates = [f"{name} {result.estimates[name]:.5g}" for name in result.parameters]
    line = f"{result.ending.value}, chi squared {result.chi_squared:.4g}, {', '.join(estimates)}"
    return CommandResult(WELL if converged else FAILED, line)


def _measured(study: Study, part: FitPart, location: FileLocation) -> Measurements:
    path = study.path.parent / part.measurements
    if not path.exists():
        location.at("measurements").refuse(part.measurements, "a CSV file", f"there is no {path}")
    # A noise given as a text, such as "2 um", is converted below, when the unit of its series is
    # known. Until then, 1.0 stands for it.
    texts = {name: c.noise for name, c in part.columns.items() if isinstance(c.noise, str)}
    channels = {
        name: Channel(column.quantity, 1.0 if name in texts else column.noise, column.unit)
        for name, column in part.columns.items()
    }
    # `read_csv` has its own default for `comment`, so None is not passed on.
    options = {} if part.comment is None else {"comment": part.comment}
    time = {"time": part.time, "time_unit": part.time_unit}
    read = read_csv(path, channels, missing=part.missing, **time, **options).series
    for name, text in texts.items():
        series = read[name]
        noise = number_of_text(text, series.unit, location.at("columns", name, "noise"))
        read[name] = replace(series, noise=noise)
    return Measurements(read)


def fit_parameters(study: Study, part: FitPart) -> tuple[dict[str, Parameter], dict[str, float]]:
    """Return the parameters of the fit and, as far as given, their guesses in SI units, by name."""
    parameters, guess = {}, {}
    for name, entry in part.parameters.items():
        part_location = study.location.at("fit", "parameters", name)
        target = find_path(entry.path, study.scene, study.state, part_location.at("path"))
        # `Parameter.initial` makes a parameter of the initial state, `Parameter` one of the scene.
        make = Parameter.initial if target.in_state else Parameter
        parameters[name] = make(target.path, entry.scale, unit=target.unit)
        if entry.guess is not None:
            guess[name] = target.number(entry.guess, part_location.at("guess"))
    return parameters, guess


def iteration_line(iteration: Iteration, most: int) -> str:
    number, chi_squared = iteration.number, iteration.chi_squared
    return f"iteration {number} of at most {most}: chi squared {chi_squared:.6g}"


def write_fit(result: Fit, folder: Path) -> dict[str, str | int | float]:
    """Write the fitted scene, tables and the report; return entries for the summary."""
    remove_old(folder, [f"{SERIES}*"])
    write_scene(folder, result.scene, result.state, "fitted.toml")
    write_table(folder, "estimates", result.to_xarray())
    (folder / REPORT).write_text(f"{result}\n", encoding="utf-8")
    rows = ("time",)
    for name, series in result.measurements.series.items():
        columns = {
            "measured": Labelled(rows, series.values, series.unit, "measured"),
            "noise": Labelled(rows, series.noise, series.unit, "one standard deviation"),
            "fitted": Labelled(rows, result.predictions[name], series.unit, "fitted"),
            "residual": Labelled(rows, result.residuals[name], "1", "(fitted - measured) / noise"),
        }
        times = {"time": Labelled(rows, np.asarray(series.times), "s", "time")}
        write_table(folder, f"{SERIES}{name}", labelled_dataset(f"fit of {name}", columns, times))
    return {
        "ended": result.ending.value,
        "samples": result.samples,
        "chi_squared": result.chi_squared,
        "degrees_of_freedom": result.degrees_of_freedom,
    }

"""`clearjoint fit`: parameters from measurements, and what is known of them."""

import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ..export.labelled import Labelled, labelled_dataset
from ..identification.fit import Fit
from ..identification.identify import FitInterrupted, identify
from ..identification.levenberg_marquardt import Ending, Iteration
from ..measurements.readers import Channel, read_csv
from ..measurements.series import Measurements, Series
from ..parametrisation.parameter import Parameter
from ..scene_files.locations import FileLocation
from ..scene_files.numbers import number_of_text
from .endings import FAILED, INTERRUPTED, WELL, CommandResult, say
from .folders import Folder
from .reports import write_fit_report
from .study import Study
from .study_parts import ColumnPart, FitPart

ESTIMATES, REPORT = "estimates", "report.txt"
FITTED_SCENE = "fitted.toml"


def fit(study: Study, out: Path) -> CommandResult:
    """Fit a study's parameters and write what was found."""
    part = study.parts.fit
    if part is None:
        study.place.at("fit").refuse(None, "a section [fit]", "add [fit.parameters.<name>]")
    begun, place = time.perf_counter(), study.place.at("fit")
    measured, (parameters, guess) = _measured(study, part, place), _parameters(study, part, place)
    measured.check(study.scene)
    iterations, interrupted = _Iterations(parameters, part.max_iterations), False
    try:
        found = identify(
            study.scene,
            study.state,
            measured,
            parameters,
            study.settings(part, "fit"),
            start_time=part.start,
            guess=guess or None,
            starts=part.starts,
            grow=part.grow,
            max_iterations=part.max_iterations,
            progress=iterations,
        )
    except FitInterrupted as stopped:
        if not stopped.fits:
            return CommandResult(INTERRUPTED, "interrupted before the first run had ended")
        interrupted, found = True, stopped.fits[-1]
    folder = Folder.made(out)
    _write(found, folder)
    converged = found.ending is Ending.CONVERGED
    summary = _summary(study, found, time.perf_counter() - begun)
    folder.write_summary(summary | ({"ended": "interrupted"} if interrupted else {}))
    write_fit_report(folder, found)
    if interrupted:
        line = f"interrupted; the best fit so far is in {folder / REPORT}"
        return CommandResult(INTERRUPTED, line)
    if not converged:
        say(f"error: the fit has not converged: {found.ending.value}")
    estimates = [f"{name} {found.estimates[name]:.5g}" for name in found.parameters]
    line = f"{found.ending.value}, chi squared {found.chi_squared:.4g}, {', '.join(estimates)}"
    return CommandResult(WELL if converged else FAILED, line)


def _measured(study: Study, part: FitPart, place: FileLocation) -> Measurements:
    """The measurements, with their noise in SI units."""
    path = study.path.parent / part.measurements
    if not path.exists():
        place.at("measurements").refuse(part.measurements, "a CSV file", f"there is no {path}")
    texts = {name for name, one in part.columns.items() if isinstance(one.noise, str)}
    channels = {
        name: Channel(one.quantity, 1.0 if name in texts else one.noise, one.unit)
        for name, one in part.columns.items()
    }
    options = {} if part.comment is None else {"comment": part.comment}
    read = read_csv(
        path,
        channels,
        time=part.time,
        time_unit=part.time_unit,
        missing="drop" if part.missing == "drop" else "refuse",
        **options,
    )
    columns = place.at("columns")
    return Measurements(
        {
            name: _noisy(one, part.columns[name], columns.at(name)) if name in texts else one
            for name, one in read.series.items()
        }
    )


def _noisy(series: Series, column: ColumnPart, place: FileLocation) -> Series:
    """The series with the noise that a text with a unit gives."""
    noise = number_of_text(column.noise, series.unit, place.at("noise"))
    rows = series.times, series.values
    return Series(series.channel, *rows, noise, series.unit, series.name)


def _parameters(
    study: Study, part: FitPart, place: FileLocation
) -> tuple[dict[str, Parameter], dict[str, float]]:
    """The parameters, and the first guesses that the study gives."""
    parameters, guess = {}, {}
    for name, one in part.parameters.items():
        where = place.at("parameters").at(name)
        found = study.find(one.place, where.at("place"))
        make = Parameter.initial if found.in_state else Parameter
        parameters[name] = make(found.place, one.scale, unit=found.unit)
        if one.guess is not None:
            guess[name] = found.number(one.guess, where.at("guess"))
    return parameters, guess


class _Iterations:
    """Tells each iteration."""

    def __init__(self, parameters: Mapping[str, Parameter], most: int):
        self._parameters, self._most = parameters, most

    def __call__(self, iteration: Iteration) -> None:
        values = ", ".join(f"{n} {value:.6g}" for n, value in self._values(iteration).items())
        mark = "" if iteration.accepted else " (rejected)"
        say(
            f"iteration {iteration.number} of at most {self._most}: "
            f"chi squared {iteration.chi_squared:.6g}, {values}{mark}"
        )

    def _values(self, iteration: Iteration) -> dict[str, float]:
        pairs = zip(self._parameters.items(), iteration.coordinates, strict=True)
        return {name: float(p.scale.value(u)) for (name, p), u in pairs}


def _write(found: Fit, folder: Folder) -> None:
    folder.write_scene(found.scene, found.state, FITTED_SCENE)
    folder.write_table(ESTIMATES, found.to_xarray())
    for name, series in found.measurements.series.items():
        columns = {
            "measured": (series.values, series.unit, "measured"),
            "noise": (series.noise, series.unit, "one standard deviation"),
            "fitted": (found.predictions[name], series.unit, "fitted"),
            "residual": (found.residuals[name], "1", "(fitted - measured) / noise"),
        }
        rows = {key: Labelled(("time",), *column) for key, column in columns.items()}
        times = {"time": Labelled(("time",), np.asarray(series.times), "s", "time")}
        folder.write_table(f"series {name}", labelled_dataset(f"fit of {name}", rows, times))
    (folder / REPORT).write_text(f"{found}\n", encoding="utf-8")


def _summary(study: Study, found: Fit, seconds: float) -> dict[str, str | int | float]:
    return {
        "kind": "fit",
        "title": study.title,
        "file": str(study.path),
        "ended": found.ending.value,
        "samples": found.samples,
        "chi_squared": found.chi_squared,
        "degrees_of_freedom": found.degrees_of_freedom,
        "seconds": round(seconds, 2),
    }

"""Files of bounce intervals, and of drop and rebound heights.

The repository giiulia/LabI-Dynamics-Thermodynamics keeps them in Python files (folders `Method1`
and `Method2` of `Coefficient_of_restitution`): `pallina4_intervalli_h1 = np.array([...])`, a row
for each bounce and a column for each throw, s; `pallina4_H0` and `pallina4_H1`, drop and rebound
heights, a row for each height and a column for each reading, cm. Literals are read; the files are
never executed. Arrays that the scripts beside them compute, such as those from `np.delete`, are not
data.
"""

import ast
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

INTERVALS = re.compile(r"pallina(\d+)_intervalli_h(\d+)")
DROPS, REBOUNDS = re.compile(r"pallina(\d+)_H0"), re.compile(r"pallina(\d+)_H1")
CENTIMETRE = 1e-2


@dataclass(frozen=True)
class Drops:
    """Drop heights (k,), m, means of the readings, and rebounds (k, readings), m."""

    heights: np.ndarray
    rebounds: np.ndarray


@dataclass(frozen=True)
class Measured:
    """Data of a ball: series of intervals between impacts, each (bounces, throws) s, and drops."""

    number: int
    series: tuple[np.ndarray, ...]
    drops: Drops | None


def read_balls(paths: list[Path]) -> dict[int, Measured]:
    """Read all balls in files, or in all Python files below folders.

    **Raises:** `ValueError` for paths without such data, and for invalid data.
    """
    tables: dict[str, np.ndarray] = {}
    for path in paths:
        for file in sorted(path.rglob("*.py")) if path.is_dir() else [path]:
            tables.update(_tables(file))
    found = [INTERVALS.fullmatch(name) or REBOUNDS.fullmatch(name) for name in tables]
    numbers = sorted({int(match[1]) for match in found if match})
    if not numbers:
        raise ValueError(
            f"No arrays named like pallina1_intervalli_h1 or pallina1_H1 are in "
            f"{[str(path) for path in paths]}: give the folder Coefficient_of_restitution, or "
            "the files data.py of its methods."
        )
    return {number: _ball(number, tables) for number in numbers}


def _ball(number: int, tables: dict[str, np.ndarray]) -> Measured:
    named = {
        int(match[2]): table
        for name, table in tables.items()
        if (match := INTERVALS.fullmatch(name)) and int(match[1]) == number
    }
    series = tuple(named[index] for index in sorted(named))
    rebounds, heights = tables.get(f"pallina{number}_H1"), tables.get(f"pallina{number}_H0")
    if rebounds is None:
        return Measured(number, series, None)
    if heights is None or len(heights) != len(rebounds):
        raise ValueError(
            f"pallina{number}_H1 has {len(rebounds)} rows, pallina{number}_H0 "
            f"{0 if heights is None else len(heights)}: each needs a row for every drop height."
        )
    drops = Drops(CENTIMETRE * heights.mean(axis=1), CENTIMETRE * rebounds)
    return Measured(number, series, drops)


def _tables(file: Path) -> dict[str, np.ndarray]:
    """Return the arrays of intervals and heights in a file by name."""
    if not file.is_file():
        raise ValueError(f"{file} is not there: give a file or a folder.")
    try:
        tree = ast.parse(file.read_text(encoding="utf-8"))
    except SyntaxError as error:
        raise ValueError(f"{file}, line {error.lineno}, is not Python: {error.msg}.") from error
    found = {}
    for node in tree.body:
        match node:
            case ast.Assign([ast.Name(name)], ast.Call(ast.Attribute(attr="array"), [rows, *_])):
                if any(known.fullmatch(name) for known in (INTERVALS, DROPS, REBOUNDS)):
                    found[name] = _literal(rows, f"{file}: {name}")
    return found


def _literal(rows: ast.expr, where: str) -> np.ndarray:
    """Return the rows of numbers in the argument of `np.array([...])`."""
    try:
        table = np.array(ast.literal_eval(rows), dtype=float)
    except (ValueError, TypeError) as error:
        raise ValueError(
            f"{where} (line {rows.lineno}) must be np.array of rows of equal length that hold "
            "numbers alone: correct the file."
        ) from error
    if table.ndim != 2 or not (np.isfinite(table).all() and (table > 0.0).all()):
        wrong = np.argwhere(~(table > 0.0))
        raise ValueError(
            f"{where} (line {rows.lineno}) must be a table of positive numbers, but has shape "
            f"{table.shape} and wrong entries at (row, column) {wrong.tolist()}: correct the file."
        )
    return table

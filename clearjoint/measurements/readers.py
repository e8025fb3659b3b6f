"""Measurements from tables: CSV files and xarray datasets.

Rows are counted from 1 below the header; blank and comment lines don't count.
"""

import warnings
from collections.abc import Callable, Hashable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar

import numpy as np

from ..fields.checks import require, require_names
from ..fields.types import ArrayLike
from ..model.drives.piecewise import PiecewiseConstant, PiecewiseLinear
from ..quantities.base import Quantity
from .series import Measurements, Series
from .units import to_si

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

T = TypeVar("T")
TableOfTime = TypeVar("TableOfTime", bound=PiecewiseLinear | PiecewiseConstant)
Missing = Literal["refuse", "drop"]
_OF_A_LINE = (
    "comment",
    "compression",
    "delimiter",
    "dialect",
    "encoding",
    "engine",
    "escapechar",
    "quotechar",
    "quoting",
    "sep",
    "skip_blank_lines",
    "skipinitialspace",
    "skiprows",
)
"""Options of `pandas.read_csv` that say how a line is read."""


@dataclass(frozen=True)
class Channel:
    """The quantity that a column holds, with its noise and unit.

    **Arguments:**

    - `quantity`: a scalar function of an `Instant`, such as those of `clearjoint.quantities`.
    - `noise`: one standard deviation, in the column's unit: a number, or one for each row.
    - `unit`: of the column, where the table does not give it.

    >>> cj.Channel(cj.quantities.JournalOffset("pin", "x"), noise=2.0, unit="um").unit
    'um'
    """

    quantity: Quantity
    noise: ArrayLike | None = None
    unit: str | None = None


@dataclass(frozen=True)
class _Column:
    """A column of a table.

    - `place`: what errors call it; `values`: as they stand in the table.
    - `unit`: that the table gives, ``None`` if it gives none.
    """

    place: str
    values: "pd.Series"
    unit: str | None

    def numbers(self) -> np.ndarray:
        """The values as numbers; NaN what is none."""
        import pandas as pd

        kind = self.values.dtype.kind
        remedy = "subtract the first and divide by a second"
        require(kind not in "mM", self.place, self.values.dtype, "numbers, not dates", remedy)
        if kind in "bO":
            plain = np.array([not isinstance(value, bool) for value in self.values.tolist()])
            self.require_each(plain, "a number, not a truth value", "write 0 and 1 if so meant")
        return np.asarray(pd.to_numeric(self.values, errors="coerce"), dtype=float)

    def require_each(self, fine: np.ndarray, expected: str, remedy: str) -> None:
        """Check every row; the error names the first that is not fine."""
        if not fine.all():
            k = int(np.argmin(fine))
            value = self.values.tolist()[k]
            raise ValueError(
                f"Row {k + 1} of {self.place} must be {expected}, but is {value!r}: {remedy}."
            )


def read_csv(
    path: str | Path,
    channels: Mapping[str, Channel],
    *,
    time: str = "t",
    time_unit: str = "s",
    noise: ArrayLike | None = None,
    missing: Missing = "refuse",
    **options: Any,
) -> Measurements:
    """Read measurements from a CSV file with a header, compressed or not.

        probe = Channel(JournalOffset("pin", "x"), noise=2.0)  # in the column's unit
        data = read_csv("rig.csv", {"probe x": probe}, comment="#", missing="drop")
        data.check(scene)  # are the bodies and joints there?

    reads the columns "t [ms]" and "probe x [um]"; all is stored in SI units.

    **Arguments:**

    - `channels`: `Channel` by column. A header may carry the unit: "probe x [mm]" is the column
      "probe x".
    - `time`, `time_unit`: the column of times, and its unit where the header has none.
    - `noise`: of channels that have none of their own.
    - `missing`: "drop" leaves samples without a number out of their series; "refuse" raises.
    - `options`: of `pandas.read_csv`, such as `sep`, `decimal`, `comment` or `skiprows`.

    **Raises:** `ValueError` for a column that is not there, without a unit or in one of another
    dimension, for text and NaN, times that don't rise, and noise that is not positive.

    >>> import pandas as pd
    >>> table = pd.DataFrame({"t [ms]": [0, 1], "probe x [um]": [1.0, 2.0]})
    >>> table.to_csv("rig.csv", index=False)
    >>> probe = cj.Channel(cj.quantities.JournalOffset("pin", "x"), noise=0.1)
    >>> cj.read_csv("rig.csv", {"probe x": probe}).series["probe x"].times  # s
    array([0.   , 0.001])
    """
    column = _columns_of(path, options)
    times = _times(column(time, "time"), time_unit)
    series = {
        name: _series(name, channel, column(name, "channels"), times, noise, missing)
        for name, channel in _valid(channels)
    }
    return Measurements(series)


def function_from_csv(
    path: str | Path,
    column: str,
    unit: str,
    kind: type[TableOfTime] = PiecewiseLinear,
    *,
    time: str = "t",
    time_unit: str = "s",
    **options: Any,
) -> TableOfTime:
    """Read a function of time, such as the torque of a drive, from a CSV file with a header.

        torque = cj.function_from_csv("torque.csv", "torque", "N m")  # columns "t [ms]", "torque"
        motor = cj.DriveTorque("ground", "crank", (0, 0, 1), torque)

    **Arguments:**

    - `column`: the name of the column of values. A header may carry its unit, "torque [N cm]".
    - `unit`: the SI unit of what follows the function, into which values are converted; that of
      the column too where its header has none.
    - `kind`: `PiecewiseLinear`, or `PiecewiseConstant` for values that are switched.
    - `time`, `time_unit`: the column of times, and its unit where the header has none.
    - `options`: of `pandas.read_csv`, such as `sep`, `decimal`, `comment` or `skiprows`.

    **Raises:** `ValueError` as `read_csv`.

    >>> import pandas as pd
    >>> table = pd.DataFrame({"t [ms]": [0, 100], "torque [N cm]": [0.0, 250.0]})
    >>> table.to_csv("torque.csv", index=False)
    >>> torque = cj.function_from_csv("torque.csv", "torque", "N m")
    >>> print(f"{torque(0.05):.4f} N m")
    1.2500 N m
    """
    found = _columns_of(path, options)
    times = _times(found(time, "time"), time_unit)
    rows = found(column, "column")
    values = rows.numbers()
    rows.require_each(np.isfinite(values), "a finite number", "correct it, or leave the row out")
    factor, _ = _within(rows, lambda: to_si(rows.unit or unit, unit))
    return kind(times, values * factor)


def _columns_of(path: str | Path, options: dict[str, Any]) -> Callable[[str, str], _Column]:
    """A function that finds a column of a CSV file; its arguments are the column's name, and the
    name of the caller's argument that gives it."""
    table = _read(path, {"index_col": False, "skipinitialspace": True, **options})
    headers = [_split(header) for header in _headers(path, table, options)]
    names = [name for name, _ in headers]
    file = f"{str(path)!r}"

    def column(name: str, argument: str) -> _Column:
        _require_listed(argument, name, names, f"columns of {file}")
        once = names.count(name) == 1
        require(once, argument, name, f"once in {file}", "rename one of the columns")
        k = names.index(name)
        return _Column(f"column {name!r} of {file}", table.iloc[:, k], headers[k][1])

    return column


def from_xarray(
    dataset: "xr.Dataset",
    channels: Mapping[str, Channel],
    *,
    noise: ArrayLike | None = None,
    missing: Missing = "refuse",
) -> Measurements:
    """Measurements from the variables of a dataset.

    Each has one dimension, whose coordinate holds its times in s, or in the unit of its attribute
    "units". The variables' own attributes "units" are theirs.

    **Arguments:** `channels`: `Channel` by variable; the others, and errors, as for `read_csv`.

    >>> import xarray as xr
    >>> data = xr.Dataset({"probe": ("t", [1.0, 2.0], {"units": "um"})}, coords={"t": [0.0, 0.1]})
    >>> channel = cj.Channel(cj.quantities.JournalOffset("pin", "x"), noise=0.1)
    >>> cj.from_xarray(data, {"probe": channel}).series["probe"].values  # m
    array([1.e-06, 2.e-06])
    """
    import pandas as pd

    def column(name: Hashable) -> _Column:
        array = dataset[name]
        place = f"variable {name!r} of the dataset"
        return _Column(place, pd.Series(np.asarray(array)), array.attrs.get("units"))

    series = {}
    for name, channel in _valid(channels):
        variables = [str(variable) for variable in dataset.data_vars]
        _require_listed("channels", name, variables, "variables of the dataset")
        dims = dataset[name].dims
        remedy = "select one series along the other dimensions"
        require(len(dims) == 1, f"channels[{name!r}]", dims, "of one dimension, the time's", remedy)
        coordinates = [str(c) for c in dataset.coords]
        remedy = "label its rows with their times"
        expected = f"with a coordinate, one of {coordinates}, along {dims[0]!r}"
        require(dims[0] in coordinates, f"channels[{name!r}]", dims, expected, remedy)
        times = _times(column(dims[0]), "s")
        series[name] = _series(name, channel, column(name), times, noise, missing)
    return Measurements(series)


def _read(path: str | Path, options: dict[str, Any]) -> "pd.DataFrame":
    import pandas as pd

    with warnings.catch_warnings():
        warnings.filterwarnings("error", "Length of header", pd.errors.ParserWarning)
        try:
            return pd.read_csv(path, **options)
        except (pd.errors.ParserError, pd.errors.ParserWarning) as error:
            raise ValueError(
                f"File {str(path)!r} must have as many fields in each row as in its header, but "
                f"pandas says: {str(error).strip()} Pass `sep`, `decimal`, `comment` or `skiprows` "
                "as it needs."
            ) from error
        except pd.errors.EmptyDataError as error:
            raise ValueError(
                f"File {str(path)!r} must have a header and rows, but nothing is in it."
            ) from error
        except UnicodeDecodeError as error:
            raise ValueError(
                f"File {str(path)!r} must be {error.encoding} text, but its byte "
                f'0x{error.object[error.start]:02x} is none: pass encoding="latin-1", or the '
                "encoding it has."
            ) from error


def _headers(path: str | Path, table: "pd.DataFrame", options: dict[str, Any]) -> list[Hashable]:
    """The headers that the caller gives, or those of the file, as they stand there: pandas would
    put numbers behind headers that stand there twice."""
    if not {"header", "names"}.isdisjoint(options) or not len(table.columns):
        return list(table.columns)
    of_a_line = {k: v for k, v in options.items() if k in _OF_A_LINE}
    first = _read(path, {"skipinitialspace": True, **of_a_line, "header": None, "nrows": 1})
    return first.iloc[0].tolist()


def _valid(channels: Mapping[str, Channel]) -> Iterator[tuple[str, Channel]]:
    """Names and channels, each checked to be a channel."""
    remedy = "pass cj.Channel(quantity, noise=...)"
    require_names("channels", channels, remedy)
    for name, channel in channels.items():
        kind = type(channel).__name__
        require(isinstance(channel, Channel), f"channels[{name!r}]", kind, "a Channel", remedy)
        yield name, channel


def _split(header: Hashable) -> tuple[str, str | None]:
    """Name and unit of a header such as "x [mm]"."""
    name, bracket, rest = str(header).strip().rpartition("[")
    if not bracket or not rest.endswith("]"):
        return str(header).strip(), None
    return name.strip(), rest.removesuffix("]").strip()


def _require_listed(argument: str, name: str, listed: list[str], what: str) -> None:
    require(name in listed, argument, name, f"among the {what}, {listed}", "correct the name")


def _times(column: _Column, unit: str) -> np.ndarray:
    """Times in s, checked to rise."""
    times = column.numbers()
    column.require_each(np.isfinite(times), "a finite number", "times must not be missing")
    rising = np.append(True, np.diff(times) > 0.0)
    column.require_each(rising, "later than the row before", "sort the rows, merge repeated times")
    return times * _within(column, lambda: to_si(column.unit or unit, "s")[0])


def _series(
    name: str,
    channel: Channel,
    column: _Column,
    times: np.ndarray,
    noise: ArrayLike | None,
    missing: Missing,
) -> Series:
    known = ("refuse", "drop")
    require(missing in known, "missing", missing, f"one of {known}", "name one of them")
    values = column.numbers()
    there = np.isfinite(values)
    if missing == "refuse":
        remedy = 'correct it, or pass missing="drop" to leave such samples out'
        column.require_each(there, "a finite number", remedy)
    deviation = channel.noise if channel.noise is not None else noise
    remedy = f"pass Channel(..., noise=...) for {name!r}, or noise=... for all"
    require(deviation is not None, "noise", deviation, "one standard deviation", remedy)
    assert deviation is not None
    if np.ndim(deviation):
        expected, remedy = f"of shape {there.shape}", "pass one number, or one a row"
        require(np.shape(deviation) == there.shape, "noise", np.shape(deviation), expected, remedy)
        deviation = np.asarray(deviation)[there]
    unit = _unit(channel, column)
    return _within(
        column, lambda: Series(channel.quantity, times[there], values[there], deviation, unit, name)
    )


def _unit(channel: Channel, column: _Column) -> str:
    """The column's unit, from the table or from its channel."""
    unit = column.unit if column.unit is not None else channel.unit
    if unit is None:
        raise ValueError(
            f"The unit of {column.place} must be known, but neither the table nor the channel has "
            "one: head a CSV column `name [unit]`, set a variable's attribute `units`, or pass "
            "Channel(..., unit=...)."
        )
    same = channel.unit in (None, unit)
    remedy = "leave the channel's unit out, or correct the table"
    require(same, f"unit of {column.place}", unit, f"the channel's {channel.unit!r}", remedy)
    return unit


def _within(column: _Column, make: Callable[[], T]) -> T:
    """The result of a function; its errors name the column."""
    try:
        return make()
    except ValueError as error:
        raise ValueError(f"In {column.place}: {error}") from error

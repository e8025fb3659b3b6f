"""Read measurements from CSV files and xarray datasets.

Error messages count rows of data from 1, without the header, blank lines and comment lines.
"""

import warnings
from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar

import numpy as np
from jaxtyping import PyTree

from .._fields.checks import errors_about, require, require_types
from .._fields.types import ArrayLike
from .._model.drives.functions_of_time import PiecewiseConstant, PiecewiseLinear
from ..quantities.base import Quantity
from .series import Measurements, Series, to_si

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

TableOfTime = TypeVar("TableOfTime", bound=PiecewiseLinear | PiecewiseConstant)
Missing = Literal["refuse", "drop"]
PASS_CHANNEL = "pass cj.Channel(quantity, noise=...)"
_FIRST_LINE: dict[str, PyTree] = dict.fromkeys(("header", "usecols", "dtype", "converters"))
_FIRST_LINE |= {"nrows": 1, "index_col": False, "parse_dates": False, "skipfooter": 0}
"""Options by which `pandas.read_csv` reads the header alone, as a row of texts."""


@dataclass(frozen=True)
class Channel:
    """The measured quantity of a table's column, with its noise and unit.

    - `quantity`: a scalar function of an `Instant` (the scene with its motion at one time), such as
      those of `clearjoint.quantities`.
    - `noise`: standard deviation of the samples in the column's unit: a number, or one for each
      row. ``None`` stands for the argument `noise` of `read_csv` or `from_xarray`.
    - `unit`: unit of the column, any that pint knows. It may be left out if the table has one; if
      both have one, the spelling must be the same.

    >>> cj.Channel(cj.quantities.JournalOffset("pin", "x"), noise=2.0, unit="um").unit
    'um'
    """

    quantity: Quantity
    noise: ArrayLike | None = None
    unit: str | None = None


@dataclass(frozen=True)
class TableColumn:
    """One column of a table, with a label for error messages and, if the table has it, its unit."""

    label: str
    values: "pd.Series"
    unit: str | None

    def numbers(self) -> np.ndarray:
        """Return the values as floats, with NaN for texts; refuse dates and truth values."""
        import pandas as pd

        kind = self.values.dtype.kind
        remedy = "subtract the first one and divide by one second"
        require(kind not in "mM", self.label, self.values.dtype, "numbers, not dates", remedy)
        if kind in "bO":
            # Truth values would become 1 and 0 below.
            plain = np.array([not isinstance(value, bool) for value in self.values.tolist()])
            self.require_each(plain, "a number, not a truth value", "write 0 or 1 instead")
        return np.asarray(pd.to_numeric(self.values, errors="coerce"), dtype=float)

    def samples(self, missing: Missing) -> tuple[np.ndarray, np.ndarray]:
        """Return the values that are finite numbers, and whether each value is such a number. If
        `missing` is "refuse", raise a `ValueError` unless all values are."""
        choices = ("refuse", "drop")
        require(missing in choices, "missing", missing, f"one of {choices}", "name one of them")
        numbers = self.numbers()
        valid = np.isfinite(numbers)
        if missing == "refuse":
            remedy = 'correct it, or pass missing="drop" to omit these samples'
            self.require_each(valid, "a finite number", remedy)
        return numbers[valid], valid

    def require_each(self, valid: np.ndarray, expected: str, remedy: str) -> None:
        """Raise a `ValueError` that names the first row that is not valid, if there is one."""
        if not valid.all():
            k = int(np.argmin(valid))
            value = self.values.tolist()[k]
            raise ValueError(
                f"Row {k + 1} of {self.label} must be {expected}, but is {value!r}: {remedy}."
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
    """Read measurements from a CSV file with a header, converted to SI units.

    **Arguments:**

    - `path`: of the file, which may be compressed.
    - `channels`: `Channel` by name of the column. A header may contain the unit: "probe x [mm]" is
      the column "probe x".
    - `time`, `time_unit`: name of the column of times, and its unit if the header has none.
    - `noise`: standard deviation of the samples for channels without their own, in the unit of each
      column: a number, or one for each row.
    - `missing`: "drop" omits samples that are not finite numbers; "refuse" raises an error.
    - `options`: of `pandas.read_csv`, such as `sep`, `decimal`, `comment` or `skiprows`.

    **Returns:** `Measurements` whose series have the names of the columns.

    **Raises:** `ValueError` for a file that pandas cannot read, or whose rows have more fields than
    its header; for a column that is missing, repeated or without samples; for a unit that is
    missing, unknown, of another dimension or not that of the channel; for dates, truth values and,
    unless dropped, samples that are not finite numbers; for times that are not finite or don't rise
    strictly; and for noise that is missing, not positive or of another length. `OSError` for a file
    that does not exist.

    >>> import pandas as pd
    >>> table = pd.DataFrame({"t [ms]": [0, 1], "probe x [um]": [1.0, 2.0]})
    >>> table.to_csv("rig.csv", index=False)
    >>> probe = cj.Channel(cj.quantities.JournalOffset("pin", "x"), noise=0.1)
    >>> cj.read_csv("rig.csv", {"probe x": probe}).series["probe x"].times  # s
    array([0.   , 0.001])
    """
    channels = _with_noise(channels, noise)
    # The second argument of `column` is the argument that error messages name.
    column = columns_of(path, options)
    times = times_in(column(time, "time"), time_unit)
    series = {
        name: _series(name, channel, column(name, "channels"), times, missing)
        for name, channel in channels.items()
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

    **Arguments:**

    - `column`: name of the column of values, whose header may contain the unit: "torque [N cm]".
    - `unit`: SI unit of the function, to which values are converted. Values in a column whose
      header has no unit are in this unit.
    - `kind`: `PiecewiseLinear`, or `PiecewiseConstant` for switched values.
    - `path`, `time`, `time_unit`, `options`: as in `read_csv`.

    **Raises:** `ValueError` as `read_csv`, also for fewer than two rows and for values that are not
    finite numbers. `OSError` for a file that does not exist.

    >>> import pandas as pd
    >>> table = pd.DataFrame({"t [ms]": [0, 100], "torque [N cm]": [0.0, 250.0]})
    >>> table.to_csv("torque.csv", index=False)
    >>> torque = cj.function_from_csv("torque.csv", "torque", "N m")
    >>> print(f"{torque(0.05):.4f} N m")
    1.2500 N m
    """
    suits = isinstance(kind, type) and issubclass(kind, PiecewiseLinear | PiecewiseConstant)
    expected, remedy = "PiecewiseLinear or PiecewiseConstant", "make others from a table's columns"
    require(suits, "kind", kind, expected, remedy)
    # The second argument of `column_named` is the argument that error messages name.
    column_named = columns_of(path, options)
    times = times_in(column_named(time, "time"), time_unit)
    content = column_named(column, "column")
    values = content.numbers()
    content.require_each(np.isfinite(values), "a finite number", "correct it, or leave the row out")
    with errors_about(f"In {content.label}"):
        factor, _ = to_si(content.unit or unit, unit)
    return kind(times, values * factor)


def columns_of(
    source: "str | Path | pd.DataFrame", options: dict[str, Any]
) -> Callable[[str, str], TableColumn]:
    """Read a CSV or Parquet file with the options of its reader in pandas, unless `source` is a
    table already. Return a function ``column(name, argument)`` that finds a column by its name.
    Errors about the name mention `argument`, the argument by which the user has given it."""
    import pandas as pd

    file, names_in_file = "the table", []
    if isinstance(source, pd.DataFrame):
        table = source
    elif Path(source).suffix.lower() == ".parquet":
        file, table = f"{str(source)!r}", _read_parquet(source, options)
    else:
        file = f"{str(source)!r}"
        options = {"index_col": False, "skipinitialspace": True, **options}
        table = _read(source, options)
        if {"header", "names"}.isdisjoint(options) and len(table.columns):
            # pandas renames repeated columns, so the header is read again as a row of texts, in
            # which a name that occurs twice can be recognised. With the user's options `header` or
            # `names`, the names are not simply in the first row, so this check is left out.
            first_row = _read(source, options | _FIRST_LINE).iloc[0]
            names_in_file = [split_header(header)[0] for header in first_row]
    headers = [split_header(header) for header in table.columns]
    names = [name for name, _ in headers]

    def column(name: str, argument: str) -> TableColumn:
        require_listed(argument, name, names, f"columns of {file}")
        once = max(names.count(name), names_in_file.count(name)) == 1
        require(once, argument, name, f"unique in {file}", "rename one of the columns")
        k = names.index(name)
        return TableColumn(f"column {name!r} of {file}", table.iloc[:, k], headers[k][1])

    return column


def from_xarray(
    dataset: "xr.Dataset",
    channels: Mapping[str, Channel],
    *,
    noise: ArrayLike | None = None,
    missing: Missing = "refuse",
) -> Measurements:
    """Return measurements from the variables of an xarray dataset.

    Each variable has one dimension, whose coordinate contains the times, in s or in the unit of its
    attribute "units". A variable's attribute "units" is the unit of its values. `channels` has a
    `Channel` by name of the variable; `noise` and `missing` are as in `read_csv`.

    **Raises:** `ValueError` as `read_csv`, and for a variable with more or less than one dimension
    or without a coordinate of times.

    >>> import xarray as xr
    >>> data = xr.Dataset({"probe": ("t", [1.0, 2.0], {"units": "um"})}, coords={"t": [0.0, 0.1]})
    >>> channel = cj.Channel(cj.quantities.JournalOffset("pin", "x"), noise=0.1)
    >>> cj.from_xarray(data, {"probe": channel}).series["probe"].values  # m
    array([1.e-06, 2.e-06])
    """
    import pandas as pd

    channels = _with_noise(channels, noise)

    def column(name: Hashable) -> TableColumn:
        array = dataset[name]
        label = f"variable {name!r} of the dataset"
        return TableColumn(label, pd.Series(np.asarray(array)), array.attrs.get("units"))

    # Each variable may have its own coordinate of times.
    series = {}
    for name, channel in channels.items():
        variables = [str(variable) for variable in dataset.data_vars]
        require_listed("channels", name, variables, "variables of the dataset")
        dims = dataset[name].dims
        remedy = "select one series along the other dimensions"
        require(len(dims) == 1, f"channels[{name!r}]", dims, "of one dimension, time", remedy)
        coordinates = [str(c) for c in dataset.coords]
        remedy = "add a coordinate with the times"
        expected = f"a variable along one of the coordinates {coordinates}"
        require(dims[0] in coordinates, f"channels[{name!r}]", dims, expected, remedy)
        times = times_in(column(dims[0]), "s")
        series[name] = _series(name, channel, column(name), times, missing)
    return Measurements(series)


def _read(path: str | Path, options: dict[str, Any]) -> "pd.DataFrame":
    import pandas as pd

    # pandas only warns of rows with more fields than the header, and drops the surplus.
    with warnings.catch_warnings():
        warnings.filterwarnings("error", "Length of header", pd.errors.ParserWarning)
        try:
            return pd.read_csv(path, **options)
        except (pd.errors.ParserError, pd.errors.ParserWarning) as error:
            raise ValueError(
                f"File {str(path)!r} must have as many fields in each row as in its header, but "
                f"pandas reports: {str(error).strip()} Pass the `sep`, `decimal`, `comment` or "
                "`skiprows` of the file."
            ) from error
        except pd.errors.EmptyDataError as error:
            raise ValueError(
                f"File {str(path)!r} must have a header and rows, but is empty."
            ) from error
        except UnicodeDecodeError as error:
            raise ValueError(
                f"File {str(path)!r} must be {error.encoding} text, but its byte "
                f'0x{error.object[error.start]:02x} is not: pass encoding="latin-1", or the '
                "encoding of the file."
            ) from error


def _read_parquet(path: str | Path, options: dict[str, PyTree]) -> "pd.DataFrame":
    """Read a Parquet file, with the `options` of `pandas.read_parquet`. A column "state" of lists
    becomes the columns "state.0", "state.1", …"""
    import pandas as pd

    try:
        table = pd.read_parquet(path, **options)
    except ImportError as error:
        raise ImportError(
            f"File {str(path)!r} needs a reader of Parquet for pandas: `pip install pyarrow`, or "
            "convert the file to CSV."
        ) from error
    # The rows of all columns are joined by position, not by the labels of an index in the file.
    parts = []
    for name, values in table.items():
        if len(values) and isinstance(values.iloc[0], list | np.ndarray):
            lengths = {np.size(entry) for entry in values}
            expected, remedy = "of lists of one length", "convert the file to plain columns"
            require(len(lengths) == 1, f"column {name!r} of {path}", lengths, expected, remedy)
            rows = np.stack([np.ravel(entry) for entry in values])
            names = [f"{name}.{k}" for k in range(rows.shape[1])]
            parts.append(pd.DataFrame(rows, columns=pd.Index(names)))
        else:
            parts.append(values.reset_index(drop=True))
    return pd.concat(parts, axis=1)


def split_header(header: Hashable) -> tuple[str, str | None]:
    """Return the name and the unit, ``None`` if there is none, of a header such as "x [mm]". A
    number right after the name is an index, as in "position[0]", and part of the name."""
    name, bracket, rest = str(header).strip().rpartition("[")
    is_index = rest.removesuffix("]").isdecimal() and not name.endswith((" ", "\t"))
    if not bracket or not rest.endswith("]") or is_index:
        return str(header).strip(), None
    return name.strip(), rest.removesuffix("]").strip()


def require_listed(argument: str, name: str, listed: list[str], kind: str) -> None:
    require(name in listed, argument, name, f"among the {kind}, {listed}", "correct the name")


def times_in(column: TableColumn, unit: str) -> np.ndarray:
    """Return the times in a column, converted to s; `unit` is the unit if the table has none."""
    times = column.numbers()
    column.require_each(np.isfinite(times), "a finite number", "complete the times")
    rising = np.append(True, np.diff(times) > 0.0)
    column.require_each(rising, "later than the row before", "sort the rows, merge repeated times")
    with errors_about(f"In {column.label}"):
        return times * to_si(column.unit or unit, "s")[0]


def _with_noise(channels: Mapping[str, Channel], noise: ArrayLike | None) -> dict[str, Channel]:
    """Return the channels, with the given noise where they have none of their own."""
    require_types("channels", channels, Channel, "a Channel", PASS_CHANNEL)
    return {n: replace(c, noise=noise) if c.noise is None else c for n, c in channels.items()}


def _series(
    name: str, channel: Channel, column: TableColumn, times: np.ndarray, missing: Missing
) -> Series:
    (values, valid), deviation = column.samples(missing), channel.noise
    remedy = f"pass Channel(..., noise=...) for {name!r}, or noise=... for all"
    require(deviation is not None, "noise", deviation, "a standard deviation", remedy)
    assert deviation is not None
    # If there is a deviation for each row, the deviations of dropped samples are left out, too.
    if np.ndim(deviation):
        expected, remedy = f"of shape {valid.shape}", "pass one number, or one for each row"
        require(np.shape(deviation) == valid.shape, "noise", np.shape(deviation), expected, remedy)
        deviation = np.asarray(deviation)[valid]
    # The unit is that of the table, or of the channel if the table has none. If both have one, the
    # two must be equal.
    unit = channel.unit if column.unit is None else column.unit
    if unit is None:
        raise ValueError(
            f"The unit of {column.label} must be known, but neither the table nor the channel has "
            "one: write `name [unit]` in the header of a CSV column, set a variable's attribute "
            "`units`, or pass Channel(..., unit=...)."
        )
    remedy = "omit the channel's unit, or correct the table"
    expected = f"the channel's {channel.unit!r}"
    require(channel.unit in (None, unit), f"unit of {column.label}", unit, expected, remedy)
    with errors_about(f"In {column.label}"):
        return Series(channel.quantity, times[valid], values, deviation, unit, name)

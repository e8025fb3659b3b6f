"""Export of results as data frames, CSV files and netCDF files, all of which are made from an
xarray dataset with units."""

import abc
import itertools
from os import PathLike
from typing import TYPE_CHECKING

import numpy as np

from ..fields.checks import require

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

IN_FRONT = ("body", "contact", "bristle_contact", "joint", "journal", "reaction", "rigid_contact")
"""Dimensions whose labels precede the name of the variable in the name of a column, as the body
"arm" does in "arm.position.x". Labels of other dimensions follow it, as the component "x" does."""


class AbstractTabular(abc.ABC):
    """Base class of results that can be exported as dataset, data frame, CSV and netCDF file.

    A subclass defines `to_xarray`, from which the other exports follow.

    ```python
    import clearjoint as cj
    import numpy as np

    crossings = cj.results.Crossings(np.array([0.1, 0.2]), {"x": np.ones(2)}, {"x": "m"})
    print(crossings.to_dataframe().columns.tolist())  # ["x [m]"]
    ```
    """

    @abc.abstractmethod
    def to_xarray(self) -> "xr.Dataset":
        """Return the results as an `xarray.Dataset`, whose attributes include the versions of the
        programs.

        Its variables have the attributes "units" and "long_name".
        """

    def to_dataframe(self) -> "pd.DataFrame":
        """Return a `pandas.DataFrame` with a row for each time, impact, crossing or parameter.

        Each number has a column, whose name has the unit, such as "arm.position.x [m]".
        """
        return to_frame(self.to_xarray())

    def to_csv(self, path: str | PathLike[str]) -> None:
        """Write the data frame of `to_dataframe` to a CSV file, for spreadsheets and
        `clearjoint.read_csv`.

        Units are in the header, and numbers are written without loss.

        **Arguments:** `path`: file, which is overwritten if it exists.
        """
        self.to_dataframe().to_csv(path)

    def to_netcdf(self, path: str | PathLike[str]) -> None:
        """Write the dataset of `to_xarray` to a netCDF file (classic format, 64-bit offsets),
        without loss.

        The writer of this format supports only Latin-1. Other characters in names of variables are
        escaped ("\\u8f74"), and the attribute "original_name" has the unescaped name.

        **Arguments:** `path`: file, which is overwritten if it exists.

        **Raises:** `ValueError` for a variable or dimension without a name.
        """
        write_netcdf(self.to_xarray(), path)


def write_netcdf(dataset: "xr.Dataset", path: str | PathLike[str]) -> None:
    """Write a dataset to a netCDF file (classic format), with names escaped as in
    `AbstractTabular.to_netcdf`.

    **Raises:** `ValueError` for a variable or dimension without a name.
    """
    # `escaped` has the written name of each variable or dimension that is not in Latin-1.
    escaped = {}
    for name in map(str, (*dataset.variables, *dataset.sizes)):
        require(name != "", "name", name, "at least one character", "name the variable")
        written = name.encode("latin-1", "backslashreplace").decode("latin-1")
        if written != name:
            escaped[name] = written
            if name in dataset.variables:
                dataset = dataset.assign({name: dataset[name].assign_attrs(original_name=name)})
    dataset.rename(escaped).to_netcdf(path, engine="scipy", format="NETCDF3_64BIT")


def header(name: str, attributes: dict) -> str:
    """Return the name of a column with its unit, such as "pin.penetration [m]".

    **Arguments:** `name`: name of the column; `attributes`: attributes of its variable, of which
    "units" is the unit. Without a unit, the result is `name` alone.
    """
    return f"{name} [{attributes['units']}]" if attributes.get("units") else name


def to_frame(dataset: "xr.Dataset", rows: str | None = None) -> "pd.DataFrame":
    """Return a data frame with a row for each position along one dimension of a dataset.

    Each number along the other dimensions of a variable gets a column, such as "arm.position.x
    [m]". Variables and coordinates without the dimension of the rows are left out. Numbers of a
    variable with the attribute "flag_meanings", such as result codes, are replaced by their
    meanings.

    **Arguments:** `rows`: name of the dimension; by default the dataset's first.
    """
    import pandas as pd

    rows = next(iter(map(str, dataset.sizes))) if rows is None else rows
    # The coordinate along the rows becomes the index; further coordinates become columns.
    columns = {}
    for name in (*dataset.coords, *dataset.data_vars):
        if name != rows and rows in dataset[name].dims:
            columns |= _columns(str(name), dataset[name], rows)
    index = pd.Index(dataset[rows].values, name=header(rows, dataset[rows].attrs))
    return pd.DataFrame(columns, index=index)


def _columns(name: str, array: "xr.DataArray", rows: str) -> dict[str, np.ndarray]:
    """Return the columns of a variable, (rows,) each, by name: one for each combination of labels
    of its other dimensions.

    **Arguments:** `name`: name of the variable; `array`: its values and attributes; `rows`: name of
    the dimension along the rows.
    """
    others = [str(dim) for dim in array.dims if dim != rows]
    values = array.transpose(rows, *others).values
    attributes = array.attrs
    if "flag_meanings" in attributes:
        values, attributes = _meanings(values, attributes), {}
    columns = {}
    for index in itertools.product(*(range(array.sizes[dim]) for dim in others)):
        labels = {d: str(array[d].values[k]) for d, k in zip(others, index, strict=True)}
        front = [label for dim, label in labels.items() if dim in IN_FRONT]
        behind = [label for dim, label in labels.items() if dim not in IN_FRONT]
        columns[header(".".join([*front, name, *behind]), attributes)] = values[(..., *index)]
    return columns


def _meanings(codes: np.ndarray, attributes: dict) -> np.ndarray:
    flags = np.atleast_1d(attributes["flag_values"]).tolist()
    texts = dict(zip(flags, attributes["flag_meanings"].split(), strict=True))
    return np.vectorize(lambda code: texts.get(code, str(code)), otypes=[object])(codes)

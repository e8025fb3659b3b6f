"""What results have in common that can be taken out: datasets, data frames and files."""

import abc
from os import PathLike
from typing import TYPE_CHECKING

from ..fields.checks import require
from .frames import to_frame

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr


class AbstractTabular(abc.ABC):
    """A result that is an `xarray.Dataset` with units, and in each form that is made of one.

    ```python
    import clearjoint as cj
    import numpy as np

    crossings = cj.results.Crossings(np.array([0.1, 0.2]), {"x": np.ones(2)}, {"x": "m"})
    print(crossings.to_dataframe().columns.tolist())  # ["x [m]"]
    ```
    """

    @abc.abstractmethod
    def to_xarray(self) -> "xr.Dataset":
        """An `xarray.Dataset` whose variables have the attributes "units" and "long_name", and
        whose own attributes tell settings and versions."""

    def to_dataframe(self) -> "pd.DataFrame":
        """A `pandas.DataFrame`: a row for each time (impact, crossing, parameter), a column for
        each number there, named with its unit, such as "arm.position.x [m]"."""
        return to_frame(self.to_xarray())

    def to_csv(self, path: str | PathLike[str]) -> None:
        """Write `to_dataframe` to a CSV file, which `clearjoint.read_csv` and spreadsheets read:
        units in the header, numbers to the last bit.

        **Arguments:** `path`: overwritten if it exists.
        """
        self.to_dataframe().to_csv(path)

    def to_netcdf(self, path: str | PathLike[str]) -> None:
        """Write `to_xarray` to a netCDF file (classic format, 64-bit offsets), which
        `xarray.open_dataset` reads with the same numbers to the last bit.

        Names of variables with characters that Latin-1 lacks, which this format's writer can't
        write, have escapes in their place ("\\u8f74"); the name is their attribute
        "original_name".

        **Arguments:** `path`: overwritten if it exists.
        """
        write_netcdf(self.to_xarray(), path)


def write_netcdf(dataset: "xr.Dataset", path: str | PathLike[str]) -> None:
    """Write a dataset as `AbstractTabular.to_netcdf` does.

    **Raises:** `ValueError` for a variable without a name.
    """
    escaped = {}
    for name in map(str, (*dataset.variables, *dataset.sizes)):
        require(name != "", "name", name, "one character at least, of each variable", "name it")
        written = name.encode("latin-1", "backslashreplace").decode("latin-1")
        if written != name:
            escaped[name] = written
    for name in escaped:
        if name in dataset.variables:
            dataset = dataset.assign({name: dataset[name].assign_attrs(original_name=name)})
    dataset.rename(escaped).to_netcdf(path, engine="scipy", format="NETCDF3_64BIT")

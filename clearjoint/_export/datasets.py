"""Results as labelled arrays with units, data frames, CSV and netCDF files."""

import abc
import itertools
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from functools import cache, partial
from importlib.metadata import PackageNotFoundError, version
from os import PathLike
from typing import TYPE_CHECKING, NamedTuple

import jax
import numpy as np

from .._fields.caching import cached_by_numbers
from .._fields.checks import require
from .._fields.types import ArrayLike

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

LONGEST = 200
"""Number of characters after which the text of an array is cut off."""
Notes = tuple[tuple[str, str | int | float], ...]
"""Pairs (name, text or number) that become attributes of a dataset."""


def describe(value: object) -> str:
    """Return a text that describes a value, such as "Tsit5(scan_kind=None)", as results record it.

    Dataclasses are described by name and fields, functions and classes by name, and other objects
    by their class alone. The store of a sweep compares such texts.
    """
    if isinstance(value, partial):
        return f"partial({describe([value.func, value.args, value.keywords])})"
    # Numbers are shown as in Python, since the `repr` of an array depends on NumPy's print options.
    if isinstance(value, np.ndarray | jax.Array | np.generic):
        text = repr(np.asarray(value).tolist())
        return text if len(text) <= LONGEST else f"{text[:LONGEST]}..."
    if is_dataclass(value) and not isinstance(value, type):
        parts = [f"{f.name}={describe(getattr(value, f.name))}" for f in fields(value)]
        return f"{type(value).__name__}({', '.join(parts)})"
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{k}: {describe(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(describe(part) for part in value) + "]"
    if isinstance(value, str | int | float | bool | None):
        return repr(value)
    # A function has a name; of any other object only the class is known.
    return getattr(value, "__qualname__", type(value).__name__)


def described(values: Mapping[str, object]) -> dict[str, str]:
    return {name: describe(value) for name, value in values.items()}


@cached_by_numbers
def setting_notes(values: dict[str, object]) -> Notes:
    """Return the `values` of settings, by field, as attributes "setting_<field>" of a dataset."""
    return tuple((f"setting_{name}", _note(value)) for name, value in values.items())


def _note(value: object) -> str | int | float:
    plain = isinstance(value, int | float) and not isinstance(value, bool)
    return value if plain else describe(value)  # pyright: ignore


@cache
def versions() -> dict[str, str]:
    """Return the versions of clearjoint, JAX and diffrax, under "version of <name>"."""
    by_package = {}
    for name in ("clearjoint", "jax", "diffrax"):
        try:
            by_package[f"version of {name}"] = version(name)
        except PackageNotFoundError:
            by_package[f"version of {name}"] = "unknown"
    return by_package


COMPONENT, COMPONENTS = "component", ("x", "y", "z")
"""Name of the dimension along the components of a vector; labels of the components."""


class Labelled(NamedTuple):
    """A variable of a dataset: `values` with the dimensions `dims`; `unit`, ``None`` if unknown;
    `description`, which becomes the attribute "long_name"; and further `attributes`."""

    dims: tuple[str, ...]
    values: ArrayLike
    unit: str | None = None
    description: str = ""
    attributes: Mapping[str, object] = {}


def labelled_dataset(
    title: str,
    variables: Mapping[str, Labelled],
    coordinates: Mapping[str, Labelled],
    notes: Notes = (),
) -> "xr.Dataset":
    # Importing xarray takes long, so it is imported only when it is needed.
    import xarray as xr

    taken = [name for name in variables if name in coordinates]
    expected = f"other names than those of the coordinates, {[*coordinates]}"
    require(not taken, "names", taken, expected, "rename the outputs or channels")
    parts = [{n: _variable(array) for n, array in d.items()} for d in (variables, coordinates)]
    programs = (f"{name.removeprefix('version of ')} {text}" for name, text in versions().items())
    attributes = {"Conventions": "CF-1.11", "title": title, "source": ", ".join(programs)}
    return xr.Dataset(*parts, attrs={**attributes, **dict(notes)})


def estimate_labels(units: Mapping[str, str]) -> dict[str, Labelled]:
    """Return the coordinates of a dataset of estimates: names of parameters, their `units`, given
    by the parameter's name, and "low" and "high" for the bounds of intervals."""
    along = ("parameter",)
    return {
        "parameter": Labelled(along, texts([*units])),
        "unit": Labelled(along, texts([*units.values()])),
        "bound": Labelled(("bound",), texts(["low", "high"])),
    }


def texts(labels: ArrayLike) -> np.ndarray:
    """Return labels as an array of texts, also if there are none: `np.asarray([])` has floats."""
    return np.array(np.asarray(labels).tolist(), dtype=str)


def _variable(array: Labelled) -> tuple[tuple[str, ...], np.ndarray, dict[str, object]]:
    possible = {"units": array.unit, "long_name": array.description or None, **array.attributes}
    attributes = {name: value for name, value in possible.items() if value is not None}
    return array.dims, np.asarray(array.values), attributes


IN_FRONT = (
    *("body", "contact", "bristle_contact", "joint", "journal", "reaction", "rigid_contact"),
    "remembered",
)
"""Dimensions whose labels precede a variable's name in the name of a column, as "arm" does in
"arm.position.x"; labels of other dimensions, such as "x", follow it."""


class AbstractTabular(abc.ABC):
    """Base class of results that can be exported; a subclass defines `to_xarray`.

    ```python
    import clearjoint as cj
    import numpy as np

    crossings = cj.results.Crossings(np.array([0.1, 0.2]), {"x": np.ones(2)}, {"x": "m"})
    print(crossings.to_dataframe().columns.tolist())  # ["x [m]"]
    ```
    """

    @abc.abstractmethod
    def to_xarray(self) -> "xr.Dataset":
        """Return an `xarray.Dataset` with units, descriptions ("long_name") and the versions of the
        programs as attributes."""

    def to_dataframe(self) -> "pd.DataFrame":
        """Return a `pandas.DataFrame` with a row for each time, impact, crossing or parameter.

        The index has the labels of the rows, such as times in s. Each component of each variable
        has a column, whose name has the unit, such as "arm.position.x [m]".
        """
        return to_frame(self.to_xarray())

    def to_csv(self, path: str | PathLike[str]) -> None:
        """Write the data frame without loss to a CSV file, with units in the header, for
        spreadsheets and `clearjoint.read_csv`."""
        self.to_dataframe().to_csv(path)

    def to_netcdf(self, path: str | PathLike[str]) -> None:
        r"""Write the dataset of `to_xarray` to a netCDF classic file (64-bit offsets) without loss.

        The writer of this format supports only Latin-1 in names. Other characters in names of
        variables and dimensions are escaped ("\\u8f74"), and a variable's attribute "original_name"
        has the unescaped name.

        **Raises:** `ValueError` for a variable or dimension without a name.
        """
        write_netcdf(self.to_xarray(), path)


def write_netcdf(dataset: "xr.Dataset", path: str | PathLike[str]) -> None:
    # Names of variables and dimensions that have characters outside Latin-1, with the names that
    # are written instead.
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
    """Return the header of a column, with the unit in the attributes: "pin.penetration [m]"."""
    return f"{name} [{attributes['units']}]" if attributes.get("units") else name


def to_frame(dataset: "xr.Dataset", rows: str | None = None) -> "pd.DataFrame":
    """Return a data frame with a row for each label along `rows`, by default the first dimension.

    A variable gets a column for each combination of labels along its other dimensions, such as
    "arm.position.x [m]". Variables and coordinates without the dimension `rows` are left out.
    Numbers of a variable with the attribute "flag_meanings", such as result codes, become their
    meanings, or, if they have none there, texts of their digits.
    """
    import pandas as pd

    rows = next(iter(map(str, dataset.sizes))) if rows is None else rows
    # Coordinates other than the index become columns.
    columns = {}
    for name in (*dataset.coords, *dataset.data_vars):
        if name != rows and rows in dataset[name].dims:
            columns |= _columns(str(name), dataset[name], rows)
    index = pd.Index(dataset[rows].values, name=header(rows, dataset[rows].attrs))
    return pd.DataFrame(columns, index=index)


def _columns(name: str, array: "xr.DataArray", rows: str) -> dict[str, np.ndarray]:
    others = [str(dim) for dim in array.dims if dim != rows]  # dimensions other than the rows
    values, attributes = array.transpose(rows, *others).values, array.attrs
    if "flag_meanings" in attributes:  # the texts of the meanings have no unit
        values, attributes = _meanings(values, attributes), {}
    columns = {}
    # One column for each combination of indices along the other dimensions.
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

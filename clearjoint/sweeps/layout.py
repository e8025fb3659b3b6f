"""Layout of a sweep's results: shapes and labels, known before the sweep runs.

The lanes of a sweep are numbered from 0. They are all combinations of the axes' values, the last
axis fastest, or, if zipped, the i-th lane has the i-th value of each axis. Lanes are computed and
stored in chunks of equal size (the last may be shorter); the results of a chunk are a dictionary of
arrays whose first dimension is the lanes of the chunk.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..fields.checks import require, require_array_names, require_count, require_finite
from ..fields.types import ArrayLike

if TYPE_CHECKING:
    import xarray as xr

LANE = "lane"
RESULT = "result"
BY_LANE = "by_lane"
"""Folder of a store with the results by lane; variables and axes can't have this name."""
PENDING = -1
"""Result code of a lane that has not been computed."""
LaneArrays = dict[str, np.ndarray]
"""Results by variable, of one lane (...) or of several lanes (lanes, ...)."""
Note = str | int | float | bool


class Coordinate(NamedTuple):
    """Labels along a dimension of the results.

    - `name`: name of the dimension.
    - `values`: (n,) numbers or texts.
    - `unit`: unit of the numbers; "1" if they have none.
    """

    name: str
    values: np.ndarray
    unit: str = "1"

    @property
    def attributes(self) -> dict[str, str]:
        """Attribute "units" of the CF conventions; empty for texts."""
        return {} if self.values.dtype.kind == "U" else {"units": self.unit}


class Variable(NamedTuple):
    """A result of every lane, such as a peak force or a table of impacts.

    Entries that have not been computed are NaN, -1 in integers and false in truth values.

    - `dims`, `shape`: names and sizes of the dimensions that follow the lane dimension.
    - `dtype`: type of the entries, by NumPy's name.
    - `unit`, `description`: texts for readers.
    - `attrs`: further attributes, for example the `flag_values` and `flag_meanings` of a code.
    """

    dims: tuple[str, ...] = ()
    shape: tuple[int, ...] = ()
    dtype: str = "float64"
    unit: str = "1"
    description: str = ""
    attrs: Mapping[str, Any] = {}

    @property
    def fill(self) -> bool | int | float:
        """Value of entries that have not been computed: NaN, -1 or false, by type."""
        fills: dict[str, bool | int | float] = {"b": False, "i": PENDING}
        return fills.get(np.dtype(self.dtype).kind, np.nan)

    @property
    def attributes(self) -> dict[str, Any]:
        """Unit, description and further attributes, named by the CF conventions."""
        return {"units": self.unit, "long_name": self.description, **self.attrs}


@dataclass(frozen=True, eq=False)
class Layout:
    """The shape, the labels and the settings of a sweep.

    **Arguments:**

    - `axes`: the swept values, one `Coordinate` for each axis.
    - `chunk`: number of lanes in a chunk.
    - `variables`: results by name. One is ``"result"``: a signed integer for each lane, zero or
      positive, whose presence marks the lane as done.
    - `coordinates`: labels of the variables' other dimensions.
    - `settings`: settings on which the numbers depend: texts, numbers and truth values by name.
      Infinities and NaN, which JSON lacks, become texts.
    - `zipped`: whether the i-th lane has the i-th value of every axis; otherwise the lanes are all
      combinations.
    - `notes`: texts, numbers and truth values for readers, by name. A store ignores differences
      between notes, for example in the name of a function.

    **Raises:** `ValueError` for names that occur twice, for sizes or shapes that disagree, and for
    variables without a valid ``"result"``.
    """

    axes: tuple[Coordinate, ...]
    chunk: int
    variables: Mapping[str, Variable]
    coordinates: tuple[Coordinate, ...] = ()
    settings: Mapping[str, Note] = field(default_factory=dict)
    zipped: bool = False
    notes: Mapping[str, Note] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for part in ("settings", "notes"):
            given = getattr(self, part)
            plain = {_netcdf_name(name): _setting(name, v) for name, v in given.items()}
            object.__setattr__(self, part, plain)
        object.__setattr__(self, "axes", tuple(map(_labels, self.axes)))
        object.__setattr__(self, "coordinates", tuple(map(_labels, self.coordinates)))
        self._check_names()
        self._check_variables()
        code = {RESULT: _with_pending(self.variables[RESULT])}
        object.__setattr__(self, "variables", {**self.variables, **code})

    def _check_names(self) -> None:
        labelled = (*self.axes, *self.coordinates)
        for name, values, _ in labelled:
            one_row = values.ndim == 1 and values.size > 0
            require(one_row, name, values, "a row of values", "pass an array of shape (n,)")
        further = {dim for v in self.variables.values() for dim in v.dims}
        further -= {c.name for c in self.coordinates}
        names = [LANE, *(c.name for c in labelled), *self.variables, *further]
        free = BY_LANE not in names
        require(free, "axes and outputs", BY_LANE, "other names", "rename the axis or output")
        twice = sorted({name for name in names if names.count(name) > 1})
        require_array_names("variables", self.variables, "name every result")
        require(not twice, "axes", twice, "names that occur once", "rename the axis")
        require_count("chunk", self.chunk, "pass 1 or more lanes")
        sizes = [c.values.size for c in self.axes]
        count = len(set(sizes)) if self.zipped else len(sizes)
        fits = count == 1 if self.zipped else count > 0
        expected = "one or more axes, of equal length if zipped"
        require(fits, "axes", sizes, expected, "pass at least one axis, or equally many values")

    def _check_variables(self) -> None:
        code = self.variables.get(RESULT)
        signed = code is not None and np.dtype(code.dtype).kind == "i" and code.shape == ()
        expected = "a signed integer for each lane"
        require(signed, "variables: result", code, expected, 'add one with dtype "int8"')
        sizes = {c.name: c.values.size for c in self.coordinates}
        for name, variable in self.variables.items():
            fits = len(variable.dims) == len(variable.shape) and all(
                size == sizes.get(dim, size)
                for dim, size in zip(variable.dims, variable.shape, strict=True)
            )
            shape = variable.shape
            expected = f"as long as the coordinates of {variable.dims}"
            require(fits, f"variables: {name}", shape, expected, "make shape and dims agree")
            kind = np.dtype(variable.dtype).kind
            expected = "a type of real or complex numbers, signed integers or truth values"
            require(kind in "bifc", f"variables: {name}", variable.dtype, expected, "convert it")

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of values along each axis; (lanes,) if zipped."""
        sizes = tuple(axis.values.size for axis in self.axes)
        return sizes[:1] if self.zipped else sizes

    @property
    def lanes(self) -> int:
        """Number of lanes of the whole sweep."""
        return int(np.prod(self.shape))

    @property
    def chunks(self) -> int:
        """Number of chunks in the sweep."""
        return -(-self.lanes // self.chunk)

    def span(self, chunk: int) -> slice:
        """Return the lanes of the chunk with number `chunk` as a slice."""
        return slice(chunk * self.chunk, min((chunk + 1) * self.chunk, self.lanes))

    def values(self) -> dict[str, np.ndarray]:
        """Return by name of the axis its value in every lane, (lanes,)."""
        columns = [axis.values for axis in self.axes]
        if not self.zipped:
            columns = [grid.ravel() for grid in np.meshgrid(*columns, indexing="ij")]
        return {axis.name: column for axis, column in zip(self.axes, columns, strict=True)}

    def pending(self) -> dict[str, np.ndarray]:
        """Return by name of the variable an array for all lanes, full of its fill value."""
        return {
            name: np.full((self.lanes, *v.shape), v.fill, v.dtype)
            for name, v in self.variables.items()
        }

    def checked(self, lanes: int, arrays: Mapping[str, ArrayLike]) -> LaneArrays:
        """Return the results of `lanes` lanes, by variable, as NumPy arrays (lanes, ...).

        **Raises:** `ValueError` unless the results have the names, shapes and types of the
        variables, and result codes that are not negative.
        """
        names = sorted(self.variables)
        require(sorted(arrays) == names, "arrays", sorted(arrays), str(names), "rename")
        results = {name: np.asarray(arrays[name]) for name in self.variables}
        for name, variable in self.variables.items():
            shape, array = (lanes, *variable.shape), results[name]
            same = array.shape == shape and array.dtype == np.dtype(variable.dtype)
            actual, expected = f"{array.dtype}{array.shape}", f"{variable.dtype}{shape}"
            require(same, f"arrays: {name}", actual, expected, "return this type and shape")
        codes = results[RESULT]
        require(bool((codes >= 0).all()), "arrays: result", codes, "codes >= 0", "-1 is pending")
        return results


def dataset(layout: Layout, arrays: Mapping[str, np.ndarray]) -> "xr.Dataset":
    """Return the results of all lanes as a dataset along the sweep's axes.

    The dataset has units, and the layout's settings and notes as attributes. If zipped, the
    dimension is `lane` and the axes are its coordinates.

    **Arguments:** `arrays`: by variable, its values in all lanes, (lanes, ...).
    """
    import xarray as xr

    dims = (LANE,) if layout.zipped else tuple(axis.name for axis in layout.axes)
    along = [LANE] * len(layout.axes) if layout.zipped else list(dims)
    along += [c.name for c in layout.coordinates]
    coordinates = {
        c.name: (dim, c.values, c.attributes)
        for dim, c in zip(along, (*layout.axes, *layout.coordinates), strict=True)
    }
    data = {
        name: (
            (*dims, *variable.dims),
            arrays[name].reshape(*layout.shape, *variable.shape),
            variable.attributes,
        )
        for name, variable in layout.variables.items()
    }
    return xr.Dataset(data, coordinates, {**layout.settings, **layout.notes})


def _labels(coordinate: Coordinate) -> Coordinate:
    """Return the coordinate with its values as an array of numbers or of texts, after a check."""
    name, values, unit = coordinate
    values = np.asarray(values)
    if values.dtype.kind in "bif":
        require_finite(name, values)
        return Coordinate(name, values, unit)
    return Coordinate(name, np.array(values.tolist(), dtype=str))


def _with_pending(code: Variable) -> Variable:
    """Return the variable of result codes with "pending" as an additional first flag."""
    values = [int(value) for value in code.attrs.get("flag_values", ()) if value != PENDING]
    meanings = code.attrs.get("flag_meanings", "").removeprefix("pending").strip()
    flags = {
        "flag_values": [PENDING, *values],
        "flag_meanings": f"pending {meanings}".strip(),
    }
    return code._replace(attrs={**code.attrs, **flags})


def _netcdf_name(name: str) -> str:
    """Return the name of an attribute with "_" for characters that netCDF forbids."""
    return name.translate({ord(c): "_" for c in "/'"}).rstrip()


def _setting(name: str, value: Any) -> Note:
    if isinstance(value, np.generic):
        value = value.item()
    plain = isinstance(value, str | int | float | bool)
    require(plain, f"settings: {name}", value, "a text, number or truth value", "pass its repr")
    return str(value) if isinstance(value, float) and not np.isfinite(value) else value

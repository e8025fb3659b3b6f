"""Layout of a sweep's results: shapes and labels, which are known before the sweep runs.

The lanes of a sweep are numbered from 0. They are all combinations of the axes' values, those of
the last axis varying fastest. In a zipped sweep the i-th lane has the i-th value of each axis.
Lanes are computed and stored in chunks of equal size; the last chunk may be shorter. The results of
some lanes are a dictionary of arrays whose first dimension is the lanes.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..fields.checks import require, require_array_names, require_count

if TYPE_CHECKING:
    import xarray as xr

LANE = "lane"
"""Name of the dimension of lanes."""
RESULT = "result"
"""Name of the variable with the lanes' result codes."""
BY_LANE = "by_lane"
"""Folder of a store with the results by lane; variables and axes can't have this name."""
PENDING = -1
"""Result code of a lane that has not been computed, which is then called pending."""
LaneArrays = dict[str, np.ndarray]
"""Results by name of the variable, of one lane (...) or of several lanes (lanes, ...)."""


class Coordinate(NamedTuple):
    """Labels along a dimension of the results, such as the values of an axis or names of bodies.

    - `name`: name of the dimension.
    - `values`: (n,) numbers or texts.
    - `unit`: unit of the numbers; "1" if they have none.
    """

    name: str
    values: np.ndarray
    unit: str = "1"

    @property
    def attributes(self) -> dict[str, str]:
        """The attribute "units" of the CF conventions by its name; an empty dictionary for
        texts."""
        return {} if self.values.dtype.kind == "U" else {"units": self.unit}


class Variable(NamedTuple):
    """A result of every lane, such as a peak force or a table of impacts.

    - `dims`, `shape`: names and sizes of the dimensions after that of the lanes.
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
        """Value of entries that have not been computed: NaN for floats, -1 for integers, and false
        for truth values."""
        fills: dict[str, bool | int | float] = {"b": False, "i": PENDING}
        return fills.get(np.dtype(self.dtype).kind, np.nan)

    def pending(self, lanes: int) -> np.ndarray:
        """Return the entries for a number of lanes that have not been computed, (lanes, ...), all
        with the value `fill`."""
        return np.full((lanes, *self.shape), self.fill, self.dtype)

    @property
    def attributes(self) -> dict[str, Any]:
        """Unit, description and further attributes, named by the CF conventions."""
        return {"units": self.unit, "long_name": self.description, **self.attrs}


@dataclass(frozen=True, eq=False)
class Layout:
    """The shape, the labels and the settings of a sweep's results.

    It is known before the sweep runs, and serves to make its store and its dataset.

    **Arguments:**

    - `axes`: the swept values, one `Coordinate` for each axis.
    - `chunk`: number of lanes in a chunk.
    - `variables`: results by name. The variable ``"result"``, an integer for each lane, is
      `PENDING` until the lane has been computed.
    - `coordinates`: labels of the variables' other dimensions.
    - `settings`: texts by name, for settings on which the numbers depend.
    - `zipped`: whether the i-th lane has the i-th value of every axis; otherwise the lanes are all
      combinations.
    - `notes`: texts by name, for readers. A store ignores differences between notes, for example in
      the name of a function.

    **Raises:** `ValueError` for names that occur twice or equal `BY_LANE`, names of variables that
    can't be those of arrays, a `chunk` that is not a positive integer, no axes, and zipped axes of
    different lengths.
    """

    axes: tuple[Coordinate, ...]
    chunk: int
    variables: Mapping[str, Variable]
    coordinates: tuple[Coordinate, ...] = ()
    settings: Mapping[str, str] = field(default_factory=dict)
    zipped: bool = False
    notes: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        # Values are converted to arrays, and names to those that netCDF allows. The class is
        # frozen, so the fields are set by `object`.
        for part in ("axes", "coordinates"):
            object.__setattr__(self, part, tuple(map(_with_array, getattr(self, part))))
        for part in ("settings", "notes"):
            texts = {_netcdf_name(name): text for name, text in getattr(self, part).items()}
            object.__setattr__(self, part, texts)
        require_array_names("variables", self.variables, "name every result")
        # A dataset has one namespace for variables, labels and dimensions, and a store has a folder
        # for each of them beside the folder `BY_LANE`.
        labels = [c.name for c in (*self.axes, *self.coordinates)]
        dims = {dim for variable in self.variables.values() for dim in variable.dims}
        names = [LANE, *labels, *self.variables, *(dims - {c.name for c in self.coordinates})]
        free = BY_LANE not in names
        require(free, "axes and outputs", BY_LANE, "other names", "rename the axis or output")
        twice = sorted({name for name in names if names.count(name) > 1})
        require(not twice, "axes", twice, "names that occur once", "rename the axis")
        require_count("chunk", self.chunk, "pass 1 or more lanes")
        sizes = [c.values.size for c in self.axes]
        fits = len(set(sizes)) == 1 if self.zipped else len(sizes) > 0
        expected = "one or more axes, of equal length if zipped"
        require(fits, "axes", sizes, expected, "pass at least one axis, or equally many values")

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of values along each axis; (lanes,) if zipped."""
        sizes = tuple(axis.values.size for axis in self.axes)
        return sizes[:1] if self.zipped else sizes

    @property
    def lanes(self) -> int:
        """Number of lanes of the sweep."""
        return int(np.prod(self.shape))

    @property
    def chunks(self) -> int:
        """Number of chunks of the sweep."""
        return -(-self.lanes // self.chunk)

    def span(self, chunk: int) -> slice:
        """Return the range of lanes of the chunk with the given number."""
        return slice(chunk * self.chunk, min((chunk + 1) * self.chunk, self.lanes))

    def values(self) -> dict[str, np.ndarray]:
        """Return the value of each axis in every lane, (lanes,), by name of the axis."""
        columns = [axis.values for axis in self.axes]
        if not self.zipped:
            columns = [grid.ravel() for grid in np.meshgrid(*columns, indexing="ij")]
        return {axis.name: column for axis, column in zip(self.axes, columns, strict=True)}

    def pending(self) -> LaneArrays:
        """Return the results of all lanes, before any of them has been computed."""
        return {name: variable.pending(self.lanes) for name, variable in self.variables.items()}


def dataset(layout: Layout, arrays: Mapping[str, np.ndarray]) -> "xr.Dataset":
    """Return the results of all lanes as a dataset along the sweep's axes.

    The dataset has the units, and the layout's settings and notes as attributes. If the sweep is
    zipped, its dimension is `LANE`, along which the axes are coordinates.

    **Arguments:** `arrays`: by name of the variable, its values in all lanes, (lanes, ...).
    """
    import xarray as xr

    # If the sweep is zipped, there is one dimension of lanes, along which the axes are labels.
    # Otherwise each axis is a dimension of its own, and results are reshaped from lanes to axes.
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


def _with_array(coordinate: Coordinate) -> Coordinate:
    """Return a coordinate whose values are an array of numbers or truth values. If they are
    anything else, it is an array of texts, and the unit is dropped."""
    values = np.asarray(coordinate.values)
    if values.dtype.kind in "bif":
        return coordinate._replace(values=values)
    return Coordinate(coordinate.name, np.array(values.tolist(), dtype=str))


def _netcdf_name(name: str) -> str:
    """Return the name of an attribute in a form that netCDF allows: with "_" in place of slashes
    and apostrophes, and without spaces at the end."""
    return name.translate({ord(c): "_" for c in "/'"}).rstrip()

"""Outputs of a sweep, and the shapes and labels of its results, both known before it runs."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._fields.checks import require, require_array_names, require_count
from .._math.vectors import pack
from .._model.scene import Scene
from .._simulation.results.solution import STATE_PARTS
from .._simulation.run.outputs import Requested
from ..quantities.base import Instant, Quantity

if TYPE_CHECKING:
    import xarray as xr

LANE = "lane"
"""Name of the dimension of lanes."""
RESULT = "result"
"""Name of the variable with the lanes' result codes."""
NOT_OUTPUTS = (RESULT, "time_reached", "attempts", "accepted")
"""Names of the variables that a sweep has besides outputs and states: one number for each lane."""
BY_LANE = "by_lane"
"""Folder of a store with the results by lane; variables and axes can't have this name."""
PENDING = -1
"""Result code of a lane that has not been computed yet."""
LaneArrays = dict[str, np.ndarray]
"""Results of one or more lanes, (lanes, ...), by name of the variable."""


class Coordinate(NamedTuple):
    """Labels along a dimension of the results, such as the values of an axis or names of bodies."""

    name: str
    values: np.ndarray
    unit: str = "1"

    @property
    def attributes(self) -> dict[str, str]:
        """Attributes in a dataset, by the CF conventions: the unit; none if labels are texts."""
        return {} if self.values.dtype.kind == "U" else {"units": self.unit}


class Variable(NamedTuple):
    """A result of every lane, such as a peak force or a table of impacts. `dims` and `shape` are
    names and sizes of the dimensions after that of the lanes; `attrs` are further attributes, such
    as the `flag_values` and `flag_meanings` of a code."""

    dims: tuple[str, ...] = ()
    shape: tuple[int, ...] = ()
    dtype: str = "float64"
    unit: str = "1"
    description: str = ""
    attrs: Mapping[str, Any] = {}

    @property
    def fill(self) -> bool | int | float:
        """Value of entries of pending lanes."""
        fills: dict[str, bool | int | float] = {"b": False, "i": PENDING}
        return fills.get(np.dtype(self.dtype).kind, np.nan)

    def pending(self, lanes: int) -> np.ndarray:
        """Return the array of a number of `lanes` without results yet, filled with `fill`."""
        return np.full((lanes, *self.shape), self.fill, self.dtype)

    @property
    def attributes(self) -> dict[str, Any]:
        """Attributes in a dataset, by the CF conventions; an unknown unit is left out."""
        units = {"units": self.unit} if self.unit else {}
        return {**units, "long_name": self.description, **self.attrs}


@dataclass(frozen=True, eq=False)
class Layout:
    """The shape, the labels and the settings of a sweep's results.

    - `axes`: the swept values; `zipped`: whether the i-th lane has the i-th value of each axis.
    - `chunk`: number of lanes in a chunk.
    - `variables`: results by name, with the result code as "result" among them.
    - `coordinates`: labels along dimensions of variables.
    - `settings`: texts by name, for settings on which the results depend.
    - `notes`: texts by name, for readers. A store ignores differences between notes, for example in
      the name of a function.
    """

    axes: tuple[Coordinate, ...]
    chunk: int
    variables: Mapping[str, Variable]
    coordinates: tuple[Coordinate, ...] = ()
    settings: Mapping[str, str] = field(default_factory=dict)
    zipped: bool = False
    notes: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        # Values of axes and labels are converted to arrays, and names of settings and notes, which
        # become attributes, to those that netCDF allows. The class is frozen, so the fields are set
        # by `object`.
        for part in ("axes", "coordinates"):
            object.__setattr__(self, part, tuple(map(_with_array, getattr(self, part))))
        for part in ("settings", "notes"):
            object.__setattr__(self, part, _netcdf_named(getattr(self, part)))
        require_array_names("variables", self.variables, "name every result")
        # A dataset has one namespace for variables, labels and dimensions, and a store has a folder
        # for each variable and each array of labels beside the folder `BY_LANE`. A dimension with
        # labels rightly has the name of these labels, so only dimensions without labels are added.
        labels = [c.name for c in (*self.axes, *self.coordinates)]
        dims = {dim for variable in self.variables.values() for dim in variable.dims}
        names = [LANE, *labels, *self.variables, *(dims - {c.name for c in self.coordinates})]
        free = BY_LANE not in names
        require(free, "axes and outputs", BY_LANE, "other names", "rename the axis or output")
        twice = sorted({name for name in names if names.count(name) > 1})
        remedy = "rename the axis or output"
        require(not twice, "axes and outputs", twice, "names that occur once", remedy)
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
        return int(np.prod(self.shape))

    @property
    def chunks(self) -> int:
        return -(-self.lanes // self.chunk)

    def span(self, chunk: int) -> slice:
        return slice(chunk * self.chunk, min((chunk + 1) * self.chunk, self.lanes))

    def values(self) -> dict[str, np.ndarray]:
        """Return the value in every lane, (lanes,), of each axis by name."""
        columns = [axis.values for axis in self.axes]
        if not self.zipped:
            columns = [grid.ravel() for grid in np.meshgrid(*columns, indexing="ij")]
        return {axis.name: column for axis, column in zip(self.axes, columns, strict=True)}

    def pending(self) -> LaneArrays:
        """Return arrays for all lanes without results yet, filled as by `Variable.pending`."""
        return {name: variable.pending(self.lanes) for name, variable in self.variables.items()}


def dataset(layout: Layout, arrays: Mapping[str, np.ndarray]) -> "xr.Dataset":
    """Return the results of all lanes as the dataset of `sweep`."""
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
    data = {}
    for name, variable in layout.variables.items():
        values = arrays[name].reshape(*layout.shape, *variable.shape)
        data[name] = (*dims, *variable.dims), values, variable.attributes
    return xr.Dataset(data, coordinates, {**layout.settings, **layout.notes})


def _with_array(coordinate: Coordinate) -> Coordinate:
    """Return the coordinate with its values as an array: of numbers, of bools, or else of texts."""
    values = np.asarray(coordinate.values)
    if values.dtype.kind in "biuf":
        return coordinate._replace(values=values)
    return Coordinate(coordinate.name, np.array(values.tolist(), dtype=str))


def _netcdf_named(attributes: Mapping[str, str]) -> dict[str, str]:
    """Return attributes under names that netCDF allows: with "_" in place of slashes and
    apostrophes, without spaces at the end, and with a number after a name that is taken already."""
    named: dict[str, str] = {}
    for name, text in attributes.items():
        allowed = unique = name.translate({ord(c): "_" for c in "/'"}).rstrip()
        number = 1
        while unique in named:
            number += 1
            unique = f"{allowed} ({number})"
        named[unique] = text
    return named


class PartOfStates(eqx.Module):
    """Quantity: one part of the states of all bodies, such as "position"."""

    is_array: ClassVar[bool] = True
    part: str = eqx.field(static=True)
    bodies: tuple[str, ...] = eqx.field(static=True)

    def __call__(self, now: Instant) -> Float[Array, "bodies parts"]:
        return jnp.stack([pack(getattr(now.bodies[name], self.part)) for name in self.bodies])


def sampled_channels(requested: Requested, scene: Scene) -> dict[str, Quantity]:
    """Return the quantities that each lane samples at the times to save at: a quantity "x" among
    the outputs by the key "/x", and parts of the states by their names (see `variable_name`)."""
    bodies = tuple(scene.bodies)
    channels = {f"/{name}": quantity for name, quantity in requested.quantities.items()}
    if requested.save.states:
        channels |= {part: PartOfStates(part, bodies) for part in STATE_PARTS}
    return channels


def variable_name(output: str, key: str) -> str:
    """Return the name of the variable with one result, named `key`, of an output: "output_key";
    "output" for an empty key; "name" for a key "/name". Names of outputs contain no slash."""
    if key.startswith("/"):
        return key[1:]
    return f"{output}_{key}" if key else output

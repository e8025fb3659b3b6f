"""Outputs of a sweep, and the shapes and labels of its results, which are known before it runs."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._fields.checks import errors_about, require, require_array_names, require_count
from .._fields.types import ArrayLike
from .._math.vectors import pack
from .._model.scene import Scene
from .._simulation.reductions.base import AbstractReduction, Instants, Window, check_reductions
from .._simulation.results.solution import STATE_PARTS
from .._simulation.run.saving import Saving
from .._simulation.run.sections import Channels, Section, check_channels, check_quantities
from .._simulation.step.settings import strictly_rising_times
from ..quantities.base import Instant, require_known

if TYPE_CHECKING:
    import xarray as xr

LANE = "lane"
"""Name of the dimension of lanes."""
RESULT = "result"
"""Name of the variable with the lanes' result codes."""
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
        """Attribute "units", as in the CF conventions; none for texts."""
        return {} if self.values.dtype.kind == "U" else {"units": self.unit}


class Variable(NamedTuple):
    """A result of every lane, such as a peak force or a table of impacts.

    `dims` and `shape` are those after the dimension of lanes. `attrs` are further attributes, for
    example the `flag_values` and `flag_meanings` of a code.
    """

    dims: tuple[str, ...] = ()
    shape: tuple[int, ...] = ()
    dtype: str = "float64"
    unit: str = "1"
    description: str = ""
    attrs: Mapping[str, Any] = {}

    @property
    def fill(self) -> bool | int | float:
        """Value of entries that have not been computed."""
        fills: dict[str, bool | int | float] = {"b": False, "i": PENDING}
        return fills.get(np.dtype(self.dtype).kind, np.nan)

    def pending(self, lanes: int) -> np.ndarray:
        """Return the entries for a number of lanes that have not been computed."""
        return np.full((lanes, *self.shape), self.fill, self.dtype)

    @property
    def attributes(self) -> dict[str, Any]:
        """Attributes, named by the CF conventions."""
        return {"units": self.unit, "long_name": self.description, **self.attrs}


@dataclass(frozen=True, eq=False)
class Layout:
    """The shape, the labels and the settings of a sweep's results.

    - `axes`: the swept values; `coordinates`: labels along dimensions of variables that have any.
    - `variables`: results by name, with ``"result"``, the result code, among them.
    - `settings`: texts by name, for settings on which the numbers depend.
    - `notes`: texts by name, for readers. A store ignores differences between notes, for example in
      the name of a function.

    **Raises:** `ValueError` for a name that occurs twice among axes, variables, labels and other
    dimensions, of which `LANE` is one, or that equals `BY_LANE`; for names of variables that are
    empty, contain a slash or backslash, or begin with "." or "__"; for a `chunk` that is not a
    positive integer; for no axes; and for zipped axes of different lengths.
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
        """Return the range of lanes of a chunk."""
        return slice(chunk * self.chunk, min((chunk + 1) * self.chunk, self.lanes))

    def values(self) -> dict[str, np.ndarray]:
        """Return the value of each axis in every lane, by name of the axis."""
        columns = [axis.values for axis in self.axes]
        if not self.zipped:
            columns = [grid.ravel() for grid in np.meshgrid(*columns, indexing="ij")]
        return {axis.name: column for axis, column in zip(self.axes, columns, strict=True)}

    def pending(self) -> LaneArrays:
        """Return the results of all lanes before any of them has been computed."""
        return {name: variable.pending(self.lanes) for name, variable in self.variables.items()}


def dataset(layout: Layout, arrays: Mapping[str, np.ndarray]) -> "xr.Dataset":
    """Return the results of all lanes as a dataset along the sweep's axes, or along `LANE` if
    zipped, with units, and with settings and notes as attributes."""
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
    """A coordinate with an array of numbers or truth values; other values become texts without
    unit."""
    values = np.asarray(coordinate.values)
    if values.dtype.kind in "biuf":
        return coordinate._replace(values=values)
    return Coordinate(coordinate.name, np.array(values.tolist(), dtype=str))


def _netcdf_named(attributes: Mapping[str, str]) -> dict[str, str]:
    """Attributes by names that netCDF allows: with "_" in place of slashes and apostrophes, without
    spaces at the end, and with a number appended to a name that is already taken."""
    named: dict[str, str] = {}
    for name, text in attributes.items():
        allowed = unique = name.translate({ord(c): "_" for c in "/'"}).rstrip()
        number = 1
        while unique in named:
            number += 1
            unique = f"{allowed} ({number})"
        named[unique] = text
    return named


SAVED = "saved"
"""Prefix of the variables with saved states, such as "saved_position", the positions of all
bodies."""
PASS_TABLE = 'pass outputs={"hits": cj.ImpactTable(20)}, which keeps the first 20 of each contact'


@dataclass(frozen=True)
class Saved:
    """Quantities at given times, computed with the solver's dense output.

    The output "path" with a channel "x" gives the results ``path_time``, s, and ``path_x``, (K,) in
    each lane. Entries for times that a failed lane has not reached are NaN.

    **Arguments:**

    - `times`: (K,) strictly rising times within the run; or a function of the lane's scene that
      returns K such times for every lane, for example one in each revolution of a crank whose speed
      is swept.
    - `channels`: the quantities to record, by name: pairs of a function of an `Instant`, such as
      those of `clearjoint.quantities`, and its unit as text.

    **Raises:** `ValueError` if there are no channels, or if they are not such pairs; and for a
    channel whose name is empty, "time" or "count", contains a slash or backslash, or begins with
    "." or "__".

    >>> offset = cj.quantities.JournalOffset("shoulder", "x")
    >>> saved = cj.Saved(np.linspace(0.0, 0.1, 5), {"x": (offset, "m")})
    >>> saved.times.shape
    (5,)
    """

    times: ArrayLike | Callable[[Scene], ArrayLike]
    channels: Channels

    def __post_init__(self) -> None:
        check_channels(self.channels)

    def check(self, scene: Scene) -> None:
        """Raise a `ValueError` if the scene lacks a body or joint that a channel names."""
        check_quantities(self.channels, scene)

    def at(self, scene: Scene) -> np.ndarray:
        """Return the times at which the quantities are recorded in a lane.

        **Raises:** `ValueError` for times that are not a row of finite numbers, or that don't rise
        strictly.
        """
        chosen = np.asarray(self.times(scene) if callable(self.times) else self.times)
        times = np.asarray(strictly_rising_times(chosen, "times"))
        # Single precision is kept, because later checks allow for its rounding errors.
        return chosen if chosen.dtype.kind == "f" else times


@dataclass(frozen=True)
class ImpactTable:
    """Table of the finished impacts of a lane, with the columns of `simulate`'s table.

    For each contact, labelled by joint and contact such as "pin V", the table has the first `count`
    impacts: onset, separation, duration and peak time, s, entry and exit speed, m/s, peak force, N,
    and largest penetration, m. Rows after the recorded impacts are NaN. The table also has the
    number of recorded impacts of each contact; a contact with `count` of them may have had more. A
    quantile of the peak forces is ``sweep.hits_peak_force.quantile(0.95, ["hits_contact",
    "hits_number"])``, for an output named "hits".

    **Arguments:**

    - `count`: number of impacts kept for each contact.
    - `joint`: name of the joint whose contacts are recorded; by default all joints with contacts.
    - `after`, `until`: start and end of a time window; by default the whole run. An impact is
      recorded if its onset lies in the window. Each may be a function of the scene that returns a
      time and that JAX can trace, so that the window follows the values of the lane.

    **Raises:** `ValueError` for a count that is not a positive integer, for times that are NaN or
    not single numbers, and for a window that does not end after its start.

    >>> scene, _ = cj.mechanisms.double_pendulum()
    >>> cj.ImpactTable(count=20, joint="shoulder").contacts(scene)
    [('shoulder', 'V'), ('shoulder', 'W')]
    """

    count: int
    joint: str | None = None
    after: Instants = None
    until: Instants = None

    def __post_init__(self) -> None:
        require_count("count", self.count, "pass a number of impacts")
        self.window()

    def window(self) -> Window | None:
        """Return the time window in which impacts must begin; ``None`` for the whole run."""
        window = Window(self.after, self.until)
        return None if self.after is None and self.until is None else window

    def check(self, scene: Scene) -> None:
        """Raise a `ValueError` if the scene has no contacts, or lacks the joint of the table."""
        joints = scene.contact_joints()
        if self.joint is not None:
            require_known("joint", self.joint, joints)
        require(len(joints) > 0, "scene", {}, "one with contacts", "leave the table out")

    def contacts(self, scene: Scene) -> list[tuple[str, str]]:
        """Return the table's contacts as pairs of joint and label, such as ("shoulder", "V")."""
        laws = scene.laws()
        names = laws if self.joint is None else [self.joint]
        return [(name, label) for name in names for label in laws[name]]


class PartOfStates(eqx.Module):
    """Quantity whose value is one part of the states of all bodies, such as all positions, in the
    unit given by `STATE_PARTS`."""

    part: str = eqx.field(static=True)
    bodies: tuple[str, ...] = eqx.field(static=True)

    def __call__(self, now: Instant) -> Float[Array, "bodies parts"]:
        return jnp.stack([pack(getattr(now.bodies[name], self.part)) for name in self.bodies])


class StatesOfLanes:
    """Output with the states of all bodies at given times, for which the argument `save` of `sweep`
    asks."""

    def __init__(self, times: Float[np.ndarray, " K"], scene: Scene):
        self.times, bodies = times, tuple(scene.bodies)
        self.channels = {
            part: (PartOfStates(part, bodies), unit) for part, (_, unit) in STATE_PARTS.items()
        }

    def check(self, scene: Scene) -> None:
        """Accept every scene."""

    def at(self, scene: Scene) -> np.ndarray:
        """Return the times, which don't depend on the scene."""
        del scene
        return self.times


AnySaved = Saved | StatesOfLanes
"""Outputs at given times: `channels` are pairs (quantity, unit) by name, `at` returns the times."""
Output = AbstractReduction | AnySaved | Section | ImpactTable


def with_saving(outputs: Mapping[str, Output], save: Saving, scene: Scene) -> dict[str, Output]:
    """Return all outputs of a sweep by name: `outputs` and those for which `save` asks.

    **Raises:** `ValueError` for a `save` with steps or impacts, which sweeps don't support, for
    names of `outputs` that can't be those of arrays (see `Layout`), and for a name in both
    `outputs` and `save`.
    """
    require_array_names("outputs", outputs, 'pass for example {"hits": cj.ImpactCount("pin")}')
    save.require_none(["steps"], "in a sweep", "pass the lane's scene to simulate() for them")
    require(not save.impacts, "impacts", True, "False in a sweep", PASS_TABLE)
    further: dict[str, Output] = {**save.sections, **save.outputs}
    if save.times is not None:
        further[SAVED] = StatesOfLanes(np.asarray(save.times, dtype=float), scene)
    twice = sorted(set(outputs) & set(further))
    require(not twice, "outputs", twice, "names that `save` does not use", "rename the output")
    return {**outputs, **further}


def check_outputs(outputs: Mapping[str, Output], scene: Scene, ledger: bool) -> None:
    """Raise a `ValueError` for an output that a sweep does not support, or that needs something
    that the scene lacks, or the energy ledger if it is not computed; and for more than one output
    at given times."""
    for name, output in outputs.items():
        expected = "a reduction, a Saved, a Section or an ImpactTable"
        remedy = "subclass AbstractReduction, or pass one of clearjoint's"
        require(isinstance(output, Output), f"outputs[{name!r}]", output, expected, remedy)
        check_reductions({name: output}, scene, ledger)
        if not isinstance(output, AbstractReduction):
            # The message of the error gets the name of the output, as for reductions.
            with errors_about(f"Output {name!r}"):
                output.check(scene)
    # A lane has one list of times to save at.
    saves = [name for name, output in outputs.items() if isinstance(output, AnySaved)]
    remedy = "join their times"
    require(len(saves) <= 1, "outputs", saves, "outputs with at most one Saved", remedy)

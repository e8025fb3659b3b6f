"""Define the sections of a study file, the classes that it may name, and its JSON Schema.

The fields of each dataclass are the keys of a table in the file. `Annotated[float, "s"]` declares
the unit of a number, which may be written as a text with another unit, such as "2 ms".
"""

import inspect
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import ModuleType
from typing import Annotated, Literal

import diffrax

from .. import quantities
from ..durability.wear_rates import WearRates
from ..dynamics.absolute_coordinates import AbsoluteCoordinates
from ..dynamics.formulation import Baumgarte, Projection, Unstabilised
from ..dynamics.joint_coordinates.coordinates import JointCoordinates
from ..fields.checks import require, require_count
from ..identification.screening.screening import Screening
from ..identification.starts import Starts
from ..measurements.readers import Missing
from ..parametrisation.scales import AbstractScale, Bounded, Linear, Log
from ..quantities.base import AbstractQuantity
from ..scene_files.schema import Catalogue, Schema, scene_properties
from ..simulation.reductions import joints
from ..simulation.reductions import quantities as of_quantities
from ..simulation.reductions.base import AbstractReduction
from ..simulation.step.settings import Settings
from ..sweeps.outputs import ImpactTable

Preset = Literal["preview", "default", "accurate", "reference", "derivatives", "identification"]
"""Names of the settings in `clearjoint.presets`."""


@dataclass(frozen=True)
class SectionPart:
    """A Poincaré section of a run.

    - `crossing`: quantity at whose upward zero crossings the channels are recorded.
    - `channels`: recorded quantities, by name.
    - `count`: largest number of recorded crossings.
    - `after`: time, s, before which crossings are not recorded.

    **Raises:** `ValueError` for a `count` that is not a positive integer.
    """

    crossing: AbstractQuantity
    channels: Mapping[str, AbstractQuantity]
    count: int = 1000
    after: Annotated[float, "s"] = 0.0

    def __post_init__(self) -> None:
        require_count("count", self.count, "give a number of crossings")


@dataclass(frozen=True)
class RunPart:
    """The section [run]: settings and outputs of a run.

    - `start`, `end`: first and last time, s. Without `end`, the command line must give it.
    - `save_every`: time between two saved states, s; by default a thousandth of the duration.
    - `preset`: name of settings in `clearjoint.presets`; `settings`: entries that replace those of
      the preset.
    - `outputs`: quantities and reductions, by name. A quantity is evaluated at the saved states;
      the extremes of forces and accelerations between saved states are found too. A reduction,
      such as `Peak`, gives one number of the run.
    - `sections`: Poincaré sections, by name.
    """

    end: Annotated[float | None, "s"] = None
    start: Annotated[float, "s"] = 0.0
    preset: Preset = "default"
    settings: Settings | None = None
    save_every: Annotated[float | None, "s"] = None
    outputs: Mapping[str, AbstractQuantity | AbstractReduction] = field(default_factory=dict)
    sections: Mapping[str, SectionPart] = field(default_factory=dict)


@dataclass(frozen=True)
class AxisPart:
    """The values that a number of the scene or of the initial state takes in a sweep.

    - `path`: a path such as "joints.pin.clearance", or a list of paths, whose numbers all get the
      same value.
    - `values`: the list of values. Without it there are `count` values from `start` to `stop`, at
      equal differences or, if `spacing` is "geometric", equal ratios. Each value is a number in SI
      units, or a text with a unit.

    **Raises:** `ValueError` unless there are either `values`, at least one in a list, or both
    `start` and `stop`; and for a `count` that is not a positive integer.
    """

    path: str | Sequence[str]
    values: Sequence[float | str] | None = None
    start: float | str | None = None
    stop: float | str | None = None
    count: int = 10
    spacing: Literal["linear", "geometric"] = "linear"

    def __post_init__(self) -> None:
        require_count("count", self.count, "give a number of values")
        ends = [end for end in (self.start, self.stop) if end is not None]
        given = {"values": self.values, "start": self.start, "stop": self.stop}
        expected = "either `values`, or `start` and `stop`"
        fine = len(ends) == (2 if self.values is None else 0)
        require(fine, "values", given, expected, "give one")
        if self.values is not None:
            is_row = isinstance(self.values, tuple | list) and len(self.values) > 0
            require(is_row, "values", self.values, "a list of values", "write [0.1, 0.2], say")


@dataclass(frozen=True)
class SweepPart:
    """The section [sweep]: many runs (lanes), each with its own values of some numbers of the scene
    or the initial state, and outputs of each run.

    - `axes`: numbers that vary, with their values, by name.
    - `outputs`: reductions such as `Peak`, or an `ImpactTable`, by name. The Poincaré sections of
      [run] are computed too.
    - `end`: s, end of the runs; that of [run] unless given.
    - `preset`, `settings`: preset, and settings that replace single ones of it. If neither is
      given, both are those of [run]; if only `settings` is given, the preset is "default".
    - `zipped`: whether lane k has the k-th value of every axis, instead of all combinations.
    - `chunk`: number of lanes that are stored together; by default a sixteenth of all lanes, at
      most 256.
    """

    axes: Mapping[str, AxisPart]
    outputs: Mapping[str, AbstractReduction | ImpactTable] = field(default_factory=dict)
    end: Annotated[float | None, "s"] = None
    preset: Preset | None = None
    settings: Settings | None = None
    zipped: bool = False
    chunk: int | None = None


@dataclass(frozen=True)
class ColumnPart:
    """A measured series: a column of the file of measurements.

    - `quantity`: the measured quantity.
    - `noise`: standard deviation of the measured values: a number in the column's unit, or a text
      with another unit.
    - `unit`: unit of the column, if its header does not give the unit.
    """

    quantity: AbstractQuantity
    noise: float | str
    unit: str | None = None


@dataclass(frozen=True)
class ParameterPart:
    """A number of the scene or of the initial state to estimate.

    - `path`: a path such as "joints.pin.clearance", or a list of paths, whose numbers all get the
      same value.
    - `scale`: scale on which the parameter is estimated, such as `Log`; by default linear.
    - `guess`: first guess, a number in SI units or a text with a unit; by default the number in
      the scene or state.
    """

    path: str | Sequence[str]
    scale: AbstractScale = field(default_factory=Linear)
    guess: float | str | None = None


@dataclass(frozen=True)
class FitPart:
    """The section [fit]: parameters to estimate from measurements.

    - `measurements`: path of a CSV file, relative to the study's folder. `time`: name of its column
      of times, in `time_unit` unless the header has a unit. `comment`: character with which comment
      lines begin.
    - `columns`: measured quantities, by the name of the column; `missing`: "drop" omits samples
      that are not numbers, "refuse" makes them errors.
    - `parameters`: numbers to estimate, by name.
    - `grow`: times, s, up to which the record is fitted one after another before the whole record;
      `max_iterations`: largest number of iterations; `starts`: further first guesses. They are
      arguments of `clearjoint.identify`.
    - `start`: time at which runs begin, s; `preset`, `settings`: as in [run].
    """

    measurements: str
    columns: Mapping[str, ColumnPart]
    parameters: Mapping[str, ParameterPart]
    time: str = "t"
    time_unit: str = "s"
    missing: Missing = "refuse"
    comment: str | None = None
    grow: Sequence[Annotated[float, "s"]] = ()
    max_iterations: int = 100
    starts: Starts | Screening | None = None
    start: Annotated[float, "s"] = 0.0
    preset: Preset = "identification"
    settings: Settings | None = None


@dataclass(frozen=True)
class WearPart:
    """The section [wear]: wear of joints over many cycles of a periodic motion.

    - `rates`: wear rates of the joints that wear, by name of the joint.
    - `cycle`: duration of a cycle, s.
    - `cycles`: number of cycles to extrapolate to; `depth`: worn depth, m, at which the computation
      ends. At least one of them must be given.
    - `settle`, `measured`, `tolerance`, `largest_change`, `samples`, `stages`: further arguments of
      `clearjoint.wear`.
    - `start`: time at which runs begin, s; `preset`, `settings`: as in [run].

    **Raises:** `ValueError` if both `cycles` and `depth` are missing.
    """

    rates: Mapping[str, WearRates]
    cycle: Annotated[float, "s"]
    cycles: float | None = None
    depth: Annotated[float | None, "m"] = None
    settle: int = 1
    measured: int = 2
    tolerance: float = 0.1
    largest_change: Annotated[float | None, "m"] = None
    samples: int = 96
    stages: int = 10_000
    start: Annotated[float, "s"] = 0.0
    preset: Preset = "default"
    settings: Settings | None = None

    def __post_init__(self) -> None:
        given = (self.cycles, self.depth) != (None, None)
        remedy = 'write cycles = 1e6 or depth = "20 um"'
        require(given, "cycles", None, "a number, unless `depth` is given", remedy)


@dataclass(frozen=True)
class StudyParts:
    """The sections of a study file, and its title. For a file without [run] that section has its
    default values; [sweep], [fit] and [wear] are None if the file lacks them."""

    title: str = ""
    run: RunPart = field(default_factory=RunPart)
    sweep: SweepPart | None = None
    fit: FitPart | None = None
    wear: WearPart | None = None


def _concrete(module: ModuleType, family: type) -> list[type]:
    """Return the subclasses of `family` in a module that are not abstract."""
    classes = [kind for kind in vars(module).values() if inspect.isclass(kind)]
    return [kind for kind in classes if issubclass(kind, family) and not inspect.isabstract(kind)]


CLASSES: tuple[type, ...] = (
    *_concrete(quantities, quantities.AbstractQuantity),
    *_concrete(of_quantities, AbstractReduction),
    *_concrete(joints, AbstractReduction),
    *(AbsoluteCoordinates, JointCoordinates, Baumgarte, Projection, Unstabilised),
    *(diffrax.Tsit5, diffrax.Dopri5, diffrax.Dopri8, diffrax.Bosh3, diffrax.Heun, diffrax.Euler),
    *(Linear, Log, Bounded, Starts, Screening, ImpactTable, WearRates),
)
"""Classes that study files may name: quantities, reductions, coordinates, stabilisations, solvers,
scales, further starts of fits, tables of impacts, and wear rates."""
TABLES = (
    *(AxisPart, ColumnPart, FitPart, ParameterPart, RunPart, SectionPart, Settings, SweepPart),
    WearPart,
)
"""Classes of the tables of study files. Files do not name them, since their keys tell the class."""


def study_schema() -> Schema:
    """Return the JSON Schema (2020-12) of study files as a dictionary for `json.dump`."""
    catalogue = Catalogue((*CLASSES, *TABLES))
    scene = {"type": "object", "properties": scene_properties(catalogue), "required": ["bodies"]}
    properties = {"scene": {"anyOf": [{"type": "string"}, scene]}}
    properties |= catalogue.properties(StudyParts)
    return catalogue.document("study", properties, ["scene"])

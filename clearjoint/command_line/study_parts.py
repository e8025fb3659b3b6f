"""What a study file holds beside its scene."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any

from ..fields.checks import require, require_count
from ..identification.screening.screening import Screening
from ..identification.starts import Starts
from ..parametrisation.scales import AbstractScale, Linear
from ..quantities.base import AbstractQuantity
from ..simulation.reductions.reductions import AbstractReduction
from ..simulation.step.settings import Settings
from ..sweeps.outputs import ImpactTable

SPACINGS = "linear", "geometric"
WRITTEN = int | float | str


@dataclass(frozen=True)
class SectionPart:
    """A Poincaré section: see `clearjoint.Section`."""

    crossing: AbstractQuantity
    channels: Mapping[str, AbstractQuantity]
    count: int = 1000
    after: Annotated[float, "s"] = 0.0

    def __post_init__(self) -> None:
        require_count("count", self.count, "give a number of crossings")


@dataclass(frozen=True)
class RunPart:
    """How a scene is run, and what of it is kept.

    - `start`, `end`: s. `save_every`: s between two saved states; a thousandth of the duration
      unless given.
    - `preset`: a name in `clearjoint.presets`; `settings`: what differs from it.
    - `outputs`: quantities along the saved states, of which those of forces and accelerations come
      with their extremes between saved states; and reductions such as `Peak`, one number for a run.
      `sections`: Poincaré sections.
    """

    end: Annotated[float | None, "s"] = None
    start: Annotated[float, "s"] = 0.0
    preset: str = "default"
    settings: Settings | None = None
    save_every: Annotated[float | None, "s"] = None
    outputs: Mapping[str, AbstractQuantity | AbstractReduction] = field(default_factory=dict)
    sections: Mapping[str, SectionPart] = field(default_factory=dict)


@dataclass(frozen=True)
class AxisPart:
    """The values of a number of the scene: all of them, or `count` of them from `start` to `stop`.

    `place`: such as "joints.pin.clearance"; several, in a list, get the same value. Values are in
    SI units, or texts with a unit.
    """

    place: str | Sequence[str]
    values: Any = None
    start: Any = None
    stop: Any = None
    count: int = 10
    spacing: str = "linear"

    def __post_init__(self) -> None:
        require_count("count", self.count, "give a number of values")
        remedy = "write one of these"
        known = self.spacing in SPACINGS
        require(known, "spacing", self.spacing, f"one of {SPACINGS}", remedy)
        ends = self.start is not None and self.stop is not None
        either = (self.values is None) == ends
        found = {"values": self.values, "start": self.start, "stop": self.stop}
        require(either, "values", found, "either `values`, or `start` and `stop`", "give one")
        if self.values is not None:
            row = isinstance(self.values, tuple | list) and len(self.values) > 0
            require(row, "values", self.values, "a list of values", "write [0.1, 0.2], say")


@dataclass(frozen=True)
class SweepPart:
    """The axes of a sweep, and what is kept of each lane.

    - `outputs`: reductions such as `Peak`, or an `ImpactTable`. The `sections` of the run are kept
      too.
    - `end`, `preset`, `settings`: those of the run unless given.
    - `zipped`: whether lanes take the axes' values side by side. `chunk`: lanes stored at once.
    """

    axes: Mapping[str, AxisPart]
    outputs: Mapping[str, AbstractReduction | ImpactTable] = field(default_factory=dict)
    end: Annotated[float | None, "s"] = None
    preset: str | None = None
    settings: Settings | None = None
    zipped: bool = False
    chunk: int | None = None


@dataclass(frozen=True)
class ColumnPart:
    """What a column of the measurements holds: `noise` is one standard deviation, a number in the
    column's unit or a text with its own."""

    quantity: AbstractQuantity
    noise: Any
    unit: str | None = None


@dataclass(frozen=True)
class ParameterPart:
    """A number of the scene that is estimated, on which scale, and a first guess, that of the scene
    unless given."""

    place: str | Sequence[str]
    scale: AbstractScale = field(default_factory=Linear)
    guess: Any = None


@dataclass(frozen=True)
class FitPart:
    """Parameters that are estimated from measurements.

    - `measurements`: a CSV file, whose path is relative to the study's. `time`: its column of
      times, in `time_unit` where the header tells none.
    - `columns`: what is fitted, by the columns' names; `missing`: "drop" leaves out samples without
      a number.
    - `grow`, `max_iterations`, `starts`: as of `clearjoint.identify`.
    """

    measurements: str
    columns: Mapping[str, ColumnPart]
    parameters: Mapping[str, ParameterPart]
    time: str = "t"
    time_unit: str = "s"
    missing: str = "refuse"
    comment: str | None = None
    grow: Sequence[Annotated[float, "s"]] = ()
    max_iterations: int = 100
    starts: Starts | Screening | None = None
    start: Annotated[float, "s"] = 0.0
    preset: str = "identification"
    settings: Settings | None = None


@dataclass(frozen=True)
class StudyParts:
    """The sections of a study file."""

    title: str = ""
    run: RunPart = field(default_factory=RunPart)
    sweep: SweepPart | None = None
    fit: FitPart | None = None

"""Logs of robots: angles and torques of joints over time, from tables of any source."""

import math
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple, TypeAlias

import numpy as np
from jaxtyping import Float, PyTree

from .._fields.checks import errors_about, require, require_finite, require_positive
from .readers import Missing, TableColumn, columns_of, split_header, times_in
from .series import to_si

if TYPE_CHECKING:
    import pandas as pd

TURN = 2.0 * math.pi
ANGLES, TORQUES = ("rad", "m"), ("N m", "N")
"""SI units, for hinges and for sliders, of positions, and of torques and forces."""
GAP = 10.0
"""A time between two samples that is above this multiple of the median is a gap."""


@dataclass(frozen=True)
class LogColumn:
    """A column of a robot's log, and how its numbers become positions or torques of a joint.

    The value is (number - `zero`) times `factor`. `LogColumn.encoder` makes angles from counts, and
    `LogColumn.current` torques from currents.

    **Arguments:**

    - `column`: name of the column, which may be followed by the unit, as in "q3 [deg]"; the number
      of the column, from 0 on, in a file without header.
    - `unit`: of the column, unless the header or `column` has one.
    - `noise`: standard deviation of the samples in the column's unit. `fit_robot` needs it for what
      it compares with the log, not for what drives the joints.
    - `zero`: number in the column at the joint's zero, in the column's unit.
    - `factor`: negative for a sensor that counts in the other direction than the joint.

    **Raises:** `ValueError` for `noise` that is not positive, and for a `factor` of zero.

    >>> cj.LogColumn("q3 [deg]", noise=0.05, factor=-1.0).column
    'q3 [deg]'
    """

    column: str | int
    unit: str | None = None
    noise: float | None = None
    zero: float = 0.0
    factor: float = 1.0
    of: str | None = None
    """SI unit of the column's numbers, if `factor` changes their dimension."""

    def __post_init__(self) -> None:
        if self.noise is not None:
            require_positive("noise", self.noise, "give a standard deviation, or leave it out")
        require_finite("factor", self.factor)
        require_finite("zero", self.zero)
        require(self.factor != 0.0, "factor", self.factor, "not zero", "give 1.0 for no change")

    @staticmethod
    def encoder(
        column: str | int,
        counts: float,
        zero: float = 0.0,
        noise: float | None = None,
        reverse: bool = False,
    ) -> "LogColumn":
        """Return a column of encoder counts: `counts` per revolution of the joint, including the
        ratio of a gear between joint and encoder, `zero` counts at the joint's zero, and `noise`,
        counts, by default the standard deviation of rounding, 0.289. With `reverse`, counts fall as
        the joint's angle rises.

        >>> print(f"{cj.LogColumn.encoder('raw', counts=4096).noise:.3f}")
        0.289
        """
        require_positive("counts", counts, "give the counts per revolution")
        noise = 1.0 / math.sqrt(12.0) if noise is None else noise
        factor = (-TURN if reverse else TURN) / counts
        return LogColumn(column, None, noise, zero, factor, of="1")

    @staticmethod
    def current(
        column: str | int,
        torque_constant: Annotated[float, "N m/A"],
        ratio: float = 1.0,
        zero: float = 0.0,
        noise: float | None = None,
    ) -> "LogColumn":
        """Return a column of motor currents, with the `torque_constant`, N m/A, of the motor, which
        makes `ratio` revolutions for one of the joint; `ratio` is negative if they are in opposite
        directions. `zero` and `noise` are in the unit of the column, by default A.

        >>> cj.LogColumn.current("i3 [mA]", torque_constant=0.05, ratio=100.0).factor  # N m/A
        5.0
        """
        require_positive("torque_constant", torque_constant, "give it in N m/A")
        return LogColumn(column, None, noise, zero, torque_constant * ratio, of="A")


class Logged(NamedTuple):
    """Samples of a joint's position or torque: times (N,), s; values (N,), in `unit`; and their
    noise, a standard deviation in `unit`, ``None`` if unknown. A `unit` of ``None`` stands for the
    SI unit for the kind of the joint, such as rad for a hinge and m for a slider.

    >>> cj.results.Logged(np.array([0.0, 0.1]), np.array([0.0, 0.3]), noise=None, unit="rad").unit
    'rad'
    """

    times: Float[np.ndarray, " N"]
    values: Float[np.ndarray, " N"]
    noise: float | None
    unit: str | None


Columns: TypeAlias = Mapping[str, "LogColumn | str | int"]
NONE: Columns = {}


@dataclass(frozen=True)
class RobotLog:
    """Positions and torques of a robot's joints over time, by the name of the joint.

    - `angles`: positions, rad or m. `torques`: N m or N. `goals`: positions to which servos move,
      rad or m. Times are in s from the first row of the log on.

    >>> import pandas as pd
    >>> table = pd.DataFrame({"t": [5.0, 5.1, 5.2], "raw": [2048, 2049, 2051]})
    >>> elbow = cj.LogColumn.encoder("raw", counts=4096, zero=2048)
    >>> log = cj.RobotLog.read(table, time="t", angles={"elbow": elbow})
    >>> log.angles["elbow"].values.round(4)  # rad
    array([0.    , 0.0015, 0.0046])
    """

    angles: dict[str, Logged]
    torques: dict[str, Logged]
    goals: dict[str, Logged]

    @staticmethod
    def read(
        source: "str | Path | pd.DataFrame",
        *,
        time: str | int = "t",
        angles: Columns = NONE,
        torques: Columns = NONE,
        goals: Columns = NONE,
        missing: Missing = "refuse",
        largest_gap: Annotated[float | None, "s"] = None,
        **options: PyTree,
    ) -> "RobotLog":
        """Read a log from a CSV or Parquet file, or from a table of pandas.

        **Arguments:**

        - `source`: path of a CSV file, or of a Parquet file (".parquet", which needs pyarrow), or a
          `pandas.DataFrame`. For a CSV file without header, pass ``header=None`` and numbers of
          columns. In a Parquet file, a column "state" of lists becomes the columns "state.0",
          "state.1" and so on.
        - `time`: column of the times, in s unless its name has a unit, as in "t [ms]", or of dates
          in the form of ISO 8601.
        - `angles`, `torques`, `goals`: columns by the name of the joint, each a `LogColumn`, or the
          name of a column, with its unit unless the header has it: "q3 [deg]".
        - `missing`: "drop" omits samples that are not finite numbers; "refuse" raises an error.
        - `largest_gap`: longest time between two samples, s; by default ten times the median.
        - `options`: options of `pandas.read_csv` or `pandas.read_parquet`.

        **Raises:** `ValueError` as `read_csv`; for a log without columns; and for a longer gap: to
        leave it out, allow it by `largest_gap`, then cut the log by `between`. `OSError` for a file
        that does not exist. `ImportError` for a Parquet file without pyarrow.
        """
        column_named = columns_of(source, options)
        remedy = 'pass for example angles={"elbow": "q3 [deg]"}'
        require(bool({**angles, **torques, **goals}), "angles", {}, "columns by joint", remedy)
        if largest_gap is not None:
            require_positive("largest_gap", largest_gap, "give a time in s")
        name, unit = split_header(time)
        times = _since_first(column_named(name, "time"), unit)

        # The samples of all joints in one of the arguments `angles`, `torques` and `goals`.
        def read(argument: str, columns: Columns, units: tuple[str, ...]) -> dict[str, Logged]:
            logged = {}
            for joint, column in columns.items():
                spec = column if isinstance(column, LogColumn) else LogColumn(column)
                where = f"{argument}[{joint!r}]"  # the argument that errors name
                content = column_named(split_header(spec.column)[0], where)
                samples = _logged(spec, content, units, times, missing)
                with errors_about(where):
                    _require_no_gap(samples.times, content, largest_gap)
                logged[joint] = samples
            return logged

        positions = read("angles", angles, ANGLES)
        return RobotLog(positions, read("torques", torques, TORQUES), read("goals", goals, ANGLES))

    @property
    def end(self) -> float:
        """Time of the last sample, s."""
        return max(float(samples.times[-1]) for samples in self._all())

    @property
    def start(self) -> float:
        """Time of the first sample, s."""
        return min(float(samples.times[0]) for samples in self._all())

    def _all(self) -> list[Logged]:
        return [s for part in (self.angles, self.torques, self.goals) for s in part.values()]

    def between(self, start: float, end: float) -> "RobotLog":
        """Return the samples with start <= time <= end, s, at unchanged times; raise a `ValueError`
        for fewer than two samples of a column."""

        def cut(part: dict[str, Logged]) -> dict[str, Logged]:
            shorter = {}
            for name, samples in part.items():
                inside = (samples.times >= start) & (samples.times <= end)
                expected = f"times with two samples of {name!r} or more between them"
                remedy = f"the log is from {self.start:g} to {self.end:g} s"
                require(inside.sum() > 1, "start, end", (start, end), expected, remedy)
                times, values = samples.times[inside], samples.values[inside]
                shorter[name] = samples._replace(times=times, values=values)
            return shorter

        return RobotLog(angles=cut(self.angles), torques=cut(self.torques), goals=cut(self.goals))


def _since_first(column: TableColumn, unit: str | None) -> Float[np.ndarray, " N"]:
    """Return the times in a column, s, less the first one. Numbers are in the column's unit or, if
    it has none, in `unit`, or in s if that is ``None``; dates are converted."""
    import pandas as pd

    # Only texts that are no numbers are read as dates: "1000" would be the year 1000.
    is_date = pd.api.types.is_datetime64_any_dtype(column.values)
    if is_date or np.isnan(column.numbers()).any():
        with suppress(ValueError, TypeError):
            dates = pd.Series(pd.to_datetime(column.values, format="ISO8601", utc=True))
            seconds = (dates - dates.iloc[0]).dt.total_seconds()
            column = replace(column, values=seconds, unit="s")
    times = times_in(column, unit or "s")
    return times - times[:1]


def _logged(
    spec: LogColumn,
    content: TableColumn,
    units: tuple[str, ...],
    times: Float[np.ndarray, " N"],
    missing: Missing,
) -> Logged:
    # The units in the table's header, in the name of the column and in the `LogColumn`. Without
    # any, numbers are in `spec.of`, the SI unit before `spec.factor` changes their dimension.
    written = content.unit, split_header(spec.column)[1], spec.unit
    unit = next((unit for unit in (*written, spec.of) if unit is not None), None)
    if unit is None:
        raise ValueError(
            f"The unit of {content.label} must be known, but neither the table nor the argument "
            f'has one: write "{spec.column} [{units[0]}]", or pass LogColumn(..., unit=...).'
        )
    allowed = units if spec.of is None else (spec.of,)
    si = allowed[0]
    # The dimension of the column's unit tells whether the joint is a hinge, with the first unit, or
    # a slider, with the last one. If the dimension fits neither, the error below names the first.
    with suppress(ValueError):
        to_si(unit, allowed[-1])
        si = allowed[-1]
    with errors_about(f"In {content.label}"):
        factor, _ = to_si(unit, si)
        for other in written:
            # Several units may be written, if they are equal.
            same = other is None or to_si(other, si)[0] == factor
            remedy = "omit one of the two"
            require(same, "unit", other, f"that of the table, {unit!r}", remedy)
    numbers, valid = content.samples(missing)
    require(len(numbers) > 1, content.label, len(numbers), "two numbers or more", "extend it")
    values = (numbers - spec.zero) * (factor * spec.factor)
    noise = None if spec.noise is None else spec.noise * abs(factor * spec.factor)
    # With `of`, the factor changes the dimension, and the unit depends on the kind of the joint.
    return Logged(times[valid], values, noise, si if spec.of is None else None)


def _require_no_gap(times: np.ndarray, content: TableColumn, largest: float | None) -> None:
    steps = np.diff(times)
    largest = GAP * float(np.median(steps)) if largest is None else largest
    k = int(steps.argmax())
    if steps[k] > largest:
        raise ValueError(
            f"The samples of {content.label} must be at most {largest:.4g} s apart, but there is a "
            f"gap from {times[k]:.6g} to {times[k + 1]:.6g} s: pass "
            f"largest_gap={1.06 * steps[k]:.2g}, and leave the gap out by `between`, or let it be "
            "interpolated."
        )

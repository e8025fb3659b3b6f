"""Timing, text and figure of the rows of the benchmark."""

import os
import re
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from statistics import median

import numpy as np
from matplotlib.figure import Figure

from clearjoint.plot import style
from clearjoint.testing import optimise_programs
from studies.benchmark.yardstick import Yardstick

HEAD = ("what", "clearjoint", "yardstick", "ratio", "aim")
SHORT = 5
"""Number of calls where a call takes milliseconds; the least time counts."""
UNITS = ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs"), (1e-9, "ns"))
BEGIN, END = "<!-- begin of the table -->", "<!-- end of the table -->"


@dataclass(frozen=True)
class Row:
    """Time of a measurement and of its yardstick, s.

    `ratio`: median of the ratios of both over the rounds; `spread`: least and largest ratio. `aim`:
    largest acceptable ratio, or without a yardstick the largest acceptable time, s.
    """

    label: str
    seconds: float
    yardstick: str = ""
    other: float | None = None
    ratio: float | None = None
    spread: tuple[float, float] | None = None
    aim: float | None = None

    def cells(self) -> tuple[str, ...]:
        """Return the row as text."""
        here, other, ratio, aim = shown(self.seconds), self.yardstick, "", ""
        if self.other is not None:
            other = f"{shown(self.other)}, {self.yardstick}"
        if self.ratio is not None and self.spread is not None:
            ratio = "{:.3g} ({:.3g} … {:.3g})".format(self.ratio, *self.spread)
        if self.aim is not None:
            aim = shown(self.aim) if self.ratio is None else f"{self.aim:g}"
        return self.label, here, other, ratio, aim


@dataclass(frozen=True)
class Sample:
    """Time of a measurement, s, and its number of attempted steps."""

    seconds: float
    steps: int = 1


@dataclass(frozen=True)
class Plan:
    """Number of rounds, and whether the measurements are short; without `yardstick` some rows have
    no ratio.
    """

    quick: bool
    rounds: int
    yardstick: Yardstick | None


def shown(seconds: float) -> str:
    """Return a time with three digits and a unit."""
    unit, name = next((pair for pair in UNITS if seconds >= 0.9995 * pair[0]), UNITS[-1])
    return f"{seconds / unit:.3g} {name}"


def interleaved(
    calls: Mapping[str, Callable[[int], Sample]], rounds: int
) -> dict[str, list[Sample]]:
    """Return samples of calls in alternation (A B C A B C), after one call each that is not
    counted, with programs as in long runs.

    Each is called with the number of the round. Disturbances of the machine then affect both sides
    of a ratio.
    """
    for call in calls.values():
        call(0)
    optimise_programs()
    samples = [{name: call(k) for name, call in calls.items()} for k in range(rounds)]
    return {name: [sample[name] for sample in samples] for name in calls}


def seconds(samples: Sequence[Sample]) -> np.ndarray:
    """Return the times of samples, (rounds,) s."""
    return np.array([sample.seconds for sample in samples])


def step_times(samples: Sequence[Sample], less: Sequence[Sample] | None = None) -> np.ndarray:
    """Return the times of an attempted step, (rounds,) s, less the least time of others."""
    outside = np.min(seconds(less)) if less else 0.0
    return np.array([(sample.seconds - outside) / sample.steps for sample in samples])


def row(
    label: str,
    here: np.ndarray,
    other: np.ndarray | None = None,
    yardstick: str = "",
    aim: float | None = None,
) -> Row:
    """Return the row of times (rounds,), compared with others of the same rounds."""
    if other is None:
        return Row(label, float(np.median(here)), yardstick, aim=None if yardstick else aim)
    ratios = (here / other).tolist()
    times = float(np.median(here)), yardstick, float(np.median(other))
    return Row(label, *times, median(ratios), (min(ratios), max(ratios)), aim)


def processor_time(call: Callable[[], int], times: int = 1) -> Sample:
    """Return the least processor time of several calls that return their number of steps."""
    found, steps = [], 1
    for _ in range(times):
        begun = time.process_time()
        steps = call()
        found.append(time.process_time() - begun)
    return Sample(min(found), steps)


def wall_time(call: Callable[[], int]) -> Sample:
    """Return the wall time of a call that returns its number of steps."""
    begun = time.perf_counter()
    steps = call()
    return Sample(time.perf_counter() - begun, steps)


def cores() -> list[int]:
    """Return the cores of this process; empty if the system does not tell (not Linux)."""
    return sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else []


@contextmanager
def on_cores(count: int) -> Iterator[None]:
    """Restrict this thread and all that it starts to a number of cores (Linux)."""
    present = cores()
    if present:
        os.sched_setaffinity(0, present[:count])
    try:
        yield
    finally:
        if present:
            os.sched_setaffinity(0, present)


def replace_table(file: Path, table: str, name: str = "table") -> None:
    """Replace the table between the two markers of a file that have its name.

    **Raises:** `ValueError` if the file does not have both.
    """
    begin, end = BEGIN.replace("table", name), END.replace("table", name)
    text = file.read_text(encoding="utf-8")
    pattern = re.compile(f"(?<={re.escape(begin)}\n).*(?={re.escape(end)})", re.DOTALL)
    if not pattern.search(text):
        raise ValueError(f"{file} must have the lines {begin!r} and {end!r}, but has not.")
    file.write_text(pattern.sub(lambda _: f"\n{table}\n\n", text), encoding="utf-8")


def figure(rows: Sequence[Row]) -> Figure:
    """Draw ratios with their spread and aims; rows without a ratio show the time over the aim."""
    drawn = [one for one in rows if one.ratio is not None or one.aim is not None]
    canvas = Figure(figsize=(9.0, 1.2 + 0.24 * len(drawn)), layout="constrained")
    axes = canvas.subplots()
    for place, one in enumerate(drawn):
        if one.ratio is not None and one.spread is not None:
            value, (least, most), aim = one.ratio, one.spread, one.aim
        else:
            value, aim = one.seconds / (one.aim or 1.0), 1.0
            least = most = value
        colour = style.BLUE if aim is None or value <= aim else style.VERMILLION
        axes.plot([least, most], [place, place], color=colour, linewidth=1.5)
        axes.plot(value, place, "o", color=colour, markersize=5)
        if aim is not None:
            axes.plot(aim, place, "|", color="black", markersize=11)
    labels = [f"{one.label} / {one.yardstick or 'aim'}" for one in drawn]
    axes.set_yticks(range(len(drawn)), labels, fontsize=7)
    axes.invert_yaxis()
    axes.set_xscale("log")
    style.dress(axes, "time over the yardstick's (dots) and aims (bars)", "")
    return canvas

"""Results of a sweep in a Zarr store (format 3) on disk, chunk by chunk.

Each variable is an array whose chunks are those of the sweep. The result codes of a chunk are
written last: without them the chunk's lanes are pending, whatever else a killed process has
written. The lanes of a chunk with a damaged, missing or exchanged file are pending, too. Two
processes that write to the same store wait for each other if the system can lock files.

A store can be extended by lanes and variables. It recognises lanes by the numbers from which they
start, and variables by their programs. It has the axes of the sweep that opened it last.
"""

import errno
import os
import time
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..._fields.cautions import warn_the_user
from ..outputs import BY_LANE, PENDING, RESULT, LaneArrays, Layout, Variable, dataset
from . import chunks
from .chunks import DAMAGED, MISSING, chunk_file, opened
from .metadata import ADDED, Contents, contents_of, create, extend, remove_abandoned, write_grid
from .program import RUN, Identity, matching_lanes

if TYPE_CHECKING:
    import xarray as xr
    import zarr

Part = str | int | np.ndarray
"""Part of a layout in which two sweeps may differ: a text, such as a setting or a unit, the number
of lanes in a chunk, or an array of labels."""


def differences(stored: Contents, wanted: Contents, matches: np.ndarray) -> list[str]:
    """Return a line of text for each reason why the results of the wanted sweep can't be added to
    the store; none if they can. `matches`: the wanted lane of each stored row, or -1 for none.

    Variables and labels that only the wanted sweep has are no reason, because the store can be
    extended by them. Different notes (see `Layout`) are no reason either, but are listed after the
    reasons, if there are any, because notes may explain these.
    """
    parts, wanted_parts = _parts(stored.layout), _parts(wanted.layout)
    lines = [
        *_compared(_settings(stored.layout), _settings(wanted.layout)),
        # A part that only the wanted sweep has is no difference: the store is extended by it.
        *_compared(parts, {name: wanted_parts[name] for name in parts if name in wanted_parts}),
        *_lost(stored, wanted.layout, matches),
    ]
    # A difference that already has a line, such as that of a setting, may change the program of the
    # run too. A second line about this program would mislead.
    lines += _programs(stored, wanted, without_run=bool(lines))
    lines += _save_times(stored, wanted, matches)
    notes = [name for name in stored.layout.notes if name in wanted.layout.notes]
    old, new = ({name: c.layout.notes[name] for name in notes} for c in (stored, wanted))
    return lines and [*lines, *_compared(old, new)]


def _settings(layout: Layout) -> dict[str, Part]:
    settings: dict[str, Part] = {f"setting {name}": text for name, text in layout.settings.items()}
    return {"lanes in a chunk": layout.chunk, **settings}


def _parts(layout: Layout) -> dict[str, Part]:
    """Return what `differences` compares of a layout besides its settings, by the names it prints:
    units of axes, values and units of coordinates, and the `_outline` of each variable."""
    parts: dict[str, Part] = {f"unit of axis {axis.name}": axis.unit for axis in layout.axes}
    parts |= {f"coordinate {c.name}": c.values for c in layout.coordinates}
    parts |= {f"unit of coordinate {c.name}": c.unit for c in layout.coordinates}
    return parts | {f"variable {name}": _outline(v) for name, v in layout.variables.items()}


def _outline(variable: Variable) -> str:
    """Text such as "float64 (lane, body 2), long_name ..., units m"."""
    sizes = zip(variable.dims, variable.shape, strict=True)
    shape = ", ".join(["lane", *(f"{dim} {size}" for dim, size in sizes)])
    attrs = ", ".join(f"{name} {value}" for name, value in sorted(variable.attributes.items()))
    return f"{np.dtype(variable.dtype)} ({shape}), {attrs}"


def _compared(stored: Mapping[str, Part], wanted: Mapping[str, Part]) -> Iterator[str]:
    """Yield a line of text for each `Part` of layouts that differs or is in one mapping only."""
    for name in {**stored, **wanted}:
        in_both = name in stored and name in wanted
        if not (in_both and np.array_equal(stored[name], wanted[name])):
            yield f"{name}: {_difference(stored.get(name), wanted.get(name))}"


def _difference(stored: Part | None, wanted: Part | None) -> str:
    """Return how a stored `Part` differs from the wanted one; ``None`` stands for a missing one."""
    if isinstance(stored, np.ndarray) and isinstance(wanted, np.ndarray):
        if stored.size != wanted.size:
            return f"stored {stored.size} values, now {wanted.size}"
        differ = np.flatnonzero(stored != wanted)
        count, first = f"{differ.size} of {stored.size} values differ", differ[0]
        return f"{count}, first number {first}: {_difference(stored[first], wanted[first])}"
    old, new = ("nothing" if part is None else _text(part) for part in (stored, wanted))
    return f"stored {old}, now {new}"


def _text(part: Part) -> str:
    return f"{part.size} values" if isinstance(part, np.ndarray) else str(part)


def _lost(stored: Contents, wanted: Layout, matches: np.ndarray) -> Iterator[str]:
    """Yield a line for each axis with stored values that `wanted` lacks, and one line for all
    stored lanes that it lacks. `matches`: as in `differences`."""
    values = {axis.name: axis.values for axis in wanted.axes}
    # An axis that the wanted sweep lacks altogether has no line here, since its unit, one of the
    # compared parts, already has one.
    for name, stored_values, _ in stored.layout.axes:
        missing = stored_values[~np.isin(stored_values, values.get(name, stored_values))]
        if missing.size:
            yield (
                f"axis {name}: {missing.size} of {stored_values.size} stored values are not among "
                f"the {values[name].size} present values, first {missing[0]}"
            )
    lost = matches < 0
    if lost.any():
        yield (
            f"lanes: {lost.sum()} of {lost.size} stored lanes are not among the {wanted.lanes} "
            "present lanes, because the numbers at their start differ, first lane "
            f"{stored.order[lost].min()}"
        )


def _programs(stored: Contents, wanted: Contents, without_run: bool) -> Iterator[str]:
    """A line for each traced program that has different digests in the two sweeps; with
    `without_run`, none for the program of the run itself."""
    new, stored_axes = wanted.identity.programs, {axis.name for axis in stored.layout.axes}
    added = [axis.name for axis in wanted.layout.axes if axis.name not in stored_axes]
    # See `fold_constants`.
    why = (
        f", perhaps because axis {' or '.join(added)} is of a vector with components that are "
        "exactly 0 or 1 in the scene: a store can't be extended by such an axis, use another `path`"
    )
    for name, program in stored.identity.programs.items():
        if program != new.get(name, program) and not (without_run and name == RUN):
            subject = f"variable {name}" if name else "program of a step"
            line = f"{subject}: the code that JAX traces differs from the stored one"
            yield line + why if added else line


def _save_times(stored: Contents, wanted: Contents, matches: np.ndarray) -> Iterator[str]:
    """Yield a line if common lanes have different sample times. `matches`: as in `differences`."""
    old, new = stored.identity.lanes, wanted.identity.lanes
    # `matches` is -1 for lanes that the wanted sweep lacks, which are left out of the count.
    for name in (old.keys() & new.keys()) - {RUN}:
        differ = new[name][matches] != old[name][stored.order]
        if count := differ[matches >= 0].sum():
            yield f"times of {name}: they differ in {count} of {matches.size} stored lanes"


Parts = Mapping[int, tuple[Sequence[int], LaneArrays]]
"""By the index of the chunk, the numbers of n of its lanes, in any order, and their results,
(n, ...) for every variable."""
_NAMED = 5
"""Number of damaged files that a warning names."""
GRID_PERIOD, GRID_SHARE = 60.0, 0.02
"""Shortest time, s, between two writes of the grid, a copy of all results, during a sweep, and
largest share of the sweep's time that these writes may take."""
_FLUSHED_TOGETHER = 16
"""Number of files that are flushed to disk at the same time."""


class SweepMemory:
    """Results of a sweep in memory, with the methods of a `SweepStore`."""

    def __init__(self, layout: Layout):
        self.layout = layout
        self._arrays = layout.pending()

    def missing(self) -> dict[int, list[int]]:
        return _missing(self._arrays[RESULT], np.arange(self.layout.lanes), self.layout.chunk)

    def write(self, parts: Parts) -> None:
        for lanes, results in parts.values():
            for name, values in results.items():
                self._arrays[name][list(lanes)] = values  # NumPy takes a tuple for indices of axes

    def write_grid(self) -> None:
        """Do nothing, because other programs can't read this memory."""

    def dataset(self) -> "xr.Dataset":
        return dataset(self.layout, self._arrays)


class SweepStore:
    """Results of a sweep in a folder on disk. `SweepStore.open` opens or creates one."""

    def __init__(self, path: Path, contents: Contents):
        self.path, self._contents = path, contents
        self.layout = contents.layout
        self._folder = path / BY_LANE
        self._row_of = np.argsort(contents.order)
        self._grid_written, self._grid_seconds = time.monotonic(), 0.0

    @classmethod
    def open(cls, path: str | os.PathLike, layout: Layout, identity: Identity) -> "SweepStore":
        """Open the store of a sweep at a path, or create it if there is nothing at the path.

        A store with fewer lanes or variables than the requested sweep is extended, and one with the
        same lanes along other axes gets the axes of the requested sweep, unless it is read only.

        **Raises:** `ValueError` if there is something other than an intact store of this version at
        the path, or another sweep's store, with the `differences`; `OSError` if the store can't be
        created or extended, for example without permission.
        """
        path = Path(path)
        # Processes that were killed may have left partly written stores beside the path.
        remove_abandoned(path)
        if not path.exists():
            create(path, Contents(layout, identity, np.arange(layout.lanes)))
        # Raises an error if the path has no store, before the lock writes a file there.
        contents_of(path)
        with chunks.locked(path / BY_LANE):
            # Read again, because another process may have extended the store before the lock.
            stored = contents_of(path)
            # The order of the rows is a placeholder: `_joined` computes it.
            extended = _joined(path, stored, Contents(layout, identity, stored.order))
            # The same lanes may lie along other axes. A store that is read only keeps its axes.
            relabelled = not _same_axes(stored.layout, layout) and os.access(path, os.W_OK)
            has_new_lanes = len(stored.order) < layout.lanes
            has_new_variables = bool(extended.added - stored.added)
            if has_new_lanes or has_new_variables or relabelled:
                extend(path, extended)
                # The grid, a copy of the results along the axes, is outdated and written anew.
                write_grid(path, _labelled(path, extended))
        return cls(path, extended)

    def missing(self) -> dict[int, list[int]]:
        """Return the numbers of the lanes whose results are missing or damaged, by the index of
        their chunk; warn of damaged files. Raise a `PermissionError` if there are such lanes and
        the store can't be written to."""
        group = chunks.opened_group(self._folder)
        codes = _arrays(self.path, group, self._contents)[RESULT]
        missing = _missing(codes, self._contents.order, self.layout.chunk)
        if missing and not os.access(self._folder, os.W_OK):
            text = "Lanes are missing in this store, which can't be written to"
            raise PermissionError(errno.EACCES, text, str(self._folder))
        return missing

    def write(self, parts: Parts) -> None:
        """Write results of some lanes to disk, so that they last even if the process is killed. If
        `GRID_PERIOD` and `GRID_SHARE` allow it, write the grid: a copy of all, along the axes."""
        with chunks.locked(self._folder):
            # Another process may have extended the store since it was opened.
            group = chunks.opened_group(self._folder)
            arrays = {name: opened(group, name) for name in self.layout.variables}
            added = group.attrs[ADDED]
            assert isinstance(added, list)
            for name in set(map(str, added)) - set(arrays):
                # Another process added this variable, and these results lack it: without its file,
                # the chunk counts as pending for sweeps with the variable.
                for chunk in parts:
                    chunk_file(self._folder, opened(group, name), chunk).unlink(missing_ok=True)
            # A file has all rows of a chunk, so lanes that are stored already are written again.
            complete = {chunk: self._whole(arrays, chunk, *part) for chunk, part in parts.items()}
            # The result codes mark the lanes as done: they are written last, when the other
            # variables are safely on disk.
            others = [name for name in arrays if name != RESULT]
            for names in (others, [RESULT]):
                _flush_all(
                    chunks.write_chunk(self._folder, arrays[name], chunk, results[name])
                    for chunk, results in complete.items()
                    for name in names
                )
        self._write_grid_if_due()

    def _whole(
        self,
        arrays: "Mapping[str, zarr.Array]",
        chunk: int,
        lanes: Sequence[int],
        results: LaneArrays,
    ) -> LaneArrays:
        """Return all rows of a chunk, by variable: the given results of `lanes` and, in the other
        rows, the stored results, or pending ones if a file of the chunk is missing or damaged."""
        # The last chunk may have fewer rows than the others.
        first_row, size = chunk * self.layout.chunk, self.layout.chunk
        count = min(size, arrays[RESULT].shape[0] - first_row)
        given_rows = self._row_of[list(lanes)] - first_row
        rows = {name: variable.pending(count) for name, variable in self.layout.variables.items()}
        if len(lanes) < count:
            stored = {
                name: chunks.read_chunk(self._folder, arrays[name], chunk) for name in results
            }
            # A text in place of rows tells that the file is missing or damaged.
            if not any(isinstance(part, str) for part in stored.values()):
                rows = {name: np.array(part) for name, part in stored.items()}
        # If all stored rows are pending, perhaps because a file is damaged or missing, old result
        # codes are removed first: if this process were killed before it has written all arrays,
        # they would mark rows as done whose other values are missing.
        if len(lanes) < count and (rows[RESULT] == PENDING).all():
            chunk_file(self._folder, arrays[RESULT], chunk).unlink(missing_ok=True)
        for name, values in results.items():
            rows[name][given_rows] = values
        return rows

    def write_grid(self) -> None:
        """Update the grid, a copy of all results along the axes, if the store can be written to."""
        # A store that can't be written to serves only sweeps whose lanes are all done: `missing`
        # raises an error for other sweeps.
        if not os.access(self.path, os.W_OK):
            return
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # `dataset` warns of damaged files.
            results = _labelled(self.path, contents_of(self.path))
        with chunks.locked(self._folder):
            write_grid(self.path, results)

    def _write_grid_if_due(self) -> None:
        start = time.monotonic()
        if start - self._grid_written > max(GRID_PERIOD, self._grid_seconds / GRID_SHARE):
            self.write_grid()
            self._grid_written = time.monotonic()
            self._grid_seconds = self._grid_written - start

    def dataset(self) -> "xr.Dataset":
        """Return the results along the axes; warn of damaged files, whose lanes are pending."""
        return _labelled(self.path, self._contents)


def open_sweep(path: str | os.PathLike) -> "xr.Dataset":
    """Read the results of a sweep's store, along its axes, also while the sweep is running.

    Lanes that are not done, and those with damaged files, have the `result` -1 (pending); their
    other results are NaN, or -1 for integers. `sweep`, called with the arguments of the first call,
    computes them. All results are read into memory. ``xarray.open_zarr(path)`` opens the same
    results lazily, without those of the last minute, or of a longer time if the results are large.

    **Raises:** `ValueError` if there is no sweep's store at the path, or if it is of another
    version or its metadata are damaged.

    **Warns:** `UserWarning` that names damaged files.

    >>> axis = cj.Axis(lambda scene: scene.forces["spring"].stiffness, [100.0, 400.0])
    >>> axes = {"stiffness": axis}
    >>> outputs = {"speed": cj.Peak(cj.quantities.Velocity("ball"), "m/s")}
    >>> _ = cj.sweep(scene, state, 0.5, axes, outputs, path="ball.zarr", progress=False)
    >>> np.round(cj.open_sweep("ball.zarr")["speed"].values, 4)
    array([1., 2.])
    """
    path = Path(path)
    return _labelled(path, contents_of(path))


def _joined(path: Path, stored: Contents, wanted: Contents) -> Contents:
    """Return the wanted contents, with the order of lanes that the store will have: stored lanes
    keep their rows, and other lanes get rows at the end. Raise a `ValueError` that lists the
    `differences`, if there are any."""
    # Lanes are recognised by the digests of the numbers from which they start.
    digests = wanted.identity.lanes[RUN]
    matches = matching_lanes(stored.identity.lanes[RUN][stored.order], digests)
    lines = differences(stored, wanted, matches)
    if lines:
        raise ValueError(
            f"The store {path} belongs to another sweep:\n  "
            + "\n  ".join(lines)
            + "\nPass another path, or delete the store to compute it again."
        )
    # `matches` has no -1 here, since a stored lane that is not wanted is one of the differences.
    order = np.concatenate([matches, np.setdiff1d(np.arange(len(digests)), matches)])
    added = stored.added | (set(wanted.layout.variables) - set(stored.layout.variables))
    return wanted._replace(order=order, added=added)


def _same_axes(layout: Layout, other: Layout) -> bool:
    axes, others = ([(a.name, a.values.tolist()) for a in x.axes] for x in (layout, other))
    return layout.zipped == other.zipped and axes == others


def _missing(codes: np.ndarray, order: np.ndarray, chunk: int) -> dict[int, list[int]]:
    """Numbers of the pending lanes, by index of their chunk. Row k has the lane `order[k]` with the
    result code `codes[k]`, and a chunk has `chunk` rows."""
    pending: dict[int, list[int]] = {}
    for row in np.flatnonzero(codes == PENDING):
        pending.setdefault(int(row) // chunk, []).append(int(order[row]))
    return pending


def _labelled(path: Path, contents: Contents) -> "xr.Dataset":
    # Arrays are in the order of the rows, and are sorted into the order of the lanes.
    arrays = _arrays(path, chunks.opened_group(path / BY_LANE), contents)
    row_of = np.argsort(contents.order)
    return dataset(contents.layout, {name: values[row_of] for name, values in arrays.items()})


def _arrays(path: Path, group: "zarr.Group", contents: Contents) -> dict[str, np.ndarray]:
    """Read the variables by name, lanes in the order of the store's rows; warn of damaged files."""
    layout, damaged, folder = contents.layout, [], path / BY_LANE
    arrays: dict[str, np.ndarray] = {}
    lanes = slice(len(contents.order))  # Another process may have added lanes.
    # Result codes are written last, so they are read first. A chunk that another process finishes
    # in between stays pending here.
    codes, faults = chunks.read(folder, opened(group, RESULT))
    codes = codes[lanes]
    # A missing file of result codes is no damage: its lanes are not done yet.
    done = codes != PENDING
    for chunk in [chunk for chunk, fault in faults.items() if fault == DAMAGED]:
        damaged.append(f"{chunk_file(folder, opened(group, RESULT), chunk)} is {DAMAGED}")
    for name in [name for name in layout.variables if name != RESULT]:
        array = opened(group, name)
        values, faults = chunks.read(folder, array)
        arrays[name] = values[lanes]
        for chunk, fault in faults.items():
            span = layout.span(chunk)
            # Missing files of lanes that are not done, and those of a variable that was added when
            # its lanes were already done, are no damage. The lanes are pending all the same.
            if done[span].any() and not (fault == MISSING and name in contents.added):
                damaged.append(f"{chunk_file(folder, array, chunk)} is {fault}")
            codes[span] = PENDING
    for name, values in arrays.items():
        values[codes == PENDING] = layout.variables[name].fill
    if damaged:
        more = f", and {len(damaged) - _NAMED} more" if len(damaged) > _NAMED else ""
        warn_the_user(
            f"The store {path} is damaged: {', '.join(damaged[:_NAMED])}{more}. The lanes of these "
            "chunks are pending; sweep with the same arguments to compute them again."
        )
    return {RESULT: codes, **arrays}


def _flush_all(paths: Iterable[Path]) -> None:
    """Wait until files are safely on disk. The iterator `paths` writes each file when it yields the
    file's path; all files are written before the first is flushed."""
    written = list(paths)
    # A file system finishes the flushes of several threads together.
    with ThreadPoolExecutor(_FLUSHED_TOGETHER) as threads:
        list(threads.map(_flush, written))  # Raises their errors.


def _flush(path: Path) -> None:
    with path.open("r+b") as file:
        os.fsync(file.fileno())

"""Results of a sweep in a Zarr store (format 3) on disk, chunk by chunk.

Each variable is an array whose first dimension is `lane` and whose chunks are the sweep's, so that
writing a chunk touches no file of another. A chunk's piece of `result` is written last: where it is
missing, the lanes read as pending, whatever else a killed process has left of the chunk. Writing a
chunk again is harmless, also by two processes at once.

Every file has a checksum. A chunk of which one is damaged or gone reads as pending too, with a
warning that names it, and is computed anew.

A store takes further lanes, behind those it has, and further variables: it knows its lanes by the
numbers that they start from, and variables by the programs that compute them. Nothing else of it
changes after creation.
"""

import os
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...fields.types import ArrayLike
from ..layout import PENDING, RESULT, Layout, dataset
from .chunks import DAMAGED, MISSING, chunk_file, opened, opened_group, read
from .differences import differences
from .identity import Identity, places
from .metadata import Contents, contents_of, create, extend, remove_remains
from .program import RUN

if TYPE_CHECKING:
    import xarray as xr
    import zarr

_NAMED = 5
"""Damaged files that a warning names."""


class SweepMemory:
    """Results in memory, with the methods of a `SweepStore`."""

    def __init__(self, layout: Layout):
        self.layout = layout
        self._arrays = layout.pending()

    def missing(self) -> dict[int, list[int]]:
        """By chunk the lanes that are not done."""
        return _missing(self._arrays[RESULT], np.arange(self.layout.lanes), self.layout.chunk)

    def write(self, chunk: int, lanes: Sequence[int], arrays: Mapping[str, ArrayLike]) -> None:
        """Keep results of lanes of a chunk."""
        del chunk
        for name, values in self.layout.checked(len(lanes), arrays).items():
            self._arrays[name][lanes] = values

    def dataset(self) -> "xr.Dataset":
        """All results with labels; lanes that are not done have the `result` -1, pending."""
        return dataset(self.layout, self._arrays)


class SweepStore:
    """Results in a folder on disk; take `SweepStore.open`."""

    def __init__(self, path: Path, contents: Contents):
        self.path, self._contents = path, contents
        self.layout = contents.layout
        self._group = opened_group(path, "r+")
        self._place = np.argsort(contents.order)

    @classmethod
    def open(cls, path: str | os.PathLike, layout: Layout, identity: Identity) -> "SweepStore":
        """Open the store at a path, or create it; what it lacks of lanes and variables is added.

        **Raises:** `ValueError` if what is there is no sweep, or one of which lanes, variables or
        settings are none of this.
        """
        path = Path(path)
        remove_remains(path)
        if not path.exists():
            create(path, Contents(layout, identity, np.arange(layout.lanes)))
        stored = contents_of(path)
        wanted = _joined(path, stored, Contents(layout, identity, stored.order))
        lanes, variables = len(stored.order), set(stored.layout.variables)
        if lanes < layout.lanes or variables < set(layout.variables):
            extend(path, wanted)
        return cls(path, wanted)

    def missing(self) -> dict[int, list[int]]:
        """By chunk the lanes that are not done."""
        codes = self._arrays()[RESULT]
        return _missing(codes, self._contents.order, self.layout.chunk)

    def write(self, chunk: int, lanes: Sequence[int], arrays: Mapping[str, ArrayLike]) -> None:
        """Put results of lanes of a chunk on disk; when this returns they are done."""
        results = self.layout.checked(len(lanes), arrays)
        span = self.layout.span(chunk)
        rows = self._place[list(lanes)] - span.start
        whole = len(lanes) == span.stop - span.start
        before = {} if whole else {name: np.asarray(self._array(name)[span]) for name in results}
        self._file(RESULT, chunk).unlink(missing_ok=True)
        for name in sorted(results, key=lambda name: name == RESULT):
            values = before.get(name, np.empty_like(results[name]))
            values[rows] = results[name]
            self._array(name)[span] = values
            _flush(self._file(name, chunk))

    def dataset(self) -> "xr.Dataset":
        """All results with labels; lanes that are not done have the `result` -1, pending."""
        return _labelled(self._contents, self._arrays())

    def _arrays(self) -> dict[str, np.ndarray]:
        return _arrays(self.path, self._group, self._contents)

    def _array(self, name: str) -> "zarr.Array":
        return opened(self._group, name)

    def _file(self, name: str, chunk: int) -> Path:
        return chunk_file(self.path, self._array(name), chunk)


def open_sweep(path: str | os.PathLike) -> "xr.Dataset":
    """The results in a sweep's store, along its axes; also while the sweep is running.

    Lanes that are not done have the `result` -1 (pending); their numbers are NaN, -1 in integers.
    So have those of which something on disk is damaged, with a warning that names the files; the
    same call of `sweep` computes them anew. All of it comes into memory: what is larger opens lane
    by lane with `xarray.open_zarr(path)`.

    **Raises:** `ValueError` if there is no sweep's store at the path.

    >>> spring = cj.SpringDamper("ground", "ball", (0, 0, 0), (0, 0, 0), stiffness=100.0)
    >>> scene = cj.Scene({"ball": cj.Body(1.0, (1e-3, 1e-3, 1e-3))}, forces={"spring": spring})
    >>> state = cj.State({"ball": cj.body_state((0.1, 0, 0))})  # 0.1 cos(10 t)
    >>> axis = cj.Axis(lambda scene: scene.forces["spring"].stiffness, [100.0, 400.0])
    >>> outputs = {"speed": cj.Peak(cj.quantities.Velocity("ball"), "m/s")}
    >>> _ = cj.sweep(
    ...     scene, state, 0.5, {"stiffness": axis}, outputs, path="ball.zarr", progress=False
    ... )
    >>> np.round(cj.open_sweep("ball.zarr")["speed"].values, 4)
    array([1., 2.])
    """
    path = Path(path)
    contents = contents_of(path)
    group = opened_group(path, "r")
    return _labelled(contents, _arrays(path, group, contents))


def _joined(path: Path, stored: Contents, wanted: Contents) -> Contents:
    """The wanted contents in the order of those stored, with what these lack behind."""
    here = wanted.identity.lanes[RUN]
    kept = places(stored.identity.lanes[RUN][stored.order], here)
    lines = differences(stored, wanted, kept)
    if lines:
        raise ValueError(
            f"The store {path} belongs to another sweep:\n  "
            + "\n  ".join(lines)
            + "\nPass another path, or delete the store to compute it anew."
        )
    order = np.concatenate([kept, np.setdiff1d(np.arange(len(here)), kept)])
    added = stored.added | (set(wanted.layout.variables) - set(stored.layout.variables))
    return wanted._replace(order=order, added=added)


def _missing(codes: np.ndarray, order: np.ndarray, chunk: int) -> dict[int, list[int]]:
    """By chunk the lanes that are pending, of codes in the order of the store."""
    pending: dict[int, list[int]] = {}
    for place in np.flatnonzero(codes == PENDING):
        pending.setdefault(int(place) // chunk, []).append(int(order[place]))
    return pending


def _labelled(contents: Contents, arrays: Mapping[str, np.ndarray]) -> "xr.Dataset":
    back = np.argsort(contents.order)
    return dataset(contents.layout, {name: values[back] for name, values in arrays.items()})


def _arrays(path: Path, group: "zarr.Group", contents: Contents) -> dict[str, np.ndarray]:
    """The variables of all lanes in the order of the store, and nothing of chunks that are not
    done, or of which something is damaged.

    The codes are read first: a chunk that another process ends meanwhile stays pending.
    """
    layout, damaged = contents.layout, []
    arrays: dict[str, np.ndarray] = {}
    codes, faults = read(path, opened(group, RESULT))
    done = codes != PENDING
    for chunk in [chunk for chunk, fault in faults.items() if fault == DAMAGED]:
        damaged.append(f"{chunk_file(path, opened(group, RESULT), chunk)} is {DAMAGED}")
    for name in [name for name in layout.variables if name != RESULT]:
        array = opened(group, name)
        arrays[name], faults = read(path, array)
        for chunk, fault in faults.items():
            span = layout.span(chunk)
            if done[span].any() and not (fault == MISSING and name in contents.added):
                damaged.append(f"{chunk_file(path, array, chunk)} is {fault}")
            codes[span] = PENDING
    for name, values in arrays.items():
        values[codes == PENDING] = layout.variables[name].fill
    if damaged:
        _warn(path, damaged)
    return {RESULT: codes, **arrays}


def _warn(path: Path, damaged: Sequence[str]) -> None:
    more = f", and {len(damaged) - _NAMED} more" if len(damaged) > _NAMED else ""
    warnings.warn(
        f"The store {path} is damaged: {', '.join(damaged[:_NAMED])}{more}. The lanes of these "
        "chunks are pending; sweep with the same arguments to compute them anew.",
        stacklevel=4,
    )


def _flush(path: Path) -> None:
    """Have a file's bytes on disk before going on."""
    with path.open("r+b") as file:
        os.fsync(file.fileno())

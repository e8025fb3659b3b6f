"""A loop over lanes that lie side by side in vectors.

Each lane has a column of memory. The function returns when a lane in it needs its host: what that
does with the columns concerns no other lane, and the arithmetic of a lane is the same at any width
and beside any others.
"""

import time
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jax.interpreters import partial_eval

from .functions import Region, read_region
from .llvm_text import llvm_text
from .lowering import Array, Lowering, Memory, kind_of
from .machine_code import NativeCall, code_folder, compiled
from .operations import Operations

WIDTH = 8
"""Lanes side by side: as many as a vector of 512 bits holds, or two of 256."""


class Columns:
    """Memory of a group of lanes: (cells, lanes)."""

    def __init__(self, cells: int):
        content = np.zeros(cells * WIDTH + 8)
        offset = -(content.ctypes.data // 8) % 8
        self.floats = content[offset : offset + cells * WIDTH].reshape(cells, WIDTH)
        self.whole = self.floats.view(np.int64)

    def write(self, region: Region, array: np.ndarray, lane: int | slice) -> None:
        """Write an array into the column of a lane, or of all of them."""
        target = self.floats if array.dtype.kind == "f" else self.whole
        rows = array.reshape(-1, 1) if isinstance(lane, slice) else array.ravel()
        target[region.start : region.start + region.size, lane] = rows

    def read(self, region: Region, lane: int) -> np.ndarray:
        """The array in the column of a lane."""
        return read_region(self.floats[:, lane], self.whole[:, lane], region)


class LaneLoop:
    """Native code that applies `turn` to lanes side by side.

    **Arguments:** `turn(shared, own, state)` gives the state after a step; `status(shared, own,
    state)` a dictionary of scalars, of which `goes` says whether the lane can go on without its
    host. All are PyTrees of arrays; of a lane, and for `shared` of all lanes.
    """

    def __init__(
        self,
        turn: Callable[[Any, Any, Any], Any],
        status: Callable[[Any, Any, Any], dict[str, Any]],
        shared: Any,
        own: Any,
        state: Any,
    ):
        began = time.perf_counter()
        trees = shared, own, state
        arrays, static = eqx.partition(trees, eqx.is_array)
        leaves, structure = jax.tree.flatten(arrays)
        names: list[str] = []

        def turned(*leaves: Any) -> list[Any]:
            given = eqx.combine(jax.tree.unflatten(structure, leaves), static)
            after = turn(*given)
            return jax.tree.leaves(eqx.filter(after, eqx.is_array))

        def looked_at(*leaves: Any) -> list[Any]:
            found = status(*eqx.combine(jax.tree.unflatten(structure, leaves), static))
            names[:] = found
            return [jax.numpy.asarray(value) for value in found.values()]

        steps, looks = (jax.make_jaxpr(f)(*leaves) for f in (turned, looked_at))
        traced = time.perf_counter()
        do = Operations(width=WIDTH)
        lowering = Lowering(do)
        self.regions = [
            Region(do.allocate(leaf.size), tuple(leaf.shape), np.dtype(leaf.dtype))
            for leaf in leaves
        ]
        self._occupied, self._limit = do.allocate(1), do.allocate(1)
        given = [
            lowering.given(v.aval, region.start)
            for v, region in zip(steps.jaxpr.invars, self.regions, strict=True)
        ]
        counts = [len(jax.tree.leaves(tree)) for tree in arrays]
        self._counts, before = counts, sum(counts[:2])
        given[:before] = [lowering.borrowed(array) for array in given[:before]]
        occupied, limit = do.load("b", self._occupied), do.load("i", self._limit)
        do.mark_uniform(limit)
        first: list[Array] = [do.constant("i", 0), *given[before:]]
        goes_at = names.index("goes")

        def looked(state: list[Array]) -> list[Array]:
            return _results(lowering, looks, [*given[:before], *state])

        def holds(carries: list[Array]) -> int:
            goes = looked([lowering.borrowed(array) for array in carries[1:]])[goes_at]
            count = carries[0]
            assert isinstance(goes, int) and isinstance(count, int)
            do.mark_uniform(count)
            waits = do.do("and", "b", occupied, do.do("not", "b", goes))
            calm = do.do("not", "b", do.do("any", "b", waits))
            return do.do("and", "b", calm, do.do("ilt", "b", count, limit))

        def go(carries: list[Array]) -> list[Array]:
            count = carries[0]
            assert isinstance(count, int)
            state = _results(lowering, steps, [*given[:before], *carries[1:]])
            return [do.do("add", "i", count, do.constant("i", 1)), *state]

        count, *state = lowering.loop(first, holds, go, uniform=True)
        for array, region in zip(state, self.regions[before:], strict=True):
            _store(lowering, array, region)
        self.status: dict[str, Region] = {}
        for name, array, v in zip(names, looked(state), looks.jaxpr.outvars, strict=True):
            kind_of(v.aval)
            region = Region(do.allocate(1), (), np.dtype(v.aval.dtype))
            _store(lowering, array, region)
            self.status[name] = region
        assert isinstance(count, int)
        lowered = time.perf_counter()
        text = llvm_text(do, "lanes", count)
        self._call: NativeCall = compiled(text, "lanes", code_folder())
        self._constants, self._cells = lowering.constants, do.cells
        self._static, self._structure = static, structure
        self.text = text
        self.seconds = {
            "tracing": traced - began,
            "lowering": lowered - traced,
            "compiling": time.perf_counter() - lowered,
        }

    def columns(self, shared: Any) -> Columns:
        """Memory of a group of lanes, none of which is occupied."""
        columns = Columns(self._cells)
        for start, array in self._constants.items():
            region = Region(start, array.shape, array.dtype)
            columns.write(region, array, slice(None))
        leaves = jax.tree.leaves(eqx.filter(shared, eqx.is_array))
        for leaf, region in zip(leaves, self.regions[: self._counts[0]], strict=True):
            columns.write(region, np.asarray(leaf), slice(None))
        return columns

    def put(self, columns: Columns, lane: int, own: Any, state: Any) -> None:
        """Occupy a lane."""
        leaves = jax.tree.leaves(eqx.filter((own, state), eqx.is_array))
        for leaf, region in zip(leaves, self.regions[self._counts[0] :], strict=True):
            columns.write(region, np.asarray(leaf), lane)
        columns.whole[self._occupied, lane] = 1

    def leave(self, columns: Columns, lane: int) -> None:
        """Say that a lane is not occupied any more."""
        columns.whole[self._occupied, lane] = 0

    def taken(self, columns: Columns, lane: int) -> tuple[Any, Any]:
        """What a lane has for itself, and its state."""
        numbers = [columns.read(region, lane) for region in self.regions[self._counts[0] :]]
        blank = [None] * self._counts[0]
        trees = jax.tree.unflatten(self._structure, [*blank, *numbers])
        return eqx.combine(trees[1:], self._static[1:])

    def status_of(self, columns: Columns) -> dict[str, np.ndarray]:
        """The status of all lanes, by name."""
        return {
            name: (columns.floats if region.dtype.kind == "f" else columns.whole)[region.start]
            for name, region in self.status.items()
        }

    def run(self, columns: Columns, limit: int) -> int:
        """Turns until an occupied lane needs its host, at most so many; their number."""
        columns.whole[self._limit] = limit
        return self._call(columns.floats.ctypes.data)


def _results(lowering: Lowering, closed: Any, arguments: list[Array]) -> list[Array]:
    outs = [True] * len(closed.jaxpr.outvars)
    jaxpr, _ = partial_eval.dce_jaxpr(closed.jaxpr, outs, instantiate=True)
    consts = [lowering.constant(const) for const in closed.consts]
    return lowering.run(jaxpr, consts, arguments)


def _store(lowering: Lowering, array: Array, region: Region) -> None:
    if isinstance(array, Memory):
        if array.start != region.start:
            lowering.copied(array, region.start)
        return
    for k, value in enumerate(lowering.values(array)):
        lowering.do.store(value, region.start + k)

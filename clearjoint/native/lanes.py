"""Compute several lanes at once by a loop in native code, each in one slot of the processor's
vectors.

The memory of a group of lanes has a column for each lane. The loop returns to its host, the Python
code that calls it, when a lane needs the host, for instance to report rows; this does not affect
the other lanes. The arithmetic of a lane is the same whatever the other columns contain.
"""

import abc
import time
from collections.abc import Callable

import equinox as eqx
import jax
import numpy as np
from jax.extend import core
from jax.interpreters import partial_eval
from jaxtyping import PyTree

from ..compilation.tracing import program_of
from .control import borrowed, loop
from .functions import RULES, Memory, cells_of
from .llvm_text import llvm_text
from .lowering import Array, InMemory, Lowering, Region, aval_of
from .machine_code import compiled
from .operations import Operations

WIDTH = 8
"""Number of lanes in a group: as many as a vector of 512 bits holds, or two of 256."""
LONGEST_RUN = 4096
"""Number of iterations after which the loop returns at the latest."""


class Columns:
    """Memory of a group of lanes, with a column for each lane.

    - `floats`, `whole`: the same memory, (cells, lanes), as floats and as integers.
    - `address`: address of the first cell.
    """

    def __init__(self, cells: int, width: int):
        memory = Memory(cells * width)
        self.floats = memory.floats.reshape(cells, width)
        self.whole = memory.whole.reshape(cells, width)
        self.address = memory.address


class AbstractLaneLoop(abc.ABC):
    """A loop that advances the states of a group of lanes.

    - `width`: number of lanes.
    - `own_cells`, `state_cells`: cells of the constant data of a lane and of its state, in both
      cases one array after the other.
    - `occupied`: cell that is 1 if the column has a lane, else 0.
    - `status`: regions of the scalars that describe the status of a lane, by name.
    """

    width: int
    own_cells: slice
    state_cells: slice
    occupied: int
    status: dict[str, Region]

    @abc.abstractmethod
    def columns(self, shared: PyTree) -> Columns:
        """Return memory for a group of lanes, with no column occupied."""

    @abc.abstractmethod
    def run(self, columns: Columns) -> int:
        """Advance all lanes until one needs its host, or up to a largest number of steps; return
        the number of steps."""

    def write_lane(self, columns: Columns, lane: int, own: np.ndarray, state: np.ndarray) -> None:
        """Put a lane into column `lane`, given the cells of its constant data `own` and of its
        state, (cells,) each."""
        columns.floats[self.own_cells, lane] = own
        columns.floats[self.state_cells, lane] = state
        columns.whole[self.occupied, lane] = 1

    def leave(self, columns: Columns, lane: int) -> None:
        """Mark a column as not occupied."""
        columns.whole[self.occupied, lane] = 0

    def status_of(self, columns: Columns) -> dict[str, np.ndarray]:
        """Return the status of all columns, (lanes,) each, by name."""
        return {
            name: (columns.floats if region.dtype.kind == "f" else columns.whole)[region.start]
            for name, region in self.status.items()
        }


class LaneLoop(AbstractLaneLoop):
    """A loop over the steps of lanes, in native code.

    **Arguments:** `step(shared, own, state)` returns the state after a step; `status(shared, own,
    state)` a dictionary of scalars, in which `goes` says whether the lane can take a step without
    its host. `shared` is the same for all lanes; `own` and `state` belong to one lane. All are
    PyTrees of arrays.
    """

    width = WIDTH

    def __init__(
        self,
        step: Callable[[PyTree, PyTree, PyTree], PyTree],
        status: Callable[[PyTree, PyTree, PyTree], dict[str, PyTree]],
        shared: PyTree,
        own: PyTree,
        state: PyTree,
    ):
        began = time.thread_time()
        arrays, static = eqx.partition((shared, own, state), eqx.is_array)
        leaves, structure = jax.tree.flatten(arrays)
        names: list[str] = []

        def step_of_arrays(*leaves: PyTree) -> list[PyTree]:
            trees = eqx.combine(jax.tree.unflatten(structure, leaves), static)
            return jax.tree.leaves(eqx.filter(step(*trees), eqx.is_array))

        def status_of_arrays(*leaves: PyTree) -> list[PyTree]:
            values = status(*eqx.combine(jax.tree.unflatten(structure, leaves), static))
            names[:] = values
            return [jax.numpy.asarray(value) for value in values.values()]

        steps, checks = (program_of(f, *leaves)[0] for f in (step_of_arrays, status_of_arrays))
        traced = time.thread_time()
        ops = Operations(width=WIDTH)
        lowering = Lowering(ops, RULES)
        avals = [aval_of(v) for v in steps.jaxpr.invars]
        regions = [Region.of(aval, ops.allocate(aval.size)) for aval in avals]
        arguments = [
            lowering.argument(aval, region.start)
            for aval, region in zip(avals, regions, strict=True)
        ]
        counts = [len(jax.tree.leaves(tree)) for tree in arrays]
        fixed = [borrowed(array) for array in arguments[: counts[0] + counts[1]]]
        state_regions = regions[len(fixed) :]
        self.occupied, self._limit = ops.allocate(1), ops.allocate(1)
        occupied, limit = ops.load("b", self.occupied), ops.load("i", self._limit)
        ops.mark_uniform(limit)

        def status_values(state: list[Array]) -> list[Array]:
            return _inlined(lowering, checks, [*fixed, *map(borrowed, state)])

        def holds(carries: list[Array]) -> int:
            count, goes = carries[0], status_values(carries[1:])[names.index("goes")]
            assert isinstance(goes, int) and isinstance(count, int)
            ops.mark_uniform(count)
            # All lanes stop together as soon as one of them needs its host, so that the condition
            # is uniform and no lane's state has to be kept from changing.
            waits = ops.emit("and", "b", occupied, ops.emit("not", "b", goes))
            none_waits = ops.emit("not", "b", ops.emit("any", "b", waits))
            return ops.emit("and", "b", none_waits, ops.emit("ilt", "b", count, limit))

        def iterate(carries: list[Array]) -> list[Array]:
            count = carries[0]
            assert isinstance(count, int)
            following = ops.emit("add", "i", count, ops.constant("i", 1))
            return [following, *_inlined(lowering, steps, [*fixed, *carries[1:]])]

        first: list[Array] = [ops.constant("i", 0), *arguments[len(fixed) :]]
        count, *after = loop(lowering, first, holds, iterate, uniform=True)
        assert isinstance(count, int)
        # The next call goes on with these states.
        for array, region in zip(after, state_regions, strict=True):
            if not (isinstance(array, InMemory) and array.start == region.start):
                lowering.write(array, region.start)
        outputs = zip(names, status_values(after), checks.jaxpr.outvars, strict=True)
        self.status = {name: lowering.stored(array, aval_of(v)) for name, array, v in outputs}
        lowered = time.thread_time()
        self.text = llvm_text(ops, count)
        written = time.thread_time()
        self._code = compiled(self.text)
        self._cells, self._constants = ops.cells, lowering.constants
        self.seconds = {
            "tracing": traced - began,
            "lowering": lowered - traced,
            "writing": written - lowered,
            "compiling": time.thread_time() - written,
        }
        ends = np.cumsum([0, *counts])
        parts = [regions[a:b] for a, b in zip(ends, ends[1:], strict=False)]
        self._shared, self.own_cells, self.state_cells = (
            slice(part[0].start, part[-1].end) if part else slice(0, 0) for part in parts
        )

    def __getstate__(self) -> dict[str, object]:
        return {**vars(self), "text": ""}

    def columns(self, shared: PyTree) -> Columns:
        """Return memory for a group of lanes, with no column occupied."""
        columns = Columns(self._cells, WIDTH)
        for start, array in self._constants.items():
            columns.floats[start : start + array.size] = cells_of([array])[:, None]
        leaves = jax.tree.leaves(eqx.filter(shared, eqx.is_array))
        columns.floats[self._shared] = cells_of(leaves)[:, None]
        return columns

    def run(self, columns: Columns) -> int:
        """Advance all lanes until one needs its host, or by `LONGEST_RUN` steps; return the number
        of steps."""
        columns.whole[self._limit] = LONGEST_RUN
        return self._code(columns.address)


def _inlined(lowering: Lowering, closed: core.ClosedJaxpr, arguments: list[Array]) -> list[Array]:
    outs = [True] * len(closed.jaxpr.outvars)
    jaxpr, _ = partial_eval.dce_jaxpr(closed.jaxpr, outs, instantiate=True)
    return lowering.inline_with(jaxpr, closed.consts, arguments)

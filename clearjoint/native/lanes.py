"""A loop over lanes that lie side by side in vectors.

Each lane has a column of memory. The function returns when a lane in it needs its host: what that
does with the columns concerns no other lane, and the arithmetic of a lane is the same beside any
others.
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
from .functions import Image, cells_of
from .llvm_text import llvm_text
from .lowering import Array, InMemory, Lowering, Region, aval_of
from .machine_code import compiled
from .operations import Operations
from .primitives import RULES

WIDTH = 8
"""Lanes side by side: as many as a vector of 512 bits holds, or two of 256."""
TURNS = 4096
"""Turns after which a loop returns at the latest."""


class Columns:
    """Memory of lanes side by side: (cells, lanes), as floats and as integers."""

    def __init__(self, cells: int, width: int):
        image = Image(cells * width)
        self.floats = image.floats.reshape(cells, width)
        self.whole = image.whole.reshape(cells, width)
        self.address = image.address


class AbstractLaneLoop(abc.ABC):
    """A loop that takes lanes side by side from one state to the next.

    - `width`: lanes side by side.
    - `own_cells`, `state_cells`: cells of what a lane has for itself, and of its state, in each of
      which the arrays lie one behind the other; `occupied`: the cell that says whether a column has
      a lane; `status`: the arrays that tell how a lane is, by name.
    """

    width: int
    own_cells: slice
    state_cells: slice
    occupied: int
    status: dict[str, Region]

    @abc.abstractmethod
    def columns(self, shared: PyTree) -> Columns:
        """Memory of a group of lanes, none of which is occupied."""

    @abc.abstractmethod
    def run(self, columns: Columns) -> int:
        """Take turns until lanes need their host, or for some time; the number of turns."""

    def write_lane(self, columns: Columns, lane: int, own: np.ndarray, state: np.ndarray) -> None:
        """Occupy a column with the cells of what its lane has for itself, and of its state."""
        columns.floats[self.own_cells, lane] = own
        columns.floats[self.state_cells, lane] = state
        columns.whole[self.occupied, lane] = 1

    def leave(self, columns: Columns, lane: int) -> None:
        """Say that a column has no lane any more."""
        columns.whole[self.occupied, lane] = 0

    def status_of(self, columns: Columns) -> dict[str, np.ndarray]:
        """The status of all lanes, by name."""
        return {
            name: (columns.floats if region.dtype.kind == "f" else columns.whole)[region.start]
            for name, region in self.status.items()
        }


class LaneLoop(AbstractLaneLoop):
    """A loop in native code that applies `relative_angle` to lanes side by side.

    **Arguments:** `turn(shared, own, state)` gives the state after a step; `status(shared, own,
    state)` a dictionary of scalars, of which `goes` says whether the lane can go on without its
    host. All are PyTrees of arrays; of a lane, and for `shared` of all lanes.
    """

    width = WIDTH

    def __init__(
        self,
        turn: Callable[[PyTree, PyTree, PyTree], PyTree],
        status: Callable[[PyTree, PyTree, PyTree], dict[str, PyTree]],
        shared: PyTree,
        own: PyTree,
        state: PyTree,
    ):
        began = time.thread_time()
        trees = shared, own, state
        arrays, static = eqx.partition(trees, eqx.is_array)
        leaves, structure = jax.tree.flatten(arrays)
        names: list[str] = []

        def turned(*leaves: PyTree) -> list[PyTree]:
            given = eqx.combine(jax.tree.unflatten(structure, leaves), static)
            return jax.tree.leaves(eqx.filter(turn(*given), eqx.is_array))

        def looked_at(*leaves: PyTree) -> list[PyTree]:
            found = status(*eqx.combine(jax.tree.unflatten(structure, leaves), static))
            names[:] = found
            return [jax.numpy.asarray(value) for value in found.values()]

        steps, looks = (program_of(f, *leaves)[0] for f in (turned, looked_at))
        traced = time.thread_time()
        do = Operations(width=WIDTH)
        lowering = Lowering(do, RULES)
        regions = [Region.of(aval_of(v), do.allocate(aval_of(v).size)) for v in steps.jaxpr.invars]
        given = [
            lowering.given(aval_of(v), region.start)
            for v, region in zip(steps.jaxpr.invars, regions, strict=True)
        ]
        counts = [len(jax.tree.leaves(tree)) for tree in arrays]
        fixed = [borrowed(array) for array in given[: counts[0] + counts[1]]]
        state_regions = regions[len(fixed) :]
        self.occupied, self._limit = do.allocate(1), do.allocate(1)
        occupied, limit = do.load("b", self.occupied), do.load("i", self._limit)
        do.mark_uniform(limit)

        def looked(state: list[Array]) -> list[Array]:
            return _results(lowering, looks, [*fixed, *map(borrowed, state)])

        def holds(carries: list[Array]) -> int:
            count, goes = carries[0], looked(carries[1:])[names.index("goes")]
            assert isinstance(goes, int) and isinstance(count, int)
            do.mark_uniform(count)
            # All lanes stop together, as soon as one of them waits for its host.
            waits = do.do("and", "b", occupied, do.do("not", "b", goes))
            calm = do.do("not", "b", do.do("any", "b", waits))
            return do.do("and", "b", calm, do.do("ilt", "b", count, limit))

        def go(carries: list[Array]) -> list[Array]:
            count = carries[0]
            assert isinstance(count, int)
            following = do.do("add", "i", count, do.constant("i", 1))
            return [following, *_results(lowering, steps, [*fixed, *carries[1:]])]

        first: list[Array] = [do.constant("i", 0), *given[len(fixed) :]]
        count, *after = loop(lowering, first, holds, go, uniform=True)
        for array, region in zip(after, state_regions, strict=True):
            _store(lowering, array, region)
        shown = zip(names, looked(after), looks.jaxpr.outvars, strict=True)
        self.status = {name: lowering.stored(array, aval_of(v)) for name, array, v in shown}
        assert isinstance(count, int)
        lowered = time.thread_time()
        self.text = llvm_text(do, "lanes", count)
        written = time.thread_time()
        self._code = compiled(self.text, "lanes")
        self._cells, self._constants = do.cells, lowering.constants
        self.seconds = {
            "tracing": traced - began,
            "lowering": lowered - traced,
            "writing": written - lowered,
            "compiling": time.thread_time() - written,
        }
        ends = np.cumsum([0, *counts])
        parts = [regions[a:b] for a, b in zip(ends, ends[1:], strict=False)]
        self._shared, self.own_cells, self.state_cells = map(_cells, parts)

    def __getstate__(self) -> dict[str, object]:
        return {**vars(self), "text": ""}

    def columns(self, shared: PyTree) -> Columns:
        """Memory of a group of lanes, none of which is occupied."""
        columns = Columns(self._cells, WIDTH)
        for start, array in self._constants.items():
            columns.floats[start : start + array.size] = cells_of([array])[:, None]
        leaves = jax.tree.leaves(eqx.filter(shared, eqx.is_array))
        columns.floats[self._shared] = cells_of(leaves)[:, None]
        return columns

    def run(self, columns: Columns) -> int:
        """Turns until an occupied lane needs its host, at most `TURNS`; their number."""
        columns.whole[self._limit] = TURNS
        return self._code(columns.address)


def _cells(regions: list[Region]) -> slice:
    """The cells of regions that lie one behind the other."""
    return slice(regions[0].start, regions[-1].end) if regions else slice(0, 0)


def _results(lowering: Lowering, closed: core.ClosedJaxpr, arguments: list[Array]) -> list[Array]:
    outs = [True] * len(closed.jaxpr.outvars)
    jaxpr, _ = partial_eval.dce_jaxpr(closed.jaxpr, outs, instantiate=True)
    consts = [lowering.constant(const) for const in closed.consts]
    return lowering.run(jaxpr, consts, arguments)


def _store(lowering: Lowering, array: Array, region: Region) -> None:
    """Write an array into its region, unless it is there."""
    if not isinstance(array, InMemory):
        for k, value in enumerate(lowering.values(array)):
            lowering.do.store(value, region.start + k)
    elif array.start != region.start:
        lowering.copied(array, region.start)

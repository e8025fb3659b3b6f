"""Loops that compute several lanes at once, each in one element of the processor's vectors.

A lane is one of several runs that differ only in numbers, as in a sweep. The memory of a group of
lanes has a column for each lane. A loop returns to its host, the Python code that called it, when
lanes need the host, for instance to empty a buffer of results. The next call continues all lanes.
The arithmetic of a lane does not depend on other columns.
"""

import abc
import threading
from collections.abc import Callable

import equinox as eqx
import jax
import numpy as np
from jax.extend import core
from jax.interpreters import partial_eval
from jaxtyping import PyTree
from typing_extensions import override

from .._compilation.xla import begins_a_program, program_is_made_inside, program_of
from .cells import Memory, Region, numbers_of
from .control import borrowed, loop
from .functions import RULES, FlatArguments
from .lowering import Array, InMemory, Lowering, aval_of, scalar
from .machine_code import Code, RecentPrograms, Stopwatch, load_or_make
from .operations import Operations, Symbol, Value

WIDTH = 8
"""Number of lanes in a group: the numbers in a vector of 512 bits, or in two of 256."""
LONGEST_RUN = 4096
"""Most steps before the loop returns, so its host can react to an interrupt and show progress."""


class AbstractLaneLoop(abc.ABC):
    """A loop that advances the states of a group of lanes, each in a column of the memory.

    - `width`: number of lanes.
    - `own_cells`, `state_cells`: cells of the constant data of a lane, and of its state.
    - `occupied`: cell that is 1 if the column has a lane, else 0. A column without a lane is
      advanced too, but the loop never returns because of it.
    - `status`: regions, by name, of the scalars that the loop computes for its host from the state
      of a lane, such as "moves": whether the lane can take a step without the host.
    """

    width: int
    own_cells: slice
    state_cells: slice
    occupied: int
    status: dict[str, Region]

    @abc.abstractmethod
    def columns(self, shared: PyTree) -> Memory:
        """Return memory for a group of lanes with the data `shared`, and no lane in any column."""

    @abc.abstractmethod
    def run(self, columns: Memory) -> None:
        """Advance all lanes by the same number of steps.

        The subclass decides how many lanes must need the host before the loop returns, and after
        how many steps it returns at the latest.
        """

    def write_lane(self, columns: Memory, lane: int, own: np.ndarray, state: np.ndarray) -> None:
        """Put a lane into the column with the index `lane`. `own` and `state` are the rows of
        numbers (see `Cells`) of the lane's constant data and of its state."""
        columns.floats[self.own_cells, lane] = own
        columns.floats[self.state_cells, lane] = state
        columns.integers[self.occupied, lane] = 1

    def leave(self, columns: Memory, lane: int) -> None:
        """Mark the column `lane` as not occupied."""
        columns.integers[self.occupied, lane] = 0

    def status_of(self, columns: Memory) -> dict[str, np.ndarray]:
        """Return the `status` after the last `run`, by name, (width,) each, with int64 for integers
        and bools. The arrays are views of the memory, which the next `run` changes."""
        return {
            name: numbers_of(columns.floats, region.dtype)[region.start]
            for name, region in self.status.items()
        }


class LaneLoop(AbstractLaneLoop):
    """A loop over the steps of `WIDTH` lanes, in machine code.

    **Arguments:**

    - `step`: function of `shared`, `own` and `state` that returns the state after a step.
    - `status`: function of the same three that returns scalars by name, among them "moves": whether
      the lane can take a step without the host.
    - `shared`: data of all lanes.
    - `own`, `state`: constant data and state of one lane. Of the arrays in `shared`, `own` and
      `state`, only shapes and dtypes are used; all other leaves become part of the program.

    **Raises:** `UnsupportedPrimitiveError`.
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
        stopwatch = Stopwatch()
        arrays, static = eqx.partition((shared, own, state), eqx.is_array)
        names, steps, checks = _traced(step, status, arrays, static)
        moves = names.index("moves")
        stopwatch.end("tracing")

        # The arguments stand in memory: first `shared` and `own`, then `state`.
        lowering = Lowering(Operations(width=WIDTH), RULES)
        ops = lowering.ops
        regions = [lowering.region(aval_of(v)) for v in steps.jaxpr.invars]
        arguments = [lowering.argument(region) for region in regions]
        counts = [len(jax.tree.leaves(tree)) for tree in arrays]
        ends = np.cumsum([0, *counts]).tolist()
        shared_regions, own_regions, state_regions = (
            regions[begin:end] for begin, end in zip(ends, ends[1:], strict=False)
        )
        start_of_state = ends[2]
        # Each step reads `shared` and `own`, so no step may overwrite them.
        fixed = [borrowed(array) for array in arguments[:start_of_state]]

        # A further cell tells the loop which columns are occupied.
        self.occupied = ops.allocate(1)
        occupied = ops.load("b", self.occupied)

        def status_values(state: list[Array]) -> list[Array]:
            return lowering.inline(checks, [*fixed, *map(borrowed, state)])

        # The carries of the loop are the number of steps and the arrays of the state.
        def holds(carries: list[Array]) -> Value:
            count, can_move = scalar(carries[0]), scalar(status_values(carries[1:])[moves])
            ops.mark_uniform(count)
            # All lanes stop together as soon as one of them needs its host, so that the condition
            # is uniform and no lane's state has to be kept from changing. After `LONGEST_RUN` steps
            # they stop too, so that the host can react to an interrupt.
            waits = Symbol(ops, occupied) & ~Symbol(ops, can_move)
            return (~waits.emit("any") & Symbol(ops, count).compare("lt", LONGEST_RUN)).value

        def iterate(carries: list[Array]) -> list[Array]:
            following = (Symbol(ops, scalar(carries[0])) + 1).value
            return [following, *lowering.inline(steps, [*fixed, *carries[1:]])]

        first_carries: list[Array] = [ops.constant("i", 0), *arguments[start_of_state:]]
        _, *after = loop(lowering, first_carries, holds, iterate, uniform=True)

        # The next call goes on with these states. Arrays that the loop has updated in place are in
        # their cells already.
        for array, region in zip(after, state_regions, strict=True):
            if not (isinstance(array, InMemory) and array.start == region.start):
                lowering.write(array, region.start)
        outputs = zip(names, status_values(after), checks.jaxpr.outvars, strict=True)
        self.status = {name: lowering.stored(array, aval_of(v)) for name, array, v in outputs}
        stopwatch.end("lowering")
        self.code = Code(lowering, stopwatch)
        self._shared = shared_regions
        self.own_cells, self.state_cells = (
            slice(part[0].start, part[-1].cells.stop) if part else slice(0, 0)
            for part in (own_regions, state_regions)
        )

    @override
    def columns(self, shared: PyTree) -> Memory:
        columns = self.code.memory()
        leaves = jax.tree.leaves(eqx.filter(shared, eqx.is_array))
        for leaf, region in zip(leaves, self._shared, strict=True):
            columns.write(region, leaf)
        return columns

    @override
    def run(self, columns: Memory) -> None:
        self.code.run(columns)


_LOOPS: RecentPrograms[LaneLoop] = RecentPrograms()
"""Loops of this process, by the function of a step and the `FlatArguments.key` of their data."""
_LOOPS_LOCK = threading.Lock()


def made_lane_loop(
    step: Callable[[PyTree, PyTree, PyTree], PyTree],
    status: Callable[[PyTree, PyTree, PyTree], dict[str, PyTree]],
    trees: tuple[PyTree, PyTree, PyTree],
) -> LaneLoop:
    """Return the `LaneLoop` with the arguments `step`, `status` and `trees` (its `shared`, `own`
    and `state`): made earlier in this process, loaded from disk, or compiled."""
    key = step, FlatArguments.of(trees).key
    # The lock makes other threads wait for a loop that is being compiled.
    with program_is_made_inside(), _LOOPS_LOCK:
        loop = _LOOPS.recent(key)
        if loop is None:
            # Progress bars show for how long the loop has been compiled, from its tracing on. The
            # key of the saved program is made of the function itself, not of its wrapper.
            traced = begins_a_program(step)
            loop = load_or_make(step, trees, lambda: LaneLoop(traced, status, *trees))
            _LOOPS.add(key, loop)
        return loop


def _traced(
    step: Callable[..., PyTree],
    status: Callable[..., dict[str, PyTree]],
    arrays: tuple[PyTree, PyTree, PyTree],
    static: tuple[PyTree, PyTree, PyTree],
) -> tuple[list[str], core.ClosedJaxpr, core.ClosedJaxpr]:
    """Return the names of the results of `status`, and jaxprs of `step` and `status` as functions
    of the `arrays` in a `LaneLoop`'s `shared`, `own` and `state`; `static`: all else in these."""
    names: list[str] = []

    def arrays_after(*trees: PyTree) -> list[PyTree]:
        return jax.tree.leaves(eqx.filter(step(*trees), eqx.is_array))

    # The names are known once JAX has traced this function.
    def scalars(*trees: PyTree) -> list[PyTree]:
        values = status(*trees)
        names[:] = values
        return [jax.numpy.asarray(value) for value in values.values()]

    # All arguments are kept (`instantiate`), so that both jaxprs have the same ones.
    def program(function: Callable[..., list[PyTree]]) -> core.ClosedJaxpr:
        closed = program_of(lambda *trees: function(*eqx.combine(trees, static)), *arrays).jaxpr
        all_results = [True] * len(closed.jaxpr.outvars)
        needed, _ = partial_eval.dce_jaxpr(closed.jaxpr, all_results, instantiate=True)
        return core.ClosedJaxpr(needed, closed.consts)

    return names, program(arrays_after), program(scalars)

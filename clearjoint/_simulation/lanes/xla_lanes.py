"""Loop over lanes compiled by XLA, for accelerators, and for scenes on CPUs for which
`clearjoint._native` cannot make machine code.

All programs compute a fixed number of lanes, so that the rounding in a lane does not depend on the
number of other lanes. Between two calls, lanes are in memory that is divided into cells of 8 bytes,
one column of cells for each lane.
"""

from collections.abc import Callable
from functools import partial
from typing import TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree
from typing_extensions import override

from ..._compilation.xla import Compiled, in_one_function
from ..._native.cells import Cells, Memory, Region
from ..._native.lanes import AbstractLaneLoop

OnLane: TypeAlias = Callable[..., PyTree]
ON_CPU, ON_ACCELERATOR = 64, 4096
"""Number of lanes of one program. An accelerator has many more arithmetic units to occupy."""
TURNS = 256
"""Largest number of turns between two returns to Python, where progress and Ctrl-C are handled."""
WAITING = 8
"""A loop returns to Python as soon as the fraction 1/`WAITING` of its lanes waits. Returning later
would leave more lanes idle, and returning earlier would copy the lanes more often."""


def width() -> int:
    """Return the number of lanes that one program computes side by side on JAX's default device."""
    return ON_CPU if jax.default_backend() == "cpu" else ON_ACCELERATOR


class XlaLaneLoop(AbstractLaneLoop):
    """A loop over lanes compiled by XLA.

    **Arguments:** `turn`: function (shared, own, state) that returns the state of a lane after a
    turn, an iteration of the loop. It changes no lane that has ended or waits for Python. `status`:
    function of the same arguments that returns scalars by name, among them "moves": whether a turn
    would change the lane. `shared`: data that all lanes share. `own`, `state`: examples of the data
    and the state of one lane, of which only structure, shapes and dtypes are used."""

    def __init__(self, turn: OnLane, status: OnLane, shared: PyTree, own: PyTree, state: PyTree):
        self.width, self._functions = width(), (turn, status)
        self._take_turns = _TURNS_IN_ONE_FUNCTION
        self._shared, self._own, self._state = shared, Cells(own), Cells(state)
        # The cells of a lane's column are, in this order: its constant data, its state, one cell
        # that tells whether the column is occupied, and one cell for each name of the status.
        self.own_cells = slice(0, self._own.size)
        self.state_cells = slice(self._own.size, self._own.size + self._state.size)
        self.occupied = self.state_cells.stop
        shown = eqx.filter_eval_shape(status, shared, own, state)
        self.status = {
            name: Region.of(form, self.occupied + 1 + k)
            for k, (name, form) in enumerate(shown.items())
        }

    @override
    def columns(self, shared: PyTree) -> Memory:
        del shared
        return Memory(self.occupied + 1 + len(self.status), self.width)

    @override
    def run(self, columns: Memory) -> None:
        # Cells become arrays with a first axis of lanes, and the new states become cells again.
        own = self._own.trees(columns.floats[self.own_cells].T)
        state = self._state.trees(columns.floats[self.state_cells].T)
        occupied = columns.integers[self.occupied] > 0
        arguments = self._functions, self._shared, own, state, occupied
        take_turns = self._take_turns  # Read once, as threads share the loop.
        try:
            state, status = take_turns(*arguments)
        except jax.errors.JaxRuntimeError:
            if take_turns is not _TURNS_IN_ONE_FUNCTION:
                raise
            # Some operations, such as scatters and calls of LAPACK, cannot be part of one native
            # function, so the loop is compiled in XLA's usual way.
            self._take_turns = _TURNS_AS_USUAL
            state, status = _TURNS_AS_USUAL(*arguments)
        columns.floats[self.state_cells] = self._state.rows(state).T
        for name, shown in self.status_of(columns).items():
            shown[:] = status[name]


class XlaFunction:
    """A function(shared, *trees) of data shared by all lanes and PyTrees of one lane, compiled by
    XLA for many lanes. `examples` have the shapes of `trees`. A call takes the cells of `trees` and
    returns those of the results, in both cases with a row, not a column, for each lane. The
    attribute `results` is the layout of the cells of one lane's result."""

    def __init__(self, function: OnLane, shared: PyTree, *examples: PyTree):
        self._function, self._shared = function, shared
        self._arguments, self._width = [Cells(tree) for tree in examples], width()
        shapes = eqx.filter_eval_shape(function, shared, *examples)
        self.results = Cells(zeros_like(shapes))

    def __call__(self, rows: np.ndarray) -> np.ndarray:
        # The empty array is the result for no rows, which `np.concatenate` could not make.
        results, width = [np.zeros((0, self.results.size))], self._width
        # Columns of `rows` between the cells of one argument and those of the next.
        ends = np.cumsum([cells.size for cells in self._arguments])[:-1]
        # The program has a fixed number of lanes. Too few lanes are repeated to fill it up, and the
        # results of the repeated ones are dropped.
        for begin in range(0, len(rows), width):
            group = rows[begin : begin + width]
            # The cells of each argument, for all lanes of the group.
            arguments = np.split(np.resize(group, (width, rows.shape[1])), ends, axis=1)
            trees = [
                layout.trees(cells)
                for layout, cells in zip(self._arguments, arguments, strict=True)
            ]
            result = _for_all(self._function, self._shared, *trees)
            results.append(self.results.rows(result)[: len(group)])
        return np.concatenate(results)


def zeros_like(shapes: PyTree) -> PyTree:
    return jax.tree.map(
        lambda s: np.zeros(s.shape, s.dtype) if isinstance(s, jax.ShapeDtypeStruct) else s, shapes
    )


def _turns(
    functions: tuple[OnLane, ...], shared: PyTree, own: PyTree, state: PyTree, occupied: jax.Array
) -> tuple[PyTree, dict[str, jax.Array]]:
    turn, status = (jax.vmap(partial(function, shared)) for function in functions)

    # Columns without a lane must not count as waiting, because their contents are meaningless.
    def continues(now: tuple[jax.Array, PyTree]) -> jax.Array:
        count, states = now
        waiting = occupied & jnp.logical_not(status(own, states)["moves"])
        return (count < TURNS) & (WAITING * waiting.sum() < occupied.sum())

    def go(now: tuple[jax.Array, PyTree]) -> tuple[jax.Array, PyTree]:
        count, states = now
        return count + 1, turn(own, states)

    _, state = jax.lax.while_loop(continues, go, (jnp.zeros((), int), state))
    return state, status(own, state)


_TURNS_IN_ONE_FUNCTION = Compiled(in_one_function(_turns))
# XLA (jaxlib 0.10.2) crashes while it compiles a loop that saves states at given times, unless its
# fusion emitters are switched off.
_TURNS_AS_USUAL = Compiled(_turns, xla_cpu_use_fusion_emitters=False)


@Compiled
def _for_all(function: OnLane, shared: PyTree, *trees: PyTree) -> PyTree:
    return jax.vmap(partial(function, shared))(*trees)

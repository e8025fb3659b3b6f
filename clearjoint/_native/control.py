"""Rules of the primitives for branches and loops.

In a program of several lanes a condition is a vector. A branch is executed if its condition holds
in any lane, and a loop goes on as long as its condition holds in any lane. Each lane then selects
its results, and writes to memory only where its own condition holds.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from jax.extend.core import ClosedJaxpr

from .indexing import read_block
from .lowering import (
    LARGEST_UNROLLED,
    LONGEST_CHOICE,
    Array,
    Equation,
    EquationRule,
    InMemory,
    Lowering,
    Packed,
    UnsupportedPrimitiveError,
    aval_of,
    borrowed,
    count_equations,
    kind_of,
    scalar,
)
from .operations import Symbol, Value


def _cond(lower: Lowering, equation: Equation, condition: Array, *arguments: Array) -> list[Array]:
    """Add a branch (`jax.lax.cond`). If the condition, a bool or the index of a branch, is known
    while the program is built, add only that branch. Otherwise, if both branches are short and
    return no large array, execute both and select the results. In all other cases, jump."""
    branches = equation.params["branches"]
    ops, condition = lower.ops, scalar(condition, "a branch whose condition is an array")
    number = ops.number(condition)
    if number is not None:
        # As in JAX, an index out of range counts as the nearest one.
        chosen = branches[min(max(int(number), 0), len(branches) - 1)]
        return lower.inline(chosen, arguments)
    if len(branches) != 2:
        raise UnsupportedPrimitiveError("switch between more than two branches")
    # From here on there are two branches, and the second one is executed if the condition holds.
    if ops.kinds[condition] != "b":
        condition = Symbol(ops, condition).compare("gt", 0).value
    no, yes = branches
    # A choice between large arrays in memory would copy them, so it is made by a jump.
    in_memory = any(aval_of(v).size > LARGEST_UNROLLED for v in equation.outvars)
    no_size, yes_size = (count_equations(branch.jaxpr) for branch in branches)
    if not in_memory and max(no_size, yes_size) <= LONGEST_CHOICE:
        # Short branches: a few operations whose results are not used cost less than a jump. Since
        # both are executed, neither may overwrite an argument.
        unchanged = [borrowed(argument) for argument in arguments]
        no_results = lower.inline(no, unchanged)
        return _selected(lower, condition, lower.inline(yes, unchanged), no_results)
    if ops.width == 1 or ops.is_uniform(condition):
        return _branch(lower, condition, yes, no, arguments)
    # In several lanes both branches may be executed, each for the lanes that need it. A jump would
    # cost more than a short branch.
    opposite = ops.emit("not", "b", condition)
    yes_jumps, no_jumps = (in_memory or n > LONGEST_CHOICE for n in (yes_size, no_size))
    yes_results = _if_any(lower, condition, yes, arguments, yes_jumps)
    no_results = _if_any(lower, opposite, no, arguments, no_jumps)
    return _selected(lower, condition, yes_results, no_results)


def _selected(lower: Lowering, condition: Value, yes: list[Array], no: list[Array]) -> list[Array]:
    if _moved(yes, no):
        raise UnsupportedPrimitiveError("branches that give different arrays, in lanes")
    ops, selected = lower.ops, []
    for yes_value, no_value in zip(lower.flatten(yes), lower.flatten(no), strict=True):
        kind = ops.kinds[yes_value]
        # For a vector of tangents the condition is repeated for each tangent.
        is_yes = ops.emit("splat", "bp", condition) if kind.endswith("p") else condition
        selected.append(ops.emit("select", kind, is_yes, yes_value, no_value))
    return lower.unflatten(selected, yes)


def _moved(new: Sequence[Array], old: Sequence[Array]) -> list[tuple[InMemory, InMemory]]:
    """Return the pairs of a new and an old array in memory that begin at different cells."""
    return [
        (a, b)
        for a, b in zip(new, old, strict=True)
        if isinstance(a, InMemory) and isinstance(b, InMemory) and a.start != b.start
    ]


def _if_any(
    lower: Lowering, condition: Value, branch: ClosedJaxpr, arguments: Sequence[Array], jumps: bool
) -> list[Array]:
    """Add a branch for the lanes in which its condition holds; in other lanes, its results are not
    used. `jumps`: whether the branch is skipped if its condition holds in no lane."""
    # Without a jump, the branch is executed in all lanes. It must not overwrite its arguments,
    # which the other branch still needs. With a jump, it writes only in the lanes in which its
    # condition holds (`masked`), and these do not use the other branch.
    if not jumps:
        return lower.inline(branch, [borrowed(argument) for argument in arguments])
    results: list[Array] = []

    def compute() -> list[Value]:
        with lower.ops.masked(condition):
            results[:] = lower.inline(branch, arguments)
        return lower.flatten(results)

    def leave_out() -> list[Value]:
        # `compute` has been called before, so the kinds of the results are known.
        return [lower.ops.constant(lower.ops.kinds[v], 0) for v in lower.flatten(results)]

    return lower.unflatten(lower.ops.branch(condition, compute, leave_out), results)


class _DifferentArraysError(Exception):
    """Raised if two branches return the same result in different arrays in memory, and the array of
    the first is not `owned` (`InMemory`), so that the second must not overwrite it."""


def _branch(
    lower: Lowering, condition: Value, yes: ClosedJaxpr, no: ClosedJaxpr, arguments: Sequence[Array]
) -> list[Array]:
    """Add a jump to one of two branches, for a condition that is the same in all lanes."""

    # Cells that an array does not own, such as those of an argument, must not be overwritten. With
    # `copies`, `yes` copies such results, so that `no` can overwrite the copies.
    def added(copies: bool) -> list[Array]:
        first_results: list[Array] = []

        def compute(branch: ClosedJaxpr) -> list[Value]:
            results = lower.inline(branch, arguments)
            # The first call, for `yes`, sets `first_results`. Each must have cells of its own,
            # since `no` may give different arrays where `yes` gives the same array twice.
            if not first_results:
                results = [
                    lower.copied(a) if copies and isinstance(a, InMemory) and not a.owned else a
                    for a in apart(lower, results)
                ]
                first_results[:] = results
            # Later operations read the same cells whichever branch was executed. So `no`, which is
            # added second, must move arrays that it has in other cells (`_moved`) to those of
            # `yes`. If `yes` does not own these, both branches are added anew, with `copies`.
            if not all(of_yes.owned for _, of_yes in _moved(results, first_results)):
                raise _DifferentArraysError
            _move_to(lower, first_results, results)
            return lower.flatten(results)

        outs = lower.ops.branch(condition, partial(compute, yes), partial(compute, no))
        return lower.unflatten(outs, first_results)

    try:
        return added(copies=False)
    except _DifferentArraysError:
        # Most branches that return an array as it was both return the same one. Copies are made
        # only if they do not, which is known once both have been added. What has been added for the
        # first attempt is not part of the program.
        return added(copies=True)


def apart(lower: Lowering, arrays: list[Array]) -> list[Array]:
    """Return the arrays, with a copy of each one that has cells in common with another."""
    in_memory = [array for array in arrays if isinstance(array, InMemory)]
    return [
        # Each array in memory overlaps with itself.
        lower.copied(array)
        if isinstance(array, InMemory) and sum(map(array.overlaps, in_memory)) > 1
        else array
        for array in arrays
    ]


def _while(lower: Lowering, equation: Equation, *arguments: Array) -> list[Array]:
    # JAX's arguments are constants of the condition, constants of the body and first carries.
    parameters = equation.params
    condition, body = parameters["cond_jaxpr"], parameters["body_jaxpr"]
    begin_of_body = parameters["cond_nconsts"]
    begin_of_carries = begin_of_body + parameters["body_nconsts"]
    # Constants are read in each iteration, and the body reads the carries after the condition has
    # read them: none of these may be overwritten.
    condition_consts = [borrowed(a) for a in arguments[:begin_of_body]]
    body_consts = [borrowed(a) for a in arguments[begin_of_body:begin_of_carries]]

    def holds(carries: list[Array]) -> Value:
        (result,) = lower.inline(condition, [*condition_consts, *map(borrowed, carries)])
        return scalar(result, "a loop whose condition is an array")

    def iterate(carries: list[Array]) -> list[Array]:
        return lower.inline(body, [*body_consts, *carries])

    return loop(lower, list(arguments[begin_of_carries:]), holds, iterate)


def loop(
    lower: Lowering,
    first: list[Array],
    holds: Callable[[list[Array]], Value],
    iterate: Callable[[list[Array]], list[Array]],
    uniform: bool = False,
) -> list[Array]:
    """Add a loop to the program, and return its carries (arrays) after the last iteration. Before
    the first iteration, the carries are `first`. Arrays in memory stay in their cells.

    **Arguments:** `holds`: adds the condition for a further iteration, as a function of the
    carries; `iterate`: adds the loop's body for carries, and returns the next ones; `uniform`:
    whether the condition is the same in all lanes.

    **Raises:** `UnsupportedPrimitiveError` for carries in memory in a program of several lanes,
    unless the condition is uniform. Lanes that have finished could not keep these arrays.
    """
    ops = lower.ops
    # The body overwrites its carries, so arrays that must not be overwritten are copied.
    first = [lower.copied(a) if isinstance(a, InMemory) and not a.owned else a for a in first]
    if ops.width > 1 and not uniform and any(isinstance(a, InMemory) for a in first):
        raise UnsupportedPrimitiveError("loops over large arrays in lanes")

    def arrays(values: list[Value]) -> list[Array]:
        carries = lower.unflatten(values, first)
        return [replace(a, owned=True) if isinstance(a, InMemory) else a for a in carries]

    def condition(values: list[Value]) -> Value:
        return holds(arrays(values))

    def body(values: list[Value]) -> list[Value]:
        results = iterate(arrays(values))
        _move_to(lower, first, results)
        # Carries keep their form: a vector stays a vector even if the body returns its elements.
        results = [
            Packed(lower.vector(new))
            if isinstance(old, Packed) and not isinstance(new, Packed | InMemory)
            else new
            for new, old in zip(results, first, strict=True)
        ]
        following = lower.flatten(results)
        if ops.width == 1 or uniform:
            return following
        # The body is executed as long as the condition holds in any lane. Lanes in which it no
        # longer holds keep the values from before this iteration. The condition is added a second
        # time here, because operations of the block that computes it are not reused in the body.
        goes_on = holds(arrays(values))
        pairs = zip(following, values, strict=True)
        return [ops.emit("select", ops.kinds[new], goes_on, new, old) for new, old in pairs]

    return arrays(ops.loop(lower.flatten(first), condition, body))


def _move_to(lower: Lowering, places: Sequence[Array], results: Sequence[Array]) -> None:
    """Copy those `results` that are in memory to the cells of the arrays `places`, from which later
    operations read them."""
    # Arrays may exchange their cells or parts of them. They are copied to new cells first, so that
    # none is overwritten before it is read.
    taken = [old for old in places if isinstance(old, InMemory)]
    moves = [
        (lower.copied(new) if any(map(new.overlaps, taken)) else new, old)
        for new, old in _moved(results, places)
    ]
    for new, old in moves:
        lower.write(new, old.start)


def _scan(lower: Lowering, equation: Equation, *arguments: Array) -> list[Array]:
    # JAX's arguments are constants, first carries and inputs; its results are carries and outputs.
    parameters, ops = equation.params, lower.ops
    if "num_consts" in parameters:
        constants, carried = parameters["num_consts"], parameters["num_carry"]
    else:  # From JAX 0.11 on.
        constants, carried, _ = map(len, parameters["ft_in"].unpack())
    length, closed = parameters["length"], parameters["jaxpr"]
    # Constants and inputs are read in each iteration, and must not be overwritten.
    consts = [borrowed(a) for a in arguments[:constants]]
    first = list(arguments[constants : constants + carried])
    avals = [aval_of(v) for v in equation.invars[constants + carried :]]
    inputs = [
        replace(lower.in_memory(a, tuple(aval.shape)), owned=False)
        for a, aval in zip(arguments[constants + carried :], avals, strict=True)
    ]
    outs = [aval_of(v) for v in equation.outvars[carried:]]
    outputs = [lower.new_array(tuple(out.shape), kind_of(out)) for out in outs]
    end = ops.constant("i", length - 1)

    def first_of_row(memory: InMemory, row: Value) -> Value:
        return (Symbol(ops, row) * math.prod(memory.shape[1:])).value

    # The first carry of the loop is the number of the iteration. An iteration reads one row of each
    # input and writes one row of each output.
    def iterate(carries: list[Array]) -> list[Array]:
        k = scalar(carries[0])
        row = ops.emit("sub", "i", end, k) if parameters["reverse"] else k
        rows = []
        for memory in inputs:
            offsets = np.arange(math.prod(memory.shape[1:]))
            first_element = first_of_row(memory, row)
            rows.append(read_block(lower, memory, first_element, offsets, memory.shape[1:]))
        results = lower.inline(closed, [*consts, *carries[1:], *rows])
        for memory, array in zip(outputs, results[carried:], strict=True):
            lower.write(array, memory.start, first_of_row(memory, row))
        return [(Symbol(ops, k) + 1).value, *results[:carried]]

    def holds(carries: list[Array]) -> Value:
        k = scalar(carries[0])
        # The counter is the same in all lanes, so that rows of all lanes are read and written at
        # once instead of lane by lane.
        ops.mark_uniform(k)
        return ops.emit("ile", "b", k, end)

    # All lanes have the same number of iterations.
    results = loop(lower, [ops.constant("i", 0), *first], holds, iterate, uniform=True)
    return [*results[1:], *map(lower.in_usual_form, outputs)]


RULES: dict[str, EquationRule] = {"cond": _cond, "while": _while, "scan": _scan}
"""Rules by the names of primitives."""

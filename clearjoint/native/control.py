"""Branches and loops; rules as in `.structure`."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from jax.extend import core

from . import elementwise
from .indexing import elements_at
from .lowering import (
    LARGEST_TAKEN_APART,
    LONGEST_CHOICE,
    Array,
    EquationRule,
    InMemory,
    Lowering,
    Packed,
    UnsupportedPrimitiveError,
    aval_of,
    count_equations,
    kind_of,
)
from .operations import Value


def _cond(lower: Lowering, equation: core.JaxprEqn, which: Array, *arguments: Array) -> list[Array]:
    branches = equation.params["branches"]
    assert isinstance(which, int)
    number = lower.do.number(which)
    if number is not None:
        chosen = branches[min(max(int(number), 0), len(branches) - 1)]
        return lower.run(chosen.jaxpr, lower.consts(chosen), arguments)
    if len(branches) != 2:
        raise UnsupportedPrimitiveError("switch between more than two branches")
    if lower.do.kinds[which] != "b":
        which = lower.do.do("igt", "b", which, elementwise.like(lower.do, which, 0))
    no, yes = branches
    in_memory = any(
        int(np.prod(aval_of(v).shape, dtype=int)) > LARGEST_TAKEN_APART for v in equation.outvars
    )
    sizes = [count_equations(branch.jaxpr) for branch in branches]
    if not in_memory and max(sizes) <= LONGEST_CHOICE:
        both = [lower.run(b.jaxpr, lower.consts(b), arguments) for b in branches]
        return _chosen(lower, which, both[1], both[0])
    if lower.do.width > 1:
        opposite = lower.do.do("not", "b", which)
        found = _if_any(lower, which, yes, arguments, sizes[1], in_memory)
        others = _if_any(lower, opposite, no, arguments, sizes[0], in_memory)
        return _chosen(lower, which, found, others)
    return _branch(lower, which, yes, no, arguments)


def _chosen(lower: Lowering, which: Value, yes: list[Array], no: list[Array]) -> list[Array]:
    for new, old in zip(yes, no, strict=True):
        if isinstance(new, InMemory) and isinstance(old, InMemory) and new.start != old.start:
            raise UnsupportedPrimitiveError("branches that give different arrays, in lanes")
    found = []
    for a, b in zip(lower.flattened(yes), lower.flattened(no), strict=True):
        kind = lower.do.kinds[a]
        condition = which
        if kind.endswith("p"):
            condition = lower.do.do("splat", "bp", which)
        found.append(lower.do.do("select", kind, condition, a, b))
    return lower.restored(found, yes)


def _if_any(
    lower: Lowering,
    condition: Value,
    branch: core.ClosedJaxpr,
    arguments: Sequence[Array],
    size: int,
    in_memory: bool,
) -> list[Array]:
    """The results of a branch, which is left out where the condition holds in no lane; it
    writes to memory in the lanes in which it holds."""
    if size <= LONGEST_CHOICE and not in_memory:
        return lower.run(branch.jaxpr, lower.consts(branch), arguments)
    kept: list[Array] = []

    def compute() -> list[Value]:
        own = [replace(a) if isinstance(a, InMemory) else a for a in arguments]
        with lower.do.masked(condition):
            kept[:] = lower.run(branch.jaxpr, lower.consts(branch), own)
        return lower.flattened(kept)

    def leave_out() -> list[Value]:
        return [lower.do.constant(lower.do.kinds[v], 0) for v in lower.flattened(kept)]

    return lower.restored(lower.do.branch(condition, compute, leave_out), kept)


def _branch(
    lower: Lowering,
    which: Value,
    yes: core.ClosedJaxpr,
    no: core.ClosedJaxpr,
    arguments: Sequence[Array],
) -> list[Array]:
    results: dict[str, list[Array]] = {}

    def build(name: str, branch: core.ClosedJaxpr) -> Callable[[], list[Value]]:
        def compute() -> list[Value]:
            own = [replace(a) if isinstance(a, InMemory) else a for a in arguments]
            found = lower.run(branch.jaxpr, lower.consts(branch), own)
            if results:
                pairs = zip(found, results["yes"], strict=True)
                for new, old in pairs:
                    if isinstance(new, InMemory) and isinstance(old, InMemory):
                        _agree(lower, new, old)
            results[name] = found
            return lower.flattened(found)

        return compute

    outs = lower.do.branch(which, build("yes", yes), build("no", no))
    return lower.restored(outs, results["yes"])


def _agree(lower: Lowering, new: InMemory, old: InMemory) -> None:
    """Have the second branch leave an array where the first one does."""
    if new.start != old.start:
        if not old.owned:
            raise UnsupportedPrimitiveError("branches that give different arrays")
        lower.copied(new, old.start)


def _while(lower: Lowering, equation: core.JaxprEqn, *arguments: Array) -> list[Array]:
    parameters = equation.params
    head, body = parameters["cond_jaxpr"], parameters["body_jaxpr"]
    outside = parameters["cond_nconsts"]
    inside = outside + parameters["body_nconsts"]
    head_consts = [borrowed(a) for a in arguments[:outside]]
    body_consts = [borrowed(a) for a in arguments[outside:inside]]

    def holds(carries: list[Array]) -> Value:
        given = [borrowed(a) for a in carries]
        (found,) = lower.run(head.jaxpr, lower.consts(head), [*head_consts, *given])
        assert isinstance(found, int)
        return found

    def go(carries: list[Array]) -> list[Array]:
        return lower.run(body.jaxpr, lower.consts(body), [*body_consts, *carries])

    return loop(lower, list(arguments[inside:]), holds, go)


def borrowed(array: Array) -> Array:
    """The array, which must not be overwritten."""
    return replace(array, owned=False) if isinstance(array, InMemory) else array


def loop(
    lower: Lowering,
    first: list[Array],
    holds: Callable[[list[Array]], Value],
    go: Callable[[list[Array]], list[Array]],
    uniform: bool = False,
) -> list[Array]:
    """A loop over arrays; those in memory stay at one place."""
    first = [_own(lower, a) if isinstance(a, InMemory) else a for a in first]
    do = lower.do
    last: list[Value] = []

    def arrays(values: list[Value]) -> list[Array]:
        found = lower.restored(values, first)
        return [replace(a, owned=True) if isinstance(a, InMemory) else a for a in found]

    def condition(values: list[Value]) -> Value:
        last[:] = [holds(arrays(values))]
        return last[0]

    def body(values: list[Value]) -> list[Value]:
        found = go(arrays(values))
        _settle(lower, first, found)
        following = lower.flattened(
            [
                f if isinstance(f, InMemory) else _like(lower, f, a)
                for f, a in zip(found, first, strict=True)
            ],
        )
        if do.width == 1 or uniform:
            return following
        # Lanes for which the condition does not hold any more stay as they are.
        goes = holds(arrays(values))
        pairs = zip(following, values, strict=True)
        return [do.do("select", do.kinds[new], goes, new, old) for new, old in pairs]

    if do.width > 1 and not uniform and any(isinstance(a, InMemory) for a in first):
        raise UnsupportedPrimitiveError("loops over large arrays in lanes")
    return arrays(do.loop(lower.flattened(first), condition, body))


def _like(lower: Lowering, array: Array, other: Array) -> Array:
    """An array in the form of another one of the same shape."""
    if isinstance(other, Packed) and not isinstance(array, Packed):
        return Packed(lower.vector(array))
    return array


def _own(lower: Lowering, memory: InMemory) -> InMemory:
    return memory if memory.owned else lower.copied(memory)


def _settle(lower: Lowering, places: Sequence[Array], found: Sequence[Array]) -> None:
    """Move arrays in memory to where the next turn of a loop expects them."""
    moves = [
        (new, old)
        for new, old in zip(found, places, strict=True)
        if isinstance(new, InMemory) and isinstance(old, InMemory) and new.start != old.start
    ]
    taken = {old.start for old in places if isinstance(old, InMemory)}
    moves = [(lower.copied(new) if new.start in taken else new, old) for new, old in moves]
    for new, old in moves:
        lower.copied(new, old.start)


def _scan(lower: Lowering, equation: core.JaxprEqn, *arguments: Array) -> list[Array]:
    parameters, do = equation.params, lower.do
    if "num_consts" in parameters:
        constants, carried = parameters["num_consts"], parameters["num_carry"]
    else:  # From JAX 0.11 on.
        constants, carried, _ = map(len, parameters["ft_in"].unpack())
    length, closed = parameters["length"], parameters["jaxpr"]
    consts = [borrowed(a) for a in arguments[:constants]]
    first = list(arguments[constants : constants + carried])
    avals = [aval_of(v) for v in equation.invars[constants + carried :]]
    rows = [
        borrowed(lower.in_memory(a, tuple(aval.shape)))
        for a, aval in zip(arguments[constants + carried :], avals, strict=True)
    ]
    outs = [aval_of(v) for v in equation.outvars[carried:]]
    made = [
        InMemory(do.allocate(int(np.prod(o.shape, dtype=int))), tuple(o.shape), kind_of(o), True)
        for o in outs
    ]
    one, end = do.constant("i", 1), do.constant("i", length - 1)

    def go(carries: list[Array]) -> list[Array]:
        k = carries[0]
        assert isinstance(k, int)
        row = do.do("sub", "i", end, k) if parameters["reverse"] else k
        items = [_row(lower, a, row) for a in rows if isinstance(a, InMemory)]
        found = lower.run(closed.jaxpr, lower.consts(closed), [*consts, *carries[1:], *items])
        for memory, array in zip(made, found[carried:], strict=True):
            _put_row(lower, memory, row, array)
        return [do.do("add", "i", k, one), *found[:carried]]

    def holds(carries: list[Array]) -> Value:
        assert isinstance(carries[0], int)
        do.mark_uniform(carries[0])
        return do.do("ile", "b", carries[0], end)

    results = loop(lower, [do.constant("i", 0), *first], holds, go, uniform=True)
    stacked = [m if m.size > LARGEST_TAKEN_APART else lower.read(m) for m in made]
    return [*results[1:], *stacked]


def _row(lower: Lowering, memory: InMemory, row: Value) -> Array:
    """A row of an array in memory."""
    shape = memory.shape[1:]
    size = int(np.prod(shape, dtype=int))
    first = lower.do.do("mul", "i", row, lower.do.constant("i", size))
    if size <= LARGEST_TAKEN_APART:
        return lower.array(elements_at(lower, memory, first, range(size)), shape)
    out = InMemory(lower.do.allocate(size), shape, memory.kind, True)

    def visit(k: Value) -> None:
        place = lower.do.do("add", "i", first, k)
        lower.do.store(lower.do.load(memory.kind, memory.start, place), out.start, k)

    lower.do.repeat(size, visit)
    return out


def _put_row(lower: Lowering, memory: InMemory, row: Value, array: Array) -> None:
    size = int(np.prod(memory.shape[1:], dtype=int))
    first = lower.do.do("mul", "i", row, lower.do.constant("i", size))
    if not isinstance(array, InMemory):
        for k, value in enumerate(lower.values(array)):
            lower.do.store(value, memory.start + k, first)
        return

    def visit(k: Value) -> None:
        place = lower.do.do("add", "i", first, k)
        lower.do.store(lower.do.load(array.kind, array.start, k), memory.start, place)

    lower.do.repeat(size, visit)


RULES: dict[str, EquationRule] = {
    "cond": _cond,
    "while": _while,
    "scan": _scan,
}
"""Rules by the names of primitives."""

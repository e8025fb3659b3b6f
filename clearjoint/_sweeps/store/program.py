"""Digests of the traced code of functions, and the digests by which a store recognises its sweep.

A run is determined by its program and the numbers from which it starts. A store compares digests of
both instead of source texts or names of functions. Programs are traced in the form lanes run.

The digest of a value combines the operation that computes the value, the operation's parameters and
the digests of its operands. It therefore doesn't depend on names, on the order of independent
operations, on unused operations, on `jax.jit` around parts of the function, or on the process, but
on all code, also of helpers, that is in the traced program.
"""

import dataclasses
import enum
from collections import defaultdict, deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import ShapedArray
from jax.extend.core import ClosedJaxpr, Jaxpr, Literal, Var
from jaxtyping import Int, PyTree

from ..._compilation.digests import digest, number
from ..._compilation.xla import CALLS, program_of
from ..._fields.types import ArrayLike
from ..._math.vectors import ConstantFolded, Scalar, unpack
from ..._model.bodies import State
from ..._simulation.lanes.lane import SAVED, Common, Lane, Task
from ..._simulation.results.impact_table import IMPACT_UNITS
from ..._simulation.run.outputs import TABLES
from ..._simulation.step.dense_output import Snapshot
from ...quantities.base import Instant
from ..axes import Lanes
from ..outputs import variable_name

_ADDRESS = " at 0x"
"""Text that marks an address in the `repr` of a Python function; it differs between processes."""
_WITHOUT_RESULT = {"debug_callback", "debug_print"}
"""Primitives that print or call a Python function, but return nothing."""


class Fingerprints(NamedTuple):
    """For each entry of the dictionary that a function returns, by key: a digest of the traced code
    that computes the entry, and the entry with `jax.ShapeDtypeStruct` in place of its arrays."""

    digests: dict[str, str]
    shapes: dict[str, PyTree]


def fingerprints(function: Callable[..., Mapping[str, PyTree]], *arguments: PyTree) -> Fingerprints:
    """Return, for each entry of the dictionary that a function returns, a digest of the traced code
    that computes it, and its shape. Digests depend on the arguments' structure, shapes and types,
    not on their numbers. Raise a `ValueError` for a Python function that JAX doesn't trace."""
    program, shapes, _ = program_of(function, *arguments)
    # An input is known by its path in the arguments, and by its type and shape.
    named = jax.tree_util.tree_flatten_with_path(arguments)[0]
    inputs = [
        digest("argument", jax.tree_util.keystr(path), _kind(variable))
        for (path, _), variable in zip(named, program.jaxpr.invars, strict=True)
    ]
    results = _results(program.jaxpr, [_constant(c) for c in program.consts], inputs)
    # The digest of an entry combines the digests of its leaves with their paths inside the entry.
    parts: dict[str, list[str]] = {name: [] for name in shapes}
    for (path, _), result in zip(
        jax.tree_util.tree_flatten_with_path(shapes)[0], results, strict=True
    ):
        parts[path[0].key] += [jax.tree_util.keystr(path[1:]), result]
    return Fingerprints({name: digest(*texts) for name, texts in parts.items()}, shapes)


def _results(jaxpr: Jaxpr, constants: Sequence[str], inputs: Sequence[str]) -> list[str]:
    """Digests of a program's results, from those of its constants and inputs."""
    digests = dict(zip(jaxpr.invars, inputs, strict=True))
    digests |= zip(jaxpr.constvars, constants, strict=True)

    # Digest of an operand or result: a number that is written in the program, or a variable.
    def of(atom: Var | Literal) -> str:
        if isinstance(atom, Literal):
            return _constant(np.asarray(atom.val, _shape(atom).dtype))
        return digests[atom]

    # An equation's digest combines those of its operands, so names and order have no effect.
    for line in jaxpr.eqns:
        operands = [of(atom) for atom in line.invars]
        name = line.primitive.name
        if name in CALLS:
            # A call counts as the program that it calls: a jitted helper computes the same numbers
            # as one that is not jitted.
            results = _inner(line.params[CALLS[name]], operands)
        elif name in _WITHOUT_RESULT:
            results = []
        elif "callback" in line.params:
            raise _untraced(name, line.params["callback"])
        else:
            operation = digest(name, _setting(name, line.params), *operands)
            results = [digest(operation, str(k)) for k in range(len(line.outvars))]
        digests |= zip(line.outvars, results, strict=True)
    return [of(atom) for atom in jaxpr.outvars]


def _inner(program: ClosedJaxpr | Jaxpr, inputs: Sequence[str]) -> list[str]:
    """Digests of the results of a program inside of an operation, such as the body of a loop."""
    if isinstance(program, ClosedJaxpr):
        return _results(program.jaxpr, [_constant(c) for c in program.consts], inputs)
    return _results(program, _numbered("constant", program.constvars), inputs)


def _numbered(kind: str, variables: Sequence[Var]) -> list[str]:
    """Digests of variables that are known only by their kind (a word), position and type."""
    return [digest(kind, str(k), _kind(v)) for k, v in enumerate(variables)]


def _setting(operation: str, value: object) -> str:
    """Digest of a parameter of an operation, or of a collection of its parameters; a `ValueError`
    for a Python function, since a change of its code would not be noticed."""
    # The body of a loop or a branch is a program, too. Its inputs are known by position only.
    if isinstance(value, ClosedJaxpr | Jaxpr):
        variables = value.jaxpr.invars if isinstance(value, ClosedJaxpr) else value.invars
        return digest(*_inner(value, _numbered("input", variables)))
    if isinstance(value, np.ndarray | np.generic | jax.Array):
        return _constant(value)
    if isinstance(value, Mapping):
        entries = sorted((str(name), _setting(operation, v)) for name, v in value.items())
        return digest(*(part for entry in entries for part in entry))
    if isinstance(value, list | tuple):
        return digest(type(value).__name__, *(_setting(operation, part) for part in value))
    if isinstance(value, enum.Enum | type):
        return digest(str(value))
    if dataclasses.is_dataclass(value):
        parts = {f.name: getattr(value, f.name) for f in dataclasses.fields(value)}
        return digest(type(value).__qualname__, _setting(operation, parts))
    # The default repr contains an address: class and attributes identify the object instead.
    if type(value).__repr__ is object.__repr__:
        return digest(type(value).__qualname__, _setting(operation, getattr(value, "__dict__", {})))
    shown = repr(value)
    if _ADDRESS in shown:
        raise _untraced(operation, shown)
    return digest(shown)


def _untraced(operation: str, function: object) -> ValueError:
    return ValueError(
        "Argument `path` must be None if the scene or an output calls a Python function that JAX "
        f"does not trace ({operation}: {function}), because a store can't detect whether it has "
        "changed: write the function with jax.numpy, or sweep without a store."
    )


def _constant(value: ArrayLike) -> str:
    if isinstance(value, jax.Array) and jnp.issubdtype(value.dtype, jax.dtypes.prng_key):
        value = jax.random.key_data(value)
    array = np.asarray(value)
    return digest("constant", f"{array.dtype}{array.shape}", array.tobytes())


def _kind(variable: Var) -> str:
    shape = _shape(variable)
    return f"{shape.dtype}{shape.shape}"


def _shape(atom: Var | Literal) -> ShapedArray:
    assert isinstance(atom.aval, ShapedArray)
    return atom.aval


RUN = ""
"""Key of the run itself, in dictionaries whose other keys are names of variables or outputs."""
_BLOCK = 4096
"""Number of lanes whose numbers `row_digests` copies at a time, to limit its use of memory."""


class Identity(NamedTuple):
    """Digests that identify a sweep of n lanes.

    - `programs`: digests of the traced programs by name, from the function `programs`.
    - `lanes`: by the key `RUN`, digests (n,) of the numbers from which each lane starts; by the key
      `SAVED`, if there are sample times, digests (n,) of the times of each lane.
    """

    programs: Mapping[str, str]
    lanes: Mapping[str, Int[np.ndarray, " n"]]


def programs(common: Common, state: State) -> dict[str, str]:
    """Return digests of the program of the run, by the key `RUN`, and of the programs that compute
    the results, by name of their variable in the dataset. As each variable has its own digest, an
    output can be added to a store without making the stored lanes invalid. `state`: an example of
    the lanes' initial states."""
    numbers, structure = eqx.partition(common.folded_scene, eqx.is_array_like)
    # The run itself is traced without outputs, so that its digest does not depend on them.
    run = Common(common.scheme, structure, common.start_time, common.max_steps)
    with_impacts = replace(run, impacts=common.impacts)

    def begin(batch: Common, numbers: PyTree, state: State, time: Scalar, length: Scalar) -> Lane:
        # All numbers of the scene are arguments of the program, as if all differed between lanes.
        # The run ends after `length`, which is also the length of its first step.
        task = Task(numbers.tree, state, time + length, length, save_at=None)
        return replace(batch, start_time=time).begun(task)

    # Data of a lane for one step. The step does not depend on the initial state and on the length
    # of the first step, so that the example `state` and any length serve.
    def task_of(numbers: PyTree, end_time: Scalar, wanted: Mapping[str, int] = {}) -> Task:
        return Task(numbers.tree, state, end_time, end_time, save_at=None, wanted=wanted)

    def step(numbers: PyTree, lane: Lane, end_time: Scalar) -> dict[str, PyTree]:
        """Return, by the key `RUN`, a pair: `lane` after one step, and the outcome of a run that
        ends at `lane`. `numbers`: of the lane's scene."""
        task = task_of(numbers, end_time)
        return {RUN: (run.after_turn(task, lane), run.outcome(task, lane))}

    def impact_tables(numbers: PyTree, lane: Lane, end_time: Scalar) -> dict[str, PyTree]:
        """Return for each variable of the impact tables what its table has recorded after one step
        of `lane`: the same for all variables of a table, because a digest covers the whole table.
        `numbers`: of the lane's scene."""
        # A row is still wanted in each log, so that the code that records an impact is traced.
        task = task_of(numbers, end_time, dict.fromkeys(lane.buffers(), 1))
        after = with_impacts.after_turn(task, lane)
        return {
            variable_name(name, key): record
            for name, record in after.run.records[TABLES].items()
            for key in (*IMPACT_UNITS, "count")
        }

    # A run begins a lane and then repeats one step: these two programs determine it. The lengths
    # and end times of 1.0 s are arbitrary, since digests do not depend on the arguments' numbers.
    start = numbers, state, jnp.asarray(common.start_time, dtype=float), 1.0
    begun = fingerprints(lambda *start: {RUN: begin(run, *start)}, *start)
    lane: Lane = begun.shapes[RUN]
    stepped = fingerprints(step, numbers, lane, 1.0)
    digests = {RUN: digest(begun.digests[RUN], stepped.digests[RUN])}
    # Outputs depend on a lane only through this snapshot, so that their digests don't change if
    # another part of the step does.
    snapshot = Snapshot(lane.run.step.t, lane.run.step.y, lane.run.step.entry_speeds)
    outputs = _Outputs(common, structure)
    tallies = jax.eval_shape(outputs.tallies, numbers, snapshot)
    # Only shapes matter, so that one snapshot stands for the end of a step and for inside of it.
    digests |= fingerprints(outputs.values, numbers, snapshot, snapshot, tallies).digests
    if not common.impacts:
        return digests
    # Records of impacts change the lane, so that they are traced in a lane of their own: a table
    # that is added must not change the digest of the run.
    lane = jax.eval_shape(partial(begin, with_impacts), *start)
    return digests | fingerprints(impact_tables, numbers, lane, 1.0).digests


@dataclass(frozen=True)
class _Outputs:
    """Outputs of a sweep, which are fields of `common`, as functions that JAX can trace.

    The argument `numbers` of these functions has the numbers of the folded scene, and `structure`
    is this scene without them. `row` is the snapshot of the motion at one time (end of a step),
    and `inside` a snapshot that stands for the motion inside of the step.
    """

    common: Common
    structure: ConstantFolded

    def instant(self, numbers: PyTree, row: Snapshot, inside: Snapshot) -> Instant:
        # A quantity may evaluate the dense output at a fraction of the step: here that is the
        # fraction times the snapshot `inside`, so that it appears in the program.
        system = self.common.scheme.system(unpack(eqx.combine(numbers, self.structure)))

        def at(fraction: Scalar) -> Instant:
            return jax.tree.map(lambda leaf: fraction * leaf, inside).instant(system)

        return row.instant(system, at)

    def tallies(self, numbers: PyTree, row: Snapshot) -> dict[str, PyTree]:
        """Return what the reductions have accumulated at the start of the run, by name."""
        now = self.instant(numbers, row, row)
        starts = {name: reduction.start(now) for name, reduction in self.common.reductions.items()}
        return jax.tree.map(jnp.asarray, starts)

    def values(
        self, numbers: PyTree, row: Snapshot, inside: Snapshot, tallies: dict[str, PyTree]
    ) -> dict[str, PyTree]:
        """Return, for each variable of the sweep's results by name, the values that are computed
        for it at the end of a step. `tallies` has what the reductions have accumulated before."""
        now, computed = self.instant(numbers, row, inside), {}
        for name, reduction in self.common.reductions.items():
            start, tally = reduction.start(now), tallies[name]
            parts = start, reduction.update(tally, now), reduction.results(tally, now)
            computed |= {variable_name(name, key): parts for key in reduction.units()}
        for name, quantities in self.common.channels.items():
            section = self.common.sections.get(name)
            # The times of a section's crossings depend on the crossing condition, so that every
            # variable of the section includes it.
            crossing = () if section is None else (section.quantity(now), section.earliest)
            computed |= {variable_name(name, key): crossing for key in ("time", "count")}
            computed |= {
                variable_name(name, key): (*crossing, quantity(now))
                for key, quantity in quantities.items()
            }
        return computed


def identity_of(digests: Mapping[str, str], lanes: Lanes, tasks: Task) -> Identity:
    """Return the identity of a sweep, with `digests` of its programs. A lane is identified by its
    scene, initial state, end time and first step's length, or its error message in `lanes.bad`."""
    scenes = jax.tree.leaves(lanes.expanded(lanes.scene, lanes.scenes))
    states = jax.tree.leaves(lanes.states)
    arrays = [leaf for leaf in scenes if eqx.is_array(leaf)]
    starts = row_digests([*arrays, *states, tasks.end_time, tasks.first_step])
    for lane, message in lanes.bad.items():
        starts[lane] = number(message.encode())
    times = {} if tasks.save_at is None else {SAVED: row_digests([tasks.save_at])}
    return Identity(digests, {RUN: starts, **times})


def row_digests(columns: Iterable[ArrayLike]) -> Int[np.ndarray, " n"]:
    """Return a digest of each lane, from its rows in `columns`, which are arrays (n, ...)."""
    arrays = [np.asarray(column) for column in columns]
    count = len(arrays[0])
    digests = np.empty(count, np.int64)
    for start in range(0, count, _BLOCK):
        block = slice(start, min(start + _BLOCK, count))
        # The bytes of a lane's rows stand one after the other in a row of `table`.
        rows = [np.ascontiguousarray(a[block]).reshape(block.stop - start, -1) for a in arrays]
        table = np.concatenate([row.view(np.uint8) for row in rows], axis=1)
        digests[block] = [number(row.tobytes()) for row in table]
    return digests


def matching_lanes(
    stored: Int[np.ndarray, " s"], wanted: Int[np.ndarray, " n"]
) -> Int[np.ndarray, " s"]:
    """Return for each stored digest a wanted lane that has it, or -1; each lane at most once."""
    # Equal digests are usual: an axis may repeat a value.
    unmatched: defaultdict[int, deque[int]] = defaultdict(deque)
    for lane, wanted_digest in enumerate(wanted.tolist()):
        unmatched[wanted_digest].append(lane)
    return np.array(
        [unmatched[key].popleft() if unmatched[key] else -1 for key in stored.tolist()], dtype=int
    )

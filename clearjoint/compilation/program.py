"""A compiled program of a function of PyTrees, as what can be written to a file."""

import enum
import io
import pickle
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import equinox as eqx
import jax
from jax._src.lib import xla_client  # pyright: ignore
from jax.experimental import serialize_executable
from jaxtyping import PyTree

from .effort import Effort, compiler_options
from .jax_cache import recorded_reads

Donated = Literal["all", "all-except-first", "warn", "warn-except-first", "none"]
"""Arguments whose memory the result may take, as of `equinox.filter_jit`."""
Positional = tuple[PyTree, ...]
Options = Mapping[str, PyTree]


class CallsBackError(Exception):
    """A program that calls Python functions of the process that compiled it."""


class ForeignCodeError(Exception):
    """A program that calls functions of a library, LAPACK's say, which tracing makes ready: another
    process, which does not trace it, would call what isn't there."""


class Place(enum.Enum):
    """Where an array stands in a result."""

    ARRAY = "array"


PLACE = Place.ARRAY
_FOREIGN = "custom_call_target="
"""What a program has in its text that calls functions of a library."""


@dataclass(frozen=True)
class Program:
    """A compiled function of arguments of one structure.

    `result`: its result, with `PLACE` where an array stands. `read`: the serialised executable, if
    it came from JAX's cache. `places`: among the leaves of arguments and options those of the
    arrays that stay, and of those that are given away.
    """

    compiled: jax.stages.Compiled
    result: PyTree
    places: tuple[list[int], list[int]]
    read: bytes | None = None

    def __call__(self, leaves: Sequence[PyTree]) -> PyTree:
        """The result for the leaves of other arguments and options; it is computed when this
        returns, as of `filter_jit`."""
        kept, given = ([leaves[place] for place in places] for places in self.places)
        numbers = iter(jax.block_until_ready(self.compiled(kept, given)))
        leaves, structure = self._results
        return jax.tree.unflatten(
            structure, [next(numbers) if leaf is PLACE else leaf for leaf in leaves]
        )

    @cached_property
    def _results(self) -> tuple[list[PyTree], jax.tree_util.PyTreeDef]:  # pyright: ignore
        return jax.tree.flatten(self.result)

    def content(self) -> bytes:
        """All that another process needs to run it.

        **Raises:** `ForeignCodeError`, or an error of JAX or of `pickle`.
        """
        executable = self.compiled.runtime_executable()
        assert executable is not None
        if any(_FOREIGN in module.to_string() for module in executable.hlo_modules()):
            raise ForeignCodeError
        devices = [device.id for device in executable.local_devices()]
        program = _serialised(self.compiled, self.read)
        result = pickle.dumps(self.result)
        return pickle.dumps((program, devices, result))


def compiled_program(
    function: Callable[..., PyTree],
    donate: Donated,
    effort: Effort,
    arguments: Positional,
    options: Options,
) -> Program:
    """Trace and compile a function for arguments like these.

    **Raises:** `CallsBackError` for a function that calls back into Python while it runs.
    """
    found: list[PyTree] = []
    leaves, structure = jax.tree.flatten((arguments, options))
    others = [None if eqx.is_array(leaf) else (leaf,) for leaf in leaves]
    places = _places(arguments, options, donate)

    def flat(kept: list[jax.Array], given: list[jax.Array]) -> list[jax.Array]:
        arrays = iter([*kept, *given] if donate.endswith("first") else [*given, *kept])
        mixed = [next(arrays) if other is None else other[0] for other in others]
        arguments, options = jax.tree.unflatten(structure, mixed)
        leaves, outer = jax.tree.flatten(function(*arguments, **options))
        found[:] = [
            jax.tree.unflatten(outer, [PLACE if eqx.is_array(leaf) else leaf for leaf in leaves])
        ]
        return [leaf for leaf in leaves if eqx.is_array(leaf)]

    flat.__name__ = function.__name__
    with warnings.catch_warnings():
        if not donate.startswith("warn"):
            warnings.filterwarnings("ignore", message="Some donated buffers were not usable*")
        arrays = ([leaves[place] for place in some] for some in places)
        lowered = jax.jit(flat, donate_argnums=1).lower(*arrays)
        if _calls_back(lowered):
            raise CallsBackError
        with recorded_reads() as read:
            compiled = lowered.compile(compiler_options(effort))
        return Program(compiled, found[0], places, read[0] if read else None)


def loaded_program(
    content: bytes, donate: Donated, arguments: Positional, options: Options
) -> Program:
    """The program that another process wrote.

    **Raises:** whatever can go wrong.
    """
    serialized, numbers, pickled = pickle.loads(content)
    result = pickle.loads(pickled)
    count = sum(leaf is PLACE for leaf in jax.tree.leaves(result))
    places = _places(arguments, options, donate)
    by_number = {device.id: device for device in jax.devices()}
    compiled = serialize_executable.deserialize_and_load(
        serialized,
        jax.tree.structure((places, {})),
        jax.tree.structure([0] * count),
        execution_devices=[by_number[number] for number in numbers],
    )
    return Program(compiled, result, places)


def _places(
    arguments: Positional, options: Options, donate: Donated
) -> tuple[list[int], list[int]]:
    """Where among all leaves the arrays stand: those that stay, and those that are given away."""
    leaves = jax.tree.leaves((arguments, options))
    every = [place for place, leaf in enumerate(leaves) if eqx.is_array(leaf)]
    if donate == "none":
        return every, []
    if not donate.endswith("first"):
        return [], every
    first = len(jax.tree.leaves(arguments[0]))
    return [p for p in every if p < first], [p for p in every if p >= first]


def _serialised(compiled: jax.stages.Compiled, read: bytes | None) -> bytes:
    """The program as `jax.experimental.serialize_executable` has it, around machine code that was
    read from JAX's cache, if it was."""
    if read is None:
        return serialize_executable.serialize(compiled)[0]
    unloaded = compiled._executable._unloaded_executable  # pyright: ignore
    content = unloaded, jax.tree.leaves(compiled.args_info), compiled._no_kwargs
    with io.BytesIO() as file:
        _Pickler(file, read).dump(content)
        return file.getvalue()


class _Pickler(serialize_executable._JaxPjrtPickler):
    """JAX's, with machine code that is given."""

    def __init__(self, file: io.BytesIO, read: bytes):
        super().__init__(file)
        self._read = read

    def persistent_id(self, obj: object) -> tuple[str, bytes | int] | tuple[str] | None:
        """What stands for machine code, a device or a client."""
        if isinstance(obj, xla_client.LoadedExecutable):
            return "exec", self._read
        return super().persistent_id(obj)


def _calls_back(lowered: Any) -> bool:
    arguments = lowered._lowering.compile_args
    return bool(arguments["host_callbacks"] or arguments["keepalive"])

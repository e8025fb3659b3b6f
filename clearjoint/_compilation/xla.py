"""Functions that XLA compiles at their first call, and tracing by JAX.

Python's garbage collector is off while JAX traces. Tracing makes a hundred thousand objects that
stay in use; the collector would visit them repeatedly, free nothing and take a third of the time.
"""

import gc
import threading
import time
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass
from functools import cache, cached_property, partial, update_wrapper, wraps
from typing import Generic, NamedTuple, ParamSpec, TypeAlias, TypeVar

import equinox as eqx
import jax
import numpy as np
from jax.core import Tracer
from jax.experimental.xla_metadata import set_xla_metadata
from jax.extend.core import ClosedJaxpr, get_opaque_trace_state, jaxpr_as_fun
from jax.interpreters import partial_eval
from jaxtyping import PyTree

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")
_began: dict[int, float | None] = {}
"""By the identifier of each thread within `program_is_made_inside`, the `time.monotonic` at which
it began to compile a program; ``None`` if it has not."""
CALLS = {
    **dict.fromkeys(("jit", "remat2"), "jaxpr"),
    **dict.fromkeys(("closed_call", "eval_jaxpr"), "call_jaxpr"),
    **dict.fromkeys(("custom_jvp_call", "custom_vjp_call"), "call_jaxpr"),
}
"""Primitives that only call a jaxpr, with the name of the parameter that holds it."""


def traced_once(function: Callable[..., Result], recomputes: bool = False) -> Callable[..., Result]:
    """Wrap a function of PyTrees so that JAX traces it once for arguments of equal structure.

    A function that is called several times within a program, such as the rates in the stages of a
    step, would otherwise be traced at each call. Leaves that are not arrays must be hashable. The
    jaxpr is discarded with the wrapper: `equinox.filter_jit` would keep it for the next run, when a
    global variable that the function reads may have changed.

    **Arguments:** `recomputes`: whether the transpose of the function's derivative computes the
    function again (`jax.checkpoint`), instead of taking its intermediate results as arguments: a
    large function has thousands, which native code passes through memory.
    """

    # Only arrays are traced; other leaves are static, so that the function can branch on them.
    @partial(jax.jit, static_argnums=1)
    def traced(arrays: list[PyTree], others: tuple[tuple[PyTree, ...], PyTree]) -> Result:
        leaves, structure = others

        def of_arrays(arrays: list[PyTree]) -> Result:
            return function(*jax.tree.unflatten(structure, joined(leaves, arrays)))

        return jax.checkpoint(of_arrays)(arrays) if recomputes else of_arrays(arrays)

    def call(*arguments: PyTree) -> Result:
        leaves, structure = jax.tree.flatten(arguments)
        others, arrays = divided(leaves)
        return traced(arrays, (tuple(others), structure))

    return call


ELEMENTWISE = "elementwise_function"
"""Name of the jaxprs that `elementwise` makes. Native code computes each by one loop."""


def elementwise(function: Callable[..., Result], *arguments: PyTree) -> Result:
    """Evaluate a function that works element by element on arrays of one shape, and scalars. For
    many elements, native code then has one loop, instead of a loop for each operation."""

    def elementwise_function(*arguments: PyTree) -> Result:
        return function(*arguments)

    return jax.jit(elementwise_function)(*arguments)


SHARED = "shared_function"
"""Name of the jaxprs that `traced_for_a_kind` makes. Native code has one function for each."""


_Shared: TypeAlias = Callable[[Iterable[PyTree]], PyTree]
SharedFunctions: TypeAlias = dict[Hashable, _Shared]
"""Functions traced by `traced_for_a_kind`, each for the arrays among its arguments' leaves."""


@dataclass
class _Program:
    """What is known of a program that JAX is tracing.

    - `shared`: functions that `traced_for_a_kind` has traced for this program, or for an earlier
      program in the same context `one_call`.
    - `tangents`: number of parameters by which the program differentiates variables; 0 for none.
    """

    shared: SharedFunctions
    tangents: int = 0


_program: ContextVar[_Program | None] = ContextVar("program", default=None)


@contextmanager
def _one_program() -> Iterator[_Program]:
    """Context in which JAX traces a program; contexts inside of it yield the same object."""
    of_call = _shared_by_call.get()
    program = _program.get() or _Program({} if of_call is None else of_call)
    token = _program.set(program)
    try:
        yield program
    finally:
        _program.reset(token)


def tell_tangents(count: int) -> None:
    """Record that the program that JAX is tracing differentiates its variables by `count`
    parameters. Native code then keeps arrays of this length as vectors of the processor."""
    program = _program.get()
    if program is not None:
        program.tangents = max(program.tangents, count)


class NotSharedError(Exception):
    """Raised if the calls of a function cannot share its jaxpr."""


def _traced_for(
    function: Callable[..., PyTree], leaves: Sequence[PyTree], structure: PyTree, is_called: bool
) -> _Shared:
    """Trace a function of PyTrees for one kind of arguments (see `traced_for_a_kind`), given by the
    leaves and structure of an example. Return the traced function, which takes the arrays among the
    leaves. `is_called`: whether it becomes one function of native code, or is repeated inline."""
    others, arrays = divided(leaves)
    # The leaves of the function's result, with placeholders for arrays, and its structure, once JAX
    # has traced it. Structural zeros stay Python numbers, which the caller leaves out of its
    # formulas.
    static: list[PyTree] = []
    form: PyTree = None

    def shared_function(*arrays: PyTree) -> list[PyTree]:
        nonlocal static, form
        result = function(*jax.tree.unflatten(structure, joined(others, arrays)))
        leaves, form = jax.tree.flatten(result)
        static, traced = divided(leaves)
        return traced

    # By the name `SHARED`, native code recognises a function that it must call, not repeat inline.
    shared_function.__name__ = SHARED if is_called else "traced_for_a_kind"
    jaxpr = jax.make_jaxpr(jax.jit(shared_function))(*arrays)
    # A traced value from outside belongs to one call, but the jaxpr to all of them.
    if any(isinstance(constant, Tracer) for constant in jaxpr.consts):
        raise NotSharedError
    call = _evaluation_of(jaxpr)
    return lambda arrays: jax.tree.unflatten(form, joined(static, call(*arrays)))


def _evaluation_of(call: ClosedJaxpr) -> Callable[..., Sequence[PyTree]]:
    """Return a function that evaluates `call`, a jaxpr whose one equation calls another jaxpr.

    The function adds only this equation to the program that JAX is tracing. That takes two fifths
    of the time of `jaxpr_as_fun`, and less than `jax.jit`, whose checks of arguments were a tenth
    of the tracing of a large scene.
    """
    jaxpr = call.jaxpr
    if not jaxpr.outvars:
        # Scenes have hundreds of ideal joints without constraint rows, which need no equation.
        return lambda *arrays: []
    if len(jaxpr.eqns) == 1:
        (equation,) = jaxpr.eqns
        # The equation alone does not suffice if an argument is also a result: JAX may return such
        # an argument without passing it through the call.
        if equation.invars == jaxpr.invars and equation.outvars == jaxpr.outvars:
            return partial(equation.primitive.bind, **equation.params)
    return jaxpr_as_fun(call)


_shared_by_call: ContextVar[SharedFunctions | None] = ContextVar("call", default=None)


@contextmanager
def one_call(shared: SharedFunctions | None = None) -> Iterator[None]:
    """Context of one call of the package. The programs that are made in it share the functions that
    `traced_for_a_kind` traces. For a humanoid with servos, tracing these again took a tenth of the
    time to the first answer. Later calls trace anew, because a global variable that a function
    reads may have changed. `shared`: dictionary that keeps these functions, empty at first. Calls
    that may share them pass the same dictionary. By default it is that of a context around this
    one, or a new one."""
    if shared is None:
        shared = _shared_by_call.get()
    token = _shared_by_call.set({} if shared is None else shared)
    try:
        yield
    finally:
        _shared_by_call.reset(token)


ARRAY = ...
"""Stands for an array among leaves of a PyTree."""


def divided(leaves: Sequence[PyTree]) -> tuple[list[PyTree], list[PyTree]]:
    others = [ARRAY if _is_array(leaf) else leaf for leaf in leaves]
    return others, [a for a, b in zip(leaves, others, strict=True) if b is ARRAY]


def joined(leaves: Sequence[PyTree], arrays: Iterable[PyTree]) -> list[PyTree]:
    """Return the leaves with each `ARRAY` among them replaced by the next of the arrays."""
    remaining = iter(arrays)
    return [next(remaining) if leaf is ARRAY else leaf for leaf in leaves]


def _is_array(leaf: PyTree) -> bool:
    # This function is called several hundred thousand times while a large program is traced, and
    # the test of Equinox takes longer than the two before it.
    if isinstance(leaf, Tracer | np.ndarray):
        return True
    return type(leaf) is not float and eqx.is_array(leaf)


def traced_for_a_kind(
    function: Callable[..., Result], *arguments: PyTree, is_called: bool = True
) -> Result:
    """Evaluate a function of PyTrees by a jaxpr that all calls with arguments of one kind share.

    Arguments are of one kind if they have equal structures, equal leaves that are no arrays, and
    arrays of equal shapes and dtypes. In each program, or in all programs of `one_call`, JAX traces
    the same function object once for each kind. In native code this becomes one function; if
    `is_called` is false, its equations are repeated at each call instead. Leaves of the result that
    are no arrays are returned as at the first call.

    **Raises:** `NotSharedError` if no program is being made, if a static part of the arguments is
    not hashable, or if the function uses a value that JAX traces and that is not an argument.
    """
    program = _program.get()
    if program is None:
        raise NotSharedError
    leaves, structure = jax.tree.flatten(arguments)
    kinds = tuple(map(kind_of_leaf, leaves))
    key = function, is_called, structure, kinds
    try:
        shared = program.shared.get(key)
    except TypeError as error:  # a part of the key is not hashable
        raise NotSharedError from error
    if shared is None:
        shared = program.shared[key] = _traced_for(function, leaves, structure, is_called)
    return shared(leaf for leaf, kind in zip(leaves, kinds, strict=True) if kind[0] is ARRAY)


FEWEST = 4
"""Number of calls, or of elements of a class, from which on a function is shared. Fewer calls are
written out: the program is then shorter, since it passes no arguments, and faster, since what
several calls compute is computed once."""


def are_many(calls: int) -> bool:
    """Return whether so many calls of a function are to share one jaxpr (see `FEWEST`)."""
    return calls >= FEWEST


def shared_by_many(calls: int, function: Callable[..., Result], *arguments: PyTree) -> Result:
    """Evaluate a function by `traced_for_a_kind` if it has many calls, and they can share a jaxpr;
    otherwise call it."""
    if are_many(calls):
        with suppress(NotSharedError):
            return traced_for_a_kind(function, *arguments)
    return function(*arguments)


def kind_of_leaf(leaf: PyTree) -> tuple[PyTree, ...]:
    """Return those properties of a leaf on which a program depends. Of an array: `ARRAY`, shape,
    dtype, and whether this is weak, as that of a Python number, which adopts the other operand's
    dtype. Of any other leaf: its type and the leaf, in place of a float its hexadecimal text."""
    # The attributes of a tracer itself take ten times as long as those of its `aval`.
    array: PyTree = leaf.aval if isinstance(leaf, Tracer) else leaf
    if array is not leaf or _is_array(leaf):
        return ARRAY, array.shape, array.dtype, getattr(array, "weak_type", False)
    # By their digits, since 0.0 == -0.0 and NaN != NaN.
    return type(leaf), leaf.hex() if type(leaf) is float else leaf


class Traced(NamedTuple):
    """A function that JAX has traced.

    - `jaxpr`: the operations of the function.
    - `shapes`: the result of the function, with shapes and dtypes in place of arrays.
    - `tangents`: number of parameters by which the function differentiates; 0 for none.
    """

    jaxpr: ClosedJaxpr
    shapes: PyTree
    tangents: int


def program_of(function: Callable[..., PyTree], *arguments: PyTree) -> Traced:
    """Trace a function for given arguments. Operations that JAX 0.12 keeps as one equation until
    lowering, such as `jax.numpy.searchsorted`, are expanded."""
    with _one_program() as context:
        program, shapes = jax.make_jaxpr(function, return_shape=True)(*arguments)
    if hasattr(partial_eval, "lower_jaxpr2"):  # JAX 0.11 and later have this function.
        program = partial_eval.lower_jaxpr2(program)  # pyright: ignore[reportAttributeAccessIssue]
    return Traced(program, shapes, context.tangents)


@contextmanager
def collector_at_rest() -> Iterator[None]:
    """Switch off Python's garbage collector within the context."""
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()


def is_tracing() -> bool:
    return get_opaque_trace_state() != _state_without_trace()


@cache
def _state_without_trace() -> object:
    # A new thread traces nothing, even if the caller is being traced.
    with ThreadPoolExecutor(1) as pool:
        return pool.submit(get_opaque_trace_state).result()


def seconds_of_compiling() -> float:
    """Return how long, s, tracing and compilation in progress have taken so far: the longest time
    of all threads; zero if no thread makes a program. Progress bars show it."""
    times = [began for began in list(_began.values()) if began is not None]
    return time.monotonic() - min(times) if times else 0.0


def begins_a_program(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Wrap a function for JAX to trace. `seconds_of_compiling` counts the time from the first
    tracing in a context `program_is_made_inside` to the end of this context. It does not count a
    tracing outside of such a context."""

    @wraps(function)
    def traced(*arguments: Arguments.args, **options: Arguments.kwargs) -> Result:
        # The time begins only once, and only within that context. Nothing would end it outside, and
        # all later progress bars of the process would say that a program is being compiled.
        thread = threading.get_ident()
        if thread in _began and _began[thread] is None:
            _began[thread] = time.monotonic()
        with _one_program():
            return function(*arguments, **options)

    return traced


@contextmanager
def program_is_made_inside() -> Iterator[None]:
    """Context in which `seconds_of_compiling` counts this thread's time from the first tracing on
    (see `begins_a_program`). A count ends with the context in which it began, inner or outer."""
    thread = threading.get_ident()
    is_inner = thread in _began
    before = _began.setdefault(thread, None)
    try:
        yield
    finally:
        if is_inner:
            _began[thread] = before
        else:
            del _began[thread]


OPTIONS: dict[str, str | bool] = {"xla_backend_optimization_level": "1"}
"""XLA's compiler options: LLVM's optimisation level 1, which compiles faster than the default 3."""
_ONE_FUNCTION = {"xla_cpu_small_call": "true", "inlineable": "false"}
"""Attributes of a call that make XLA's CPU compiler compile it as a function of its own."""


class Compiled(Generic[Arguments, Result]):
    """Function that XLA compiles at its first call, as by `equinox.filter_jit`.

    A program serves all arguments that differ only in the numbers in arrays; any other change
    compiles a further program. JAX's cache on disk saves programs. `compiler_options` of XLA are
    added to `OPTIONS`.
    """

    __wrapped__: Callable[Arguments, Result]

    def __init__(self, function: Callable[Arguments, Result], **compiler_options: str | bool):
        self._traced, self._options = begins_a_program(function), OPTIONS | compiler_options
        update_wrapper(self, function)

    # The function as a part of another program, for which JAX accepts no compiler options, and as a
    # program of its own. Each is made when it is needed: both together take 6 ms, and a process
    # never compiles most functions of the package.
    @cached_property
    def _inner(self) -> Callable[..., Result]:
        return eqx.filter_jit(self._traced)

    @cached_property
    def _outermost(self) -> Callable[..., Result]:
        return eqx.filter_jit(self._traced, compiler_options=self._options)  # pyright: ignore

    def __call__(self, *arguments: Arguments.args, **options: Arguments.kwargs) -> Result:
        with collector_at_rest(), program_is_made_inside():
            # While JAX traces another program, this function becomes a part of that program.
            compiled = self._inner if is_tracing() else self._outermost
            return compiled(*arguments, **options)


USUAL_ERRORS = (ArithmeticError, AttributeError, LookupError, TypeError, ValueError)
"""Errors of a function or value that does not support what is tried. No wider class is caught,
since a handler of signals may raise an error, such as `TimeoutError`, to end a run."""
_NEEDS_JAX = (*USUAL_ERRORS, NotImplementedError)
"""Errors of functions that NumPy cannot compute; those of JAX are subclasses."""


class HostFirst(Generic[Arguments, Result]):
    """Function of PyTrees that NumPy computes if it can, and otherwise a program of XLA. It is for
    functions that are called once or twice in a run: NumPy takes milliseconds for some hundred
    scalar operations, which XLA compiles in half a second. NumPy cannot compute a function that
    needs JAX, for instance for a derivative."""

    __wrapped__: Callable[Arguments, Result]

    def __init__(self, function: Callable[Arguments, Result]):
        self._compiled = Compiled(function)
        # Structures of arguments for which NumPy has computed the function, or cannot do so.
        self._by_numpy: dict[jax.tree_util.PyTreeDef, bool] = {}  # pyright: ignore
        update_wrapper(self, function)

    def __call__(self, *arguments: Arguments.args, **options: Arguments.kwargs) -> Result:
        # NumPy is not tried again for a structure of arguments for which it has failed once. A call
        # with tracers does not count as a failure: NumPy may be able to compute with the numbers
        # of a later call.
        leaves, structure = jax.tree.flatten((arguments, options))
        is_traced = any(isinstance(leaf, Tracer) for leaf in leaves)
        by_numpy = self._by_numpy.get(structure)
        if not is_traced and by_numpy is not False:
            host_arguments, host_options = jax.tree.unflatten(structure, map(_on_host, leaves))
            call = partial(self.__wrapped__, *host_arguments, **host_options)
            # A list with the result, or an empty one.
            results = self._results(call, is_new=by_numpy is None)
            self._by_numpy[structure] = bool(results)
            if results:
                return results[0]
        return self._compiled(*arguments, **options)

    def _results(self, call: Callable[[], Result], is_new: bool) -> list[Result]:
        """Return a list with the result of `call`; the list is empty if NumPy cannot compute the
        result. `is_new`: whether this is the first attempt for arguments of this structure."""
        results: list[Result] = []
        with np.errstate(all="ignore"):
            try:
                # Under `eval_shape`, an operation of JAX is not compiled but returns a tracer, even
                # for known numbers. A tracer in the result shows that the function needs JAX. Once
                # NumPy has computed the function, this is known for all numbers.
                if is_new:
                    jax.eval_shape(lambda: results.append(call()))
                else:
                    results.append(call())
            except _NEEDS_JAX:
                # An error of the function itself is raised again when XLA compiles the function.
                return []
        return [] if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(results)) else results


def _on_host(leaf: PyTree) -> PyTree:
    return np.asarray(leaf) if eqx.is_array(leaf) else leaf


def in_one_function(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Wrap a function of PyTrees so that XLA's CPU compiler compiles it as one function.

    Without this wrapper, XLA starts a kernel for each group of operations, and recomputes in each
    one what several need. A step of a run, with some thousand operations on scalars, would take
    forty times as long, and ten times as long to compile. `set_xla_metadata`, which gives
    attributes to a call, is experimental in JAX.
    """
    call = eqx.filter_jit(function)

    @wraps(function)
    def called(*arguments: Arguments.args, **options: Arguments.kwargs) -> Result:
        if jax.default_backend() != "cpu":
            return function(*arguments, **options)
        with set_xla_metadata(**_ONE_FUNCTION):
            return call(*arguments, **options)

    return called

"""Fingerprint of a function: a digest of the program (the jaxpr) that JAX traces from the function.

A store compares fingerprints to detect that the code of a sweep has changed. The digest of a value
combines the operation that computes the value, the operation's parameters and the digests of its
operands. The digest of a constant is that of its numbers, and the digest of an argument that of its
name and type. The digest of a result therefore doesn't depend on names of variables and functions,
on the order of independent operations, on unused operations, on `jax.jit` around parts of the
function, or on the process. All that globals, helpers, base classes and properties contribute is
part of it, because it appears in the traced program.
"""

import dataclasses
import enum
import hashlib
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import ShapedArray
from jax.extend.core import ClosedJaxpr, Jaxpr, Literal, Var
from jaxtyping import PyTree

from ...compilation.tracing import CALLS, program_of
from ...fields.types import ArrayLike

DIGITS = 16
"""Number of characters of a digest, hexadecimal: 64 bits, with which equal digests of different
programs are practically excluded."""
_ADDRESS = " at 0x"
"""Text that marks an address in the `repr` of a Python function; it differs between processes."""
_WITHOUT_RESULT = {"debug_callback", "debug_print"}
"""Names of primitives that only print. They are left out, since they change no result."""


class Fingerprints(NamedTuple):
    """Digests and shapes of the entries of the dictionary that a function returns, by key.

    - `digests`: digest of each entry; it changes if the code that computes the entry changes.
    - `shapes`: each entry with `jax.ShapeDtypeStruct` in place of its arrays.
    """

    digests: dict[str, str]
    shapes: dict[str, PyTree]


def fingerprints(function: Callable[..., Mapping[str, PyTree]], *arguments: PyTree) -> Fingerprints:
    """Return the digest of each entry of the dictionary that a function returns.

    Digests depend on structure, shapes and types of the arguments, but not on their numbers.

    **Arguments:** `function`: function of PyTrees that JAX can trace; `arguments`: example
    arguments.

    **Raises:** `ValueError` if the function calls back into Python, which JAX doesn't trace.
    """
    program, shapes = program_of(function, *arguments)
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
    """Return the digests of a program's results.

    **Arguments:** `jaxpr`: the program; `constants`, `inputs`: digests of its constants and inputs.

    **Raises:** `ValueError` for a call of a Python function that JAX does not trace.
    """
    known = dict(zip(jaxpr.invars, inputs, strict=True))
    known |= zip(jaxpr.constvars, constants, strict=True)

    def of(atom: Var | Literal) -> str:
        if isinstance(atom, Literal):
            return _constant(np.asarray(atom.val, _shape(atom).dtype))
        return known[atom]

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
        known |= zip(line.outvars, results, strict=True)
    return [of(atom) for atom in jaxpr.outvars]


def _inner(program: ClosedJaxpr | Jaxpr, inputs: Sequence[str]) -> list[str]:
    """Return the digests of the results of a program that is a parameter of an operation, such as
    the body of a loop.

    **Arguments:** `inputs`: digests of the program's inputs.
    """
    if isinstance(program, ClosedJaxpr):
        return _results(program.jaxpr, [_constant(c) for c in program.consts], inputs)
    return _results(program, _numbered("constant", program.constvars), inputs)


def _numbered(kind: str, variables: Sequence[Var]) -> list[str]:
    """Return the digests of variables that are known only by their `kind` ("input" or "constant"),
    position and type."""
    return [digest(kind, str(k), _kind(v)) for k, v in enumerate(variables)]


def _setting(operation: str, value: object) -> str:
    """Return the digest of a parameter of an operation, or of a collection of its parameters.

    **Arguments:** `operation`: name of the operation, for error messages; `value`: the parameter
    or the collection.

    **Raises:** `ValueError` for a Python function, which would differ between processes.
    """
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


def digest(*parts: str | bytes) -> str:
    """Return the digest of a sequence of texts or bytes, as a text of `DIGITS` characters."""
    state = hashlib.blake2b(digest_size=DIGITS // 2)
    for part in parts:
        content = part.encode() if isinstance(part, str) else part
        # With its length in front, ("ab", "c") differs from ("a", "bc").
        state.update(b"%d:" % len(content))
        state.update(content)
    return state.hexdigest()

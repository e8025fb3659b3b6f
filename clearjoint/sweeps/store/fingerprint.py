"""What a function computes, as a digest of the program that JAX traces of it.

Each value of the program is digested with all that it is computed from: an operation with its
settings and operands, a constant by its value, an argument by its name. So a digest does not depend
on names of variables and functions, on the order of independent lines, on what is not used, on
`jax.jit` around parts, nor on the process. All that a global, a helper, a base class or a property
contributes is in it, since only what was traced counts.
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

from ...compilation import program_of
from ...fields.types import ArrayLike

DIGITS = 16
_WRAPPERS = {
    "jit": "jaxpr",
    "closed_call": "call_jaxpr",
    "eval_jaxpr": "call_jaxpr",
    "checkpoint": "jaxpr",
    "remat2": "jaxpr",
    "custom_jvp_call": "call_jaxpr",
    "custom_vjp_call": "call_jaxpr",
}
"""Operations that compute what the program inside them does, and where they keep it."""
_ADDRESS = " at 0x"
"""In the text of a function: nothing that another process would know."""
_WITHOUT_RESULT = {"debug_callback", "debug_print"}


class Fingerprints(NamedTuple):
    """Digests of what a function returns, and its shapes (`jax.ShapeDtypeStruct`), both by name."""

    digests: dict[str, str]
    shapes: dict[str, PyTree]


def fingerprints(function: Callable[..., Mapping[str, PyTree]], *arguments: PyTree) -> Fingerprints:
    """Digests of the entries that a function of PyTrees returns.

    Only structure, shapes and types of the arguments count.

    **Raises:** `ValueError` if the function calls back into Python, where nothing is traced.
    """
    program, shapes = program_of(function, *arguments)
    named = jax.tree_util.tree_flatten_with_path(arguments)[0]
    inputs = [
        digest("argument", jax.tree_util.keystr(path), _kind(variable))
        for (path, _), variable in zip(named, program.jaxpr.invars, strict=True)
    ]
    results = _results(program.jaxpr, [_constant(c) for c in program.consts], inputs)
    parts: dict[str, list[str]] = {name: [] for name in shapes}
    for (path, _), result in zip(
        jax.tree_util.tree_flatten_with_path(shapes)[0], results, strict=True
    ):
        parts[path[0].key] += [jax.tree_util.keystr(path[1:]), result]
    return Fingerprints({name: digest(*own) for name, own in parts.items()}, shapes)


def _results(jaxpr: Jaxpr, constants: Sequence[str], inputs: Sequence[str]) -> list[str]:
    """Digests of a program's results from those of its constants and inputs."""
    known = dict(zip(jaxpr.invars, inputs, strict=True))
    known |= zip(jaxpr.constvars, constants, strict=True)

    def of(atom: Var | Literal) -> str:
        if isinstance(atom, Literal):
            return _constant(np.asarray(atom.val, _shape(atom).dtype))
        return known[atom]

    for line in jaxpr.eqns:
        operands = [of(atom) for atom in line.invars]
        name = line.primitive.name
        if name in _WRAPPERS:
            results = _inner(line.params[_WRAPPERS[name]], operands)
        elif name in _WITHOUT_RESULT:
            results = []
        elif "callback" in line.params:
            raise _untraced(name, line.params["callback"])
        else:
            here = digest(name, _setting(name, line.params), *operands)
            results = [digest(here, str(k)) for k in range(len(line.outvars))]
        known |= zip(line.outvars, results, strict=True)
    return [of(atom) for atom in jaxpr.outvars]


def _inner(program: ClosedJaxpr | Jaxpr, inputs: Sequence[str]) -> list[str]:
    if isinstance(program, ClosedJaxpr):
        return _results(program.jaxpr, [_constant(c) for c in program.consts], inputs)
    return _results(program, _places("constant", program.constvars), inputs)


def _places(kind: str, variables: Sequence[Var]) -> list[str]:
    return [digest(kind, str(k), _kind(v)) for k, v in enumerate(variables)]


def _setting(operation: str, value: object) -> str:
    """A digest of a setting of an operation."""
    if isinstance(value, ClosedJaxpr | Jaxpr):
        variables = value.jaxpr.invars if isinstance(value, ClosedJaxpr) else value.invars
        return digest(*_inner(value, _places("input", variables)))
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
    if type(value).__repr__ is object.__repr__:
        return digest(type(value).__qualname__, _setting(operation, getattr(value, "__dict__", {})))
    shown = repr(value)
    if _ADDRESS in shown:
        raise _untraced(operation, shown)
    return digest(shown)


def _untraced(operation: str, function: object) -> ValueError:
    return ValueError(
        "Argument `path` must be None where the scene or an output calls a Python function that "
        f"JAX does not trace ({operation}: {function}), since no store could tell whether it has "
        "changed: write it with jax.numpy, or sweep without a store."
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
    """The digest of parts in their order; each goes in with its length, so that none passes for
    two."""
    whole = hashlib.blake2b(digest_size=DIGITS // 2)
    for part in parts:
        content = part.encode() if isinstance(part, str) else part
        whole.update(b"%d:" % len(content))
        whole.update(content)
    return whole.hexdigest()

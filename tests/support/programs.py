"""Looking into traced programs."""

from collections import Counter
from collections.abc import Collection
from typing import Any

import jax


def made_by(function: Any) -> int:
    """How many programs a compiled function (`Compiled`, `Native` or `HostFirst`) has made, those
    of native code that were used least recently left out."""
    by_xla = vars(getattr(function, "_compiled", function))
    made = [by_xla[name] for name in ("_inner", "_outermost") if name in by_xla]
    by_native = function.native._programs if hasattr(function, "native") else ()
    return sum(one._cached._cache_size() for one in made) + len(by_native)


def inside(equation: Any) -> list[Any]:
    """The programs that an equation carries out: the body of a loop, say."""
    parts = jax.tree.leaves(equation.params, is_leaf=lambda part: hasattr(part, "eqns"))
    return [part for part in parts if hasattr(part, "eqns")]


def primitives(program: Any, beside: Collection[str] = ()) -> Counter[str]:
    """How often each primitive occurs, those in inner programs included, but for what is inside
    primitives of the names `beside`."""
    found = Counter(equation.primitive.name for equation in program.eqns)
    for equation in program.eqns:
        if equation.primitive.name not in beside:
            for part in inside(equation):
                found += primitives(part, beside)
    return found


def body_of(program: Any, name: str) -> Any:
    """The body of the only loop of a kind, such as "scan", on the outermost level, or on that of a
    function that is compiled there."""

    def level(jaxpr: Any) -> Any:
        for equation in jaxpr.eqns:
            yield equation
            if equation.primitive.name in ("jit", "pjit"):
                for inner in inside(equation):
                    yield from level(inner)

    (loop,) = (equation for equation in level(program) if equation.primitive.name == name)
    (body,) = inside(loop)
    return body

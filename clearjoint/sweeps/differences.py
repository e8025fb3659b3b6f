"""Where two sweeps' layouts differ, in words."""

from collections.abc import Iterator
from os.path import commonprefix
from typing import Any

import numpy as np

from .layout import Coordinate, Layout, Variable

_SHOWN = 60
_ABSENT = object()


def differences(stored: Layout, wanted: Layout) -> list[str]:
    """A line for each thing that is not the same in both."""
    there, here = dict(_parts(stored)), dict(_parts(wanted))
    return [
        f"{name}: {_difference(there.get(name, _ABSENT), here.get(name, _ABSENT))}"
        for name in {**there, **here}
        if not _same(there.get(name, _ABSENT), here.get(name, _ABSENT))
    ]


def _parts(layout: Layout) -> Iterator[tuple[str, Any]]:
    """What has to agree, by name."""
    yield "axes", ", ".join(axis.name for axis in layout.axes)
    yield "axes zipped", layout.zipped
    yield "lanes in a chunk", layout.chunk
    for name, value in layout.settings.items():
        yield f"setting {name}", value
    for kind, coordinates in (("axis", layout.axes), ("coordinate", layout.coordinates)):
        for coordinate in coordinates:
            yield from _labels(f"{kind} {coordinate.name}", coordinate)
    for name, variable in layout.variables.items():
        yield f"variable {name}", _outline(variable)


def _labels(name: str, coordinate: Coordinate) -> Iterator[tuple[str, Any]]:
    yield name, coordinate.values
    yield f"unit of {name}", coordinate.unit


def _outline(variable: Variable) -> str:
    sizes = zip(variable.dims, variable.shape, strict=True)
    shape = ", ".join(["lane", *(f"{dim} {size}" for dim, size in sizes)])
    attrs = ", ".join(f"{name} {value}" for name, value in sorted(variable.attributes.items()))
    return f"{np.dtype(variable.dtype)} ({shape}), {attrs}"


def _same(one: Any, other: Any) -> bool:
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        return np.array_equal(one, other)
    return type(one) is type(other) and one == other


def _difference(stored: Any, wanted: Any) -> str:
    if isinstance(stored, np.ndarray) and isinstance(wanted, np.ndarray):
        if stored.size != wanted.size:
            return f"stored {stored.size} values, now {wanted.size}"
        differ = np.flatnonzero(stored != wanted)
        first = differ[0]
        return (
            f"{differ.size} of {stored.size} values differ, first number {first}: "
            f"stored {_shown(stored[first])}, now {_shown(wanted[first])}"
        )
    if isinstance(stored, str) and isinstance(wanted, str):
        same = len(commonprefix((stored, wanted)))
        stored, wanted = _from(stored, same), _from(wanted, same)
    return f"stored {_shown(stored)}, now {_shown(wanted)}"


def _from(text: str, place: int) -> str:
    """The text from shortly before a place on, if that would not be shown otherwise."""
    return text if place < _SHOWN // 2 else f"…{text[place - _SHOWN // 4 :]}"


def _shown(value: Any) -> str:
    if value is _ABSENT:
        return "nothing"
    if isinstance(value, np.ndarray):
        return f"{value.size} values"
    text = value if isinstance(value, str) else str(value)
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}…"

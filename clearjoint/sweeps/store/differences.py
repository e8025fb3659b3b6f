"""Why a store can't hold another sweep, in words."""

from collections.abc import Iterator
from os.path import commonprefix

import numpy as np

from ..layout import Layout, Note, Variable
from .metadata import Contents
from .program import RUN

_SHOWN = 60
Part = Note | np.ndarray
"""A part of a layout that sweeps may differ in."""


def differences(stored: Contents, wanted: Contents, kept: np.ndarray) -> list[str]:
    """A line for each thing that a stored sweep has and the wanted one lacks or has otherwise.

    `kept` are the wanted sweep's lanes at the places of the store, -1 where it has none. Further
    lanes, axes and variables are no difference. What only tells a reader what was run is named
    where something else differs.
    """
    lines = [
        *_compared(_settings(stored.layout), _settings(wanted.layout)),
        *_lacking(_parts(stored.layout), _parts(wanted.layout)),
        *_lost(stored.layout, wanted.layout, kept),
    ]
    lines += _programs(stored, wanted, only_outputs=bool(lines))
    lines += _own_numbers(stored, wanted, kept)
    return lines and [*lines, *_compared(*_common_notes(stored.layout, wanted.layout))]


def _settings(layout: Layout) -> dict[str, Part]:
    settings: dict[str, Part] = {
        f"setting {name}": value for name, value in layout.settings.items()
    }
    return {"lanes in a chunk": layout.chunk, **settings}


def _parts(layout: Layout) -> dict[str, Part]:
    """What another layout has to have too, by name."""
    units = {f"unit of axis {axis.name}": axis.unit for axis in layout.axes}
    labels: dict[str, Part] = {f"coordinate {c.name}": c.values for c in layout.coordinates}
    labels |= {f"unit of coordinate {c.name}": c.unit for c in layout.coordinates}
    variables = {f"variable {name}": _outline(v) for name, v in layout.variables.items()}
    return {**units, **labels, **variables}


def _common_notes(stored: Layout, wanted: Layout) -> tuple[dict[str, Part], dict[str, Part]]:
    names = [name for name in stored.notes if name in wanted.notes]
    return {n: stored.notes[n] for n in names}, {n: wanted.notes[n] for n in names}


def _lacking(there: dict[str, Part], here: dict[str, Part]) -> Iterator[str]:
    return _compared(there, {name: here[name] for name in there if name in here})


def _compared(there: dict[str, Part], here: dict[str, Part]) -> Iterator[str]:
    for name in {**there, **here}:
        one, other = there.get(name), here.get(name)
        if not _same(one, other):
            yield f"{name}: {_difference(one, other)}"


def _lost(stored: Layout, wanted: Layout, kept: np.ndarray) -> Iterator[str]:
    """Values of axes, and lanes."""
    values = {axis.name: axis.values for axis in wanted.axes}
    for name, there, _ in stored.axes:
        gone = there[~np.isin(there, values.get(name, there))]
        if gone.size:
            yield (
                f"axis {name}: {gone.size} of {there.size} stored values are none of the "
                f"{values[name].size} now, first {_shown(gone[0])}"
            )
    lost = kept < 0
    if lost.any():
        yield (
            f"lanes: {lost.sum()} of {lost.size} stored lanes, by all the numbers that they start "
            f"from, are none of the {wanted.lanes} now, first number {lost.argmax()}"
        )


def _programs(stored: Contents, wanted: Contents, only_outputs: bool) -> Iterator[str]:
    """What is computed otherwise; settings are part of the program of the run."""
    there, here = stored.identity.programs, wanted.identity.programs
    for name, program in there.items():
        if program != here.get(name, program) and not (only_outputs and name == RUN):
            what = f"variable {name}" if name else "what a step computes"
            yield f"{what}: its code, as JAX traces it, is other than the one stored"


def _own_numbers(stored: Contents, wanted: Contents, kept: np.ndarray) -> Iterator[str]:
    """What outputs have of their own in each lane, such as the times to save at."""
    there, here = stored.identity.lanes, wanted.identity.lanes
    for name in (there.keys() & here.keys()) - {RUN}:
        others = (here[name][kept] != there[name][stored.order])[kept >= 0].sum()
        if others:
            yield f"times of {name}: others in {others} of {kept.size} stored lanes"


def _outline(variable: Variable) -> str:
    sizes = zip(variable.dims, variable.shape, strict=True)
    shape = ", ".join(["lane", *(f"{dim} {size}" for dim, size in sizes)])
    attrs = ", ".join(f"{name} {value}" for name, value in sorted(variable.attributes.items()))
    return f"{np.dtype(variable.dtype)} ({shape}), {attrs}"


def _same(one: Part | None, other: Part | None) -> bool:
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        return np.array_equal(one, other)
    return type(one) is type(other) and one == other


def _difference(stored: Part | None, wanted: Part | None) -> str:
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


def _shown(value: object) -> str:
    if value is None:
        return "nothing"
    if isinstance(value, np.ndarray):
        return f"{value.size} values"
    text = value if isinstance(value, str) else str(value)
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}…"

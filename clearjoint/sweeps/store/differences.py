"""Messages about the differences between a stored sweep and the sweep that is requested."""

from collections.abc import Iterator, Mapping
from os.path import commonprefix

import numpy as np

from ..layout import Layout, Variable
from .metadata import Contents
from .program import RUN

_SHOWN = 60
"""Number of characters of a text that a message shows."""
Part = str | int | np.ndarray
"""Part of a layout in which two sweeps may differ: a setting, or an array of labels."""


def differences(stored: Contents, wanted: Contents, kept: np.ndarray) -> list[str]:
    """Return one line for each difference that prevents the store from taking the wanted sweep.

    Additional lanes, axes and variables are not differences, because a store can be extended.
    Differences between notes are listed only if there are other differences, which they may
    explain.

    **Arguments:** `stored`, `wanted`: contents of the store, and of a store of the wanted sweep;
    `kept`: (rows of the store,) lane of the wanted sweep that each row holds, -1 if the wanted
    sweep lacks the row's lane.

    **Returns:** the lines; an empty list if the store can take the wanted sweep.
    """
    parts, wanted_parts = _parts(stored.layout), _parts(wanted.layout)
    lines = [
        *_compared(_settings(stored.layout), _settings(wanted.layout)),
        # A part that only the wanted sweep has is no difference: the store is extended by it.
        *_compared(parts, {name: wanted_parts[name] for name in parts if name in wanted_parts}),
        *_lost(stored.layout, wanted.layout, kept),
    ]
    # Settings are part of the program of the run. If a setting differs, the program differs too,
    # and a second line about it would mislead.
    lines += _programs(stored, wanted, without_run=bool(lines))
    lines += _save_times(stored, wanted, kept)
    notes = [name for name in stored.layout.notes if name in wanted.layout.notes]
    old, new = ({name: one.layout.notes[name] for name in notes} for one in (stored, wanted))
    return lines and [*lines, *_compared(old, new)]


def _settings(layout: Layout) -> dict[str, Part]:
    """Return the settings of a sweep, and the size of its chunks, by the names that messages
    show."""
    settings: dict[str, Part] = {f"setting {name}": text for name, text in layout.settings.items()}
    return {"lanes in a chunk": layout.chunk, **settings}


def _parts(layout: Layout) -> dict[str, Part]:
    """Return the parts of a stored layout that another layout must have, by name."""
    parts: dict[str, Part] = {f"unit of axis {axis.name}": axis.unit for axis in layout.axes}
    parts |= {f"coordinate {c.name}": c.values for c in layout.coordinates}
    parts |= {f"unit of coordinate {c.name}": c.unit for c in layout.coordinates}
    return parts | {f"variable {name}": _outline(v) for name, v in layout.variables.items()}


def _outline(variable: Variable) -> str:
    """Return the dtype, dimensions and attributes of a variable as text, such as "float64 (lane,
    body 2), long_name ..., units m"."""
    sizes = zip(variable.dims, variable.shape, strict=True)
    shape = ", ".join(["lane", *(f"{dim} {size}" for dim, size in sizes)])
    attrs = ", ".join(f"{name} {value}" for name, value in sorted(variable.attributes.items()))
    return f"{np.dtype(variable.dtype)} ({shape}), {attrs}"


def _compared(stored: Mapping[str, Part], wanted: Mapping[str, Part]) -> Iterator[str]:
    """Yield a line for each part that differs or that only one of the two sweeps has."""
    for name in {**stored, **wanted}:
        in_both = name in stored and name in wanted
        if not (in_both and np.array_equal(stored[name], wanted[name])):
            yield f"{name}: {_difference(stored.get(name), wanted.get(name))}"


def _difference(stored: Part | None, wanted: Part | None) -> str:
    """Return the end of a line, which says how the stored part differs from the wanted one.
    ``None`` stands for a part that is absent."""
    if isinstance(stored, np.ndarray) and isinstance(wanted, np.ndarray):
        if stored.size != wanted.size:
            return f"stored {stored.size} values, now {wanted.size}"
        differ = np.flatnonzero(stored != wanted)
        first = differ[0]
        return (
            f"{differ.size} of {stored.size} values differ, first number {first}: "
            f"stored {_shown(stored[first])}, now {_shown(wanted[first])}"
        )
    start = 0
    if isinstance(stored, str) and isinstance(wanted, str):
        # If the first difference would not be shown otherwise, the text begins shortly before it.
        same = len(commonprefix((stored, wanted)))
        start = max(same - _SHOWN // 4, 0) if same >= _SHOWN // 2 else 0
    return f"stored {_shown(stored, start)}, now {_shown(wanted, start)}"


def _shown(value: object, start: int = 0) -> str:
    """Return a text that shows a value: at most `_SHOWN` characters from the character `start` on,
    with "…" in place of omitted characters."""
    if value is None:
        return "nothing"
    text = f"{value.size} values" if isinstance(value, np.ndarray) else str(value)
    rest = text[start:]
    head, tail = "…" if start else "", "…" if len(rest) > _SHOWN else ""
    return f"{head}{rest[:_SHOWN]}{tail}"


def _lost(stored: Layout, wanted: Layout, kept: np.ndarray) -> Iterator[str]:
    """Yield a line for each axis with stored values that the wanted sweep lacks, and a line if it
    lacks stored lanes.

    **Arguments:** `kept`: as in `differences`.
    """
    values = {axis.name: axis.values for axis in wanted.axes}
    # An axis that the wanted sweep lacks altogether has no line here, since its unit, one of the
    # compared parts, already has one.
    for name, old, _ in stored.axes:
        gone = old[~np.isin(old, values.get(name, old))]
        if gone.size:
            yield (
                f"axis {name}: {gone.size} of {old.size} stored values are not among the "
                f"{values[name].size} present values, first {_shown(gone[0])}"
            )
    lost = kept < 0
    if lost.any():
        yield (
            f"lanes: {lost.sum()} of {lost.size} stored lanes are not among the {wanted.lanes} "
            "present lanes, because the numbers at their start differ, first lane "
            f"{lost.argmax()}"
        )


def _programs(stored: Contents, wanted: Contents, without_run: bool) -> Iterator[str]:
    """Yield a line for each traced program that both sweeps have, but with different digests.

    **Arguments:** `without_run`: whether to leave out the program of the run, and thus to compare
    only those of the variables.
    """
    new = wanted.identity.programs
    for name, program in stored.identity.programs.items():
        if program != new.get(name, program) and not (without_run and name == RUN):
            subject = f"variable {name}" if name else "program of a step"
            yield f"{subject}: the code that JAX traces differs from the stored one"


def _save_times(stored: Contents, wanted: Contents, kept: np.ndarray) -> Iterator[str]:
    """Yield a line for each output whose times to save at differ in any lane that both sweeps have.

    **Arguments:** `kept`: as in `differences`.
    """
    old, new = stored.identity.lanes, wanted.identity.lanes
    # `kept` is -1 for lanes that the wanted sweep lacks, which are left out of the count.
    for name in (old.keys() & new.keys()) - {RUN}:
        others = (new[name][kept] != old[name][stored.order])[kept >= 0].sum()
        if others:
            yield f"times of {name}: they differ in {others} of {kept.size} stored lanes"

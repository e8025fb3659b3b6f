"""The span of a run, and times within it."""

import jax
import jax.numpy as jnp
import numpy as np

from ...fields.checks import as_number, as_shown, checkable, require
from ...fields.types import ArrayLike, Column
from ...math.vectors import Scalar

ROUNDINGS = 4.0
"""Times may be so many roundings outside of a span: sums of steps, and single precision, are."""

SHORTEST = 1e10
"""A span is at least as many of the smallest normal numbers: processors take smaller ones, of which
its first steps would be, for zero."""


def check_span(start: Scalar, end: Scalar) -> None:
    """Check the span of a run in s.

    **Raises:** `ValueError` if it does not go forward to a finite end.
    """
    for name, value in (("start_time", start), ("end_time", end)):
        number = np.shape(as_number(value, name, "s")) == ()
        require(number, name, value, "a single number", "pass one time in s")
    if (known := checkable(start, end)) is not None:
        first, last = known
        require(
            (abs(first) < np.inf) & (abs(last) < np.inf) & (last > first),
            "end_time",
            end,
            f"finite and after start_time = {as_shown(start)}",
            "give times in s",
        )
        shortest = SHORTEST * float(jnp.finfo(float).tiny)
        require(
            last - first >= shortest,
            "end_time",
            end,
            f"at least {shortest:.1g} s after start_time = {as_shown(start)}",
            "give times in s; shorter spans are zero to the processor",
        )


def checked_times(start: Scalar, end: Scalar, times: ArrayLike, argument: str) -> Column:
    """Times to look at during a run, found to rise within its span.

    **Arguments:** `argument`: what the caller calls these times.

    **Returns:** the times in double precision, (N,). One that is outside by the rounding of its own
    precision, or of the span's, is taken as the span's end.

    **Raises:** `ValueError` for times that don't rise or are outside.
    """
    row = check_rising(times, argument)
    if (known := checkable(row, start, end)) is not None:
        row, first, last = known
        room = rounding(start, end, times)
        require(
            (row[0] >= first - room) & (row[-1] <= last + room),
            argument,
            [row[0], row[-1]],
            f"between start_time = {as_shown(start)} and end_time = {as_shown(end)}",
            "leave out the times outside",
        )
        return row.astype(float).clip(first, last)
    return row


def check_rising(times: ArrayLike, argument: str) -> Column:
    """The times as an array, (N,).

    **Raises:** `ValueError` for times that don't rise.
    """
    row = as_number(times, argument, "s")
    expected = "a rising one-dimensional array of finite times"
    remedy = "sort the times, or pass for example numpy.linspace(0, 1, 101)"
    require(row.ndim == 1 and row.size > 0, argument, row, expected, remedy)
    if (known := checkable(row)) is None:
        return row
    (row,) = known
    fine = row.__array_namespace__().isfinite(row).all() & (row[1:] >= row[:-1]).all()
    require(fine, argument, row, expected, remedy)
    return row


def rounding(start: Scalar, end: Scalar, times: ArrayLike) -> Scalar:
    """How far times may be outside of a span by rounding alone, s: that of the coarsest of the
    types in which these are given."""
    precision = max(float(jnp.finfo(_float_type(value)).eps) for value in (start, end, times))
    return ROUNDINGS * precision * (abs(start) + abs(end))


def _float_type(value: ArrayLike) -> np.dtype:
    kind = value.dtype if isinstance(value, jax.Array) else np.asarray(value).dtype
    return kind if jnp.issubdtype(kind, jnp.floating) else np.dtype(float)

"""The span of a run, and times within it."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from ..fields.checks import as_number, require
from ..math.vectors import Scalar

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
    require(
        bool(np.isfinite(end)) and bool(end > start),
        "end_time",
        end,
        f"finite and after start_time = {start}",
        "give times in s",
    )
    shortest = SHORTEST * float(jnp.finfo(float).tiny)
    require(
        bool(float(end) - float(start) >= shortest),
        "end_time",
        end,
        f"at least {shortest:.1g} s after start_time = {start}",
        "give times in s; shorter spans are zero to the processor",
    )


def checked_times(
    start: Scalar, end: Scalar, times: ArrayLike, argument: str
) -> Float[np.ndarray, " N"]:
    """Times to look at during a run, found to rise within its span.

    **Arguments:** `argument`: what the caller calls these times.

    **Returns:** the times in double precision, (N,). One that is outside by the rounding of its own
    precision, or of the span's, is taken as the span's end.

    **Raises:** `ValueError` for times that don't rise or are outside.
    """
    row = check_rising(times, argument)
    room = rounding(start, end, times)
    require(
        bool(row[0] >= start - room) and bool(row[-1] <= end + room),
        argument,
        [float(row[0]), float(row[-1])],
        f"between start_time = {start} and end_time = {end}",
        "leave out the times outside",
    )
    return np.clip(row.astype(float), float(start), float(end))


def check_rising(times: ArrayLike, argument: str) -> Float[np.ndarray, " N"]:
    """The times as an array, (N,).

    **Raises:** `ValueError` for times that don't rise.
    """
    row = np.asarray(as_number(times, argument, "s"))
    fine = row.ndim == 1 and row.size > 0 and bool(np.isfinite(row).all())
    require(
        fine and bool((np.diff(row) >= 0).all()),
        argument,
        row,
        "a rising one-dimensional array of finite times",
        "sort the times, or pass for example numpy.linspace(0, 1, 101)",
    )
    return row


def rounding(start: Scalar, end: Scalar, times: ArrayLike) -> float:
    """How far times may be outside of a span by rounding alone, s: that of the coarsest of the
    types in which these are given."""
    precision = max(float(jnp.finfo(_float_type(value)).eps) for value in (start, end, times))
    return ROUNDINGS * precision * max(abs(float(start)), abs(float(end)))


def _float_type(value: ArrayLike) -> np.dtype:
    kind = np.asarray(value).dtype
    return kind if jnp.issubdtype(kind, jnp.floating) else np.dtype(float)

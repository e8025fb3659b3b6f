"""Checks of the start time and end time of a run, and of times between them."""

import jax
import jax.numpy as jnp
import numpy as np

from ...fields.checks import as_number, as_shown, checkable, require
from ...fields.types import ArrayLike, Column
from ...math.vectors import Scalar

ROUNDINGS = 4.0
"""Largest distance by which a valid time may be outside of a run, in units of rounding error. Times
in single precision, and times that a user computes as sums of steps, are wrong by that much."""
SHORTEST = 1e10
"""Shortest duration of a run, in multiples of the smallest normal floating-point number. Processors
may take numbers below the smallest normal one as zero, and steps are much shorter than the run: the
first one is by default a millionth of the duration."""


def check_span(start: Scalar, end: Scalar) -> None:
    """Check the `start` and `end` time of a run, s; values that JAX traces are not checked.

    **Raises:** `ValueError` if a time is not a finite number, or if the end is not after the start
    by at least `SHORTEST` times the smallest normal number, 2.2e-298 s.
    """
    for name, value in (("start_time", start), ("end_time", end)):
        number = np.shape(as_number(value, name, "s")) == ()
        require(number, name, value, "a single number", "pass one time in s")
    if (known := checkable(start, end)) is not None:
        first, last = known
        after = f"after start_time = {as_shown(start)}"
        fine = (abs(first) < np.inf) & (abs(last) < np.inf) & (last > first)
        require(fine, "end_time", end, f"finite and {after}", "give times in s")
        shortest = SHORTEST * float(jnp.finfo(float).tiny)
        expected = f"at least {shortest:.1g} s {after}"
        remedy = "give times in s; the processor takes shorter spans as zero"
        require(last - first >= shortest, "end_time", end, expected, remedy)


def checked_times(start: Scalar, end: Scalar, times: ArrayLike, argument: str) -> Column:
    """Check that times lie within a run from `start` to `end`, s, and return them as an array.

    **Arguments:** `times`: (N,), s; `argument`: their name in error messages.

    **Returns:** the times, (N,), in double precision. Times outside of the run by rounding errors
    alone are moved to its start or end. Of traced times only the shape is checked.

    **Raises:** `ValueError` for times that decrease, are not finite, are not one-dimensional or are
    outside of the run, and for an empty array.
    """
    row = check_rising(times, argument)
    if (known := checkable(row, start, end)) is not None:
        row, first, last = known
        room = rounding(start, end, times)
        fine = (row[0] >= first - room) & (row[-1] <= last + room)
        expected = f"between start_time = {as_shown(start)} and end_time = {as_shown(end)}"
        require(fine, argument, [row[0], row[-1]], expected, "leave out the times outside")
        return row.astype(float).clip(first, last)
    return row


def check_rising(times: ArrayLike, argument: str) -> Column:
    """Check that times, s, do not decrease, and return them as an array, (N,). Of traced times only
    the shape is checked.

    **Arguments:** `argument`: the times' name in error messages.

    **Raises:** `ValueError` for times that decrease, are not finite, or are not one-dimensional,
    and for an empty array.
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


def check_strictly_rising(times: ArrayLike, argument: str) -> Column:
    """Check times, s, that JAX does not trace, and return them as an array, (N,).

    **Arguments:** `argument`: the times' name in error messages.

    **Raises:** `ValueError` for times that decrease, are repeated, are not finite, or are not
    one-dimensional, and for an empty array.
    """
    row = check_rising(times, argument)
    remedy = "remove repeated times, for example with numpy.unique"
    require(bool((np.diff(row) > 0).all()), argument, times, "without repetition", remedy)
    return row


def rounding(start: Scalar, end: Scalar, times: ArrayLike) -> Scalar:
    """Return by how much, s, `times` may be outside of a run from `start` to `end` because of
    rounding errors alone.

    The least precise floating-point type among the arguments determines the rounding error.
    """
    precision = 0.0
    for value in (start, end, times):
        kind = value.dtype if isinstance(value, jax.Array) else np.asarray(value).dtype
        kind = kind if jnp.issubdtype(kind, jnp.floating) else np.dtype(float)
        precision = max(precision, float(jnp.finfo(kind).eps))
    return ROUNDINGS * precision * (abs(start) + abs(end))

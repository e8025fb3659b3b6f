"""Settings of a run: integration method, tolerances, coordinates and limit of steps."""

from dataclasses import dataclass, field, replace

import diffrax
import jax
import jax.numpy as jnp
import numpy as np

from ..._dynamics.coordinates import AbstractCoordinates
from ..._dynamics.formulation import AbstractStabilisation, Baumgarte
from ..._dynamics.joint_coordinates.coordinates import JointCoordinates
from ..._fields.checks import (
    as_number,
    as_shown,
    checkable,
    require,
    require_count,
    require_positive,
    require_type,
)
from ..._fields.types import ArrayLike, Column
from ..._math.vectors import Scalar
from .solvers import require_ordinary
from .types import Numbers

DEFAULT_RTOL = 1e-6
"""Default relative tolerance, also for drivers in runs whose controller has none."""
FIRST_SHARE = 1e-6
"""Default length of the first step, relative to the duration of the run: short enough for stiff
contacts. The controller lengthens each of the next steps up to tenfold."""

NUMBERS = (int, float, np.number, np.ndarray, jax.Array)


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Settings of a run: integration method, tolerances, coordinates and limit of steps.

    Functions that make runs raise a `ValueError` for settings that they do not support. To change
    single settings, use `dataclasses.replace`, which returns a modified copy:

        dataclasses.replace(cj.presets.accurate, ledger=True)

    **Arguments:**

    - `solver`: a diffrax solver of ordinary differential equations. Runs with derivatives, and
      sweeps that save states, sections or statistics, need an explicit Runge-Kutta method. Implicit
      solvers iterate stages to `rtol` and `atol`: take an `atol` such as `rtol`/1000.
    - `controller`: a diffrax step-size controller. The default, ``None``, is a
      `diffrax.PIDController` with `rtol` and `atol`; another controller has its own tolerances.
    - `rtol`, `atol`: relative and absolute tolerance of the error of each variable in one step.
      `atol` is in the SI unit of the variable (m, m/s, rad, ...). Its default is 1e-5 `rtol`,
      because impacts amplify errors of variables that are nearly zero, such as the misalignment of
      a journal. Give a smaller `atol` if all speeds of the motion are below 1e4 `atol`.
    - `first_step`: length of the first step, s; by default a millionth of the run's duration.
    - `landing_tolerance`: m. A step ends at each onset and end of a contact. The penetration at the
      end of this step differs by at most this value from the penetration at the event; in slow
      contacts, the step ends at most 1e-11 s after the event. With ``None``, steps go across onsets
      and ends. Runs with derivatives and an `rtol` of 1e-10 or less need 1e-13.
    - `derivative_tolerance`: factor by which the tolerances of derivatives are larger than those of
      the variables. The table shows its effect on the double pendulum after five impacts at each
      base of the journal, with three parameters and an `rtol` of 1e-9. Errors are relative. A run
      without derivatives takes 823 attempted steps, more than with 1e5, because it places the
      solver's stages differently during contacts:

      | `derivative_tolerance` | steps | error of a position's derivative | of an entry speed's |
      |---|---|---|---|
      | 1 | 1451 | 5e-8 | 4e-7 |
      | 10 | 1078 | 6e-7 | 2e-6 |
      | 100 | 905 | 1e-6 | 6e-6 |
      | 1e3 | 851 | 4e-5 | 4e-4 |
      | 1e5 | 799 | 4e-4 | 1e-3 |

    - `coordinates`: `JointCoordinates()`, which are faster, or `AbsoluteCoordinates()`, in which
      every ideal joint adds constraint equations.
    - `stabilisation`: method against drift from the constraints: `Baumgarte()`, `Projection()` or
      `Unstabilised()`.
    - `ledger`: whether to integrate the dissipated and supplied energies, J, with the motion.
    - `redundant`: whether some constraint equations depend linearly on others. By default, runs
      find this out from the initial state; under a transformation, they take all as independent.
    - `max_steps`: largest number of attempted steps of a run, accepted and rejected. The output
      `RejectedSteps` tells when and why steps are rejected.
    - `allow_float32`: whether runs may compute in single precision, JAX's default.

    **Raises:** `ValueError` that names the setting: for a value of a wrong type; for a solver of
    stochastic equations or one that splits the equations; for a `diffrax.ClipStepSizeController`
    with `step_ts` or `jump_ts`; for a number that is negative, not finite, or zero (only one of
    `rtol` and `atol` may be zero); and for `max_steps` below 1.

    >>> settings = cj.Settings(rtol=1e-8, ledger=True)
    >>> settings.rtol, settings.ledger
    (1e-08, True)
    """

    solver: diffrax.AbstractSolver = field(default_factory=diffrax.Tsit5)
    controller: diffrax.AbstractStepSizeController | None = None
    rtol: float = DEFAULT_RTOL
    atol: float | None = None
    first_step: float | None = None
    landing_tolerance: float | None = 1e-12
    derivative_tolerance: float = 10.0
    coordinates: AbstractCoordinates = field(default_factory=JointCoordinates)
    stabilisation: AbstractStabilisation = field(default_factory=Baumgarte)
    ledger: bool = False
    redundant: bool | None = None
    max_steps: int = 10_000_000
    allow_float32: bool = False

    def __post_init__(self) -> None:
        for name, value in list(vars(self).items()):
            if isinstance(value, np.generic):
                # JAX would compile another program for a NumPy scalar than for a Python number.
                object.__setattr__(self, name, value.item())
        for name, kind, example in (
            ("solver", diffrax.AbstractSolver, "diffrax.Tsit5()"),
            ("controller", diffrax.AbstractStepSizeController | None, "diffrax.PIDController()"),
            ("coordinates", AbstractCoordinates, "JointCoordinates()"),
            ("stabilisation", AbstractStabilisation, "Baumgarte()"),
        ):
            value, expected = getattr(self, name), f"an object such as {example}"
            require(isinstance(value, kind), name, value, expected, "pass one, or leave it out")
        # Steps that end early, at contact events, would miss the times at which a
        # `ClipStepSizeController` wants steps to end.
        clip = self.controller
        keeps_steps = not isinstance(clip, diffrax.ClipStepSizeController) or (
            clip.step_ts is None and clip.jump_ts is None
        )
        remedy = "save at times by cj.Saving(times); functions of time declare their `breakpoints`"
        require(keeps_steps, "controller", clip, "without `step_ts` and `jump_ts`", remedy)
        require_ordinary(self.solver)
        self.check_numbers()
        require_count("max_steps", self.max_steps, "give a number of steps")
        for name, kind in (("ledger", bool), ("redundant", bool | None), ("allow_float32", bool)):
            value = getattr(self, name)
            require(isinstance(value, kind), name, value, "True or False", "pass a bool")

    def check_numbers(self) -> None:
        """Check that each tolerance, and the length of the first step, is a number in its range, or
        raise a `ValueError` that names it. The compiled program checks numbers that JAX traces."""
        # Name of each setting, remedy in the error message, and whether the setting may be zero.
        for name, remedy, zero in (
            ("rtol", "give a relative tolerance such as 1e-6", True),
            ("atol", "give an absolute tolerance such as 1e-9, or None", True),
            ("derivative_tolerance", "give a factor such as 10", False),
            ("first_step", "give a step in s, or None", False),
            ("landing_tolerance", "give a penetration in m, or None", False),
        ):
            value = getattr(self, name)
            # These two must be numbers; for the others ``None`` has a meaning.
            if name not in ("rtol", "derivative_tolerance") and value is None:
                continue
            is_number = isinstance(value, NUMBERS) and not isinstance(value, bool)
            require(is_number, name, value, "a number", remedy)
            require_positive(name, value, remedy, zero=zero)
        # Errors are divided by atol + rtol |variable|, so one of both must be positive. Traced
        # tolerances cannot be compared.
        tolerances = checkable(self.rtol, 0.0 if self.atol is None else self.atol)
        if tolerances is not None:
            is_positive = (tolerances[0] > 0) | (tolerances[1] > 0)
            remedy = "give a relative tolerance such as 1e-6"
            require(is_positive, "rtol", self.rtol, "positive unless `atol` is", remedy)

    @property
    def numbers(self) -> tuple[float | None, ...]:
        """The settings `rtol`, `atol`, `first_step`, `landing_tolerance`, which JAX may trace."""
        return self.rtol, self.atol, self.first_step, self.landing_tolerance

    def length_of_first_step(self, start_time: Scalar, end_time: Numbers) -> Numbers:
        """Return the length of the first step, s, of a run to each of the end times, s:
        `first_step` or, if that is ``None``, the part `FIRST_SHARE` of the run's duration."""
        length = self.first_step
        return FIRST_SHARE * (end_time - start_time) if length is None else length

    def looser(self, factor: float) -> "Settings":
        """Return a copy of these settings with `rtol` and `atol` multiplied by `factor`. Raise a
        `ValueError` if a `controller` is set, because it has its own tolerances."""
        self.require_tolerances("runs of several tolerances are made")
        atol = None if self.atol is None else factor * self.atol
        return replace(self, rtol=factor * self.rtol, atol=atol)

    def require_tolerances(self, where: str) -> None:
        """Refuse a `controller`, which replaces `rtol`, `atol`. `where`: clause for the error."""
        controller, remedy = self.controller, "leave it out, and give rtol and atol"
        require(controller is None, "controller", controller, f"None where {where}", remedy)

    def require_double(self) -> None:
        expected = "False for sweeps and runs with derivatives"
        remedy = "leave it out, and call clearjoint.configure() first"
        require(not self.allow_float32, "allow_float32", True, expected, remedy)


def settings_or(settings: Settings | None, default: Settings) -> Settings:
    """Return `settings`, or `default` for ``None``; raise a `ValueError` for another type."""
    remedy = "pass cj.Settings(rtol=1e-8), say, or one of cj.presets"
    require_type("settings", settings, Settings | None, "Settings or None", remedy)
    return default if settings is None else settings


ROUNDINGS = 4.0
"""Largest distance by which a valid time may be outside of a run, in units of rounding error. Times
in single precision, and times that a user computes as sums of steps, are wrong by that much."""
SHORTEST = 1e10
"""Shortest duration of a run, in multiples of the smallest normal floating-point number. Processors
may take numbers below the smallest normal one as zero, and steps are much shorter than the run."""


def check_span(start: Scalar, end: Scalar) -> None:
    """Check the `start` and `end` time of a run, s; of traced times only types and shapes.

    **Raises:** `ValueError` if a time is not a single finite number, or if the end is not after the
    start by at least `SHORTEST` times the smallest normal number: 2.2e-298 s in double precision.
    """
    for name, value in (("start_time", start), ("end_time", end)):
        is_single = np.shape(as_number(value, name, "s")) == ()
        require(is_single, name, value, "a single number", "pass one time in s")
    if (times := checkable(start, end)) is not None:  # JAX traces neither time
        start_number, end_number = times
        after = f"after start_time = {as_shown(start)}"
        are_finite = (abs(start_number) < np.inf) & (abs(end_number) < np.inf)
        is_span = are_finite & (end_number > start_number)
        require(is_span, "end_time", end, f"finite and {after}", "give times in s")
        shortest = SHORTEST * float(jnp.finfo(jnp.result_type(float)).tiny)
        expected = f"at least {shortest:.1g} s {after}"
        remedy = "give times in s; the processor takes shorter spans as zero"
        is_long_enough = end_number - start_number >= shortest
        require(is_long_enough, "end_time", end, expected, remedy)


def checked_times(start: Scalar, end: Scalar, times: ArrayLike) -> Column:
    """Return the `times`, (N,) s, of a run from `start` to `end`, s, in double precision. Times
    that are outside of the run by rounding errors alone are moved to its start or end.

    If JAX traces the times, only their shape is checked; if it traces the start or the end of the
    run, the times are not compared with these. In both cases, the times are returned unchanged.

    **Raises:** `ValueError` that names the argument `times`, for times that decrease, are not
    finite, are not one-dimensional or are outside of the run, and for an empty array.
    """
    rising = rising_times(times)
    # `checkable` returns ``None`` if JAX traces one of the numbers.
    if (numbers := checkable(rising, start, end)) is not None:
        rising, first, last = numbers
        tolerance = rounding(start, end, times)
        # The times rise, so that only the first and the last one can be outside.
        is_inside = (rising[0] >= first - tolerance) & (rising[-1] <= last + tolerance)
        expected = f"between start_time = {as_shown(start)} and end_time = {as_shown(end)}"
        remedy = "leave out the times outside"
        require(is_inside, "times", [rising[0], rising[-1]], expected, remedy)
        return rising.astype(float).clip(first, last)
    return rising


def rising_times(times: ArrayLike) -> Column:
    """Return `times`, (N,) s, as an array. Raise a `ValueError` unless they are one-dimensional, at
    least one, finite, and never decrease. Of traced times only the shape is checked."""
    rising = as_number(times, "times", "s")
    expected = "a rising one-dimensional array of finite times"
    remedy = "sort the times, or pass for example numpy.linspace(0, 1, 101)"
    require(rising.ndim == 1 and rising.size > 0, "times", rising, expected, remedy)
    if (numbers := checkable(rising)) is None:  # JAX traces the times
        return rising
    (rising,) = numbers
    are_finite = rising.__array_namespace__().isfinite(rising).all()
    rises = are_finite & (rising[1:] >= rising[:-1]).all()
    require(rises, "times", rising, expected, remedy)
    return rising


def strictly_rising_times(times: ArrayLike) -> Column:
    """Return `times` as `rising_times` does, but refuse repeated times. They must not be traced."""
    rising = rising_times(times)
    remedy = "remove repeated times, for example with numpy.unique"
    require(bool((np.diff(rising) > 0).all()), "times", times, "without repetition", remedy)
    return rising


def rounding(start: Scalar, end: Scalar, times: ArrayLike) -> Scalar:
    """Return by how much, s, `times` may be outside of a run from `start` to `end`, s, because of
    rounding errors in the least precise floating-point type among the arguments."""
    arrays = [v if isinstance(v, jax.Array) else np.asarray(v) for v in (start, end, times)]
    kinds = [v.dtype if jnp.issubdtype(v.dtype, jnp.floating) else float for v in arrays]
    precision = max(float(jnp.finfo(kind).eps) for kind in kinds)
    return ROUNDINGS * precision * (abs(start) + abs(end))

"""Settings of the integration, for all functions that make runs."""

from dataclasses import dataclass, field, replace

import diffrax
import jax
import numpy as np

from ...dynamics.coordinates import AbstractCoordinates
from ...dynamics.joint_coordinates.coordinates import JointCoordinates
from ...dynamics.stabilisation import AbstractStabilisation, Baumgarte
from ...fields.checks import checkable, require, require_count, require_positive
from ...math.vectors import Scalar
from .solvers import require_ordinary
from .types import Numbers

FIRST_SHARE = 1e-6
"""Default length of the first step relative to the duration of the run."""

NUMBERS = (int, float, np.number, np.ndarray, jax.Array)


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Settings of the integration of runs: method, tolerances and formulation.

    A function that makes runs raises a `ValueError` for settings that it does not support. For a
    modified copy use `dataclasses.replace`:

        dataclasses.replace(cj.presets.accurate, ledger=True)

    **Arguments:**

    - `solver`: any diffrax ODE solver. Implicit ones need a looser `atol`, such as `rtol`/1000, to
      which they also solve their stages. Runs with derivatives, and sweeps that save states,
      sections or statistics, need an explicit Runge-Kutta method.
    - `controller`: a diffrax step-size controller; it replaces the default one, and with it `rtol`
      and `atol`.
    - `rtol`, `atol`: relative and absolute tolerance of the error of a step. `atol` is in the SI
      units of each state; the default is 1e-5 `rtol`, because impacts amplify small misalignments.
      Give a smaller one if no speed exceeds 1e4 `atol`.
    - `first_step`: s; by default a millionth of the duration.
    - `landing_tolerance`: m, penetration within which steps land on the onset and end of contacts;
      ``None``: steps go across them. Derivatives at an `rtol` of 1e-10 or less need 1e-13.
    - `derivative_tolerance`: tolerance of derivatives, in tolerances of the states. Example: the
      double pendulum after five impacts at each base, with three parameters, at an `rtol` of 1e-9;
      the motion alone takes 823 attempted steps:

      | `derivative_tolerance` | steps | error of a position's derivative | of entry speeds' |
      |---|---|---|---|
      | 1 | 1451 | 5e-8 | 4e-7 |
      | 10 | 1078 | 6e-7 | 2e-6 |
      | 100 | 905 | 1e-6 | 6e-6 |
      | 1e3 | 851 | 4e-5 | 4e-4 |
      | 1e5 | 799 | 4e-4 | 1e-3 |

    - `coordinates`: `JointCoordinates()`, which are faster, or `AbsoluteCoordinates()`, in which
      every ideal joint is a constraint, as in the paper.
    - `stabilisation`: of constraints: `Baumgarte()`, `Projection()` or `Unstabilised()`.
    - `ledger`: integrate the dissipated energies, J, with the state.
    - `redundant`: whether constraints depend on each other. By default this is determined from the
      initial state; inside a JAX transformation, they are assumed independent.
    - `max_steps`: largest number of attempted steps of a run.
    - `allow_float32`: allow single precision if JAX is configured for it.

    **Raises:** `ValueError` for a setting that no run can use.

    >>> settings = cj.Settings(rtol=1e-8, ledger=True)
    >>> settings.rtol, settings.ledger
    (1e-08, True)
    """

    solver: diffrax.AbstractSolver = field(default_factory=diffrax.Tsit5)
    controller: diffrax.AbstractStepSizeController | None = None
    rtol: float = 1e-6
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
        self._convert_numpy_scalars()
        self._check_method()
        self.check_numbers()
        require_count("max_steps", self.max_steps, "give a number of steps")
        for name, kinds in (
            ("ledger", bool),
            ("redundant", bool | None),
            ("allow_float32", bool),
        ):
            value = getattr(self, name)
            require(isinstance(value, kinds), name, value, "True or False", "say whether")

    def _convert_numpy_scalars(self) -> None:
        """Convert NumPy scalars to Python numbers, for which JAX would compile another program."""
        for name, value in list(vars(self).items()):
            if isinstance(value, np.generic):
                object.__setattr__(self, name, value.item())

    def _check_method(self) -> None:
        for name, kind, example in (
            ("solver", diffrax.AbstractSolver, "diffrax.Tsit5()"),
            ("controller", diffrax.AbstractStepSizeController | None, "diffrax.PIDController()"),
            ("coordinates", AbstractCoordinates, "JointCoordinates()"),
            ("stabilisation", AbstractStabilisation, "Baumgarte()"),
        ):
            value = getattr(self, name)
            expected = f"an object such as {example}"
            require(isinstance(value, kind), name, value, expected, "pass one, or leave it out")
        require_ordinary(self.solver)

    def check_numbers(self) -> None:
        """Check that each number is in its range.

        **Raises:** `ValueError` that names the number.
        """
        for name, remedy, zero in (
            ("rtol", "give a relative tolerance such as 1e-6", True),
            ("atol", "give an absolute tolerance such as 1e-9, or None", True),
            ("derivative_tolerance", "give a number of state tolerances such as 10", False),
            ("first_step", "give a step in s, or None", False),
            ("landing_tolerance", "give a penetration in m, or None", False),
        ):
            value = getattr(self, name)
            if name not in ("rtol", "derivative_tolerance") and value is None:
                continue
            fine = isinstance(value, NUMBERS) and not isinstance(value, bool)
            require(fine, name, value, "a number", remedy)
            require_positive(name, value, remedy, zero=zero)
        known = checkable(self.rtol, 0.0 if self.atol is None else self.atol)
        if known is not None:
            rtol, atol = known
            require(
                (rtol > 0) | (atol > 0),
                "rtol",
                self.rtol,
                "positive unless `atol` is",
                "give a relative tolerance such as 1e-6",
            )

    @property
    def numbers(self) -> tuple[float | None, ...]:
        """The settings that JAX may trace: `rtol`, `atol`, `first_step` (s) and `landing_tolerance`
        (m)."""
        return self.rtol, self.atol, self.first_step, self.landing_tolerance

    def length_of_first_step(self, start_time: Scalar, end_time: Numbers) -> Numbers:
        """Return the length of the first step of a run between two times, s."""
        if self.first_step is None:
            return FIRST_SHARE * (end_time - start_time)
        return self.first_step

    def looser(self, factor: float) -> "Settings":
        """Return the settings with `rtol` and `atol` multiplied by a factor.

        **Raises:** `ValueError` if a controller replaces them.
        """
        self.require_tolerances("runs of several tolerances are made")
        atol = None if self.atol is None else factor * self.atol
        return replace(self, rtol=factor * self.rtol, atol=atol)

    def require_tolerances(self, where: str) -> None:
        """Check that `rtol` and `atol` are in use, and not replaced by a controller."""
        require(
            self.controller is None,
            "controller",
            self.controller,
            f"None where {where}",
            "leave it out, and give rtol and atol",
        )

    def require_double(self) -> None:
        """Check that single precision is not allowed, for runs that need double precision."""
        require(
            not self.allow_float32,
            "allow_float32",
            True,
            "False for sweeps and runs with derivatives",
            "leave it out, and call clearjoint.configure() first",
        )


def settings_or(settings: Settings | None, default: Settings) -> Settings:
    """Return the settings, or the default if they are ``None``.

    **Raises:** `ValueError` for any other type.
    """
    kind = type(settings).__name__
    remedy = "pass cj.Settings(rtol=1e-8), say, or one of cj.presets"
    require(isinstance(settings, Settings | None), "settings", kind, "Settings or None", remedy)
    return default if settings is None else settings

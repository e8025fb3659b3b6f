"""Choices for the equations of motion: coordinates, stabilisation, solver."""

from collections.abc import Callable, Mapping
from typing import TypeVar

import equinox as eqx
from typing_extensions import override

from .._fields.objects import AbstractConverting, quantity
from .._fields.types import Single
from .._math.linear_solvers import AbstractSolver, Exact, LeastNorm
from .._math.vectors import Scalar
from .coordinates import AbstractCoordinates
from .joint_coordinates.coordinates import JointCoordinates

T = TypeVar("T")


class AbstractStabilisation(AbstractConverting):
    """Base class of methods that keep constraints satisfied in spite of integration errors.

    A subclass overrides `target` or `corrected`:

    ```python
    import clearjoint as cj

    class CriticallyDamped(cj.extend.AbstractStabilisation):
        time_constant: float  # s

        def target(self, value, rate):
            return -2.0 * rate / self.time_constant - value / self.time_constant**2

    stabilisation = CriticallyDamped(time_constant=0.01)
    ```
    """

    def target(self, value: Scalar, rate: Scalar) -> Scalar:
        """Return the second time derivative that the equations of motion impose on a constraint,
        for its `value`, in m, rad or without unit, and its rate of change; zero by default."""
        return 0.0

    def corrected(self, variables: T, project: Callable[[T], T]) -> T:
        """Return the variables at the end of a step, corrected; by default unchanged. The function
        `project` returns variables with positions and speeds projected onto the constraints."""
        return variables


class Unstabilised(AbstractStabilisation):
    """No stabilisation: only the second time derivatives of the constraints are satisfied, so that
    their values drift as integration errors accumulate.

    >>> cj.Settings(stabilisation=cj.Unstabilised()).stabilisation
    Unstabilised()
    """


class Baumgarte(AbstractStabilisation):
    """Feedback that imposes -2 alpha rate - beta^2 value on the second time derivative of each
    constraint (J. Baumgarte 1972; eq. 32 of P. Flores et al. 2006, where the first term lacks the
    dot that marks the rate).

    `alpha` and `beta` are in 1/s, and not negative; 5 is usual.

    >>> feedback = cj.Baumgarte(alpha=5.0, beta=5.0).target(value=1e-3, rate=0.0)
    >>> print(f"{feedback:.3f}")  # -beta^2 value
    -0.025
    """

    alpha: Single = quantity("1/s", default=5.0, positive=True, zero=True)
    beta: Single = quantity("1/s", default=5.0, positive=True, zero=True)

    @override
    def target(self, value: Scalar, rate: Scalar) -> Scalar:
        return -2.0 * self.alpha * rate - self.beta**2 * value


class Projection(AbstractStabilisation):
    """Projection of positions, by one Newton step, and of velocities onto the constraints at the
    end of each step.

    >>> cj.Settings(stabilisation=cj.Projection()).stabilisation
    Projection()
    """

    @override
    def corrected(self, variables: T, project: Callable[[T], T]) -> T:
        return project(variables)


class Formulation(eqx.Module):
    """Coordinates, stabilisation and linear solver for the equations of motion.

    - `redundant`: whether some constraints depend on others; see `clearjoint.constraint_report`. If
      so, reactions are not unique, and the multipliers of least norm are computed. In this norm,
      each multiplier is divided by the square root of the mass or moment of inertia that it would
      accelerate if all bodies were free.
    - `ledger`: whether the powers of damping, friction, films, drives and stabilisation are
      integrated with the state, as an energy ledger in J.
    - `integrands`: further functions ``f(system, t, variables, entry_speeds, bristles, memory)``,
      by name, whose values are integrated over time with the state.

    >>> formulation = extend.Formulation(cj.AbsoluteCoordinates(), cj.Baumgarte(), ledger=True)
    >>> formulation.coordinates
    AbsoluteCoordinates()
    """

    coordinates: AbstractCoordinates = eqx.field(default_factory=JointCoordinates)
    stabilisation: AbstractStabilisation = eqx.field(default_factory=Baumgarte)
    redundant: bool = eqx.field(default=False, static=True)
    ledger: bool = eqx.field(default=False, static=True)
    integrands: Mapping[str, Callable[..., Scalar]] = eqx.field(default_factory=dict)

    def solver(self) -> AbstractSolver:
        """Return the linear solver for the constraint multipliers."""
        return LeastNorm() if self.redundant else Exact()

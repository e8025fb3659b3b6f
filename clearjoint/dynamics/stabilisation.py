"""What keeps constraints satisfied in spite of the integration's error: Baumgarte's feedback
(eq. 32), projection at the end of each step, or nothing."""

import abc
from collections.abc import Callable
from typing import TypeVar

from ..fields.conversion import AbstractConverting
from ..fields.declarations import quantity
from ..fields.types import Single
from ..math.vectors import Scalar

T = TypeVar("T")


class AbstractStabilisation(AbstractConverting):
    """What keeps the constraints satisfied in spite of integration error.

    ```python
    import clearjoint as cj

    class CriticallyDamped(cj.extend.AbstractStabilisation):
        time_constant: float  # s

        def target(self, value, rate):
            return -2.0 * rate / self.time_constant - value / self.time_constant**2

    stabilisation = CriticallyDamped(time_constant=0.01)
    ```
    """

    @abc.abstractmethod
    def target(self, value: Scalar, rate: Scalar) -> Scalar:
        """The second derivative that a constraint of given value and rate shall have."""

    def corrected(self, variables: T, project: Callable[[T], T]) -> T:
        """The variables to go on with after a step; by default those that the step ended with.

        **Arguments:** `project`: puts positions and velocities of variables onto the constraints.
        """
        del project
        return variables


class Unstabilised(AbstractStabilisation):
    """No stabilisation: the constraints drift with the integration error.

    >>> kept = cj.Unstabilised()
    >>> cj.Settings(coordinates=cj.AbsoluteCoordinates(), stabilisation=kept).stabilisation
    Unstabilised()
    """

    def target(self, value: Scalar, rate: Scalar) -> Scalar:
        """Zero: constraints are differentiated twice, and left to themselves."""
        del value, rate
        return 0.0


class Baumgarte(AbstractStabilisation):
    """Feedback -2 alpha rate - beta^2 value (eq. 32; J. Baumgarte 1972).

    The paper prints the first term without its dot. `alpha` and `beta` in 1/s; 5 is usual.

    >>> feedback = cj.Baumgarte(alpha=5.0, beta=5.0).target(value=1e-3, rate=0.0)
    >>> print(f"{feedback:.3f}")  # -beta^2 value
    -0.025
    """

    alpha: Single = quantity("1/s", default=5.0, positive=True, zero=True)
    beta: Single = quantity("1/s", default=5.0, positive=True, zero=True)

    def target(self, value: Scalar, rate: Scalar) -> Scalar:
        """-2 alpha rate - beta^2 value."""
        return -2.0 * self.alpha * rate - self.beta**2 * value


class Projection(AbstractStabilisation):
    """Positions and velocities at the end of each step are projected onto the constraints.

    >>> kept = cj.Projection()
    >>> cj.Settings(coordinates=cj.AbsoluteCoordinates(), stabilisation=kept).stabilisation
    Projection()
    """

    def target(self, value: Scalar, rate: Scalar) -> Scalar:
        """Zero: constraints are differentiated twice, and left to themselves."""
        del value, rate
        return 0.0

    def corrected(self, variables: T, project: Callable[[T], T]) -> T:
        """The variables with positions and velocities projected onto the constraints."""
        return project(variables)

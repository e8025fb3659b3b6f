"""Two classical methods for fixed steps, as solvers of diffrax."""

from typing import Any, ClassVar

import diffrax
import equinox as eqx
import jax
import numpy as np

import clearjoint as cj
from clearjoint.extend import JointState


class RungeKutta4(diffrax.AbstractERK):
    """Kutta's method of order four (1901).

    Its error estimate is the difference to Euler's method, which is far too large for adaptive
    steps: use `controller=diffrax.ConstantStepSize()`.
    """

    tableau: ClassVar[diffrax.ButcherTableau] = diffrax.ButcherTableau(
        a_lower=(np.array([0.5]), np.array([0.0, 0.5]), np.array([0.0, 0.0, 1.0])),
        b_sol=np.array([1 / 6, 1 / 3, 1 / 3, 1 / 6]),
        b_error=np.array([1 / 6 - 1.0, 1 / 3, 1 / 3, 1 / 6]),
        c=np.array([0.5, 0.5, 1.0]),
    )
    interpolation_cls: ClassVar[Any] = diffrax.ThirdOrderHermitePolynomialInterpolation.from_k

    def order(self, terms: Any) -> int:
        """Return four."""
        del terms
        return 4


class SemiImplicitEuler(diffrax.AbstractSolver):
    """Semi-implicit Euler method: speeds first, then positions at the new speeds.

    It has order one and is symplectic for a constant mass matrix. diffrax's own method needs
    separate positions and speeds. The rates are evaluated twice; the second time only those of the
    positions are used, so that the compiler removes the forces.
    """

    term_structure = diffrax.ODETerm
    interpolation_cls: ClassVar[Any] = diffrax.LocalLinearInterpolation

    def order(self, terms: Any) -> int:
        """Return one."""
        del terms
        return 1

    def init(self, terms: Any, t0: Any, t1: Any, y0: Any, args: Any) -> None:
        """Return no state."""

    def func(self, terms: Any, t0: Any, y0: Any, args: Any) -> Any:
        """Return the rates."""
        return terms.vf(t0, y0, args)

    def step(
        self, terms: Any, t0: Any, t1: Any, y0: Any, args: Any, solver_state: Any, made_jump: Any
    ) -> tuple[Any, Any, dict[str, Any], None, diffrax.RESULTS]:
        """Make a step with a zero error estimate."""
        del solver_state, made_jump
        h = t1 - t0

        def advanced(y: Any, rates: Any) -> Any:
            return jax.tree.map(lambda value, rate: value + h * rate, y, rates)

        faster = eqx.tree_at(_speeds, y0, _speeds(advanced(y0, terms.vf(t0, y0, args))))
        moved = advanced(y0, terms.vf(t1, faster, args))
        y1 = eqx.tree_at(_speeds, moved, _speeds(faster))
        error = jax.tree.map(lambda value: 0.0 * value, y1)
        return y1, error, {"y0": y0, "y1": y1}, None, diffrax.RESULTS.successful


def _speeds(y: Any) -> list[Any]:
    """Return the speeds among the variables, in absolute and in joint coordinates."""

    def is_state(node: Any) -> bool:
        return isinstance(node, cj.BodyState | JointState)

    found: list[Any] = []
    for state in filter(is_state, jax.tree.leaves(y.motion, is_leaf=is_state)):
        found += [state.velocity, state.spin] if isinstance(state, cj.BodyState) else [state.speeds]
    return found

"""Choices for the equations of motion that are not part of the scene: coordinates, stabilisation,
solver."""

import equinox as eqx

from ..math.linear_solvers import AbstractSolver, Exact, LeastNorm
from .coordinates import AbstractCoordinates
from .joint_coordinates.coordinates import JointCoordinates
from .stabilisation import AbstractStabilisation, Baumgarte


class Formulation(eqx.Module):
    """Coordinates, stabilisation and linear solver for the equations of motion.

    - `coordinates`: the integrated variables; `JointCoordinates` by default.
    - `stabilisation`: how constraints are kept satisfied; `Baumgarte` feedback by default.
    - `redundant`: whether some constraints depend on others; see `clearjoint.constraint_report`. If
      so, reactions are not unique, and the multipliers of least norm are computed, where each is
      divided by the square root of the mass, or moment of inertia, that it would accelerate if all
      bodies were free.
    - `ledger`: whether the powers of damping, friction, films, drives and stabilisation are
      integrated with the state, as an energy ledger in J.

    >>> formulation = extend.Formulation(cj.AbsoluteCoordinates(), cj.Baumgarte(), ledger=True)
    >>> formulation.coordinates
    AbsoluteCoordinates()
    """

    coordinates: AbstractCoordinates = eqx.field(default_factory=JointCoordinates)
    stabilisation: AbstractStabilisation = eqx.field(default_factory=Baumgarte)
    redundant: bool = eqx.field(default=False, static=True)
    ledger: bool = eqx.field(default=False, static=True)

    def solver(self) -> AbstractSolver:
        """Return the linear solver for the constraint multipliers."""
        return LeastNorm() if self.redundant else Exact()

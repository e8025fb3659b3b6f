"""Formulation of the equations of motion: the choices that do not belong to the scene."""

import equinox as eqx

from ..math.linear_solvers import AbstractSolver, Exact, LeastNorm
from .coordinates import AbstractCoordinates
from .joint_coordinates.coordinates import JointCoordinates
from .stabilisation import AbstractStabilisation, Baumgarte


class Formulation(eqx.Module):
    """Coordinates, stabilisation and solver for the equations of motion.

    - `redundant`: whether constraints depend on each other, so that multipliers of least norm are
      computed; see `clearjoint.constraint_report`.
    - `ledger`: whether the dissipated energies are integrated with the state.

    >>> formulation = extend.Formulation(cj.AbsoluteCoordinates(), cj.Baumgarte(), ledger=True)
    >>> formulation.coordinates
    AbsoluteCoordinates()
    """

    coordinates: AbstractCoordinates = eqx.field(default_factory=JointCoordinates)
    stabilisation: AbstractStabilisation = eqx.field(default_factory=Baumgarte)
    redundant: bool = eqx.field(default=False, static=True)
    ledger: bool = eqx.field(default=False, static=True)

    def solver(self) -> AbstractSolver:
        """Return the linear solver for the multipliers."""
        return LeastNorm() if self.redundant else Exact()

"""How the equations of motion are set up: the choices that are not the scene's."""

import equinox as eqx

from ..math.linear_solvers import AbstractSolver, Exact, LeastNorm
from .coordinates import AbstractCoordinates
from .joint_coordinates.coordinates import JointCoordinates
from .stabilisation import AbstractStabilisation, Baumgarte


class Formulation(eqx.Module):
    """How the equations of motion are set up; the choices that are not the scene's.

    - `redundant`: whether constraints depend on each other, so that multipliers of least norm are
      sought. `clearjoint.dynamics.constraint_report` finds out.
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
        """The solver for the multipliers."""
        return LeastNorm() if self.redundant else Exact()

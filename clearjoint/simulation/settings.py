"""How runs with derivatives are integrated: one value for all functions that make such runs."""

from dataclasses import dataclass

import diffrax

from ..dynamics.coordinates import AbstractCoordinates
from ..dynamics.joint_coordinates.coordinates import JointCoordinates
from ..dynamics.stabilisation import AbstractStabilisation
from ..fields.checks import require, require_count
from ..model.bodies import State
from ..model.scene import Scene
from .decisions import require_declared
from .dense_output import require_dense
from .method import Scheme, make_formulation, make_scheme
from .run_checks import check_precision, check_structure, check_values

LANDING_TOLERANCE = 1e-13
"""m. An onset found this closely leaves no error in the derivative of the entry speed."""


@dataclass(frozen=True)
class Integration:
    """Settings of runs with derivatives; as those of `simulate`, but tighter.

    **Arguments:**

    - `rtol`, `atol`: tolerances of the error of a step of the state; a hundred-thousandth of `rtol`
      for the latter unless given. Derivatives are held to ten times these.
    - `solver`: an explicit Runge-Kutta method of diffrax; `diffrax.Tsit5()` unless given.
    - `coordinates`, `stabilisation`: see `simulate`.
    - `landing_tolerance`: m, penetration within which steps land on the begin and end of contacts.
      Derivatives of entry speeds need the default, 1e-13.
    - `max_steps`: largest number of steps tried.
    """

    rtol: float = 1e-9
    atol: float | None = None
    solver: diffrax.AbstractERK | None = None
    coordinates: AbstractCoordinates | None = None
    stabilisation: AbstractStabilisation | None = None
    landing_tolerance: float = LANDING_TOLERANCE
    max_steps: int = 1_000_000

    def scheme(self, scene: Scene, state: State, start_time: float = 0.0) -> Scheme:
        """How the scene's motion is computed.

        **Raises:** `ValueError` for a scene, state or setting that no run can use, and for an
        element that changes with time at instants it doesn't declare as `breakpoints`.
        """
        check_precision(False)
        require_count("max_steps", self.max_steps, "give a number of steps")
        check_values(scene, state, self.rtol, self.atol, None, self.landing_tolerance)
        require(
            self.landing_tolerance is not None,
            "landing_tolerance",
            None,
            "a penetration in m",
            "derivatives hold only where steps land on the begin and end of contacts",
        )
        require_declared(scene)
        coordinates = JointCoordinates() if self.coordinates is None else self.coordinates
        redundant = check_structure(scene, state, start_time, coordinates)
        formulation = make_formulation(coordinates, self.stabilisation, bool(redundant))
        scheme = make_scheme(
            self.solver, None, formulation, self.landing_tolerance, self.rtol, self.atol
        )
        require_dense(scheme.method.solver)
        return scheme

"""Number of right-hand sides in an attempted step, by the tableau or by counting."""

from collections import Counter
from typing import Any

import diffrax
import jax

import clearjoint as cj
from clearjoint.extend import Gap
from studies.speed_accuracy.steppers import SemiImplicitEuler

LANDING = 1e-12
"""Landing tolerance, m; the default of `simulate`."""
VARIABLES = 15
"""Number of variables of the double pendulum in joint coordinates: 13 of the free arm, angle and
rate of the hinge. A Jacobian by forward differentiation costs about as many right-hand sides.
"""

_calls: Counter[str] = Counter()


class CountingLaw(cj.extend.AbstractContactLaw):
    """Lankarani and Nikravesh's law with a count of its evaluations."""

    law: cj.laws.LankaraniNikravesh
    uses_entry_speed = True
    force_jumps = False

    def force(self, gap: Gap, entry_speed: Any) -> Any:
        """Return the normal force, N."""
        jax.debug.callback(lambda: _calls.update(["force"]))
        return self.law.force(gap, entry_speed)

    def elastic_force(self, gap: Gap) -> Any:
        """Return the elastic part of the force, N."""
        return self.law.elastic_force(gap)

    def stored_energy(self, gap: Gap) -> Any:
        """Return the elastic energy, J."""
        return self.law.stored_energy(gap)


def an_attempt(settings: cj.Settings) -> float | None:
    """Return the right-hand sides of an attempt, or ``None`` for implicit methods.

    A method whose first stage is the last one of the step before saves an evaluation. This requires
    that the entry speeds have not changed in between, which only landing ensures.
    """
    solver = settings.solver
    if isinstance(solver, SemiImplicitEuler):
        return 1.0
    if not isinstance(solver, diffrax.AbstractERK):
        return None
    tableau = solver.tableau
    assert isinstance(tableau, diffrax.ButcherTableau)
    anew = settings.landing_tolerance is None
    return float(tableau.num_stages - tableau.fsal + anew)


def counted(end_time: float, settings: cj.Settings) -> float:
    """Count the right-hand sides of an attempt over a run of the double pendulum.

    Implicit methods begin each step with a Jacobian, which counts once for each variable.
    """
    law = CountingLaw(
        law=cj.laws.LankaraniNikravesh(restitution=0.9, stiffness=cj.mechanisms.STEEL)
    )
    scene, state = cj.mechanisms.double_pendulum(law=law)
    _calls.clear()
    solution = cj.simulate(scene, state, end_time, settings, throw=False, progress=False)
    jax.effects_barrier()
    jacobians = VARIABLES if isinstance(settings.solver, diffrax.AbstractImplicitSolver) else 0
    return 0.5 * _calls["force"] / int(solution.attempts) + jacobians

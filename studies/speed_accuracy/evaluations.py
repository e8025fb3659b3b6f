"""Right-hand sides that an attempted step takes, of explicit methods by the tableau, of implicit
ones by counting."""

from collections import Counter
from typing import Any

import diffrax
import jax

import clearjoint as cj
from clearjoint.extend import Gap
from studies.speed_accuracy.steppers import SemiImplicitEuler

LANDING = 1e-12
"""m; the default of `simulate`."""
VARIABLES = 15
"""Of the double pendulum in joint coordinates: 13 of the free arm, angle and rate of the hinge. A
Jacobian by forward differentiation costs about as many right-hand sides."""

_calls: Counter[str] = Counter()


class CountingLaw(cj.extend.AbstractContactLaw):
    """A law that counts how often it is asked for a force, and says the same as `law`."""

    law: cj.laws.LankaraniNikravesh
    uses_entry_speed = True
    force_jumps = False

    def force(self, gap: Gap, entry_speed: Any) -> Any:
        """Normal force, N."""
        jax.debug.callback(lambda: _calls.update(["force"]))
        return self.law.force(gap, entry_speed)

    def elastic_force(self, gap: Gap) -> Any:
        """The part of the force that comes from stored energy, N."""
        return self.law.elastic_force(gap)

    def stored_energy(self, gap: Gap) -> Any:
        """Elastic energy, J."""
        return self.law.stored_energy(gap)


def an_attempt(settings: cj.Settings) -> float | None:
    """Right-hand sides an attempt of `simulate` with these settings on a law with memory;
    ``None`` for implicit methods, which `counted` tells.

    The first stage is the last of the step before where the method allows it, and the memory is
    sure not to have changed, which only landing makes it.
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
    """Right-hand sides an attempt, counted over a run of the double pendulum; implicit methods
    begin each step with a Jacobian, which counts once for each variable."""
    law = CountingLaw(
        law=cj.laws.LankaraniNikravesh(restitution=0.9, stiffness=cj.mechanisms.STEEL)
    )
    scene, state = cj.mechanisms.double_pendulum(law=law)
    _calls.clear()
    solution = cj.simulate(scene, state, end_time, settings, throw=False, progress=False)
    jax.effects_barrier()
    jacobians = VARIABLES if isinstance(settings.solver, diffrax.AbstractImplicitSolver) else 0
    return 0.5 * _calls["force"] / int(solution.attempts) + jacobians

"""The equations of motion (eqs 27-32) of a scene, in scalar form.

Everything that a scene lacks is absent from the compiled program: no constraint, no multiplier; no
friction, no slip; no ledger, no power. That is decided here, in Python, while tracing.
"""

from typing import Any

from ..math.vectors import Scalar
from ..model.scene import Scene
from .contact_forces import Closed, Memory
from .energy import ledger_powers
from .equations_of_motion import evaluate
from .formulation import Formulation


def state_rates(
    scene: Scene,
    formulation: Formulation,
    variables: Any,
    memory: Memory,
    t: Scalar,
    closed: Closed | None = None,
) -> tuple[Any, dict[str, Scalar]]:
    """Time derivatives of the variables and of the ledger's integrals; see `evaluate`."""
    dynamics = evaluate(scene, formulation, variables, memory, t, closed)
    powers = ledger_powers(scene, dynamics, t) if formulation.ledger else {}
    return dynamics.variable_rates, powers

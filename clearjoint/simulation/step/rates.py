"""The rates of all that the solver integrates."""

from ...dynamics.bristles import bristle_rates
from ...dynamics.contact_forces import Closed, EntrySpeeds
from ...dynamics.system import System
from ...math.vectors import Scalar
from .step_state import Variables


def rates_of(
    system: System, y: Variables, entry_speeds: EntrySpeeds, t: Scalar, closed: Closed | None = None
) -> Variables:
    """Time derivatives of the variables at t, s; only `closed` contacts push, if they are given."""
    dynamics = system.dynamics(y.motion, entry_speeds, t, closed, y.bristles)
    powers = system.powers(dynamics, t)
    return Variables(dynamics.variable_rates, powers, bristle_rates(dynamics))

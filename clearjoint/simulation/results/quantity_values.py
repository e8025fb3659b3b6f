"""Values and rates of a quantity along a solution."""

import jax
import jax.numpy as jnp
import numpy as np

from ...dynamics.absolute_coordinates import AbsoluteCoordinates
from ...dynamics.bristles import initial_bristles
from ...dynamics.formulation import Formulation
from ...dynamics.system import System
from ...fields.conversion import with_arrays
from ...math.vectors import ConstantFolded, Scalar, fold_constants, unpack
from ...model.bodies import State
from ...model.scene import Scene
from ...native import Native, over_rows
from ...quantities.base import Quantity, check_quantity
from ...quantities.instant import Instant
from ..step.types import Numbers
from .observe import in_chunks
from .solution import Solution, Trajectory


def values_along(
    scene: Scene, solution: Solution, quantity: Quantity, trajectory: Trajectory
) -> np.ndarray:
    """Return a quantity at the states of a trajectory, (N,), in its unit.

    **Arguments:** as of `observe`; `quantity`: a scalar function of an `Instant`.

    **Raises:** `ValueError` for a quantity of something that the scene lacks.
    """
    folded_scene, absolute, rows = _prepared(scene, solution, quantity, trajectory)
    return in_chunks(lambda part: values_compiled(folded_scene, absolute, quantity, *part), rows)


def rates_along(
    scene: Scene, solution: Solution, quantity: Quantity, trajectory: Trajectory
) -> np.ndarray:
    """Return the rate of a quantity at the states of a trajectory, (N,), in its unit per s.

    The quantity is differentiated with respect to positions, velocities and time along the motion;
    entry speeds and bristles are constant.

    **Arguments**, **Raises:** as of `values_along`.
    """
    folded_scene, absolute, rows = _prepared(scene, solution, quantity, trajectory)
    return in_chunks(lambda part: rates_compiled(folded_scene, absolute, quantity, *part), rows)


def _prepared(
    scene: Scene, solution: Solution, quantity: Quantity, trajectory: Trajectory
) -> tuple[ConstantFolded, Formulation, tuple[np.ndarray, State]]:
    check_quantity("quantity", quantity, scene)
    ran = solution.formulation
    absolute = Formulation(AbsoluteCoordinates(), ran.stabilisation, ran.redundant)
    rows = np.asarray(trajectory.times), trajectory.states
    return fold_constants(with_arrays(scene)), absolute, rows


@Native
def values_compiled(
    folded_scene: ConstantFolded,
    absolute: Formulation,
    quantity: Quantity,
    times: Numbers,
    states: State,
) -> Numbers:
    """Return a quantity at times (N,) s and states with N in front."""
    system = System(unpack(folded_scene), absolute)

    def at(t: Scalar, state: State) -> Numbers:
        return _KnownState(system, state).value(quantity, t, system.encode(unpack(state.bodies)))

    return over_rows(at, times, states)


@Native
def rates_compiled(
    folded_scene: ConstantFolded,
    absolute: Formulation,
    quantity: Quantity,
    times: Numbers,
    states: State,
) -> Numbers:
    """Return the rate of a quantity at times (N,) s and states with N in front."""
    system = System(unpack(folded_scene), absolute)

    def at(t: Scalar, state: State) -> Numbers:
        known = _KnownState(system, state)
        variables = system.encode(unpack(state.bodies))
        rates, _ = system.rates(variables, state.entry_speeds, t, bristles=known.bristles)
        t, variables, rates = jax.tree.map(
            lambda number: jnp.asarray(number, dtype=float), (t, variables, rates)
        )
        along = jnp.ones(()), rates
        return jax.jvp(lambda *x: known.value(quantity, *x), (t, variables), along)[1]

    return over_rows(at, times, states)


class _KnownState:
    """The parts of a state that the variables of the motion do not have."""

    def __init__(self, system: System, state: State):
        self._system, self._entry_speeds, self._work = (
            system,
            state.entry_speeds,
            unpack(state.work),
        )
        self.bristles = initial_bristles(system.scene, unpack(state.bristles))

    def value(self, quantity: Quantity, t: Scalar, variables: jax.Array) -> Numbers:
        """Return the quantity at a time in s and the variables of a motion."""
        now = Instant(self._system, t, variables, self._entry_speeds, self._work, self.bristles)
        return jnp.asarray(quantity(now), dtype=float)

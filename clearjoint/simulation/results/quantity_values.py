"""Values and time derivatives of a quantity at the states of a trajectory."""

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
    """Return the values of a quantity at the N states of a trajectory, (N,), in its unit.

    **Arguments:** `scene`, `solution`: the scene that was simulated, and its solution; `quantity`:
    a scalar function of an `Instant`; `trajectory`: N times and states of the solution.

    **Raises:** `ValueError` if the quantity names an element that the scene lacks.
    """
    folded_scene, absolute, rows = _prepared(scene, solution, quantity, trajectory)
    return in_chunks(lambda part: values_compiled(folded_scene, absolute, quantity, *part), rows)


def rates_along(
    scene: Scene, solution: Solution, quantity: Quantity, trajectory: Trajectory
) -> np.ndarray:
    """Return the time derivatives of a quantity at N states, (N,), in its unit per s.

    They are total derivatives along the motion: by the chain rule through time, positions and
    velocities. Entry speeds and bristles count as constant.

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
    """Return the values of a quantity, (N,), at times, (N,) s, and N states in packed form."""
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
    """Return the time derivatives of a quantity, (N,), at times, (N,) s, and N states.

    The derivatives are those of `rates_along`. Vectors and Euler parameters of the states are
    arrays, (N, 3) and (N, 4).
    """
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
    """Entry speeds, work and bristles of a state; the variables of a motion lack them."""

    def __init__(self, system: System, state: State):
        self._system, self._entry_speeds, self._work = (
            system,
            state.entry_speeds,
            unpack(state.work),
        )
        self.bristles = initial_bristles(system.scene, unpack(state.bristles))

    def value(self, quantity: Quantity, t: Scalar, variables: jax.Array) -> Numbers:
        """Return the value of a quantity for a time t, s, and the variables of a motion at t."""
        now = Instant(self._system, t, variables, self._entry_speeds, self._work, self.bristles)
        return jnp.asarray(quantity(now), dtype=float)

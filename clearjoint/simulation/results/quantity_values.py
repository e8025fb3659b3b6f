"""Values and time derivatives of a quantity at the states of a trajectory.

A quantity is a scalar function of an `Instant`, a scene and its motion at one time. Examples are a
coordinate of a body and the force of a contact.
"""

import jax
import jax.numpy as jnp
import numpy as np

from ...dynamics.bristles import initial_bristles
from ...dynamics.coordinates import MotionVariables
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
from .observe import absolute_formulation, in_chunks
from .solution import Solution, Trajectory


def values_along(
    scene: Scene, solution: Solution, quantity: Quantity, trajectory: Trajectory
) -> np.ndarray:
    """Return the values of a quantity at the N states of a trajectory, (N,), in its unit.

    **Arguments:** `scene`: the scene that was simulated; `solution`: its solution, of which only
    the formulation is used; `quantity`: a scalar function of an `Instant`; `trajectory`: N times
    and states, such as `solution.saved` or `solution.steps`.

    **Raises:** `ValueError` if the quantity names an element that the scene lacks.
    """
    return _along(scene, solution, quantity, trajectory, rates=False)


def rates_along(
    scene: Scene, solution: Solution, quantity: Quantity, trajectory: Trajectory
) -> np.ndarray:
    """Return the time derivatives of a quantity at the N states of a trajectory, (N,), in its unit
    per s.

    They are total derivatives along the motion, by the chain rule through time, positions and
    velocities. Entry speeds of contacts and deflections of bristles count as constant.

    **Arguments**, **Raises:** as of `values_along`.
    """
    return _along(scene, solution, quantity, trajectory, rates=True)


def _along(
    scene: Scene, solution: Solution, quantity: Quantity, trajectory: Trajectory, rates: bool
) -> np.ndarray:
    """Return the values of a quantity at the N states of a trajectory, (N,), or with `rates` their
    time derivatives; the other arguments are those of `values_along`."""
    check_quantity("quantity", quantity, scene)
    fixed = fold_constants(with_arrays(scene)), absolute_formulation(solution), quantity, rates
    rows = np.asarray(trajectory.times), trajectory.states
    return np.asarray(in_chunks(lambda part: along_compiled(*fixed, *part), rows))


@Native
def along_compiled(
    folded_scene: ConstantFolded,
    absolute: Formulation,
    quantity: Quantity,
    rates: bool,
    times: Numbers,
    states: State,
) -> Numbers:
    """Return the values of a quantity, or with `rates` their time derivatives, (N,), at times,
    (N,) s, and N states.

    The states have vectors as arrays (N, 3); `absolute` is a formulation in absolute coordinates,
    and `folded_scene` the scene, whose exact zeros and ones are compiled as constants.
    """
    system = System(unpack(folded_scene), absolute)

    def at(t: Scalar, state: State) -> Numbers:
        variables = system.encode(unpack(state.bodies))
        bristles = initial_bristles(system.scene, unpack(state.bristles))

        def value(t: Scalar, variables: MotionVariables) -> Numbers:
            now = Instant(system, t, variables, state.entry_speeds, unpack(state.work), bristles)
            return jnp.asarray(quantity(now), dtype=float)

        if not rates:
            return value(t, variables)
        speeds, _ = system.rates(variables, state.entry_speeds, t, bristles=bristles)
        # The direction of the derivative is that of the motion: time advances at the rate 1, and
        # the variables at their rates. `jax.jvp` demands floats, but components may be Python
        # numbers.
        point, along = jax.tree.map(
            lambda number: jnp.asarray(number, dtype=float), ((t, variables), (1.0, speeds))
        )
        return jax.jvp(value, point, along)[1]

    return over_rows(at, times, states)

"""How a run ended."""

import equinox as eqx
import numpy as np


class RESULTS(eqx.Enumeration):
    """Result codes; `RESULTS[code]` is the message.

    >>> cj.RESULTS[cj.RESULTS.successful]
    'The run reached its end time.'
    """

    successful = "The run reached its end time."
    max_steps_reached = (
        "The step limit was reached before the end time. Raise `max_steps`, loosen the tolerances, "
        "or continue from the state reached."
    )
    step_too_small = (
        "The step size fell to the resolution of the time. The motion may be singular there, the "
        "tolerances tighter than double precision allows, or the time so late that short steps are "
        "lost in it: then continue from the state reached with a `start_time` of zero. With "
        "derivatives it may be a force with a kink within a contact, as where the damping of "
        "`KelvinVoigt` or `ElastoGap` is clamped: loosen `rtol`, or take a law without."
    )
    non_finite = (
        "A fixed step met a non-finite state. Use a smaller step or an adaptive controller."
    )
    solver_failed = (
        "The solver or controller gave up on a step, for example because an implicit solve did "
        "not converge."
    )
    bad_parameters = (
        "A parameter has a value that no scene can have or no run can use; the sweep's warning "
        "says which."
    )
    not_assembled = (
        "The initial state does not satisfy the ideal joints at these parameters. Assemble it."
    )
    step_too_long = (
        "A fixed step went deeper into a rigid bearing than its clearance, so that the side of the "
        "contact is unknown. Use a shorter step."
    )
    left_bearing = (
        "A journal penetrates its bearing's wall by more than its radius, where no contact law "
        "holds. Check the stiffness, the journal's length and tilt, the units, and fixed steps."
    )
    not_followed = (
        "A driver or an ideal joint is not followed. Either a driver's value has a step, which "
        "nothing can follow, or a kink that its `breakpoints` don't declare, at the time reached: "
        "take `PiecewiseLinear`, or declare the times of kinks. Or a joint or driver is off by "
        "more than 1e-3 m or rad, or by a journal's clearance: tighten `rtol`, or take "
        "`JointCoordinates()` or `Projection()`."
    )
    force_jumped = (
        "A force of a class of one's own jumped where the motion decides, and the derivatives from "
        "there on would lack the jump's term. Let it change over a width, make it a contact law "
        "that jumps at its onset only, or take differences of runs."
    )
    domain = (
        "A number of the scene, of the state, of the times or of the settings is NaN, infinite or "
        "outside its range, in a run that JAX traces; no step was taken. The same run outside of "
        "jax.jit, jax.vmap and jax.grad raises a ValueError that names the number."
    )


def result_number(result: RESULTS) -> np.ndarray:
    """The number of a result code, or of several.

    >>> int(extend.result_number(cj.RESULTS.successful))
    0
    """
    return np.asarray(result._value)


def result_numbers() -> dict[str, int]:
    """The number of each result code by name.

    >>> extend.result_numbers()["max_steps_reached"]
    1
    """
    return {name: int(result_number(item)) for name, item in RESULTS._name_to_item.items()}

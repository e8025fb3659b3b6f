"""Result codes: how a run ended."""

import equinox as eqx
import numpy as np


class RESULTS(eqx.Enumeration):
    """How a run ended. Each code, such as `RESULTS.successful`, has a message, `RESULTS[code]`.

    >>> cj.RESULTS[cj.RESULTS.successful]
    'The run reached its end time.'
    """

    successful = "The run reached its end time."
    max_steps_reached = (
        "The step limit was reached before the end time. Raise `max_steps`, loosen the tolerances "
        "(in runs with derivatives, raise `derivative_tolerance`), or continue from the state "
        "reached. If far more steps were tried than accepted, a force or driver may jump or have a "
        "kink near this time: give its class `breakpoints`. The output `RejectedSteps` tells why "
        "steps were rejected."
    )
    step_too_small = (
        "The step size fell to the resolution of the time. The motion may be singular there, or "
        "the tolerances tighter than double precision allows. If the time is large, short steps "
        "are lost in rounding: continue from the state reached with a `start_time` of zero. Far "
        "from the origin, penetrations have few digits: place the origin near the contacts. In "
        "runs with derivatives, raise `derivative_tolerance`, for example to 1e3. A looser `rtol` "
        "would make the derivatives wrong."
    )
    non_finite = (
        "A fixed step met a non-finite state. Use a smaller step or an adaptive controller."
    )
    solver_failed = (
        "The solver or controller gave up on a step, for example because an implicit solve did "
        "not converge."
    )
    bad_parameters = (
        "A parameter has a value that a scene or a run cannot have; the sweep's warning says which."
    )
    not_assembled = (
        "The initial state does not satisfy the ideal joints at these parameters. Assemble it."
    )
    step_too_long = (
        "A fixed step went deeper into a rigid contact than the clearance of its bearing, or than "
        "its joint allows, so that the side of the contact is unknown. Use a shorter step."
    )
    left_bearing = (
        "A journal penetrates its bearing's wall by more than its radius, where no contact law "
        "holds. Check the stiffness, the journal's length and tilt, the units, and fixed steps."
    )
    not_followed = (
        "The motion does not follow a driver or an ideal joint. Either a driver's value has a step "
        "at the time reached, which no motion can follow, or a kink that its `breakpoints` do not "
        "declare: take `PiecewiseLinear`, or declare the times of kinks. Or the error of a joint "
        "or driver exceeds 1e-3 m or rad, or a journal's clearance: tighten `rtol`, shorten fixed "
        "steps, or take `JointCoordinates()` or `Projection()`."
    )
    force_jumped = (
        "A force of a user-defined class, the torque of a torsional spring, bushing or motor at "
        "half a revolution, or a spring between points that pass each other jumped at a time that "
        "depends on the motion, and the derivatives would lack the term of the jump from there on. "
        "Let the force change over a width, make it a contact law that jumps only at its onset, or "
        "take differences of runs."
    )
    domain = (
        "A number of the scene, of the state, of the times or of the settings is NaN, infinite or "
        "outside its range, in a run that JAX traces; no step was taken. The same run outside of "
        "jax.jit, jax.vmap and jax.grad raises a ValueError that names the number."
    )
    contact_unsolved = (
        "The impulses of the rigid contacts in a fixed step were not found: friction may be so "
        "strong that no impulses satisfy it (Painleve's paradox). Use a shorter step, lower the "
        "coefficient of friction, or take simulate(), whose contacts are elastic."
    )


def result_number(result: RESULTS) -> np.ndarray:
    """Return the whole number of a result code, (), or of N codes, (N,), for files and NumPy masks.

    >>> int(extend.result_number(cj.RESULTS.successful))
    0
    """
    return np.asarray(result._value)


def result_numbers() -> dict[str, int]:
    """Return the whole number of each result code, by the code's name.

    >>> extend.result_numbers()["max_steps_reached"]
    1
    """
    return {name: int(result_number(item)) for name, item in RESULTS._name_to_item.items()}

"""Limit of the rotations in a step, in scenes whose steps are searched for events.

A joint angle that grows evenly is integrated without error, so that the controller lengthens the
steps to many revolutions. But contacts, sections, peaks and other statistics are searched for in
each step as if the motion were smooth there. In such scenes, a step therefore ends after a part of
a revolution: it is shortened by the rotation rate at its start, and repeated if the rates later in
the step were much higher. Rotations that change nothing that is searched for are not limited.
"""

from collections.abc import Callable
from functools import reduce

import jax
from jax.interpreters import partial_eval
from jaxtyping import PyTree

from ..._dynamics.coordinates import MotionVariables
from ..._dynamics.system import System
from ..._math.vectors import Scalar, larger
from .solvers import UnrolledExplicit
from .step_state import Method
from .trial_step import Trial

LARGEST = 0.75
"""Largest rotation of a body relative to the body that carries it, rad, in an accepted step."""
TARGET = 0.5
"""The rotation, rad, to which steps are shortened. It is smaller than `LARGEST`, so that steps of a
rotation that accelerates are rarely repeated.

Contacts would allow longer steps: in 200 random mechanisms, steps of 2.1 rad found the same impacts
as very short steps. Statistics need short steps, since they approximate a quantity by a parabola in
each step: the root mean square of a coordinate of a rotor is wrong by 7e-5 of its value with 0.5
rad, and by 2.5e-4 with 0.7 rad.
"""


def rotating_bodies(
    system: System, motion: MotionVariables, searched: Callable[[MotionVariables], PyTree[Scalar]]
) -> frozenset[str]:
    """Return the names of the bodies whose rotations a step must limit: those that move the bodies
    of a contact joint relative to each other, and those on which the results of `searched` depend.
    `searched` computes the numbers that outputs, such as sections and peaks, evaluate at only a few
    instants of each step; `motion` is an example of its argument."""
    scene, coordinates = system.scene, system.formulation.coordinates
    # Only the names are needed here: the rates are traced and not computed.
    rates = jax.eval_shape(lambda: coordinates.rotation_rates(scene, motion))
    if not rates:
        return frozenset()
    # The bodies whose rotations move the two bodies of each contact joint against each other.
    joints = scene.contact_joints().values()
    carriers = (coordinates.carriers(scene, joint.body_names()) for joint in joints)
    # The variables without which the numbers of `searched` cannot be computed.
    program = jax.make_jaxpr(searched)(motion).jaxpr
    _, used = partial_eval.dce_jaxpr(program, [True] * len(program.outvars), instantiate=False)
    variables = jax.tree.unflatten(jax.tree.structure(motion), used)
    needed = (body for body in rates if any(jax.tree.leaves(variables[body].position)))
    return frozenset(rates) & frozenset().union(needed, *carriers)


def fastest_rotation(method: Method, system: System, motion: MotionVariables) -> Scalar:
    rates = system.formulation.coordinates.rotation_rates(system.scene, motion)
    # Step sizes are not differentiated: the solution does not depend on them. Names are sorted,
    # because a set has another order in each process, and the traced program would differ.
    return jax.lax.stop_gradient(reduce(larger, [rates[b] for b in sorted(method.rotating)]))


def rotation_in(trial: Trial) -> Scalar:
    """Return an estimate, rad, of the largest rotation of a body in a trial step: the length of the
    step times the fastest rotation rate.

    Rates are computed at both ends of the step and, with an `UnrolledExplicit` solver, also in the
    middle, since a motion may be at rest at both ends.
    """
    method, start, outcome = trial.method, trial.step, trial.outcome
    motions = [start.y.motion, outcome.y.motion]
    if isinstance(method.solver, UnrolledExplicit):
        dense = method.solver.interpolation_cls(t0=start.t, t1=trial.t1, **outcome.information)
        motions.append(dense.at(0.5).motion)
    rates = [fastest_rotation(method, trial.system, motion) for motion in motions]
    return (trial.t1 - start.t) * reduce(larger, rates)

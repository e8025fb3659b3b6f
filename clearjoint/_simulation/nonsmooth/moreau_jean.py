"""One time step of Moreau's midpoint rule.

See M. Jean, The non-smooth contact dynamics method (1999), with theta = 1/2, and V. Acary, B.
Brogliato, Numerical methods for nonsmooth dynamical systems (2008), ch. 10.

    q_m = q + h/2 H u,    M(q_m) (u+ - u) = h F(q_m, (u + u+)/2) + D(q_m)^T P,
    q+ = q + h H(q_m) (u + u+)/2,

with positions q and speeds u before the step, q+ and u+ after it, q_m in its middle, the length h,
rates of positions H u, mass matrix M, forces F, and impulses P along the directions D of the
contacts. A contact is closed if its gap at q_m is not positive. A predictor gives the velocity in
F, so that smooth motion has second order. Ideal joints are kept by constraints on accelerations, as
in `simulate`. If no force acts, the velocity of a contact after an impact is exactly the
restitution times its approach velocity, for any step length.

The impulse stops the approach of a contact, but not its penetration in the middle of the step,
which is at most the approach in half a step. If, at its velocity after the impact, the contact
would still be penetrated at the end of the next step, the positions are projected out of the wall,
in the metric of the masses (V. Acary, Projected event-capturing time-stepping schemes, 2013).
"""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import PyTree

from ..._dynamics.breakpoints import one_sided_time
from ..._dynamics.coordinates import MotionVariables
from ..._dynamics.system import System
from ..._math.rotations import normalised
from ..._math.vectors import Condition, EulerParameters, Scalar, add, multiply
from .bounded_lcp import Impulses
from .contact_problem import ContactProblem, Touch, touches

SOLVED = 1e-6
"""Largest relative residual with which the contact problem of a step counts as solved. The methods
for this problem aim at much smaller residuals; a larger one means that they did not converge."""


class Rigid(eqx.Module):
    """A system with rigid contacts, and `restitution[joint][contact]`, Newton's coefficients."""

    system: System
    restitution: dict[str, dict[str, Scalar]]


class ContactStep(eqx.Module):
    """One contact in one step.

    - `impulse`: N s, normal impulse, zero or positive.
    - `opening`: m/s, velocity before the step, positive if the contact opens.
    - `dissipated`: J, energy dissipated by the normal impulse and by friction.
    - `penetration`: m, in the middle of the step; zero if the contact is open there.
    """

    impulse: Scalar
    opening: Scalar
    dissipated: Scalar
    penetration: Scalar


class StepEnd(eqx.Module):
    """Result of one step.

    - `contacts[joint][contact]`: the `ContactStep` of each contact.
    - `residual`: largest relative residual of the contact problem and of the projection.
    - `shallow`: whether no contact's penetration in the middle of the step reaches `Touch.deepest`,
      beyond which the side of the wall on which the contact is would be unknown.
    """

    variables: MotionVariables
    contacts: dict[str, dict[str, ContactStep]]
    residual: Scalar
    shallow: Condition


def advance(rigid: Rigid, variables: MotionVariables, t: Scalar, h: Scalar) -> StepEnd:
    """Move the system `rigid` by one step of length h, s, from the time t, s. A driver or load with
    a breakpoint at t has the value that holds after it; no breakpoint may be inside the step."""
    system, middle_time = rigid.system, t + 0.5 * h
    # The time t in a step that starts there: at a breakpoint, just after it.
    t = one_sided_time(system, t, t)
    # Motion without contact forces, from which the gaps in the middle of the step follow. `middle`
    # and `last` both have the positions there: `middle` with the speeds at the start of the step,
    # and `last` with the speeds at its end, at first without impulses.
    middle, last = _smooth_step(rigid, variables, t, middle_time, h)
    mechanics = system.mechanics(last)
    contacts = touches(system.scene, mechanics.motions)
    steps, residual, push = {}, jnp.zeros(()), None
    if contacts:
        # Each closed contact must open at least with its restitution times the approach velocity.
        # An aim is the opening velocity without impulses, less this smallest velocity. (`opening`
        # is the opening velocity before the step, which is negative for an approach.) The lists of
        # velocities begin with one for each contact; those of the slip directions follow, and have
        # no aims.
        problem = ContactProblem(system, mechanics, contacts, middle_time)
        before = problem.velocities(system.mechanics(middle).motions)
        unloaded = problem.velocities(mechanics.motions)
        closed = [touch.gap <= 0.0 for touch in contacts]
        aims = [
            velocity + rigid.restitution[touch.joint][touch.label] * opening
            for touch, velocity, opening in zip(contacts, unloaded, before, strict=False)
        ]
        impulses, residual = problem.impulses(closed, aims, unloaded[len(contacts) :])
        # The impulses change the speeds. A further change, `push`, moves only the positions, out of
        # penetrations. A sink is the velocity towards the wall that all forces but those of the
        # contacts add in the step.
        all_rows = range(len(problem.rows))
        after = problem.velocities_after(unloaded, impulses, rows=all_rows, columns=all_rows)
        steps = _contact_steps(contacts, impulses, before, after)
        last = mechanics.after_speed_change(problem.kick(impulses))
        sinks = [jnp.maximum(a - b, 0.0) for a, b in zip(before, unloaded, strict=True)]
        push, projection_residual = _projection(problem, closed, after, sinks, h)
        residual = jnp.maximum(residual, projection_residual)
    # The positions move with the mean speeds and the push.
    half = jax.tree.map(lambda a, b: add(multiply(a, 0.5), multiply(b, 0.5)), middle, last)
    mean = system.with_speeds(middle, half)
    if push is not None:
        mean = system.mechanics(mean).after_speed_change(push)
    moved = _displaced(system, variables, _smooth_rates(rigid, mean, middle_time), h)
    return StepEnd(system.with_speeds(moved, last), steps, residual, _is_shallow(contacts))


def _smooth_step(
    rigid: Rigid, variables: MotionVariables, t: Scalar, middle_time: Scalar, h: Scalar
) -> tuple[MotionVariables, MotionVariables]:
    """Return the variables without contact forces, with positions in the middle of the step, at
    `middle_time`, s: first with the speeds at the start of the step, then with those at its end."""
    # `predicted` has estimated speeds in the middle of the step. Evaluated at these, forces that
    # depend on speeds are integrated to second order.
    half = 0.5 * h
    middle = _displaced(rigid.system, variables, _smooth_rates(rigid, variables, t), half)
    predicted = _accelerated(rigid.system, middle, _smooth_rates(rigid, middle, middle_time), half)
    rates = _smooth_rates(rigid, predicted, middle_time)
    return middle, _accelerated(rigid.system, middle, rates, h)


def _is_shallow(contacts: list[Touch]) -> Condition:
    """Return whether every penetration is below its `Touch.deepest`, if it has one."""
    shallow = jnp.asarray(True)
    for touch in contacts:
        if touch.deepest is not None:
            shallow = shallow & (touch.gap > -touch.deepest)
    return shallow


def _projection(
    problem: ContactProblem,
    closed: Sequence[Condition],
    after: Sequence[Scalar],
    sinks: Sequence[Scalar],
    h: Scalar,
) -> tuple[list[Scalar], Scalar]:
    """Return a change of the speeds that moves positions out of the wall, and the relative residual
    of its contact problem. The speeds at the end of the step exclude it. Gaps are linearised.
    `after`: opening velocities after the impulses, m/s. `sinks`: velocities towards the wall that
    the forces add, at least zero, m/s. Both begin with one for each contact; others are unused."""
    stays, ends = [], []
    rows = zip(problem.contacts, closed, after, sinks, strict=False)
    for touch, shut, velocity, sink in rows:
        # Gaps are divided by h, so that they are velocities: `left` in the middle of this step,
        # `left + velocity / 2` at its end, and `left + 3 / 2 velocity` at the end of the next one.
        # All are larger than the true gaps by `sink / 2`, so that a contact at rest stays slightly
        # penetrated. If it were pushed to a gap of exactly zero, rounding could open it.
        left = touch.gap / h + 0.5 * sink
        # Only contacts that would be penetrated at the end of the next step too are pushed.
        stays.append(shut & (left + 1.5 * velocity < 0.0))
        ends.append(left + 0.5 * velocity)
    impulses, residual = problem.normal_impulses(stays, ends)
    return problem.kick(impulses), residual


def _contact_steps(
    contacts: list[Touch], impulses: Impulses, before: Sequence[Scalar], after: Sequence[Scalar]
) -> dict[str, dict[str, ContactStep]]:
    # Positions move with the mean velocity, so that its product with the impulse is the work. With
    # the opposite sign, it is the energy dissipated.
    rows = zip(impulses, before, after, strict=True)
    losses = [-0.5 * impulse * (a + b) for impulse, a, b in rows]
    steps: dict[str, dict[str, ContactStep]] = {}
    # The normal rows of all contacts come first, then the rows of slip of each contact.
    slip_begin = len(contacts)
    for k, touch in enumerate(contacts):
        slip_end = slip_begin + len(touch.slip)
        loss = sum(losses[slip_begin:slip_end], losses[k])
        penetration = jnp.maximum(-touch.gap, 0.0)
        step = ContactStep(impulses[k], jnp.asarray(before[k]), loss, penetration)
        steps.setdefault(touch.joint, {})[touch.label] = step
        slip_begin = slip_end
    return steps


def _smooth_rates(rigid: Rigid, variables: MotionVariables, t: Scalar) -> MotionVariables:
    mechanics = rigid.system.mechanics(variables)
    return rigid.system.dynamics_under(mechanics, {}, t).variable_rates


def _displaced(
    system: System, variables: MotionVariables, rates: MotionVariables, time: Scalar
) -> MotionVariables:
    """Return variables with the positions changed by `time`, s, times the `rates`."""
    return system.with_speeds(_plus(variables, rates, time), variables)


def _accelerated(
    system: System, variables: MotionVariables, rates: MotionVariables, time: Scalar
) -> MotionVariables:
    """Return variables with the speeds changed by `time`, s, times the `rates`."""
    return system.with_speeds(variables, _plus(variables, rates, time))


def _plus(start: MotionVariables, rate: MotionVariables, time: Scalar) -> MotionVariables:
    def move(a: PyTree, b: PyTree) -> PyTree:
        # A finite change along the rate does not keep the unit norm of Euler parameters.
        if isinstance(a, EulerParameters):
            return normalised(jax.tree.map(lambda x, y: x + time * y, a, b))
        return add(a, multiply(time, b))

    return jax.tree.map(move, start, rate, is_leaf=lambda a: isinstance(a, EulerParameters))

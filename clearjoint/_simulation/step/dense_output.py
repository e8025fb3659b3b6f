"""States inside an accepted step by dense output, projected onto the constraints where the
stabilisation projects the ends of steps. A `method` is the one with which the step was computed.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TypeAlias

import diffrax
import equinox as eqx
import jax.numpy as jnp

from ..._dynamics.breakpoints import is_reached
from ..._dynamics.contact_events import ContactGaps, entry_speeds_inside
from ..._dynamics.contact_forces import EntrySpeeds
from ..._dynamics.coordinates import MotionVariables
from ..._dynamics.sampled_forces import sampled_forces
from ..._dynamics.system import System
from ..._fields.checks import require
from ..._math.vectors import Condition, Scalar
from ..._model.bodies import State
from ...quantities.base import Instant, Quantity, number_at
from .solvers import DenseOutput, UnrolledExplicit
from .step_state import Attempt, Method, Step, Variables, choose
from .time_map import AbstractTimeMap

Quantities: TypeAlias = Mapping[str, Quantity]


def look_inside(method: Method, system: System, attempt: Attempt, t: Scalar) -> "Snapshot":
    """Return the snapshot at a time t, s, of the accepted step of an `attempt`, corrected by the
    stabilisation. Before the end of the step, contacts have the entry speeds of the step's start
    or, after an onset, of its end. At the end, variables and entry speeds are those in
    `attempt.step`, which contain the corrections for events there."""
    step, end = attempt.step, attempt.step.t
    dense = method.solver.interpolation_cls(t0=attempt.t_start, t1=end, **attempt.information)
    is_end = at_end(system, end, t)
    y = choose(is_end, step.y, dense.evaluate(dense_time(attempt, t)))
    ends = attempt.entry_speeds_start, step.entry_speeds
    inside = entry_speeds_inside(system.scene, step.contact_gaps, end - t, *ends)
    return Snapshot(t, on_constraints(system, y, t), choose(is_end, step.entry_speeds, inside))


def at_end(system: System, end: Scalar, t: Scalar) -> Condition:
    """Return whether a time t, s, is the `end`, s, of the step in which it lies. With sampled
    forces, a time that is earlier by a rounding error also counts as the end, because at an instant
    at which a force samples the motion, the values after the jump of its memory are wanted."""
    return is_reached(system, end, t) if sampled_forces(system.scene) else t >= end


def dense_time(attempt: Attempt, t: Scalar) -> Scalar:
    """Return the time, s, at which diffrax's dense output has the state of the time t, s. They
    differ if the attempt has a `time_map`: diffrax assumes that time is uniform in the step."""
    if attempt.time_map is None:
        return t
    length = attempt.step.t - attempt.t_start
    elapsed = (t - attempt.t_start) / jnp.where(length > 0.0, length, 1.0)
    return attempt.t_start + length * attempt.time_map.fraction(elapsed)


def stabilised(system: System, y: Variables, t: Scalar) -> Variables:
    """Return the variables at the end t, s, of a step, corrected by the stabilisation of the
    constraints. The energy that a projection onto the constraints removes, J, is added to the
    integral "stabilisation" of the energy ledger, if the run has one."""

    # Total energy, kinetic and stored.
    def energy(motion: MotionVariables) -> Scalar:
        return sum(system.energies(motion, t).values())

    # A stabilisation that does not project, such as `Baumgarte`, does not call this function.
    def project(y: Variables) -> Variables:
        motion, work = system.project(y.motion, t), y.work
        if system.formulation.ledger and "stabilisation" in work:
            loss = energy(y.motion) - energy(motion)
            work = {**work, "stabilisation": work["stabilisation"] + loss}
        return replace(y, motion=motion, work=work)

    return system.formulation.stabilisation.corrected(y, project)


def on_constraints(system: System, y: Variables, t: Scalar) -> Variables:
    """Return the variables at a time t, s, inside a step, with the motion corrected by the
    stabilisation. The energy ledger stays, because this correction does not enter later steps."""
    return replace(y, motion=stabilised(system, y, t).motion)


def require_dense(solver: diffrax.AbstractSolver) -> None:
    """Check that a solver is an `UnrolledExplicit`, the only one with which quantities inside
    steps, and derivatives, are computed, or raise a `ValueError`."""
    is_explicit, kind = isinstance(solver, UnrolledExplicit), type(solver).__name__
    expected = (
        "an explicit Runge-Kutta method for sections, for values inside the steps of a sweep "
        "(saved states, peaks, statistics, impacts), and for derivatives"
    )
    remedy = "take one such as diffrax.Tsit5(), or leave these outputs out"
    require(is_explicit, "solver", kind, expected, remedy)


class Snapshot(eqx.Module):
    """The state of a run at the time t, s: variables `y`, and entry speeds of contacts, m/s."""

    t: Scalar
    y: Variables
    entry_speeds: EntrySpeeds

    @staticmethod
    def of(step: Step) -> "Snapshot":
        return Snapshot(step.t, step.y, step.entry_speeds)

    def instant(
        self,
        system: System,
        inside: Callable[[Scalar], Instant] | None = None,
        jumps: Condition | None = None,
    ) -> Instant:
        """Return the snapshot as an `Instant`. `inside`: function that returns the instant after a
        part, 0 to 1, of the step that ends here; ``None`` if no quantity needs it. `jumps`: whether
        quantities may jump at this end of a step; ``None`` in a scene without jumps."""
        y = self.y
        parts = y.motion, self.entry_speeds, y.work, y.bristles, y.memory
        return Instant(system, self.t, *parts, inside, jumps)

    def state(self, system: System) -> State:
        y = self.y
        return State(system.decode(y.motion), self.entry_speeds, y.work, y.bristles, y.memory)

    def values(self, system: System, quantities: Quantities) -> dict[str, Scalar]:
        now = self.instant(system)
        return {name: number_at(now, quantity) for name, quantity in quantities.items()}

    def columns(self, system: System, channels: Quantities) -> dict[str, Scalar]:
        """Return a row of a table of recorded states, by name of the column: the scene's time in s
        as "time", and the value of each quantity in `channels`, in its unit."""
        return {"time": self.instant(system).time, **self.values(system, channels)}


class DenseStep(eqx.Module):
    """The latest accepted step of a run, with the contact `gaps` at its end, the `stages` of its
    `DenseOutput`, and its `time_map`; with ``None``, time is uniform in the step."""

    start: Snapshot
    end: Snapshot
    gaps: ContactGaps
    stages: tuple[Variables, ...]
    time_map: AbstractTimeMap | None

    @staticmethod
    def of(tried: Attempt) -> "DenseStep":
        step, inside = tried.step, tried.information
        return DenseStep(
            Snapshot(tried.t_start, inside["y0"], tried.entry_speeds_start),
            Snapshot.of(step),
            step.contact_gaps,
            inside["stages"],
            tried.time_map,
        )

    def inside(self, method: Method, elapsed: Scalar) -> Variables:
        """Return the variables after a part `elapsed`, 0 to 1, of the step's time, without
        correction by the stabilisation."""
        assert isinstance(method.solver, UnrolledExplicit)
        start, end = self.start, self.end
        dense = DenseOutput(method.solver.method, start.t, end.t, start.y, self.stages)
        return dense.at(elapsed if self.time_map is None else self.time_map.fraction(elapsed))

    def within(self, method: Method, elapsed: Scalar) -> Snapshot:
        """Return the snapshot after a part `elapsed`, 0 to 1, of the step's time, with the entry
        speeds of the step's start and without correction by the stabilisation. Raise a `ValueError`
        if the solver is not an explicit Runge-Kutta method."""
        require_dense(method.solver)
        t = self.start.t + elapsed * (self.end.t - self.start.t)
        return Snapshot(t, self.inside(method, elapsed), self.start.entry_speeds)

    def at(self, method: Method, system: System, t: Scalar) -> Snapshot:
        """Return the stabilised snapshot at a time t, s, of this step, as `look_inside` does."""
        start, end = self.start, self.end
        length = end.t - start.t
        elapsed = (t - start.t) / jnp.where(length > 0.0, length, 1.0)
        is_end = at_end(system, end.t, t)
        y = on_constraints(system, choose(is_end, end.y, self.inside(method, elapsed)), t)
        ends = start.entry_speeds, end.entry_speeds
        speeds = entry_speeds_inside(system.scene, self.gaps, end.t - t, *ends)
        return Snapshot(t, y, choose(is_end, end.entry_speeds, speeds))

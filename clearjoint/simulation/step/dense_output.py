"""What a run is like inside a step, and on the constraints."""

from collections.abc import Callable, Mapping
from dataclasses import replace

import diffrax
import equinox as eqx
import jax.numpy as jnp

from ...dynamics.contact_forces import EntrySpeeds
from ...dynamics.coordinates import MotionVariables
from ...dynamics.system import System
from ...fields.checks import require
from ...math.vectors import Scalar
from ...quantities.base import Quantity
from ...quantities.instant import Instant
from .step_state import Attempt, Method, Variables, choose
from .time_map import AbstractTimeMap
from .unrolled_runge_kutta import DenseOutput, UnrolledExplicit


def look_inside(
    method: Method, system: System, attempt: Attempt, t: Scalar
) -> tuple[Variables, EntrySpeeds]:
    """Variables and memory at an instant of an accepted step, by the solver's dense output.

    The memory is that of the step's start: what the step's end changes holds from there on.
    """
    end = attempt.step.t
    dense = method.solver.interpolation_cls(t0=attempt.t_start, t1=end, **attempt.information)
    y = choose(t >= end, attempt.step.y, dense.evaluate(dense_time(attempt, t)))
    entry_speeds = choose(t >= end, attempt.step.entry_speeds, attempt.entry_speeds_start)
    return on_constraints(system, y, t), entry_speeds


def dense_time(attempt: Attempt, t: Scalar) -> Scalar:
    """The time at which the dense output of a graded step has what belongs to t."""
    if attempt.time_map is None:
        return t
    length = attempt.step.t - attempt.t_start
    x = (t - attempt.t_start) / jnp.where(length > 0.0, length, 1.0)
    return attempt.t_start + length * attempt.time_map.place(x)


def correct(system: System, y: Variables, t: Scalar) -> Variables:
    """The variables as the stabilisation wants them at the end of a step; what a projection takes
    is booked in the ledger."""
    return system.formulation.stabilisation.corrected(y, lambda y: _project(system, y, t))


def on_constraints(system: System, y: Variables, t: Scalar) -> Variables:
    """The variables as they are saved inside a step: corrected too, but nothing is booked."""
    return replace(y, motion=correct(system, y, t).motion)


def _project(system: System, y: Variables, t: Scalar) -> Variables:
    motion, work = system.project(y.motion, t), y.work
    if system.formulation.ledger and "stabilisation" in work:
        loss = _energy(system, y.motion, t) - _energy(system, motion, t)
        work = {**work, "stabilisation": work["stabilisation"] + loss}
    return replace(y, motion=motion, work=work)


def _energy(system: System, motion: MotionVariables, t: Scalar) -> Scalar:
    return sum(system.energies(motion, t).values())


def require_dense(solver: diffrax.AbstractSolver) -> None:
    """Check that a solver's dense output is known in scalar form."""
    require(
        isinstance(solver, UnrolledExplicit),
        "solver",
        type(solver).__name__,
        "an explicit Runge-Kutta method for sections, for what sweeps see inside steps (saved "
        "states, peaks, statistics, impacts), and for derivatives",
        "take one such as diffrax.Tsit5(), or leave these outputs out",
    )


class Snapshot(eqx.Module):
    """A time, the variables and the memory there."""

    t: Scalar
    y: Variables
    entry_speeds: EntrySpeeds

    def instant(
        self,
        system: System,
        inside: Callable[[Scalar], Instant] | None = None,
    ) -> Instant:
        """The system at this row; `inside` gives that at a place of the step that ends here."""
        motion, work = self.y.motion, self.y.work
        return Instant(system, self.t, motion, self.entry_speeds, work, self.y.bristles, inside)

    def columns(self, system: System, channels: Mapping[str, Quantity]) -> dict[str, Scalar]:
        """What is reported of the row: its time, s, and quantities by name."""
        now = self.instant(system)
        return {"time": now.time, **{name: quantity(now) for name, quantity in channels.items()}}


class DenseStep(eqx.Module):
    """The latest accepted step, from `start` to `end`, with its stages to look inside by."""

    start: Snapshot
    end: Snapshot
    stages: tuple[Variables, ...]
    time_map: AbstractTimeMap | None

    @staticmethod
    def of(tried: Attempt) -> "DenseStep":
        """The bracket of the step that an accepted attempt made."""
        step, inside = tried.step, tried.information
        return DenseStep(
            Snapshot(tried.t_start, inside["y0"], tried.entry_speeds_start),
            Snapshot(step.t, step.y, step.entry_speeds),
            inside["stages"],
            tried.time_map,
        )

    def inside(self, method: Method, x: Scalar) -> Variables:
        """The variables at a fraction x of the step, by the solver's dense output."""
        assert isinstance(method.solver, UnrolledExplicit)
        start, end = self.start, self.end
        dense = DenseOutput(method.solver.method, start.t, end.t, start.y, self.stages)
        return dense.at(x if self.time_map is None else self.time_map.place(x))

    def within(self, method: Method, x: Scalar) -> Snapshot:
        """The row at a fraction x of the step."""
        require_dense(method.solver)
        t = self.start.t + x * (self.end.t - self.start.t)
        return Snapshot(t, self.inside(method, x), self.start.entry_speeds)

    def at(self, method: Method, t: Scalar) -> Snapshot:
        """The row at a time of the step."""
        length = self.end.t - self.start.t
        x = (t - self.start.t) / jnp.where(length > 0.0, length, 1.0)
        ends = t >= self.end.t
        y = choose(ends, self.end.y, self.inside(method, x))
        return Snapshot(t, y, choose(ends, self.end.entry_speeds, self.start.entry_speeds))

"""State inside an accepted step by dense output, and the correction onto the constraints."""

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
    """Return the variables and entry speeds at a time t, s, of an accepted step.

    Inside the step, entry speeds are those of its start: they change at its end. At the end, the
    variables are the stored ones, which contain the corrections for events there.
    """
    end = attempt.step.t
    dense = method.solver.interpolation_cls(t0=attempt.t_start, t1=end, **attempt.information)
    y = choose(t >= end, attempt.step.y, dense.evaluate(dense_time(attempt, t)))
    entry_speeds = choose(t >= end, attempt.step.entry_speeds, attempt.entry_speeds_start)
    return on_constraints(system, y, t), entry_speeds


def dense_time(attempt: Attempt, t: Scalar) -> Scalar:
    """Return the time to pass to the dense output for the state at t, s.

    The solver assumes uniform time, so t is mapped to the fraction of the step and back.
    """
    if attempt.time_map is None:
        return t
    length = attempt.step.t - attempt.t_start
    elapsed = (t - attempt.t_start) / jnp.where(length > 0.0, length, 1.0)
    return attempt.t_start + length * attempt.time_map.fraction(elapsed)


def correct(system: System, y: Variables, t: Scalar) -> Variables:
    """Return the variables at the end of a step, corrected by the stabilisation.

    The energy that a projection removes is booked in the ledger.
    """
    return system.formulation.stabilisation.corrected(y, lambda y: _project(system, y, t))


def on_constraints(system: System, y: Variables, t: Scalar) -> Variables:
    """Return the variables inside a step, corrected by the stabilisation; the ledger stays."""
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
    """Check that the dense output of a solver is available in scalar form."""
    require(
        isinstance(solver, UnrolledExplicit),
        "solver",
        type(solver).__name__,
        "an explicit Runge-Kutta method for sections, for values inside the steps of a sweep "
        "(saved states, peaks, statistics, impacts), and for derivatives",
        "take one such as diffrax.Tsit5(), or leave these outputs out",
    )


class Snapshot(eqx.Module):
    """A time, s, and the variables and entry speeds there."""

    t: Scalar
    y: Variables
    entry_speeds: EntrySpeeds

    def instant(
        self,
        system: System,
        inside: Callable[[Scalar], Instant] | None = None,
    ) -> Instant:
        """Return the `Instant` of the snapshot; `inside` gives the one at a fraction of the step
        that ends here."""
        motion, work = self.y.motion, self.y.work
        return Instant(system, self.t, motion, self.entry_speeds, work, self.y.bristles, inside)

    def columns(self, system: System, channels: Mapping[str, Quantity]) -> dict[str, Scalar]:
        """Return the time, s, and the values of quantities by name."""
        now = self.instant(system)
        return {"time": now.time, **{name: quantity(now) for name, quantity in channels.items()}}


class DenseStep(eqx.Module):
    """The latest accepted step, from `start` to `end`, with its stages for dense output."""

    start: Snapshot
    end: Snapshot
    stages: tuple[Variables, ...]
    time_map: AbstractTimeMap | None

    @staticmethod
    def of(tried: Attempt) -> "DenseStep":
        """Return the step of an accepted attempt."""
        step, inside = tried.step, tried.information
        return DenseStep(
            Snapshot(tried.t_start, inside["y0"], tried.entry_speeds_start),
            Snapshot(step.t, step.y, step.entry_speeds),
            inside["stages"],
            tried.time_map,
        )

    def inside(self, method: Method, elapsed: Scalar) -> Variables:
        """Return the variables after an elapsed part of the step's time, 0 to 1."""
        assert isinstance(method.solver, UnrolledExplicit)
        start, end = self.start, self.end
        dense = DenseOutput(method.solver.method, start.t, end.t, start.y, self.stages)
        return dense.at(elapsed if self.time_map is None else self.time_map.fraction(elapsed))

    def within(self, method: Method, elapsed: Scalar) -> Snapshot:
        """Return the snapshot after an elapsed part of the step's time, 0 to 1."""
        require_dense(method.solver)
        t = self.start.t + elapsed * (self.end.t - self.start.t)
        return Snapshot(t, self.inside(method, elapsed), self.start.entry_speeds)

    def at(self, method: Method, t: Scalar) -> Snapshot:
        """Return the snapshot at a time t of the step, s."""
        length = self.end.t - self.start.t
        elapsed = (t - self.start.t) / jnp.where(length > 0.0, length, 1.0)
        ends = t >= self.end.t
        y = choose(ends, self.end.y, self.inside(method, elapsed))
        return Snapshot(t, y, choose(ends, self.end.entry_speeds, self.start.entry_speeds))

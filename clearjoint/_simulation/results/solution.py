"""Results of runs: trajectory, crossings of sections, solution, and the error of a failed run."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

import equinox as eqx
import jax
import numpy as np
from jax.core import Tracer

# Hermite's polynomials are declared for scalars; they are elementwise in arrays.
# pyright: reportArgumentType=false, reportCallIssue=false
from jaxtyping import Float, Int, PyTree
from typing_extensions import override

from ..._dynamics.formulation import Formulation
from ..._export.datasets import (
    COMPONENT,
    COMPONENTS,
    AbstractTabular,
    Labelled,
    Notes,
    labelled_dataset,
    texts,
)
from ..._fields.checks import as_shown, require
from ..._fields.objects import AbstractReadable
from ..._fields.types import ArrayLike
from ..._math.interpolation import Slope, hermite_rate, hermite_value
from ..._math.rotations import composed
from ..._math.vectors import EulerParameters, Scalar, pack
from ..._model.bodies import BodyState, State
from ..._result_codes import RESULTS, result_number
from ..step.settings import checked_times
from ..step.types import Flags, Numbers
from .impact_table import Impacts

T = TypeVar("T")
STATE_PARTS = {
    field.name: ("parameter" if field.name == "orientation" else COMPONENT, field.metadata["unit"])
    for field in fields(BodyState)
}
"""Last dimension and unit of the array for each field of a `BodyState`."""
LABELS = {COMPONENT: [*COMPONENTS], "parameter": ["e0", "e1", "e2", "e3"]}
CONTACTS = "contact"
BRISTLES = "bristle_contact"
MEMORY = "remembered"
"""Names of the dimensions of contacts, of contacts with bristles, and of numbers in memories."""


def contact_label(joint: str, contact: str) -> str:
    return f"{joint} {contact}"


def by_contact(tables: Mapping[str, Mapping[str, T]]) -> dict[str, T]:
    return {
        contact_label(joint, contact): entry
        for joint, entries in tables.items()
        for contact, entry in entries.items()
    }


def state_arrays(states: State, rows: tuple[str, ...], prefix: str = "") -> dict[str, Labelled]:
    """Return states as arrays by name of variable, with `prefix` in front of each name. `rows`:
    names of the first dimensions of all arrays in `states`, such as ("time",) or ()."""
    arrays = {}
    for field in fields(BodyState):
        values = [np.asarray(getattr(body, field.name)) for body in states.bodies.values()]
        # Bodies are stacked along a new dimension before that of the components. The metadata of a
        # field are its unit and its description.
        dims = (*rows, "body", STATE_PARTS[field.name][0])
        arrays[prefix + field.name] = Labelled(dims, np.stack(values, -2), *field.metadata.values())
    of_entry = "speed of approach at the onset of the contact; zero in flight"
    of_bristle = "deflection of the bristles, in the axes of the joint's first body"
    of_memory = "numbers that sampled forces remember, in SI units"
    of_ledger = "integrals of the energy ledger; friction includes the elastic energy of bristles"
    # Arrays of single contacts, remembered numbers and integrals are stacked along a new dimension,
    # before that of the components of vectors. `by_contact` also joins the names of a sampled force
    # and of a number that it remembers.
    for name, parts, dims, unit, text in (
        ("entry_speed", by_contact(states.entry_speeds), (CONTACTS,), "m/s", of_entry),
        ("bristle_deflection", by_contact(states.bristles), (BRISTLES, COMPONENT), "m", of_bristle),
        ("memory", by_contact(states.memory), (MEMORY,), None, of_memory),
        ("ledger", states.work, ("integral",), "J", of_ledger),
    ):
        if parts:
            values = np.stack([np.asarray(part) for part in parts.values()], -len(dims))
            arrays[prefix + name] = Labelled((*rows, *dims), values, unit, text)
    return arrays


def state_labels(states: State) -> dict[str, Labelled]:
    """Return the labels along each dimension of the arrays that `state_arrays` returns."""
    labels = {"body": [*states.bodies], **LABELS}
    labels[CONTACTS] = [*by_contact(states.entry_speeds)]
    labels[BRISTLES] = [*by_contact(states.bristles)]
    labels[MEMORY] = [*by_contact(states.memory)]
    labels["integral"] = [*states.work]
    return {name: Labelled((name,), texts(own)) for name, own in labels.items() if own}


FINEST = 16
"""Number of parts of the most curved step for drawing: the distance between a path and its chords
is then 1/256 of that of the undivided step."""
LARGEST_ROTATION = 0.05
"""Largest rotation of a body within one part of a step, rad, unless the step has `MOST` parts: an
arc of this angle is at most 3e-4 of its radius away from its chord."""
MOST = 64
"""Largest number of parts of a step: a body may spin fast in a long step."""

Times = Float[np.ndarray, " N"]
Wanted = Float[np.ndarray, " M"]
Rows = Int[np.ndarray, " M"]


def instants_of_smooth_curves(times: Times, states: State) -> Wanted:
    """Return times, (M,) s, at which states look like a smooth curve if joined by straight lines:
    the N `times` at the ends of steps, and equidistant times inside curved steps."""
    lengths = np.diff(times)
    # `bend`, m, is the length of a step times the change of a velocity in it. For a parabola, it is
    # 8 times the largest distance between curve and chord.
    bend, rotation = np.zeros(len(lengths)), np.zeros(len(lengths))
    for body in states.bodies.values():
        change = np.linalg.norm(np.diff(body.velocity, axis=0), axis=1)
        bend = np.maximum(bend, lengths * change)
        # The angle by which the body rotates in the step, rad, at the spin of the step's start.
        rotation = np.maximum(rotation, lengths * np.linalg.norm(body.spin[:-1], axis=1))
    # If all velocities are constant, the tiny number avoids a division by zero.
    largest = max(bend.max(initial=0.0), np.finfo(float).tiny)
    # n parts reduce the distance between path and chords by the factor n^2. So the number of parts
    # is proportional to the square root of the bend.
    parts = np.maximum(FINEST * np.sqrt(bend / largest), rotation / LARGEST_ROTATION)
    parts = np.clip(np.ceil(parts), 1, MOST).astype(int)
    # For all parts of all steps: `step` is the index of the step, and `part` counts the parts of
    # this step from 0. The difference is the number of parts in all earlier steps.
    step = np.repeat(np.arange(len(parts)), parts)
    part = np.arange(len(step)) - (np.cumsum(parts) - parts)[step]
    starts_of_parts = times[step] + part / parts[step] * lengths[step]
    return np.append(starts_of_parts, times[-1:])


def states_between(times: Times, states: State, wanted: Wanted) -> State:
    """Interpolate states at the N `times` to the M `wanted` times, s, as `Trajectory.between` does.
    Of several states at one time, the last one counts."""
    wanted = checked_times(times[0], times[-1], wanted)
    # The step of a wanted time begins at the last row whose time is not later. No step begins at
    # the last row of all, so for its time `left` is the start of the last step, and x is 1. If the
    # last time is repeated, the last step has the length zero, for which x is set to 1.
    left = np.clip(np.searchsorted(times, wanted, "right") - 1, 0, len(times) - 2)
    h = (times[left + 1] - times[left])[:, None]
    x = np.where(h > 0.0, (wanted - times[left])[:, None] / np.where(h > 0.0, h, 1.0), 1.0)
    bodies = {name: _body(body, left, x, h) for name, body in states.bodies.items()}
    # Entry speeds and memories are those of the start of the step, except at its end.
    kept_rows = np.where(x[:, 0] == 1.0, left + 1, left)

    def linear(rows: Numbers) -> np.ndarray:
        rows = np.asarray(rows)
        # x is (M, 1), and gets as many axes as the rows have.
        part = x.reshape(-1, *[1] * (rows.ndim - 1))
        return (1.0 - part) * rows[left] + part * rows[left + 1]

    kept = states.entry_speeds, states.memory
    entry_speeds, memory = jax.tree.map(lambda rows: np.asarray(rows)[kept_rows], kept)
    work, bristles = jax.tree.map(linear, (states.work, states.bristles))
    return State(bodies, entry_speeds, work, bristles, memory)


# Interpolates at the parts `x` of steps of lengths `h`, which begin at the rows `left` of the body.
def _body(body: BodyState, left: Rows, x: np.ndarray, h: np.ndarray) -> BodyState:
    positions, velocities = np.asarray(body.position), np.asarray(body.velocity)
    start, end = (Slope(positions[row], velocities[row]) for row in (left, left + 1))
    position, velocity = _along(start, end, x, h)
    orientations, spins = np.asarray(body.orientation), np.asarray(body.spin)
    at_start, at_end = orientations[left], orientations[left + 1]
    # Both signs of Euler parameters are the same orientation: at the end, take the one that is
    # nearer to the start.
    sign = np.where(np.sum(at_start * at_end, axis=1, keepdims=True) < 0.0, -1.0, 1.0)
    # The rate of the Euler parameters p is the quaternion product p (0, w)/2, where w is the spin.
    rates = 0.5 * _product(orientations, np.pad(spins, ((0, 0), (1, 0))))
    signed_end = Slope(sign * at_end, sign * rates[left + 1])
    orientation, rate = _along(Slope(at_start, rates[left]), signed_end, x, h)
    # The same relation gives the spin, (0, w) = 2 p^-1 dp/dt. Its scalar part is left out: it is
    # not zero inside the step, only because the size of the interpolated p changes there.
    size = np.linalg.norm(orientation, axis=1, keepdims=True)
    inverse = orientation * (1.0, -1.0, -1.0, -1.0) / size**2
    return BodyState(position, orientation / size, velocity, 2.0 * _product(inverse, rate)[:, 1:])


def _along(start: Slope, end: Slope, x: np.ndarray, h: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return cubic Hermite interpolants and their rates, (M, components), at the parts `x`, (M, 1),
    0 to 1, of steps of lengths `h`, (M, 1) s; the values at `end` where h is zero."""
    is_step, length = h > 0.0, np.where(h > 0.0, h, 1.0)
    value, rate = hermite_value(x, start, end, length), hermite_rate(x, start, end, length)
    return np.where(is_step, value, end.value), np.where(is_step, rate, end.rate)


def _product(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    return pack(composed(EulerParameters(*first.T), EulerParameters(*second.T)))


if TYPE_CHECKING:
    import xarray as xr

TIME = "time"
"""Name of the column with the times of crossings, which no channel may have."""
SHOWN_BODIES = 6
"""Largest number of bodies that `repr(solution)` shows."""
SUCCESSFUL = result_number(RESULTS.successful)
SAVE_TIMES = "pass save=Saving(times) to simulate()"


class Trajectory(AbstractReadable, AbstractTabular):
    """States of a motion at N times.

    - `times`: (N,) s, not decreasing.
    - `states`: a `State` whose arrays have an additional first axis of length N. For example,
      `states.bodies["arm"].position` has the shape (N, 3), in m.
    - `interpolated`: (N,), true at the times inside steps, where `between` has interpolated the
      states; ``None`` for a trajectory of computed states.

    >>> states = cj.State({"arm": cj.body_state((0, 0, 0))})
    >>> cj.results.Trajectory(np.zeros(1), states).times.shape
    (1,)
    """

    times: Numbers
    states: State
    interpolated: Flags | None = None

    def __len__(self) -> int:
        return self.times.shape[0]

    def between(self, times: ArrayLike | None = None) -> "Trajectory":
        """Interpolate the states between the ends of accepted steps, to draw smooth curves.

        Motions of bodies are interpolated by a cubic Hermite polynomial in each step, with an error
        far below the clearances. Bristle deflections and the energy ledger are interpolated
        linearly; entry speeds and memories keep their values until the end of the step. Call this
        for `solution.steps` only: between two states of `solution.saved` there may be impacts.

        **Arguments:** `times`: (M,) s, not decreasing, between the first and last time of the
        trajectory. By default, the ends of all steps, and further times inside steps in which a
        body rotates by more than 0.05 rad, or its velocity changes much compared with other steps.

        **Raises:** `ValueError` for `times` that are empty, not one-dimensional, not finite,
        decrease or lie outside of the trajectory; and for a trajectory of fewer than two states.
        """
        ends = np.asarray(self.times)
        remedy = "pass save=Saving(steps=True) to simulate(), and take solution.steps"
        require(len(ends) >= 2, "times", len(ends), "two states of the trajectory or more", remedy)
        states = jax.tree.map(np.asarray, self.states)
        wanted = instants_of_smooth_curves(ends, states) if times is None else np.asarray(times)
        return Trajectory(wanted, states_between(ends, states, wanted), ~np.isin(wanted, ends))

    @override
    def __str__(self) -> str:
        if is_abstract((self.times, self.states)) or np.ndim(self.times) != 1 or not len(self):
            return repr(self)
        bodies = ", ".join(map(repr, self.states.bodies))
        first, last = as_shown(np.asarray(self.times)[[0, -1]])
        return f"{len(self)} states of {bodies} from {first} s to {last} s"

    @override
    def to_xarray(self) -> "xr.Dataset":
        """Return the states as an `xarray.Dataset` with units.

        - `position` in m, `velocity` in m/s (both global) and `spin` in rad/s (body axes) have the
          dimensions "time", "body" and "component" ("x", "y", "z").
        - `orientation` has "parameter" ("e0" to "e3", Euler parameters) instead of "component".
        - `entry_speed` in m/s along "contact", `bristle_deflection` in m along "bristle_contact",
          `memory` along "remembered", with labels such as "servo torque", and `ledger` in J along
          "integral" exist only if the states have them.
        """
        rows, times = ("time",), Labelled(("time",), self.times, "s", "time")
        labels = {"time": times, **state_labels(self.states)}
        return labelled_dataset("motion", state_arrays(self.states, rows), labels)


class Crossings(AbstractReadable, AbstractTabular):
    """The N crossings of a Poincaré section in a run.

    A channel is a quantity, such as a speed, that the section records at each crossing by name.

    - `times`: (N,) s, times of the crossings.
    - `values`: by name of the channel, the values of its quantity at the crossings, (N,).
    - `units`: by name of the channel, the unit of its values; empty if unknown.

    >>> crossings = cj.results.Crossings(np.array([0.1, 0.2]), {"speed": np.array([1.0, 1.1])})
    >>> np.diff(crossings.times).round(6)  # the period
    array([0.1])
    """

    times: Numbers
    values: dict[str, Numbers]
    units: Mapping[str, str] = eqx.field(default_factory=dict, static=True)

    @override
    def to_xarray(self) -> "xr.Dataset":
        """Return an `xarray.Dataset` with a variable along "time" for each channel."""
        values = {
            name: Labelled((TIME,), row, self.units.get(name)) for name, row in self.values.items()
        }
        times = Labelled((TIME,), self.times, "s", "time of the crossing")
        return labelled_dataset("crossings of a section", values, {TIME: times})

    def __len__(self) -> int:
        return self.times.shape[0]


class Solution(AbstractReadable, AbstractTabular):
    """Result of `clearjoint.simulate`.

    - `saved`: the `Trajectory` at those requested times that the run reached; ``None`` if no times
      were requested by `Saving.times`. Under a JAX transformation its arrays have a row for every
      requested time, and only the first `saved_count` rows are valid.
    - `time`, `final`: the end of the run, s, and its `State`, from which a further run can start.
    - `result`: the `RESULTS` code, which says whether the run succeeded or why it failed.
    - `attempts`, `accepted`: numbers of steps that were tried, and that were accepted. The output
      `RejectedSteps` lists the others, with the reason why each was rejected.
    - `steps`: the `Trajectory` with the states at the start of the run and after every accepted
      step; ``None`` unless requested.
    - `impacts`: the table of contacts that began and ended in the run; ``None`` unless requested.
    - `outputs[name]`: the result of each requested output: the (N,) values of a quantity at those
      requested times that the run reached, the `Crossings` of a `Section`, the `Impacts` of an
      `ImpactTable`, the `Rejections` of `RejectedSteps`, and the number of a reduction. A reduction
      may have several results: a `Peak` "force" has the entries "force" and "force_time".
    - `formulation`: coordinates, stabilisation, and whether the energy ledger was integrated.
    - `redundant_constraints`: names of constraint equations that depend linearly on others. If
      there are any, the reactions are not unique, and those of least norm are computed.
    - `settings`: those of the run, pairs of name and value; empty under a JAX transformation.

    >>> solution = cj.simulate(scene, state, 0.1, save=cj.Saving([0.0, 0.1]), progress=False)
    >>> positions = solution.saved.states.bodies["ball"].position
    >>> print(solution.result == cj.RESULTS.successful, np.round(positions[:, 0], 4))
    True [0.1   0.054]
    """

    time: Scalar
    final: State
    result: RESULTS
    attempts: Scalar
    accepted: Scalar
    saved: Trajectory | None
    saved_count: Scalar | None
    steps: Trajectory | None
    impacts: Impacts | None = eqx.field(static=True)
    formulation: Formulation
    redundant_constraints: tuple[str, ...] = eqx.field(static=True)
    outputs: Mapping[str, Any] = eqx.field(default_factory=dict)
    settings: Notes = eqx.field(default=(), static=True)

    @override
    def __repr__(self) -> str:
        if is_abstract(self):
            return super().__repr__()
        lines = [f"{self.accepted} steps, {self.attempts} tried"]
        for name, kept in (("saved", self.saved), ("steps", self.steps)):
            if kept is not None:
                lines.append(f"{name}: {kept}")
        if self.impacts is not None:
            lines.append(f"impacts: {len(self.impacts)}")
        if self.outputs:
            lines.append(f"outputs: {', '.join(map(repr, self.outputs))}")
        return run_text(self, self.final, self.redundant_constraints, lines)

    @property
    def times(self) -> Numbers:
        """The requested times that the run reached, (N,) s; `AttributeError` if there are none."""
        return self._requested().times

    @property
    def states(self) -> State:
        """The `State` at the requested `times`, (N,); `AttributeError` if there are none."""
        return self._requested().states

    @override
    def to_xarray(self) -> "xr.Dataset":
        """Return the saved states as an `xarray.Dataset` (see `Trajectory.to_xarray`).

        The final state is in further variables without "time", such as `final_position`. Attributes
        are result, time reached, s, steps, redundant constraints and settings.

        **Raises:** `ValueError` if no states were saved.
        """
        require(self.saved is not None, "solution", "without saved states", "with some", SAVE_TIMES)
        assert self.saved is not None
        # The final state has no dimension of time, so it gets variables of its own, which `merge`
        # adds to those of the saved states.
        dataset = self.saved.to_xarray()
        final = state_arrays(self.final, (), "final_")
        reached = labelled_dataset("state reached", final, state_labels(self.final))
        notes = {
            "title": "motion of a mechanism",
            "result": RESULTS[self.result],
            "time_reached": float(self.time),
            "attempts": int(self.attempts),
            "accepted": int(self.accepted),
            "redundant_constraints": ", ".join(self.redundant_constraints) or "none",
            **dict(self.settings),
        }
        return dataset.merge(reached).assign_attrs(notes)

    def _requested(self) -> Trajectory:
        if self.saved is None:
            raise AttributeError("No states were saved: pass save=Saving(times) to simulate().")
        return self.saved


class FinishedRun(Protocol):
    @property
    def time(self) -> Scalar: ...

    @property
    def result(self) -> RESULTS: ...


def is_abstract(tree: PyTree) -> bool:
    """Return whether JAX traces a leaf of a result, or `jax.vmap` has computed several runs."""
    time = getattr(tree, "time", 0.0)
    return np.ndim(time) > 0 or any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(tree))


def run_text(
    run: FinishedRun, final: State, redundant: tuple[str, ...], lines: Sequence[str]
) -> str:
    """Return the text that `repr` shows for a result: type, time and result code of the `run`, the
    `lines`, names of `redundant` constraints, and the motion of bodies in the `final` state."""
    if redundant:
        names = ", ".join(map(repr, redundant))
        lines = [*lines, f"redundant constraints: {names}"]
    bodies = list(final.bodies.items())
    for name, body in bodies[:SHOWN_BODIES]:
        position, velocity = (
            f"({', '.join(f'{number:.6g}' for number in np.asarray(vector))})"
            for vector in (body.position, body.velocity)
        )
        lines = [*lines, f"{name!r} at {position} m with {velocity} m/s"]
    if len(bodies) > SHOWN_BODIES:
        lines = [*lines, f"... and {len(bodies) - SHOWN_BODIES} more in `final.bodies`"]
    head = f"{type(run).__name__} at t = {float(run.time):.9g} s: {RESULTS[run.result]}"
    return "\n  ".join([head, *lines])


class SimulationError(RuntimeError):
    """The error that `simulate` and other functions raise if a run fails.

    Its attribute `solution` has the results up to the failure, of the type returned on success.

    >>> cj.simulate(scene, state, 1.0, cj.Settings(max_steps=10), progress=False)
    Traceback (most recent call last):
        ...
    clearjoint._simulation.results.solution.SimulationError: The run ended at t = 0.124372989 ...
    """

    def __init__(self, message: str, solution: FinishedRun):
        super().__init__(message)
        self.solution = solution


def raise_failure(
    solution: FinishedRun, message: str | None = None, causes: Iterable[str] = ()
) -> None:
    """Raise a `SimulationError` unless a run ended successfully. The text is `message`, or by
    default the description of the result code, followed by the sentences `causes`."""
    if result_number(solution.result) != SUCCESSFUL:
        start = f"The run ended at t = {float(solution.time):.9g} s:"
        message = RESULTS[solution.result] if message is None else message
        raise SimulationError(" ".join([start, message, *causes]), solution)

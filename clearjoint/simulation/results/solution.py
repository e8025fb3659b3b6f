"""Solution of a run: trajectories, result code and tables."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Protocol

import equinox as eqx
import jax
import numpy as np
from jax.core import Tracer
from jaxtyping import PyTree

from ...dynamics.formulation import Formulation
from ...export.labelled import Labelled, labelled_dataset
from ...export.provenance import Notes
from ...export.tabular import AbstractTabular
from ...fields.checks import as_shown, require
from ...fields.readable import AbstractReadable
from ...fields.types import ArrayLike
from ...math.vectors import Scalar
from ...model.bodies import State
from ...result_codes import RESULTS, result_number
from ..run.sections import Crossings
from ..step.types import Numbers
from .between_steps import instants_of_smooth_curves, states_between
from .impact_table import Impacts
from .state_tables import state_arrays, state_labels

if TYPE_CHECKING:
    import xarray as xr

SHOWN_BODIES = 6
"""Largest number of bodies whose final state is in the text of a run."""
SUCCESSFUL = result_number(RESULTS.successful)
SAVE_TIMES = "pass save=Saving(times) to simulate()"


class Trajectory(AbstractReadable, AbstractTabular):
    """States at N times: `times`, (N,) s, and `states`, with N in front of each array.

    >>> states = cj.State({"arm": cj.body_state((0, 0, 0))})
    >>> cj.results.Trajectory(np.zeros(1), states).times.shape
    (1,)
    """

    times: Numbers
    states: State

    def __len__(self) -> int:
        return self.times.shape[0]

    def between(self, times: ArrayLike | None = None) -> "Trajectory":
        """Return states inside the accepted steps, for smooth curves.

        Cubic Hermite interpolation between the ends of each step, with an error far below the
        clearances. Use it for `solution.steps` only: between saved states there may be impacts.

        **Arguments:** `times`: (M,) s, rising, between the first and the last of the trajectory;
        unless given, the ends of all steps and times inside the steps in which a body moves along a
        curve.

        **Raises:** `ValueError` for times outside, and for fewer than two states.

        >>> scene, state = cj.mechanisms.double_pendulum()
        >>> solution = cj.simulate(scene, state, 0.02, save=cj.Saving(steps=True), progress=False)
        >>> path = cj.observe(scene, solution, solution.steps.between())
        >>> axes = plot.journal_orbit(path, "shoulder")
        """
        ends = np.asarray(self.times)
        remedy = "pass save=Saving(steps=True) to simulate(), and take solution.steps"
        require(len(ends) >= 2, "times", len(ends), "two states of the trajectory or more", remedy)
        states = jax.tree.map(np.asarray, self.states)
        wanted = instants_of_smooth_curves(ends, states) if times is None else np.asarray(times)
        return Trajectory(wanted, states_between(ends, states, wanted))

    def __str__(self) -> str:
        """Return a line with the number of states, the bodies, and the first and the last time."""
        if is_abstract((self.times, self.states)) or np.ndim(self.times) != 1 or not len(self):
            return repr(self)
        bodies = ", ".join(map(repr, self.states.bodies))
        first, last = as_shown(np.asarray(self.times)[[0, -1]])
        return f"{len(self)} states of {bodies} from {first} s to {last} s"

    def to_xarray(self) -> "xr.Dataset":
        """Return an `xarray.Dataset` along "time", "body" and "component", with units.

        Its variables are `position`, `orientation`, `velocity` and `spin`, and if the states have
        them `entry_speed` and `bristle_deflection` of the contacts and the energy `ledger`. See
        `AbstractTabular`.
        """
        rows, times = ("time",), Labelled(("time",), self.times, "s", "time")
        labels = {"time": times, **state_labels(self.states)}
        return labelled_dataset("motion", state_arrays(self.states, rows), labels)


class Solution(AbstractReadable, AbstractTabular):
    """The outcome of `clearjoint.simulation.run.simulate`.

    - `saved`: the states at the requested times that were reached (all if successful), or ``None``
      if none were requested. Under a JAX transformation it has all rows, and the first
      `saved_count` are valid.
    - `time`, `final`: end of the run in s and the state then, from which it can be continued.
    - `result`: a `RESULTS` code.
    - `attempts`, `accepted`: steps tried and accepted.
    - `steps`: the states at the start and after every accepted step, if requested.
    - `impacts`: the table of finished contacts, if requested.
    - `sections[name]`: the `Crossings` of each requested section.
    - `outputs[name]`: results of the requested reductions, one number each; "name_part" for
      further numbers, such as "force_time" of a `Peak`.
    - `formulation`: the formulation of the equations of motion.
    - `redundant_constraints`: names of constraints that depend on the others. If there are any,
      reactions are not unique, and those of least norm are computed.
    - `settings`: settings of the run, as pairs of a name and a text or number.

    `to_xarray`, `to_dataframe`, `to_csv` and `to_netcdf` export the saved states.

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
    sections: Mapping[str, Crossings] = eqx.field(default_factory=dict)
    outputs: Mapping[str, float] = eqx.field(default_factory=dict)
    settings: Notes = eqx.field(default=(), static=True)

    def __repr__(self) -> str:
        """Return a few lines: how the run ended, its results, and the bodies' final states."""
        if is_abstract(self):
            return super().__repr__()
        lines = [f"{self.accepted} steps, {self.attempts} tried"]
        lines += [
            f"{name}: {kept}"
            for name, kept in (("saved", self.saved), ("steps", self.steps))
            if kept is not None
        ]
        if self.impacts is not None:
            lines.append(f"impacts: {len(self.impacts)}")
        if self.sections:
            lines.append(f"sections: {', '.join(map(repr, self.sections))}")
        return run_text(self, self.final, self.redundant_constraints, lines)

    @property
    def times(self) -> Numbers:
        """Requested times that were reached, s."""
        return self._requested().times

    @property
    def states(self) -> State:
        """States at the requested times that were reached, with N in front."""
        return self._requested().states

    def to_xarray(self) -> "xr.Dataset":
        """Return an `xarray.Dataset` of the saved states, see `Trajectory.to_xarray`.

        The final state is included as `final_position` and so on. The result and the settings are
        attributes.

        ```python
        import clearjoint as cj
        import numpy as np

        save = cj.Saving(np.linspace(0.0, 0.01, 11))
        solution = cj.simulate(*cj.mechanisms.double_pendulum(), 0.01, save=save)
        solution.to_netcdf("motion.nc")
        print(solution.to_dataframe()["arm 1.position.x [m]"])
        ```

        **Raises:** `ValueError` for a run that saved no states.
        """
        require(self.saved is not None, "solution", "without saved states", "with some", SAVE_TIMES)
        assert self.saved is not None
        found = self.saved.to_xarray()
        final = state_arrays(self.final, (), "final_")
        reached = labelled_dataset("state reached", final, state_labels(self.final))
        return found.merge(reached).assign_attrs(self._notes())

    def _notes(self) -> dict[str, str | int | float]:
        """Attributes of the dataset: how the run ended, and its settings."""
        return {
            "title": "motion of a mechanism",
            "result": RESULTS[self.result],
            "time_reached": float(self.time),
            "attempts": int(self.attempts),
            "accepted": int(self.accepted),
            "redundant_constraints": ", ".join(self.redundant_constraints) or "none",
            **dict(self.settings),
        }

    def _requested(self) -> Trajectory:
        if self.saved is None:
            raise AttributeError("No times were requested: pass save=Saving(times) to simulate().")
        return self.saved


class FinishedRun(Protocol):
    """The outcome of any run."""

    @property
    def time(self) -> Scalar:
        """The time at which the run ended, s."""
        ...

    @property
    def result(self) -> RESULTS:
        """The result code."""
        ...


def is_abstract(tree: PyTree) -> bool:
    """Whether numbers are traced or belong to a batch of runs, so that there is no text of them."""
    time = getattr(tree, "time", 0.0)
    return np.ndim(time) > 0 or any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(tree))


def run_text(
    run: FinishedRun, final: State, redundant: tuple[str, ...], lines: Sequence[str]
) -> str:
    """Return how a run ended, the given lines, and the final states of some bodies as text."""
    if redundant:
        names = ", ".join(map(repr, redundant))
        lines = [*lines, f"redundant constraints: {names}"]
    bodies = list(final.bodies.items())
    for name, body in bodies[:SHOWN_BODIES]:
        position, velocity = (_triple(vector) for vector in (body.position, body.velocity))
        lines = [*lines, f"{name!r} at {position} m with {velocity} m/s"]
    if len(bodies) > SHOWN_BODIES:
        lines = [*lines, f"... and {len(bodies) - SHOWN_BODIES} more in `final.bodies`"]
    head = f"{type(run).__name__} at t = {float(run.time):.9g} s: {RESULTS[run.result]}"
    return "\n  ".join([head, *lines])


def _triple(vector: Numbers) -> str:
    return f"({', '.join(f'{number:.6g}' for number in np.asarray(vector))})"


class SimulationError(RuntimeError):
    """A run that failed.

    `solution` has everything that was computed: a `Solution`, or the result type of the function
    that raised the error.

    >>> cj.simulate(scene, state, 1.0, cj.Settings(max_steps=10), progress=False)
    Traceback (most recent call last):
        ...
    clearjoint.simulation.results.solution.SimulationError: The run ended at t = 0.124372989 s: T...
    """

    def __init__(self, message: str, solution: FinishedRun):
        super().__init__(message)
        self.solution = solution


def raise_failure(solution: FinishedRun) -> None:
    """Raise a `SimulationError` if a run failed.

    **Arguments:** `solution`: the outcome of the run, which becomes the error's `solution`.
    """
    if result_number(solution.result) != SUCCESSFUL:
        raise SimulationError(
            f"The run ended at t = {float(solution.time):.9g} s: {RESULTS[solution.result]}",
            solution,
        )

"""What a run returns."""

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
"""Bodies whose final state is in the text of a run."""
SUCCESSFUL = result_number(RESULTS.successful)
SAVE_TIMES = "pass save=Saving(times) to simulate()"


class Trajectory(AbstractReadable, AbstractTabular):
    """States over time: `times` (N,) s, and `states` with the times in front of each array.

    >>> states = cj.State({"arm": cj.body_state((0, 0, 0))})
    >>> cj.results.Trajectory(np.zeros(1), states).times.shape
    (1,)
    """

    times: Numbers
    states: State

    def __len__(self) -> int:
        return self.times.shape[0]

    def between(self, times: ArrayLike | None = None) -> "Trajectory":
        """The states inside the accepted steps, for smooth curves of flights and of turning bodies.

        Cubic Hermite interpolation of the states at both ends of each step, whose error is far
        below the clearances. Of `solution.steps` only: between saved states there may be impacts.

        **Arguments:** `times`: (M,) s, rising, between the first and the last of the trajectory.
        Unless given, the ends of all steps, and instants inside those in which a body moves in a
        curve.

        **Raises:** `ValueError` for instants outside, and for less than two states.

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
        """How many states, of which bodies and from when to when, in a line."""
        if is_abstract((self.times, self.states)) or np.ndim(self.times) != 1 or not len(self):
            return repr(self)
        bodies = ", ".join(map(repr, self.states.bodies))
        first, last = as_shown(np.asarray(self.times)[[0, -1]])
        return f"{len(self)} states of {bodies} from {first} s to {last} s"

    def to_xarray(self) -> "xr.Dataset":
        """An `xarray.Dataset` along "time", "body" and "component", with units: `position`,
        `orientation`, `velocity` and `spin`, and as far as the states have them the contacts'
        `entry_speed`, `bristle_deflection` and the energy `ledger`; see `AbstractTabular`."""
        rows, times = ("time",), Labelled(("time",), self.times, "s", "time")
        labels = {"time": times, **state_labels(self.states)}
        return labelled_dataset("motion", state_arrays(self.states, rows), labels)


class Solution(AbstractReadable, AbstractTabular):
    """The outcome of `clearjoint.simulation.run.simulate`.

    - `saved`: the states at the requested times that were reached (all of them if successful), or
      ``None`` if none were requested. Under a JAX transformation it keeps all rows, of which the
      first `saved_count` hold.
    - `time`, `final`: where the run ended, s, and the state there, from which it can be continued.
    - `result`: how it ended, a `RESULTS` code.
    - `attempts`, `accepted`: steps tried and accepted.
    - `steps`: every accepted step, the start included, if asked for.
    - `impacts`: the table of finished contacts, if asked for.
    - `sections[name]`: the `Crossings` of each section asked for.
    - `outputs[name]`: what each reduction asked for reports, a number; "name_part" for its parts,
      such as "force_time" of a `Peak`.
    - `formulation`: how the equations were set up.
    - `redundant_constraints`: names of constraints that depend on the others. If there are any,
      reactions are those of least norm and not unique.
    - `settings`: those of the run as pairs of name and text or number, for a reader.

    `to_xarray`, `to_dataframe`, `to_csv` and `to_netcdf` give the saved states.

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
        """How the run ended, what it kept, and where the bodies are, in a few lines."""
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
        """The requested times that were reached, s."""
        return self._requested().times

    @property
    def states(self) -> State:
        """The states at the requested times that were reached, with N in front."""
        return self._requested().states

    def to_xarray(self) -> "xr.Dataset":
        """An `xarray.Dataset` of the saved states, as `Trajectory.to_xarray` has them, and of the
        state reached, `final_position` and so on; how the run ended and its settings are
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
        """How the run ended, and its settings."""
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
    """The parts that the outcome of any run has."""

    @property
    def time(self) -> Scalar:
        """The time at which the run ended, s."""
        ...

    @property
    def result(self) -> RESULTS:
        """The code that tells how the run ended."""
        ...


def is_abstract(tree: PyTree) -> bool:
    """Whether JAX traces any number, or a run is one of a batch: then there is no single text."""
    time = getattr(tree, "time", 0.0)
    return np.ndim(time) > 0 or any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(tree))


def run_text(
    run: FinishedRun, final: State, redundant: tuple[str, ...], lines: Sequence[str]
) -> str:
    """How a run ended, the given lines, and the final state of up to `SHOWN_BODIES` bodies."""
    if redundant:
        names = ", ".join(map(repr, redundant))
        lines = [*lines, f"redundant constraints: {names}"]
    bodies = list(final.bodies.items())
    for name, body in bodies[:SHOWN_BODIES]:
        place, speed = (_triple(vector) for vector in (body.position, body.velocity))
        lines = [*lines, f"{name!r} at {place} m with {speed} m/s"]
    if len(bodies) > SHOWN_BODIES:
        lines = [*lines, f"... and {len(bodies) - SHOWN_BODIES} more in `final.bodies`"]
    head = f"{type(run).__name__} at t = {float(run.time):.9g} s: {RESULTS[run.result]}"
    return "\n  ".join([head, *lines])


def _triple(vector: Numbers) -> str:
    return f"({', '.join(f'{number:.6g}' for number in np.asarray(vector))})"


class SimulationError(RuntimeError):
    """A run that failed; `solution` holds all that was computed: a `Solution`, or what the function
    that raised it returns.

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

    **Arguments:** `solution`: a run's `result`, `time` in s, and whatever the error is to carry.
    """
    if result_number(solution.result) != SUCCESSFUL:
        raise SimulationError(
            f"The run ended at t = {float(solution.time):.9g} s: {RESULTS[solution.result]}",
            solution,
        )

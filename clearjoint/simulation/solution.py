"""What a run returns."""

from collections.abc import Mapping
from typing import Protocol

import equinox as eqx

from ..dynamics.formulation import Formulation
from ..fields.readable import AbstractReadable
from ..math.vectors import Scalar
from ..model.bodies import State
from ..results import RESULTS
from .aliases import Numbers
from .impact_table import Impacts
from .sections import Crossings


class Trajectory(AbstractReadable):
    """States over time: `times` (N,) s, and `states` with the times in front of each array.

    >>> states = cj.State({"arm": cj.body_state((0, 0, 0))})
    >>> cj.Trajectory(np.zeros(1), states).times.shape
    (1,)
    """

    times: Numbers
    states: State

    def __len__(self) -> int:
        return self.times.shape[0]


class Solution(AbstractReadable):
    """The outcome of `clearjoint.simulation.simulate`.

    - `saved`: the states at the requested times that were reached (all of them if successful), or
      ``None`` if none were requested. Under a JAX transformation it keeps all rows, of which the
      first `saved_count` hold.
    - `time`, `final`: where the run ended, s, and the state there, from which it can be continued.
    - `result`: how it ended, a `RESULTS` code.
    - `attempts`, `accepted`: steps tried and accepted.
    - `steps`: every accepted step, the start included, if asked for.
    - `impacts`: the table of finished contacts, if asked for.
    - `sections[name]`: the `Crossings` of each section asked for.
    - `formulation`: how the equations were set up.
    - `redundant_constraints`: names of constraints that depend on the others. If there are any,
      reactions are those of least norm and not unique.

    >>> spring = cj.SpringDamper("ground", "ball", (0, 0, 0), (0, 0, 0), stiffness=100.0)
    >>> scene = cj.Scene({"ball": cj.Body(1.0, (1e-3, 1e-3, 1e-3))}, forces={"spring": spring})
    >>> state = cj.State({"ball": cj.body_state((0.1, 0, 0))})  # 0.1 cos(10 t)
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

    @property
    def times(self) -> Numbers:
        """The requested times that were reached, s."""
        return self._requested().times

    @property
    def states(self) -> State:
        """The states at the requested times that were reached, with N in front."""
        return self._requested().states

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


class SimulationError(RuntimeError):
    """A run that failed; `solution` holds all that was computed: a `Solution`, or what the function
    that raised it returns.

    >>> spring = cj.SpringDamper("ground", "ball", (0, 0, 0), (0, 0, 0), stiffness=100.0)
    >>> scene = cj.Scene({"ball": cj.Body(1.0, (1e-3, 1e-3, 1e-3))}, forces={"spring": spring})
    >>> state = cj.State({"ball": cj.body_state((0.1, 0, 0))})  # 0.1 cos(10 t)
    >>> cj.simulate(scene, state, 1.0, cj.Settings(max_steps=10), progress=False)
    Traceback (most recent call last):
        ...
    clearjoint.simulation.solution.SimulationError: The run ended at t = 0.124372989 s: Th...
    """

    def __init__(self, message: str, solution: FinishedRun):
        super().__init__(message)
        self.solution = solution


def raise_failure(solution: FinishedRun) -> None:
    """Raise a `SimulationError` if a run failed.

    **Arguments:** `solution`: a run's `result`, `time` in s, and whatever the error is to carry.
    """
    if solution.result != RESULTS.successful:
        raise SimulationError(
            f"The run ended at t = {float(solution.time):.9g} s: {RESULTS[solution.result]}",
            solution,
        )

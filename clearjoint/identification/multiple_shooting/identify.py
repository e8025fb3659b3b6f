"""Multiple shooting: records too long for a single run.

Small errors of a guess grow from impact to impact, until the run meets other impacts than the data
tell of, and least squares lead astray. So the record is cut into windows, each short enough to be
followed, with starts of their own that are estimated too. H. G. Bock, *Recent advances in parameter
identification techniques for ODE* (1983).

The motion grows window by window. The first one is fitted by itself, like a short record. Each
further one begins where the one before leads, so that there is no gap at first, and its own samples
say little new: a few iterations bring all windows together to the data again, while their ends stay
tied as closely as in the end. What one is tempted to do instead, to let all windows follow the data
by themselves and to tie them afterwards, ends where neighbours have met different impacts. A window
that can't be reached in one go is reached in halves. Windows meet in flight: a start that may or
may not touch makes the misfit jump.

Ties weigh a thousand times as much as samples, so steps are whole ones of Gauss and Newton
(`gauss_newton`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from ...fields.checks import require_count, require_positive
from ...measurements.series import Measurements
from ...model.bodies import State
from ...model.scene import Scene
from ...parametrisation.parameter import Parameter
from ...simulation.settings import Integration
from ..fit import Fit, Search, Window
from ..gauss_newton import search
from ..identify import Tell, TellOf, shown
from ..starts import Guess, start_coordinates
from .problem import AllEvaluated, Shooting

BEFORE_LAST = 0.1
"""Tolerance, in standard deviations, of what is not fitted for the last time."""
FAR = 1.0
"""Gauss-Newton step, in standard deviations, with which a further window had better not begin."""
HALVINGS = 1
"""How often the way to the end of a window is halved if the search for it ends so far off."""


@dataclass(frozen=True)
class ShootingFit:
    """A fit by windows.

    - `fit`: estimates and what they are worth, as of a single run; its chi squared counts the gaps.
    - `boundaries`: (K,) s, where the windows meet.
    - `gaps`: (K, d) differences of the variables and entry speeds there, in m and rad, m/s and
      rad/s: what is left of them shows how far the pieces are one motion.
    """

    fit: Fit
    boundaries: np.ndarray
    gaps: np.ndarray

    def __str__(self) -> str:
        largest = float(np.abs(self.gaps).max())
        count = len(self.boundaries) + 1
        return f"{self.fit}\n\n{count} windows, gaps between them at most {largest:.2g}"


def identify_by_shots(
    scene: Scene,
    state: State,
    measurements: Measurements,
    parameters: Mapping[str, Parameter],
    boundaries: Sequence[float],
    *,
    start_time: float = 0.0,
    guess: Guess | None = None,
    continuity: float = 1e-9,
    integration: Integration | None = None,
    max_iterations: int = 50,
    tolerance: float = 1e-3,
    progress: bool | Tell = True,
) -> ShootingFit:
    """Estimate parameters and the states at the boundaries between windows.

    **Arguments:**

    - `scene`, `state`, `measurements`, `parameters`, `start_time`, `guess`, `integration`,
      `max_iterations`, `tolerance`, `progress`: as in `identify`. An iteration runs all windows.
    - `boundaries`: rising times, s, inside the record, at which windows meet: shorter ones than the
      convergence horizon (see `horizon`), longer ones than it takes to see the state. Each is moved
      to the sample in the later half of its window at which all contacts are farthest open. The
      first window is fitted as a record by itself: from a guess far off fit it by `identify`, with
      `grow`, and pass what it finds as the guess.
    - `continuity`: gap in m that counts as one standard deviation of a measurement; in velocities,
      a hundred times as much in m/s. Integrate more closely than that.

    **Returns:** a `ShootingFit`; its covariance is that of the parameters, all starts estimated.

    **Raises:** `ValueError` for arguments that no fit can use.
    """
    measurements.check(scene)
    require_count("max_iterations", max_iterations, "allow one run")
    require_positive("tolerance", tolerance, "1e-3 standard deviations suffice")
    require_positive("continuity", continuity, "give a gap in m, far below the clearance")
    problem = Shooting(scene, state, measurements, parameters, boundaries, start_time, integration)
    row = start_coordinates(scene, state, parameters, guess, None)[0]
    at = problem.begin(row)
    with shown(progress, parameters, 1) as tell:
        seek = _Seek(problem, continuity, tolerance, max_iterations, tell)
        best = seek.reach(at, problem.ends[0])
        for end in problem.ends[1:]:
            problem.add(best)
            best = seek.reach(best.coordinates, end)
    found = problem.condensed(best)
    whole = Search(row, tuple(seek.windows), found)
    units = {n: p.variation.unit_in(scene, state) for n, p in parameters.items()}
    made = problem.base.scene_and_state(found.coordinates)
    fit = Fit(*made, dict(parameters), units, measurements, (whole,), whole)
    starts = [piece.start for piece in problem.pieces[1:]]
    return ShootingFit(fit, np.array(starts), best.gaps)


@dataclass
class _Seek:
    """The searches, one after the other."""

    problem: Shooting
    continuity: float
    tolerance: float
    max_iterations: int
    tell: TellOf
    windows: list[Window] = field(default_factory=list)

    def reach(self, at: np.ndarray, end: float, halvings: int = HALVINGS) -> AllEvaluated:
        """The best with the last window up to an end, s, from unknowns `at`."""
        _, reached = self.problem.reached
        best = self._searched(at, end)
        if self.windows[-1].iterations[-1].decrement < FAR or halvings == 0:
            return best
        for until in (0.5 * (reached + end), end):
            best = self.reach(at, until, halvings - 1)
            at = best.coordinates
        return best

    def _searched(self, at: np.ndarray, end: float) -> AllEvaluated:
        problem = self.problem
        problem.extend(end)
        best, iterations, ending = search(
            partial(problem.evaluate, size=self.continuity),
            at,
            self.tolerance if end == problem.ends[-1] else max(BEFORE_LAST, self.tolerance),
            self.max_iterations,
            lambda one: self.tell(problem.count, problem.of_parameters(one)),
        )
        self.windows.append(Window(float(end), iterations, ending))
        return best

"""Multiple shooting: fits of records that are too long for a single run.

Small errors of a guess grow from impact to impact, until the run meets other impacts than the
measured motion, and least squares lead astray. So the record is cut into windows, each short enough
for a run to follow the data, and the states at the starts of the windows are estimated as well.
H. G. Bock, *Recent advances in parameter identification techniques for ODE* (1983).

Windows are added one by one. The first one is fitted by itself, like a short record. Each further
one begins at the end of the run of the one before, so that there is no gap at first, and a few
iterations fit all windows so far, their ends tied from the outset. (Where all windows are first
fitted by themselves and tied afterwards, neighbours may have met different impacts, and the search
stalls.) If the search ends far off, the window is approached in halves. Windows meet in flight: a
start that may or may not touch makes the misfit jump.

Ties weigh a thousand times as much as samples, so the search takes whole Gauss-Newton steps
(`gauss_newton`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from jaxtyping import Float

from ...fields.checks import require, require_count, require_positive
from ...measurements.series import Measurements
from ...model.bodies import State
from ...model.scene import Scene
from ...parametrisation.parameter import Parameter
from ...simulation.settings import Settings
from ..fit import Fit
from ..gauss_newton import search_in_whole_steps
from ..identify import OnFitIteration, OnIteration, iteration_callback
from ..searches import Search, WindowSearch
from ..starts import Guess, start_coordinates
from .problem import Shooting, WindowsMisfit

BEFORE_LAST = 0.1
"""Tolerance, in standard deviations, of all searches but the last."""
FAR = 1.0
"""Length of the Gauss-Newton step, in standard deviations, from which on a search has ended too far
off for a further window to begin."""
HALVINGS = 1
"""How often the part that a search adds to the last window is halved if it ends so far off."""


@dataclass(frozen=True)
class ShootingFit:
    """A fit by multiple shooting.

    - `fit`: the estimates with their errors and tests, as from `identify`; its chi squared includes
      the gaps.
    - `boundaries`: (K,) s, at which windows meet.
    - `gaps`: (K, d) jumps of the variables and entry speeds at the boundaries, in m, rad, m/s and
      rad/s. The smaller they are, the better the windows make up one motion.

    >>> spring = cj.SpringDamper("ground", "ball", (0, 0, 0), (0, 0, 0), stiffness=100.0)
    >>> scene = cj.Scene({"ball": cj.Body(1.0, (1e-3, 1e-3, 1e-3))}, forces={"spring": spring})
    >>> state = cj.State({"ball": cj.body_state((0.1, 0, 0))})  # 0.1 cos(10 t)
    >>> stiffness = cj.Parameter(lambda scene: scene.forces["spring"].stiffness, cj.Log())
    >>> times, x = np.linspace(0.01, 0.3, 30), cj.quantities.Position("ball", "x")
    >>> data = cj.Series(x, times, 0.1 * np.cos(10.0 * times), noise=1e-4)
    >>> found = cj.identify_by_shots(
    ...     scene,
    ...     state,
    ...     cj.Measurements({"x": data}),
    ...     {"stiffness": stiffness},
    ...     boundaries=[0.15],
    ...     guess={"stiffness": 95.0},
    ...     progress=False,
    ... )
    >>> bool(abs(found.gaps).max() < 1e-6)
    True
    """

    fit: Fit
    boundaries: Float[np.ndarray, " K"]
    gaps: Float[np.ndarray, "K d"]

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
    settings: Settings | None = None,
    *,
    start_time: float = 0.0,
    guess: Guess | None = None,
    continuity: float = 1e-9,
    max_iterations: int = 50,
    tolerance: float = 1e-3,
    progress: bool | OnIteration = True,
) -> ShootingFit:
    """Estimate parameters, and with them the states at the boundaries between windows.

    **Arguments:**

    - `scene`, `state`, `measurements`, `parameters`, `settings`, `start_time`, `guess`,
      `max_iterations`, `tolerance`, `progress`: as in `identify`. An iteration runs all windows.
    - `boundaries`: rising times, s, inside the record, at which windows meet. Windows should be
      shorter than the convergence horizon (see `horizon`), but long enough for their samples to
      determine the state. Each boundary is moved to the sample in the later half of its window at
      which all contacts are farthest open. The first window is fitted as a record by itself: if
      the guess is far off, fit that by `identify` with `grow`, and pass the estimates as the guess.
    - `continuity`: gap in m that counts as one standard deviation of a measurement; in velocities,
      a hundred times as much in m/s. Choose tolerances of the settings below it.

    **Returns:** a `ShootingFit`. The covariance of the parameters allows for the starts, which are
    estimated with them.

    **Raises:** `ValueError` for arguments that no fit can use.

    >>> spring = cj.SpringDamper("ground", "ball", (0, 0, 0), (0, 0, 0), stiffness=100.0)
    >>> scene = cj.Scene({"ball": cj.Body(1.0, (1e-3, 1e-3, 1e-3))}, forces={"spring": spring})
    >>> state = cj.State({"ball": cj.body_state((0.1, 0, 0))})  # 0.1 cos(10 t)
    >>> stiffness = cj.Parameter(lambda scene: scene.forces["spring"].stiffness, cj.Log())
    >>> times, x = np.linspace(0.01, 0.3, 30), cj.quantities.Position("ball", "x")
    >>> data = cj.Series(x, times, 0.1 * np.cos(10.0 * times), noise=1e-4)
    >>> found = cj.identify_by_shots(
    ...     scene,
    ...     state,
    ...     cj.Measurements({"x": data}),
    ...     {"stiffness": stiffness},
    ...     boundaries=[0.15],
    ...     guess={"stiffness": 95.0},
    ...     progress=False,
    ... )
    >>> print(f"{found.fit.estimates['stiffness']:.2f} N/m")
    100.00 N/m
    """
    measurements.check(scene)
    with_bristles = sorted(scene.bristle_laws())
    require(
        not with_bristles,
        "scene",
        with_bristles,
        "without bristles: where a window begins, deflections of closed contacts are not estimated",
        "fit a record with bristles by identify(), with `grow` if it is long, or take an "
        "AbstractFriction such as Stribeck",
    )
    require_count("max_iterations", max_iterations, "allow one run")
    require_positive("tolerance", tolerance, "1e-3 standard deviations suffice")
    require_positive("continuity", continuity, "give a gap in m, far below the clearance")
    problem = Shooting(scene, state, measurements, parameters, boundaries, start_time, settings)
    row = start_coordinates(scene, state, parameters, guess, None)[0]
    at = problem.begin(row)
    with iteration_callback(progress, parameters, 1) as on_iteration:
        searches = _Searches(problem, continuity, tolerance, max_iterations, on_iteration)
        best = searches.reach(at, problem.ends[0])
        for end in problem.ends[1:]:
            problem.add(best)
            best = searches.reach(best.coordinates, end)
    misfit = problem.of_parameters(best)
    whole = Search(row, tuple(searches.windows), misfit)
    units = {n: p.variation.unit_in(scene, state) for n, p in parameters.items()}
    fitted = problem.base.scene_and_state(misfit.coordinates)
    fit = Fit(*fitted, dict(parameters), units, measurements, (whole,), whole)
    starts = [piece.start for piece in problem.pieces[1:]]
    return ShootingFit(fit, np.array(starts), best.gaps)


@dataclass
class _Searches:
    """Searches over more and more of the record, and in `windows` how each of them went."""

    problem: Shooting
    continuity: float
    tolerance: float
    max_iterations: int
    on_iteration: OnFitIteration
    windows: list[WindowSearch] = field(default_factory=list)

    def reach(self, at: np.ndarray, end: float, halvings: int = HALVINGS) -> WindowsMisfit:
        """The best fit of all windows, the last one up to `end`, s, from unknowns `at`; in halves
        if the search ends far off."""
        _, reached = self.problem.last_span
        best = self._search(at, end)
        if self.windows[-1].iterations[-1].decrement < FAR or halvings == 0:
            return best
        for until in (0.5 * (reached + end), end):
            best = self.reach(at, until, halvings - 1)
            at = best.coordinates
        return best

    def _search(self, at: np.ndarray, end: float) -> WindowsMisfit:
        problem = self.problem
        problem.extend(end)
        best, iterations, ending = search_in_whole_steps(
            partial(problem.misfit, size=self.continuity),
            at,
            self.tolerance if end == problem.ends[-1] else max(BEFORE_LAST, self.tolerance),
            self.max_iterations,
            lambda one: self.on_iteration(problem.count, problem.without_starts(one)),
        )
        self.windows.append(WindowSearch(float(end), iterations, ending))
        return best

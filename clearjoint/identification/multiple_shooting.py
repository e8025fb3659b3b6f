"""Multiple shooting: records too long for a single run.

Small errors of a guess grow from impact to impact, until the run meets other impacts than the data
tell of, and least squares lead astray. So the record is cut into windows, each short enough to be
followed, with starts of their own that are estimated too. H. G. Bock, *Recent advances in parameter
identification techniques for ODE* (1983).

The parameters of the guess should come from a fit of the record's beginning. With these the
windows' starts are found one after the other, each near where the window before leads, so that all
follow the data; and boundaries are moved into flight, since a start that may or may not touch makes
the misfit jump. Then everything is fitted together, and what a window leads to and where the next
one starts are tied ever more closely.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from ..bodies import State
from ..estimands import Parameter
from ..integration import Integration
from ..measurements import Measurements
from ..scene import Scene
from .fit import Fit, Search, Window
from .identify import Tell, shown
from .levenberg_marquardt import search
from .shooting import BEFORE_LAST, Shooting
from .starts import Guess, start_coordinates

TRUST = 1e4
"""In the model at first: gaps outweigh the data by far, and damping of what they weigh would hold
the rest."""
TIGHTENING = 12
"""Iterations, at most, before gaps are counted more strictly: while they are wide, the data hardly
see some combinations, along which a search would creep."""


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
      to the sample in the later half of its window at which all contacts are farthest open.
    - `continuity`: gap in m that counts as one standard deviation of a measurement in the end; in
      velocities, a hundred times as much in m/s. At first it is the size of the gaps that are left
      when every window follows the data by itself.

    **Returns:** a `ShootingFit`; its covariance is that of the parameters, all starts estimated.

    **Raises:** `ValueError` for arguments that no fit can use.
    """
    problem = Shooting(scene, state, measurements, parameters, boundaries, start_time, integration)
    row = start_coordinates(scene, state, parameters, guess, None)[0]
    at = problem.followed(row)
    windows, best = [], None
    with shown(progress, parameters, 1) as tell:
        for size in problem.sizes(at, continuity):
            last = size == continuity
            best, iterations, ending = search(
                partial(problem.evaluate, size=size),
                at,
                np.full(len(at), np.inf),
                tolerance if last else BEFORE_LAST,
                max_iterations if last else min(TIGHTENING, max_iterations),
                lambda one: tell(problem.samples, problem.of_parameters(one)),
                TRUST,
            )
            at = best.coordinates
            windows.append(Window(float(problem.pieces[-1].end), iterations, ending))
    assert best is not None
    found = problem.condensed(best)
    whole = Search(row, tuple(windows), found)
    units = {n: p.variation.unit_in(scene, state) for n, p in parameters.items()}
    made = problem.base.made(found.coordinates)
    fit = Fit(*made, dict(parameters), units, measurements, (whole,), whole)
    starts = [piece.start for piece in problem.pieces[1:]]
    return ShootingFit(fit, np.array(starts), best.gaps)

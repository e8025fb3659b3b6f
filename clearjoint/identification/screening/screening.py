"""Starts found by runs without derivatives, over a record that grows.

Impacts that predicted and measured peaks do not share leave chi squared without a slope towards
each other, and later ones give it many minima. So the whole neighbourhood of a guess is looked at,
but only as far as the data of an early part of the record tell its points apart; then anew among
those that are left, over as much more of the record as those allow, and so on to its end.

It shrinks level sets like nested sampling (J. Skilling, *Nested sampling for general Bayesian
computation*, 2006), of a misfit that grows with the record.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ...fields.checks import require, require_count
from ...simulation.run.progress_bars import ProgressBar, telling_of_compiling
from ..starts import half_widths
from .level_sets import among, apart, level, reached
from .misfit_curves import SideBySide

LEVEL = 0.99
"""Probability of the excess of chi squared up to which points are kept."""
FEW = 4
"""Points that a round's runs must still tell from the best: they go no farther."""
FIRST = 4
"""Times as many points in the first round."""
NEIGHBOURS = 2
"""Neighbours of a point, over p + 1, whose covariance says where to draw others."""
EIGHTH = 8
"""The first round runs to this part of the record, and farther if nothing is told apart there."""


@dataclass(frozen=True)
class Screening:
    """Starts that are left after screening a box around the guess.

    Every round runs a number of points, without derivatives and side by side, and keeps those that
    the data do not tell from the best, up to where just so many are left. The next round draws
    its points among them. It ends with the record.

    **Arguments:**

    - `number`: of new points in a round; in the first, which fills the box evenly, four times as
      many. More for more than three or four parameters.
    - `spread`: half the width of the box, in the coordinates of the scales (of a `Log` scale: 1 is
      a factor of e both ways): one number, or one by parameter.
    - `keep`: points that are kept in a round.
    - `finish`: starts of searches among those kept last: the best, and others far from it.
    - `smoothing`: number of times over which residuals are averaged, so that predicted and
      measured peaks that just miss each other are told from those that are far apart.
    - `rounds`: at most.
    - `passes`: at most. Another one, with other random numbers, follows while the best search ends
      at a chi squared that noise does not explain.
    - `seed`: of the generator.

    >>> cj.Screening(number=80, spread={"clearance": 0.5}).finish
    4
    """

    number: int = 160
    spread: float | Mapping[str, float] = 1.0
    keep: int = 32
    finish: int = 4
    rounds: int = 60
    smoothing: int = 10
    passes: int = 3
    seed: int = 0

    def __post_init__(self) -> None:
        for name in ("number", "finish", "rounds", "smoothing", "passes"):
            require_count(name, getattr(self, name), "leave it at its default")
        sizes = self.spread.values() if isinstance(self.spread, Mapping) else [self.spread]
        wide = all(math.isfinite(size) and size > 0.0 for size in sizes)
        remedy = "pass how far the guess may be off, and leave out what is not in doubt"
        require(wide, "spread", self.spread, "finite and positive", remedy)
        fits = self.finish <= self.keep and FEW < self.keep <= FIRST * self.number
        expected = f"above {FEW}, at least finish = {self.finish}, at most {FIRST} times number"
        require(fits, "keep", self.keep, expected, "keep about a fifth of number")


@dataclass(frozen=True)
class Screened:
    """What a screening left.

    - `points`: (keep, p) coordinates, the best first; `chi_squared`: (keep,) of the averaged
      residuals, up to the time of the last round.
    - `starts`: (finish, p) those of them from which to search.
    - `times`: s, up to which each round could keep its points; `runs`: of all rounds.
    - `complete`: whether they came to the end of the record.

    >>> data = cj.Series(x, times, 0.1 * np.cos(10.0 * times), noise=1e-4)
    >>> fit = cj.identify(
    ...     scene,
    ...     state,
    ...     cj.Measurements({"x": data}),
    ...     {"stiffness": stiffness},
    ...     starts=cj.Screening(number=16, keep=8, finish=1, passes=1),
    ...     progress=False,
    ... )
    >>> fit.screened[0].starts.shape
    (1, 1)
    """

    points: Float[np.ndarray, "keep p"]
    chi_squared: Float[np.ndarray, " keep"]
    starts: Float[np.ndarray, "finish p"]
    times: tuple[float, ...]
    runs: int
    complete: bool


def screen(
    screening: Screening,
    lanes: SideBySide,
    centre: Float[np.ndarray, " p"],
    names: Sequence[str],
    number: int,
    progress: bool,
) -> Screened:
    """Screen the box around a guess (p,); `number` is that of the pass."""
    from scipy.special import chdtri
    from scipy.stats import qmc

    spread = half_widths(screening.spread, names)
    excess = float(chdtri(len(centre), 1.0 - LEVEL))
    generator = np.random.default_rng(screening.seed + number)
    box = qmc.LatinHypercube(len(centre), rng=generator)
    points = centre + spread * (2.0 * box.random(FIRST * screening.number) - 1.0)
    ahead = max(lanes.count // EIGHTH, 1)
    times, runs = [], 0
    bar = ProgressBar(desc="screening", unit=" runs", leave=False, disable=not progress)
    with telling_of_compiling(bar):
        while True:
            curves = lanes.chi_squared(points, ahead, screening.smoothing)
            count = reached(curves, screening.keep, excess)
            misfits = level(curves, count)
            best = np.argsort(misfits, kind="stable")[: screening.keep]
            runs += len(points)
            times.append(lanes.time(count))
            bar.set_postfix_str(f"to {times[-1]:.4g} s")
            bar.update(len(points))
            left, complete = points[best], count >= lanes.count
            if complete or len(times) == screening.rounds:
                starts = left[apart(left, screening.finish)]
                return Screened(left, misfits[best], starts, tuple(times), runs, complete)
            if count >= ahead:
                ahead = min(lanes.count, ahead + ahead // 2 + 1)
                continue
            ahead = min(lanes.count, int(reached(curves, FEW, excess)) + 2)
            bounds = centre - spread, centre + spread
            new = among(left, screening.number, NEIGHBOURS * (len(centre) + 1), bounds, generator)
            points = np.concatenate([left, new])

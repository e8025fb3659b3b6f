"""Search for starts of a fit by runs without derivatives, over a growing part of the record.

If predicted and measured impact peaks don't overlap, the derivatives of chi squared don't lead to
the solution, and later impacts add many minima. The first round therefore uses a part of the record
so short that many points of a box around the guess fit it about equally well. The method shrinks
level sets like nested sampling (J. Skilling, *Nested sampling for general Bayesian computation*,
2006), for a misfit that grows with the record.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ..._fields.checks import require, require_count
from ..._simulation.run.terminal import ProgressBar
from .. import goodness_of_fit as statistics
from ..comparison import Comparison
from ..points import Point, chi_squared_over, drawn_among, far_apart, filled, reached
from ..starts import half_widths

LEVEL = 0.99
"""Points fit about as well as the best if their chi squared exceeds the smallest by at most the
quantile of the chi squared distribution with p degrees of freedom at this level."""
LOOSER = 1000.0
"""Tolerance of the integration in screening runs, which only rank points, relative to the fit's."""
STILL_FITTING = 4
"""The next round runs over the part of the record that this number of the present points fit."""
FIRST = 4
"""Ratio of the number of points in the first round, which fills the whole box, to the number of new
points in each other round."""
FIRST_SHARE = 1 / 8
"""Share of the record over which the first round runs: most points of the box fit only an early
part. If this share is too short, the runs are repeated over more of the record."""


@dataclass(frozen=True)
class Screening:
    """Starts of a fit, found by screening a box around the guess.

    Every round runs points without derivatives. It finds how far into the record at least `keep` of
    them fit it about as well as the best, and keeps so many. The next round runs these again, with
    new points drawn among them. Screening ends with the record, or after `rounds` rounds.

    **Arguments:**

    - `number`: number of new points in a round. The first round, which fills the box evenly, has
      four times as many. Use a larger number for more than three or four parameters.
    - `spread`: half the width of the box, as of `Starts`.
    - `finish`: number of starts among the points kept last: the best, and others far from it.
    - `rounds`: maximum number of rounds. If runs were too short to choose among the points, the
      same points run over more of the record, which counts as another round.
    - `smoothing`: number of successive sample times over which the residuals of each series are
      averaged, so that the misfit of a predicted and a measured peak depends on their distance in
      time. Where a series has no sample, its residual counts as zero.
    - `passes`: maximum number of passes. A pass is a whole screening, followed by a fit from each
      of its starts. Another pass, with other random numbers, follows while noise doesn't explain
      the chi squared of the best fit.

    **Raises:** `ValueError` for a `number`, `keep`, `finish`, `rounds`, `smoothing` or `passes`
    that is not a positive integer, for a `spread` that is not finite and positive, and for a `keep`
    below 5, below `finish`, or above 4 times `number`.

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
        for name in ("number", "keep", "finish", "rounds", "smoothing", "passes"):
            require_count(name, getattr(self, name), "leave it at its default")
        require_count("seed", self.seed, "pass 0", zero=True)
        sizes = self.spread.values() if isinstance(self.spread, Mapping) else [self.spread]
        wide = all(math.isfinite(size) and size > 0.0 for size in sizes)
        remedy = "pass the possible error of the guess, and leave out well-known parameters"
        require(wide, "spread", self.spread, "finite and positive", remedy)
        # With `STILL_FITTING` points or fewer, all points kept would fit the next part of the
        # record, and a round cannot keep more points than the first one has.
        fits = self.finish <= self.keep and STILL_FITTING < self.keep <= FIRST * self.number
        expected = (
            f"above {STILL_FITTING}, at least finish = {self.finish}, at most {FIRST} times number"
        )
        require(fits, "keep", self.keep, expected, "keep about a fifth of number")


@dataclass(frozen=True)
class Screened:
    """Result of one pass of a `Screening`, for p parameters.

    - `points`: (keep, p) points kept last, the best first.
    - `chi_squared`: (keep,) of these points up to the last of `times`; see `Screening.smoothing`.
    - `starts`: (finish, p) the points from which to search.
    - `times`: end of the part of the record that each round used, s.
    - `runs`: number of runs in all rounds.
    - `complete`: whether the last round reached the end of the record.

    >>> data = cj.Measurements({"x": cj.Series(x, times, 0.1 * np.cos(10.0 * times), noise=1e-4)})
    >>> options = {"starts": cj.Screening(number=16, keep=8, finish=1, passes=1), "progress": False}
    >>> fit = cj.identify(scene, state, data, {"stiffness": stiffness}, **options)
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
    screening: Screening, compared: Comparison, centre: Point, index: int, progress: bool
) -> Screened:
    """Make one pass of a `Screening`: find starts of a fit in the box around the guess `centre`, by
    runs of `compared` without derivatives. Each pass has an `index`, from 0, and random numbers of
    its own; `progress` tells whether to show a progress bar."""
    spread = half_widths(screening.spread, tuple(compared.parameters))
    excess = statistics.chi_squared_exceeded(1.0 - LEVEL, len(centre))
    generator = np.random.default_rng(screening.seed + index)
    bounds = centre - spread, centre + spread
    points = filled(*bounds, FIRST * screening.number, generator)
    # Number of the record's times over which the points of this round run.
    ahead = max(int(FIRST_SHARE * compared.count), 1)
    times, runs = [], 0
    with ProgressBar(progress, desc="screening", unit=" runs") as bar:
        while True:
            curves = compared.chi_squared(points, ahead, screening.smoothing)
            # Number of times over which enough points fit about as well as the best. It may be a
            # fraction, at which the points' chi squared is interpolated.
            count = reached(curves, screening.keep, excess)
            misfits = chi_squared_over(curves, count)
            best = np.argsort(misfits, kind="stable")[: screening.keep]
            runs += len(points)
            times.append(compared.time(count))
            bar.set_postfix_str(f"to {times[-1]:.4g} s")
            bar.update(len(points))
            kept, complete = points[best], count >= compared.count
            if complete or len(times) == screening.rounds:
                starts = kept[far_apart(kept, screening.finish)]
                return Screened(kept, misfits[best], starts, tuple(times), runs, complete)
            # If `keep` points fit up to the end of these runs, the runs were too short to choose
            # among the points: the same points run over a part about 1.5 times as long.
            if count >= ahead:
                ahead = min(compared.count, ahead + ahead // 2 + 1)
                continue
            # Hardly any new point will fit more of the record than the best present ones. The
            # number of times that these fit is rounded up, and one more shows where their fit ends.
            ahead = min(compared.count, int(reached(curves, STILL_FITTING, excess)) + 2)
            new = drawn_among(kept, screening.number, bounds, generator)
            points = np.concatenate([kept, new])

"""Restitution over impact speed, from bounce intervals and from drop-rebound heights."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares, root_scalar

import clearjoint as cj
from studies.real_bounces.ball import fall_speed, landing_speed, launch_speed, rise_speed
from studies.real_bounces.bounce_files import Drops

OUTLIER = 5.0
"""Distance from the median of a cell, in scatters, beyond which a point is left out."""
WITHIN_ONE = 0.6827
"""Fraction of a normal distribution within one standard deviation."""


@dataclass(frozen=True)
class Points:
    """Restitutions of N impacts.

    - `speed`: (N,) impact speeds, m/s.
    - `restitution`: (N,).
    - `scatter`: standard deviation of the restitution among impacts of one cell.
    - `cell`: (N,) number of the cell: a bounce of a series, or a drop height.
    - `left_out`: reasons for points left out, a line each.
    """

    speed: np.ndarray
    restitution: np.ndarray
    cell: np.ndarray
    scatter: float
    left_out: tuple[str, ...]

    def means(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return speed, restitution and its standard error of each cell."""
        cells = [self.cell == number for number in np.unique(self.cell)]
        speed, restitution = (
            np.array([values[cell].mean() for cell in cells])
            for values in (self.speed, self.restitution)
        )
        return speed, restitution, self.scatter / np.sqrt([cell.sum() for cell in cells])


def from_intervals(series: tuple[np.ndarray, ...], terminal: float) -> Points:
    """Return the restitutions of impacts between two flights.

    A throw is used up to an interval that repeats the one before to the last digit, which is a
    copy.
    """
    rows, left_out = [], []
    for number, intervals in enumerate(series):
        for throw, column in enumerate(intervals.T):
            good = whole(column)
            if len(good) < len(column):
                left_out.append(
                    f"series {number + 1}, throw {throw + 1}: from interval {len(good) + 1}, "
                    f"{column[len(good)]:.6f} s, a copy of the one before"
                )
            launches = np.array([launch_speed(interval, terminal) for interval in good])
            landings = [landing_speed(launch, terminal) for launch in launches]
            for bounce, (after, before) in enumerate(zip(launches[1:], landings, strict=False)):
                cell = 100 * number + bounce
                rows.append((before, after / before, cell))
    return _clean(rows, left_out)


def whole(intervals: np.ndarray) -> np.ndarray:
    """Return the intervals of a throw up to the first that copies the one before."""
    copies = np.flatnonzero(np.diff(intervals) == 0.0)
    return intervals if len(copies) == 0 else intervals[: copies[0] + 1]


def from_drops(drops: Drops, terminal: float) -> Points:
    """Return the restitutions of drops: speed of the rebound over speed of the fall."""
    rows = [
        (fall_speed(height, terminal), rise_speed(reading, terminal), number)
        for number, (height, readings) in enumerate(zip(drops.heights, drops.rebounds, strict=True))
        for reading in readings
    ]
    return _clean([(before, after / before, cell) for before, after, cell in rows], [])


def _clean(rows: list[tuple[float, float, int]], left_out: list[str]) -> Points:
    """Return the points within `OUTLIER` scatters of the median of their cell."""
    speed, restitution, cell = (np.array(column) for column in zip(*rows, strict=True))
    numbers, where = np.unique(cell, return_inverse=True)
    medians = np.array([np.median(restitution[cell == number]) for number in numbers])
    away = restitution - medians[where]
    rough = float(np.quantile(np.abs(away[away != 0.0]), WITHIN_ONE))
    kept = np.abs(away) <= OUTLIER * rough
    left_out = left_out + [
        f"{restitution[k]:.3f} at {speed[k]:.2f} m/s, {away[k] / rough:+.1f} scatters from the "
        f"median of its cell"
        for k in np.flatnonzero(~kept)
    ]
    speed, restitution, cell = speed[kept], restitution[kept], cell[kept]
    within = [restitution[cell == number] for number in np.unique(cell)]
    squares = sum(float(np.sum((values - values.mean()) ** 2)) for values in within)
    scatter = np.sqrt(squares / (len(speed) - len(within)))
    return Points(speed, restitution, cell.astype(int), float(scatter), tuple(left_out))


@dataclass(frozen=True)
class Fit:
    """Fit of e = 1 - loss (v/(1 m/s))^power by weighted least squares.

    - `values`: (loss, power); the power is 0 for a constant.
    - `errors`: standard errors; `covariance`: of the estimated values, (p, p). Both are widened by
      the square root of chi^2 over the degrees of freedom if that exceeds one: cells differ by more
      than their scatter explains.
    - `chi2`, `degrees_of_freedom`: of the points.
    """

    values: tuple[float, float]
    errors: tuple[float, float]
    covariance: np.ndarray
    chi2: float
    degrees_of_freedom: int

    def at(self, speed: np.ndarray) -> np.ndarray:
        """Return the restitution at speeds in m/s."""
        return restitution_at(np.array(self.values), speed)

    def error_at(self, speed: np.ndarray) -> np.ndarray:
        """Return the standard error of the restitution at speeds in m/s."""
        loss, power = self.values
        slopes = np.stack([speed**power, loss * speed**power * np.log(speed)])
        slopes = slopes[: len(self.covariance)]
        return np.sqrt(np.einsum("in,ij,jn->n", slopes, self.covariance, slopes))

    @property
    def akaike(self) -> float:
        """Akaike's criterion chi^2 + 2 p, in units of the scatter of the points."""
        return self.chi2 + 2 * len(self.covariance)


def restitution_at(values: np.ndarray, speed: np.ndarray) -> np.ndarray:
    """Return 1 - loss v^power; the power is 0 unless given."""
    power = values[1] if len(values) > 1 else 0.0
    return 1.0 - values[0] * speed**power


def fit(points: Points, constant: bool) -> Fit:
    """Fit a restitution that is constant, or falls with a power of the speed."""
    loss = 1.0 - float(points.restitution.mean())

    def residuals(values: np.ndarray) -> np.ndarray:
        away = restitution_at(values, points.speed) - points.restitution
        return away / points.scatter

    start = [loss] if constant else [loss, 0.0]
    found = least_squares(residuals, start, x_scale="jac", xtol=1e-12, ftol=1e-12)
    degrees_of_freedom = len(points.speed) - len(start)
    chi2 = 2.0 * float(found.cost)
    covariance = np.linalg.inv(found.jac.T @ found.jac) * max(1.0, chi2 / degrees_of_freedom)
    errors = np.sqrt(np.diag(covariance))
    values = (float(found.x[0]), 0.0 if constant else float(found.x[1]))
    spread = (float(errors[0]), 0.0 if constant else float(errors[1]))
    return Fit(values, spread, covariance, chi2, degrees_of_freedom)


def requested(law: type, delivered: float) -> float | None:
    """Return the restitution to request of a law, or ``None`` if it cannot deliver one."""

    def lacking(value: float) -> float:
        return float(law(value, 1e9).delivered_restitution()) - delivered

    lowest = 1e-6
    if lacking(lowest) > 0.0 or delivered >= 1.0:
        return None
    return float(root_scalar(lacking, bracket=(lowest, 1.0), xtol=1e-12).root)


LAWS = (cj.laws.HuntCrossley, cj.laws.LankaraniNikravesh, cj.laws.Flores2011)

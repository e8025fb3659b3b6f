"""Fits of the pendulum to measured swings by sensitivities."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

import clearjoint as cj
from studies.real_pendulum.pendulum import (
    GRAVITY,
    HINGE,
    MAX_STEPS,
    RTOL,
    Pendulum,
    parameters,
    predicted,
)
from studies.real_pendulum.swing_files import Swing

TOLERANCE = 1e-2
"""Tolerance in standard deviations; errors of runs at `RTOL` hide smaller changes."""


@dataclass(frozen=True)
class SwingFit:
    """Fit of a pendulum to a swing.

    - `pendulum`: estimates; `names`: estimated parameters.
    - `errors`: standard errors by name, after Newey and West, for residuals that are correlated
      over `LAGS` periods; `naive`: as if residuals were independent.
    - `residuals`: (N,) measured minus fitted angles, rad.
    - `evaluations`: runs with derivatives.
    """

    pendulum: Pendulum
    names: tuple[str, ...]
    errors: dict[str, float]
    naive: dict[str, float]
    residuals: np.ndarray
    evaluations: int

    @property
    def rms(self) -> float:
        """Root mean square of the residuals, rad."""
        return float(np.sqrt(np.mean(self.residuals**2)))

    @property
    def correlation(self) -> float:
        """Correlation of successive residuals."""
        return float(np.corrcoef(self.residuals[:-1], self.residuals[1:])[0, 1])


LAGS = 2.0
FRICTIONS = ("viscous", "coulomb", "quadratic")
SIZES = dict.fromkeys((*FRICTIONS, "length", "vertical"), 1e-3) | {"angle": 0.1, "speed": 1.0}
"""Scales of the first steps."""


def fit(swing: Swing, start: Pendulum, names: tuple[str, ...]) -> SwingFit:
    """Estimate named fields of a pendulum by least squares, with non-negative frictions.

    A friction that ends at zero is taken as known to be zero and has no error.
    """
    seen: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}

    def pendulum(values: np.ndarray) -> Pendulum:
        return replace(start, **dict(zip(names, map(float, values), strict=True)))

    def looked_at(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        key = values.tobytes()
        if key not in seen:
            angles, slopes = predicted(pendulum(values), swing.times)
            seen[key] = angles, np.stack([slopes[name] for name in names], axis=1)
        return seen[key]

    found = least_squares(
        lambda values: looked_at(values)[0] - swing.angles,
        [getattr(start, name) for name in names],
        jac=lambda values: looked_at(values)[1],  # pyright: ignore[reportArgumentType]
        bounds=([0.0 if name in FRICTIONS else -np.inf for name in names], np.inf),
        x_scale=[SIZES[name] for name in names],
        xtol=1e-9,
        ftol=1e-9,
    )
    values = np.where(found.active_mask == 0, found.x, 0.0)
    free = tuple(name for name, fixed in zip(names, found.active_mask, strict=True) if not fixed)
    residuals, slopes = -found.fun, np.asarray(found.jac)[:, found.active_mask == 0]
    lags = round(LAGS * period(swing) / float(np.median(np.diff(swing.times))))
    errors, naive = standard_errors(slopes, residuals, lags)
    return SwingFit(
        pendulum(values),
        names,
        dict(zip(free, errors, strict=True)),
        dict(zip(free, naive, strict=True)),
        residuals,
        len(seen),
    )


def standard_errors(
    slopes: np.ndarray, residuals: np.ndarray, lags: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return standard errors (p,) of least squares with slopes (N, p).

    The first allow for correlation of residuals up to a number of lags (W. Newey, K. West 1987),
    the second do not.
    """
    inverse = np.linalg.inv(slopes.T @ slopes)
    scores = slopes * residuals[:, None]
    middle = scores.T @ scores
    for lag in range(1, lags + 1):
        product = scores[lag:].T @ scores[:-lag]
        middle += (1.0 - lag / (lags + 1)) * (product + product.T)
    degrees_of_freedom = len(residuals) - slopes.shape[1]
    naive = inverse * float(residuals @ residuals) / degrees_of_freedom
    return np.sqrt(np.diag(inverse @ middle @ inverse)), np.sqrt(np.diag(naive))


def crossings(swing: Swing) -> np.ndarray:
    """Return the times of passages through the middle, s."""
    away = swing.angles - 0.5 * (swing.angles.max() + swing.angles.min())
    k = np.flatnonzero((away[1:] < 0.0) != (away[:-1] < 0.0))
    share = away[k] / (away[k] - away[k + 1])
    return swing.times[k] + share * np.diff(swing.times)[k]


def period(swing: Swing) -> float:
    """Return twice the median time between passages through the middle, s."""
    return 2.0 * float(np.median(np.diff(crossings(swing))))


def guess(swing: Swing) -> Pendulum:
    """Return a guess: length by the first period and amplitude, little friction.

    **Raises:** `ValueError` for less than a period.
    """
    first = crossings(swing)[:3]
    if len(first) < 3:
        raise ValueError(
            f"{swing.name} passes its middle {len(first)} times: a period, three passages, is the "
            "least that can be fitted."
        )
    amplitude = float(np.abs(swing.angles[swing.times <= first[-1]]).max())
    small = (first[-1] - first[0]) / (1.0 + amplitude**2 / 16 + 11 * amplitude**4 / 3072)
    k = min(5, len(swing.times) - 1)
    speed = (swing.angles[k] - swing.angles[0]) / (swing.times[k] - swing.times[0])
    length = GRAVITY * (small / (2.0 * np.pi)) ** 2
    return Pendulum(length, 1e-3, 0.0, 0.0, 0.0, float(swing.angles[0]), float(speed))


WITHOUT_FRICTION = ("length", "vertical", "angle", "speed")
START = ("vertical", "angle", "speed")
"""Parameters that differ from swing to swing."""

GROW = (2.0, 6.0, 20.0)
"""Ends of the parts that are fitted before the whole swing, in periods. With a slightly wrong
length a long run would end half a swing apart, and a fit would stay there.
"""


def roughly(swing: Swing) -> Pendulum:
    """Return a pendulum with viscous friction only, by fits to growing parts of a swing."""
    pendulum, names = guess(swing), ("viscous", *WITHOUT_FRICTION)
    since = swing.times - swing.times[0]
    for periods in GROW:
        inside = since <= periods * period(swing)
        part = replace(swing, times=swing.times[inside], angles=swing.angles[inside])
        pendulum = fit(part, pendulum, names).pendulum
    return pendulum


def fit_frictions(swing: Swing, rough: Pendulum, frictions: tuple[str, ...]) -> SwingFit:
    """Fit the whole swing with some frictions, which begin with equal shares of the loss."""
    return fit(swing, shared(rough, frictions), (*frictions, *WITHOUT_FRICTION))


def shared(rough: Pendulum, frictions: tuple[str, ...]) -> Pendulum:
    """Return the pendulum with its viscous friction divided among some frictions."""
    mean_speed = 0.5 * abs(rough.speed)
    share = rough.viscous / len(frictions)
    alike = {"viscous": share, "coulomb": share * mean_speed, "quadratic": share / mean_speed}
    return replace(rough, **{"viscous": 0.0} | {name: alike[name] for name in frictions})


def fit_start(swing: Swing, known: Pendulum) -> SwingFit:
    """Fit the start of a swing of a known pendulum."""
    own = guess(swing)
    return fit(swing, replace(known, vertical=0.0, angle=own.angle, speed=own.speed), START)


def identified(swing: Swing, found: SwingFit, rough: Pendulum) -> cj.results.Fit:
    """Fit the same swing by `cj.identify`, with the noise that the residuals show.

    It estimates the parameters that did not end at zero in `found`, from a rough pendulum on, and
    should find the same minimum.
    """
    names = tuple(found.errors)
    begin = shared(rough, tuple(name for name in names if name in FRICTIONS))
    known = parameters(begin)
    channel = cj.quantities.JointAngle(HINGE)
    series = cj.Series(channel, swing.times, swing.angles, found.rms, "rad", swing.name)
    return cj.identify(
        begin.scene(),
        begin.state(),
        cj.Measurements({"angle": series}),
        {"inertia" if name == "length" else name: known[name] for name in names},
        start_time=float(swing.times[0]),
        settings=replace(cj.presets.derivatives, rtol=RTOL, max_steps=MAX_STEPS),
        tolerance=TOLERANCE,
        progress=False,
    )

"""Identification: parameters and initial states that explain measurements best."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ..fields.cautions import PoorFitWarning, caution
from ..fields.checks import require, require_count, require_positive
from ..information.horizon import FitHorizon
from ..measurements.series import Measurements
from ..model.bodies import State
from ..model.scene import Scene
from ..parametrisation.parameter import Parameter
from ..result_codes import RESULTS
from ..simulation.run.progress_bars import ProgressBar, telling_of_compiling
from ..simulation.step import presets
from ..simulation.step.settings import Settings, settings_or
from .checking import check
from .checking import lowest as lowest_of
from .fit import Fit
from .levenberg_marquardt import Ending, Iteration, search_with_damping
from .report import numbered
from .residuals import (
    Experiment,
    RunMisfit,
    Samples,
    check_start,
    experiment,
    run_misfit,
    samples,
)
from .screening.passes import LOOSER, Passes, lowest
from .screening.screening import Screened, Screening
from .searches import Search, WindowSearch
from .starts import Guess, Starts, start_coordinates

OnIteration = Callable[[Iteration], None]
OnFitIteration = Callable[[int, Iteration], None]
"""A function of the number of samples in the fit and of an iteration."""
WINDOW_TOLERANCE = 0.1
"""Tolerance, in standard deviations, of the fits of all windows but the last."""


class FitInterrupted(KeyboardInterrupt):
    """A fit that was stopped by Ctrl-C (SIGINT).

    `fits`: those that had ended, and last the best so far of the one that was interrupted, unless
    it had no run yet.

    >>> cj.FitInterrupted([]).fits
    []
    """

    def __init__(self, fits: Sequence[Fit]):
        text = "The fit was interrupted before its first run had ended."
        if fits:
            values = ", ".join(f"{n} {value:.6g}" for n, value in fits[-1].estimates.items())
            text = (
                f"The fit was interrupted; the best so far has chi squared "
                f"{fits[-1].chi_squared:.6g} of {fits[-1].degrees_of_freedom} expected, at {values}"
                ". "
                "It is in "
                "the exception's `fits`, and a next fit may start from its estimates."
            )
        super().__init__(text)
        self.fits = list(fits)


def identify(
    scene: Scene,
    state: State,
    measurements: Measurements,
    parameters: Mapping[str, Parameter],
    settings: Settings | None = None,
    *,
    start_time: float = 0.0,
    guess: Guess | Sequence[Guess] | None = None,
    starts: Starts | Screening | None = None,
    grow: Sequence[float] = (),
    max_iterations: int = 100,
    tolerance: float = 1e-3,
    horizon: FitHorizon | None = None,
    check_runs: int = 400,
    progress: bool | OnIteration = True,
) -> Fit:
    """Estimate parameters by least squares (Levenberg-Marquardt), from one run at a time.

    **Arguments:**

    - `scene`, `state`, `start_time` s: as in `simulate`; the run goes to the last sample.
    - `measurements`: what was measured, with its noise.
    - `parameters`: what to estimate, by name, and on which scales; see `Parameter`.
    - `guess`: values to start from, by name; a parameter that is left out starts from the scene's
      value. A list of guesses makes a start of each.
    - `starts`: `Starts` draws further starts around the first guess. A `Screening` round the only
      guess instead finds starts by many runs without derivatives, where no slope leads to the
      truth. The fit is the best of all searches; `Fit.searches` has all of them, and `Fit.rivals`
      other minima that fit the data about as well.
    - `grow`: ends, s, of windows of the record that are fitted before the whole: the samples up to
      the first end, then those up to the next, each fit from where the one before ended. After
      some impacts small errors of parameters have grown so far that a fit of the whole record from
      a start far off finds no way down. In these windows each parameter is held near its value at
      the window's start, with its scale's stride as standard deviation, so that those that are not
      seen yet do not run away. The double pendulum's record of 187 ms, five times what a single run
      can fit from a guess far off (`clearjoint.fit_horizon`), is fitted so in 140 runs.
    - `settings`: how to integrate; `clearjoint.presets.identification` unless given. Their
      `max_steps` bound what a run with absurd parameters costs.
    - `max_iterations`: of each window of each start; an iteration is one run.
    - `tolerance`: Gauss-Newton step, in standard deviations of the estimates, at which to end.
    - `horizon`: from `clearjoint.fit_horizon`, to warn if the record is longer than a fit by a
      single run can use.
    - `check_runs`: how thoroughly the covariance is tested once the search has converged. Some
      twenty runs for each parameter compare chi squared, up to four standard errors around the
      estimates, with what the covariance predicts. Where they differ, chi squared has several
      minima close together, or is curved: then so many runs without derivatives, side by side, and
      further rounds among the lowest of them explore it, with local searches in between. The fit
      moves to the lowest minimum found, its intervals cover all points that the data allow, and
      its report says so first. See `Fit.check`; 0 leaves out the test.
    - `progress`: show a line with the iterations, or call a function with each `Iteration`.

    **Raises:** `ValueError` for arguments that no fit can use. `FitInterrupted`, which is a
    `KeyboardInterrupt` and holds the best fit so far, on Ctrl-C. A search that fails raises
    nothing: see `Fit.ending` and `Fit.warnings`.

    **Warns:** `PoorFitWarning` if the fit ends far above the noise, with what to try, in order,
    which `Fit.advice` and the report have too.

    >>> data = cj.Series(x, times, 0.1 * np.cos(10.0 * times), noise=1e-4)
    >>> fit = cj.identify(
    ...     scene,
    ...     state,
    ...     cj.Measurements({"x": data}),
    ...     {"stiffness": stiffness},
    ...     guess={"stiffness": 90.0},
    ...     progress=False,
    ... )
    >>> print(f"{fit.estimates['stiffness']:.3f} N/m")
    100.000 N/m
    """
    return identify_many(
        scene,
        state,
        [measurements],
        parameters,
        settings,
        start_time=start_time,
        guess=guess,
        starts=starts,
        grow=grow,
        max_iterations=max_iterations,
        tolerance=tolerance,
        horizon=horizon,
        check_runs=check_runs,
        progress=progress,
    )[0]


def identify_many(
    scene: Scene,
    state: State,
    measurements: Sequence[Measurements],
    parameters: Mapping[str, Parameter],
    settings: Settings | None = None,
    *,
    start_time: float = 0.0,
    guess: Guess | Sequence[Guess] | None = None,
    starts: Starts | Screening | None = None,
    grow: Sequence[float] = (),
    max_iterations: int = 100,
    tolerance: float = 1e-3,
    horizon: FitHorizon | None = None,
    check_runs: int = 400,
    progress: bool | OnIteration = True,
) -> list[Fit]:
    """`identify` for several sets of measurements of the same channels and times, such as draws of
    the noise: one fit for each.

    >>> data = cj.Series(x, times, 0.1 * np.cos(10.0 * times), noise=1e-4)
    >>> noisy = [data.with_noise(np.random.default_rng(seed)) for seed in range(2)]
    >>> draws = [cj.Measurements({"x": series}) for series in noisy]
    >>> fits = cj.identify_many(scene, state, draws, {"stiffness": stiffness}, progress=False)
    >>> all(abs(fit.estimates["stiffness"] - 100.0) < 1.0 for fit in fits)
    True
    """
    _check(scene, measurements, start_time, grow, max_iterations, tolerance, check_runs)
    settings = settings_or(settings, presets.identification)
    times = measurements[0].times()
    if horizon is not None:
        horizon.warn_if_beyond(float(times[-1]))
    outputs = {name: series.channel for name, series in measurements[0].series.items()}
    runs_with = partial(experiment, scene, state, parameters, outputs, times, start_time)
    runs = runs_with(settings)
    around = starts if isinstance(starts, Starts) else None
    rows = start_coordinates(scene, state, parameters, guess, around)
    passes = None
    if isinstance(starts, Screening):
        require(len(rows) == 1, "guess", len(rows), "one guess, round which to screen", "pass one")
        coarse_runs = runs_with(settings.looser(LOOSER))
        passes = Passes(starts, coarse_runs, rows[0], tuple(parameters), progress is True)
    ends = (*grow, float(times[-1]))
    windows = _Windows(runs, ends, _strides(parameters), tolerance, max_iterations)
    units = {n: p.variation.unit_in(scene, state) for n, p in parameters.items()}
    fits = []
    with iteration_callback(progress, parameters, len(measurements) * len(rows)) as on_iteration:
        for one in measurements:
            searches: list[Search] = []
            screened, checked, stopped = (), None, False
            try:
                screened = windows.search(one, rows, passes, on_iteration, searches)
                best = lowest(searches)
                if check_runs > 0 and best.ending in (Ending.CONVERGED, Ending.STALLED):
                    data = samples(one, len(runs.times))
                    on_check = partial(on_iteration, data.count)
                    checked = check(best.best, runs, data, parameters, check_runs, on_check)
                    best = lowest_of(checked, best)
            except KeyboardInterrupt as interruption:
                if not searches:
                    raise FitInterrupted(fits) from interruption
                best, stopped = lowest(searches), True
            fitted = runs.family.scene_and_state(best.best.coordinates)
            found = tuple(searches), best, screened, horizon, checked
            fits.append(Fit(*fitted, dict(parameters), units, one, *found))
            if stopped:
                raise FitInterrupted(fits)
    _warn_of_poor(fits)
    _warn_of_rough(fits)
    return fits


def _warn_of_poor(fits: Sequence[Fit]) -> None:
    """Warn once of fits that end far above the noise, with the first one's advice."""
    poor = [fit for fit in fits if fit.advice]
    if poor:
        many = "" if len(fits) == 1 else f"{len(poor)} of {len(fits)} fits end so. The first: "
        end = f"{poor[0].ending.value}, chi squared {poor[0].chi_squared:.3g} of "
        caution(
            f"The fit ends far above the noise ({end}{poor[0].degrees_of_freedom} expected). {many}"
            "What to "
            f"try, in this order:\n{numbered(poor[0].advice)}\n",
            PoorFitWarning,
        )


def _warn_of_rough(fits: Sequence[Fit]) -> None:
    """Warn once of fits whose covariance does not describe chi squared around the estimates."""
    rough = [warning for fit in fits for warning in fit.doubts]
    if rough:
        many = "" if len(fits) == 1 else f"{len(rough)} of {len(fits)} fits say so. The first: "
        caution(f"{many}{rough[0]}", PoorFitWarning)


@dataclass(frozen=True)
class _Windows:
    """Windows of the record up to each of the `ends`, s, and how to search in them."""

    runs: Experiment
    ends: tuple[float, ...]
    strides: np.ndarray
    tolerance: float
    max_iterations: int

    def search(
        self,
        measurements: Measurements,
        rows: np.ndarray,
        passes: Passes | None,
        on_iteration: OnFitIteration,
        searches: list[Search],
    ) -> tuple[Screened, ...]:
        """Search from given starts (n, p), or from those that screening leaves; what it left.

        `searches` gets each search as it ends, so that none is lost if the next is interrupted.
        """
        data = samples(measurements, len(self.runs.times))

        def search_from(start: np.ndarray) -> Search:
            searches.append(self._search(data, on_iteration, start))
            if searches[-1].ending is Ending.INTERRUPTED:
                raise KeyboardInterrupt
            return searches[-1]

        if passes is not None:
            return passes.searches(data, search_from)[1]
        for row in rows:
            search_from(row)
        return ()

    def _search(self, data: Samples, on_iteration: OnFitIteration, start: np.ndarray) -> Search:
        """Search from a start (p,) over the windows, one after the other."""
        windows, at = [], start
        best: RunMisfit | None = None
        for end in self.ends:
            part, last = data.until(self.runs.times, end), end == self.ends[-1]
            misfit = partial(run_misfit, self.runs, part, end)
            try:
                best, iterations, ending = search_with_damping(
                    misfit if last else partial(_with_prior, misfit, at, self.strides),
                    at,
                    self.strides,
                    self.tolerance if last else max(self.tolerance, WINDOW_TOLERANCE),
                    self.max_iterations,
                    partial(on_iteration, part.count),
                )
            except KeyboardInterrupt:  # in the first run of the window
                if best is None:
                    raise
                iterations, ending, last = (), Ending.INTERRUPTED, False
            if best.result != RESULTS.successful and ending is not Ending.INTERRUPTED:
                ending = Ending.FAILED
            windows.append(WindowSearch(end, iterations, ending))
            at = best.coordinates
            if ending is Ending.INTERRUPTED:
                if not last:
                    best = run_misfit(self.runs, data, self.ends[-1], at)
                break
        assert best is not None
        return Search(start, tuple(windows), best)


def _strides(parameters: Mapping[str, Parameter]) -> np.ndarray:
    return np.array([parameter.scale.max_step for parameter in parameters.values()])


def _with_prior(
    misfit: Callable[[np.ndarray], RunMisfit],
    centre: np.ndarray,
    strides: np.ndarray,
    at: np.ndarray,
) -> RunMisfit:
    """The misfit at coordinates (p,), as if the coordinates themselves had been measured to be at
    the centre (p,), with the strides (p,) as standard deviations."""
    plain = misfit(at)
    return replace(
        plain,
        residuals=np.append(plain.residuals, (at - centre) / strides),
        jacobian=np.vstack([plain.jacobian, np.diag(1.0 / strides)]),
    )


@contextmanager
def iteration_callback(
    progress: bool | OnIteration, parameters: Mapping[str, Parameter], searches: int
) -> Iterator[OnFitIteration]:
    """A function to call with each iteration: it calls the user's, or shows the iteration in a
    progress line while the context lasts."""
    if callable(progress):
        yield lambda _, iteration: progress(iteration)
        return
    bar = ProgressBar(
        desc="fit" if searches == 1 else f"{searches} fits",
        unit=" runs",
        leave=False,
        disable=not progress,
    )
    with telling_of_compiling(bar):

        def show(count: int, iteration: Iteration) -> None:
            values = [
                f"{name} {float(parameter.scale.value(u)):.6g}"
                for (name, parameter), u in zip(
                    parameters.items(), iteration.coordinates, strict=True
                )
            ]
            bar.set_postfix_str(
                f"chi2/N {iteration.chi_squared / count:.4g}, step {iteration.decrement:.2g} sd, "
                + ", ".join(values)
            )
            bar.update()

        yield show


def _check(
    scene: Scene,
    measurements: Sequence[Measurements],
    start_time: float,
    grow: Sequence[float],
    max_iterations: int,
    tolerance: float,
    check_runs: int,
) -> None:
    remedy = "pass one set of measurements at least"
    require(len(measurements) > 0, "measurements", len(measurements), "not empty", remedy)
    remedy = 'pass cj.Measurements({"probe": cj.Series(...)})'
    for one in measurements:
        kind, fine = type(one).__name__, isinstance(one, Measurements)
        require(fine, "measurements", kind, "Measurements", remedy)
    first = measurements[0]
    first.check(scene)
    for k, one in enumerate(measurements):
        same = list(one.series) == list(first.series) and all(
            series.channel == first[name].channel
            and np.array_equal(series.times, first[name].times)
            for name, series in one.series.items()
        )
        expected = "of the channels and times of the first"
        require(same, f"measurements[{k}]", list(one.series), expected, "fit it by itself")
    times = first.times()
    check_start(start_time, times)
    ends = [start_time, *grow, times[-1]]
    rising = all(a < b for a, b in zip(ends, ends[1:], strict=False))
    require(
        rising,
        "grow",
        list(grow),
        f"rising times between the start, {start_time} s, and the last sample, {ends[-1]} s",
        "leave out the last sample's time, which comes last by itself",
    )
    require_count("max_iterations", max_iterations, "allow one run")
    require_positive("tolerance", tolerance, "1e-3 standard deviations suffice")
    fine = isinstance(check_runs, int) and (check_runs == 0 or check_runs >= 50)
    remedy = "pass 0 to leave out the test"
    require(fine, "check_runs", check_runs, "0, or a whole number from 50", remedy)

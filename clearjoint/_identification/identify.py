"""Estimation of parameters and initial states by least squares."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from .._dynamics.constraint_report import check_names
from .._export.tables import numbered
from .._fields.cautions import PoorFitWarning, caution
from .._fields.checks import (
    as_number,
    require,
    require_count,
    require_positive,
    require_shape,
    require_type,
)
from .._information.horizon import FitHorizon
from .._measurements.series import Measurements
from .._model.bodies import State
from .._model.scene import Scene
from .._parametrisation.parameter import Parameter, values_at
from .._simulation.run.terminal import ProgressBar
from .._simulation.step import presets
from .._simulation.step.settings import Settings, settings_or
from .checking import check
from .comparison import Comparison, OnFitIteration, check_sets, comparison
from .fit import Fit
from .goodness_of_fit import UNLIKELY, chi_squared_p
from .levenberg_marquardt import Ending, Iteration, Search, best_search
from .screening.screening import LOOSER, Screened, Screening, screen
from .starts import Guess, Starts, start_coordinates

OnIteration = Callable[[Iteration], None]
"""Function of the user that is called after each run of a search."""


class FitInterrupted(KeyboardInterrupt):
    """Interruption of a fit by Ctrl-C (SIGINT).

    `fits` has the finished fits and, if `partly` is true, at the end the fit that was interrupted,
    with the best result so far.

    >>> cj.FitInterrupted([]).fits
    []
    """

    def __init__(self, fits: Sequence[Fit], partly: bool = True):
        text = "The fit was interrupted before the first run of a search had ended."
        if fits and not partly:
            text += " The exception's `fits` has the finished fits of earlier sets."
        elif fits:
            values = ", ".join(f"{n} {value:.6g}" for n, value in fits[-1].estimates.items())
            last = fits[-1]
            text = (
                "The fit was interrupted; the best so far has chi squared "
                f"{last.chi_squared:.6g} ({last.degrees_of_freedom} expected), at {values}. It is "
                "in the exception's `fits`. Another fit may start from its estimates."
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
    check_runs: int | None = None,
    progress: bool | OnIteration = True,
) -> Fit:
    """Estimate parameters of a scene and of its initial state from measurements, by least squares.

    The method is that of Levenberg and Marquardt, with the derivatives of runs.

    **Arguments:**

    - `scene`, `state`, `start_time`: as in `simulate`; the run ends at the last sample.
    - `guess`: values to start from, by name. A parameter without one starts from its
      `Parameter.value`, by default the scene's or state's number. Each guess of a list is a start.
    - `starts`: `Starts` draws more starts around the first guess. A `Screening` around a single
      guess finds starts by many runs without derivatives, for data with impacts, where derivatives
      don't lead to the solution. The fit is the best of all searches; `Fit.rivals` has other minima
      that fit the data about as well.
    - `grow`: rising ends of windows of the record, s, that are fitted before the whole record, each
      from the result of the one before. After some impacts small errors of parameters have grown so
      much that a fit of the whole record from a distant start fails. Each window has a normal prior
      around its start, with the scale's `max_step` as standard deviation, so that parameters that
      it doesn't determine stay in range. For example, a record of 187 ms of
      `clearjoint.mechanisms.double_pendulum`, five times as long as a single run can fit from a
      distant guess (`clearjoint.fit_horizon`), takes 140 runs with windows.
    - `settings`: by default `clearjoint.presets.identification`. `max_steps` limits the cost of
      runs with extreme parameters.
    - `max_iterations`: limit for each window of each start; an iteration is one run.
    - `tolerance`: length of the Gauss-Newton step, in standard deviations of the estimates, below
      which a search ends.
    - `horizon`: result of `clearjoint.fit_horizon`, for a warning if the record is too long for a
      fit by a single run.
    - `check_runs`: 0 for no test of the covariance. After a search that neither failed nor reached
      `max_iterations`, about twenty runs for each parameter test whether chi squared rises as the
      covariance predicts, up to four standard errors from the estimates. If it does not, there are
      several minima close together, or chi squared is not quadratic. Up to six rounds of runs
      without derivatives and of local searches then explore it, and the fit moves to the lowest
      minimum. By default this costs about as much as the searches and the test. A number n, 50 or
      more, such as 400, is that of the runs in the first round. With a given n, or after a long
      search, the intervals are those of a posterior, from at most 75 n runs.
    - `progress`: whether to show a line of iterations, or a function called with each `Iteration`.

    **Raises:** `ValueError` for unsupported arguments; `FitInterrupted`, with the best fit so far,
    on Ctrl-C. A search that fails raises no error: see `Fit.ending` and `Fit.warnings`.

    **Warns:** `PoorFitWarning`, with the remedies of `Fit.advice`, if the residuals are far above
    the noise or the best run does not reach the last sample; another `PoorFitWarning` if the test
    of the covariance has failed; `UserWarning` if the record is longer than `horizon` allows.

    >>> data = cj.Measurements({"x": cj.Series(x, times, 0.1 * np.cos(10.0 * times), noise=1e-4)})
    >>> fit = cj.identify(scene, state, data, {"stiffness": stiffness}, progress=False)
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
    check_runs: int | None = None,
    progress: bool | OnIteration = True,
) -> list[Fit]:
    """Estimate parameters from each of several sets of measurements, such as draws of the noise.

    All sets have series of the same names, quantities and times. Other arguments: as `identify`.

    **Raises:** as `identify`, and `ValueError` for no sets, or sets whose series differ in these.

    **Warns:** as `identify`; of several poor fits, a warning shows the first and their number.

    >>> data = cj.Series(x, times, 0.1 * np.cos(10.0 * times), noise=1e-4)
    >>> draws = [data.with_noise(np.random.default_rng(seed)) for seed in range(2)]
    >>> sets = [cj.Measurements({"x": series}) for series in draws]
    >>> fits = cj.identify_many(scene, state, sets, {"stiffness": stiffness}, progress=False)
    >>> all(abs(fit.estimates["stiffness"] - 100.0) < 1.0 for fit in fits)
    True
    """
    check_names(scene, state)
    check_sets(scene, measurements)
    require_shape("start_time", start_time, (), "pass one time in s")
    first_set = measurements[0]
    ends = _ends_of_windows(grow, first_set, start_time)
    expected, remedy = "Starts, a Screening or None", "pass cj.Starts(4), say"
    require_type("starts", starts, Starts | Screening | None, expected, remedy)
    require_count("max_iterations", max_iterations, "allow one run")
    require_positive("tolerance", tolerance, "1e-3 standard deviations suffice")
    # An exploration by fewer points would hardly describe chi squared of several parameters.
    is_number = isinstance(check_runs, int) and (check_runs == 0 or check_runs >= 50)
    remedy = "pass 0 to leave out the test"
    expected = "None, 0, or a whole number from 50"
    require(check_runs is None or is_number, "check_runs", check_runs, expected, remedy)
    settings = settings_or(settings, presets.identification)
    if horizon is not None:
        horizon.warn_if_beyond(ends[-1])
    # All sets have the same quantities and times, so that one compiled program serves all fits.
    compared = comparison(scene, state, first_set, parameters, start_time, settings)
    around = starts if isinstance(starts, Starts) else None
    rows, coarse = start_coordinates(scene, state, compared.parameters, guess, around), compared
    if isinstance(starts, Screening):
        require(len(rows) == 1, "guess", len(rows), "one guess, for a screening", "pass one")
        # A screening only ranks points, for which cheaper runs are accurate enough.
        looser = settings.looser(LOOSER)
        coarse = comparison(scene, state, first_set, parameters, start_time, looser)
    problem = _Problem(
        compared, coarse, rows, starts, ends, tolerance, max_iterations, check_runs, horizon
    )
    fits: list[Fit] = []
    searches = len(measurements) * len(rows)
    with iteration_callback(progress, compared.parameters, searches) as on_iteration:
        for measured in measurements:
            fit, stopped = problem.fit(measured, on_iteration, show=progress is True)
            fits += [] if fit is None else [fit]
            if stopped:
                raise FitInterrupted(fits, partly=fit is not None)
    warn_of(fits)
    return fits


def _ends_of_windows(
    grow: Sequence[float], measured: Measurements, start_time: float
) -> tuple[float, ...]:
    """Return the ends of the windows to fit one after another, s, the last sample's time last."""
    first, last = measured.times()[[0, -1]].tolist()
    ends = (*np.ravel(as_number(grow, "grow", "s")).tolist(), last)
    expected = f"later than the start of the run, {start_time} s"
    remedy = "pass start_time, or later samples"
    require(last > start_time, "measurements", last, expected, remedy)
    # The first window must have a sample.
    rising = ends[0] >= first and all(a < b for a, b in pairwise((start_time, *ends)))
    expected = f"rising times between the first sample, {first} s, and the last, {last} s"
    remedy = "leave out the time of the last sample, which is added"
    require(rising, "grow", ends[:-1], expected, remedy)
    return ends


@dataclass(frozen=True)
class _Problem:
    """Arguments that all fits of `identify_many` share; `fit` fits one set of measurements.

    - `compared`: the experiment, with the first set of measurements.
    - `coarse`: the same with the looser tolerances of a screening, if there is one.
    - `rows`: (S, p) points from which searches start; for a screening, the centre of its box.
    - `ends`: ends of the growing windows and of the record, s.
    - Other fields are arguments of `identify`.
    """

    compared: Comparison
    coarse: Comparison
    rows: np.ndarray
    starts: Starts | Screening | None
    ends: Sequence[float]
    tolerance: float
    max_iterations: int
    check_runs: int | None
    horizon: FitHorizon | None

    def fit(
        self, measurements: Measurements, on_iteration: OnFitIteration, show: bool
    ) -> tuple[Fit | None, bool]:
        """Fit one set of measurements; with `show`, show progress bars. Return the fit, ``None`` if
        interrupted before any run had ended, and whether the user interrupted the fit."""
        compared, parameters = self.compared.of(measurements), self.compared.parameters
        searches: list[Search] = []
        screened: list[Screened] = []
        checked, stopped = None, False

        def search_from(start: np.ndarray) -> None:
            # The search is kept before the interruption goes on, so that its best run is not lost.
            search = compared.search(
                start, self.ends, self.tolerance, self.max_iterations, on_iteration
            )
            searches.append(search)
            if search.ending is Ending.INTERRUPTED:
                raise KeyboardInterrupt

        try:
            if isinstance(self.starts, Screening):
                coarse = self.coarse.of(measurements)
                freedom = compared.data.count - len(parameters)
                for number in range(self.starts.passes):
                    screened.append(screen(self.starts, coarse, self.rows[0], number, show))
                    for start in screened[-1].starts:
                        search_from(start)
                    p_value = chi_squared_p(best_search(searches).best.chi_squared, freedom)
                    # Noise explains a p-value that is not small. Without degrees of freedom it is
                    # NaN, and one pass must do.
                    if not p_value < UNLIKELY:
                        break
            else:
                for row in self.rows:
                    search_from(row)
            best = best_search(searches)
            # Searches that failed or reached their limit of iterations have no minimum to check.
            if self.check_runs != 0 and best.ending in (Ending.CONVERGED, Ending.STALLED):
                # In runs with derivatives, each of which costs as much as 1 + p of a screening.
                cost = sum(search.evaluations for search in searches)
                cost += sum(screening.runs for screening in screened) // (1 + len(parameters))
                checked = check(best.best, compared, self.check_runs, on_iteration, cost, show)
                # The check may have found lower minima by local searches. Of equal chi squared the
                # first counts: the fit's own search, then the last local one, which started from
                # the lowest minimum.
                best = best_search((best, *checked.searches[::-1]))
        except KeyboardInterrupt:
            if not searches:
                return None, True
            best, stopped = best_search(searches), True
        runs = compared.runs
        scene, state = runs.base.family.scene_and_state(runs.with_held(best.best.coordinates))
        fit = Fit(
            scene=scene,
            state=state,
            parameters=dict(parameters),
            units=dict(compared.units),
            measurements=measurements,
            searches=tuple(searches),
            best=best,
            screened=tuple(screened),
            horizon=self.horizon,
            check=checked,
            start_time=float(runs.base.start_time),
        )
        return fit, stopped


def warn_of(fits: Sequence[Fit]) -> None:
    poor = [fit for fit in fits if fit.advice]
    if poor:
        many = "" if len(fits) == 1 else f"{len(poor)} of {len(fits)} fits are; the first: "
        caution(
            f"The residuals of the fit are far above the noise ({many}{poor[0].ending.value}, chi "
            f"squared {poor[0].chi_squared:.3g}, {poor[0].degrees_of_freedom} expected). Remedies, "
            f"in this order:\n{numbered(poor[0].advice)}\n",
            PoorFitWarning,
        )
    # Fits whose test of the covariance has failed, such as where chi squared is rough.
    rough = [warning for fit in fits for warning in fit.doubts]
    if rough:
        many = "" if len(fits) == 1 else f"In {len(rough)} of {len(fits)} fits; the first: "
        caution(f"{many}{rough[0]}", PoorFitWarning)


@contextmanager
def iteration_callback(
    progress: bool | OnIteration, parameters: Mapping[str, Parameter], searches: int
) -> Iterator[OnFitIteration]:
    """Yield the function to call after each run: the user's, or one that updates a progress bar,
    which is hidden if `progress` is false. `searches` is the total number of searches."""
    if callable(progress):
        # The user's function does not get the number of samples.
        yield lambda samples, iteration: progress(iteration)
        return
    name = "fit" if searches == 1 else f"{searches} fits"
    with ProgressBar(progress, desc=name, unit=" runs") as bar:

        def show(count: int, iteration: Iteration) -> None:
            values = values_at(parameters, iteration.coordinates)
            bar.set_postfix_str(
                f"chi2/N {iteration.chi_squared / count:.4g}, step {iteration.decrement:.2g} sd, "
                + ", ".join(f"{name} {value:.6g}" for name, value in values.items())
            )
            bar.update()

        yield show

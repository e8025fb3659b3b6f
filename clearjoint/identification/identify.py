"""Identification: parameters and initial states that explain measurements best."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial

import numpy as np
from tqdm import tqdm

from ..fields.checks import require, require_count, require_positive
from ..information.horizon import Horizon
from ..measurements.series import Measurements
from ..model.bodies import State
from ..model.scene import Scene
from ..parametrisation.parameter import Parameter
from ..results import RESULTS
from ..simulation.settings import Integration
from .fit import Fit, Search, Window
from .levenberg_marquardt import Ending, Iteration, search
from .residuals import Evaluated, Experiment, Samples, check_start, evaluate, experiment, samples
from .screening.passes import Passes, coarser, lowest
from .screening.screening import Screened, Screening
from .starts import Guess, Starts, start_coordinates

Tell = Callable[[Iteration], None]
TellOf = Callable[[int, Iteration], None]
"""With the number of samples that are fitted in front."""
WINDOW_TOLERANCE = 0.1
"""Tolerance of windows that others follow."""


def identify(
    scene: Scene,
    state: State,
    measurements: Measurements,
    parameters: Mapping[str, Parameter],
    *,
    start_time: float = 0.0,
    guess: Guess | Sequence[Guess] | None = None,
    starts: Starts | Screening | None = None,
    grow: Sequence[float] = (),
    integration: Integration | None = None,
    max_iterations: int = 100,
    tolerance: float = 1e-3,
    horizon: Horizon | None = None,
    progress: bool | Tell = True,
) -> Fit:
    """Estimate parameters by least squares (Levenberg-Marquardt), from one run at a time.

    **Arguments:**

    - `scene`, `state`, `start_time` s: as in `simulate`; the run goes to the last sample.
    - `measurements`: what was measured, with its noise.
    - `parameters`: what to estimate, by name, and on which scales; see `Parameter`.
    - `guess`: values to start from, by name; those of the scene for others. A list of them is as
      many starts.
    - `starts`: further starts drawn around the first guess; see `Starts`. Or a `Screening` round
      the only guess, which finds starts by many runs without derivatives where no slope leads to
      the truth. The best end wins, `Fit.searches` has all, and `Fit.rivals` are minima that the
      data do not tell from it.
    - `grow`: times, s, up to which the samples are fitted first, one after the other, each from
      where the one before ended. After some impacts small errors of parameters have grown so far
      that a start farther off finds no way down. In these windows a stride of each scale holds
      the parameters to where the window began, so that those not seen yet do not run away.
    - `integration`: tolerances and method; `Integration()` unless given. Its `max_steps` bounds
      what a run with absurd parameters costs.
    - `max_iterations`: of each window of each start; an iteration is one run.
    - `tolerance`: Gauss-Newton step, in standard deviations of the estimates, at which to end.
    - `horizon`: that of `clearjoint.horizon`: warn if the record goes beyond what a single run can
      use.
    - `progress`: show a line with the iterations, or call a function with each `Iteration`.

    **Raises:** `ValueError` for arguments that no fit can use. A search that fails raises nothing:
    see `Fit.ending` and `Fit.warnings`.
    """
    return identify_many(
        scene,
        state,
        [measurements],
        parameters,
        start_time=start_time,
        guess=guess,
        starts=starts,
        grow=grow,
        integration=integration,
        max_iterations=max_iterations,
        tolerance=tolerance,
        horizon=horizon,
        progress=progress,
    )[0]


def identify_many(
    scene: Scene,
    state: State,
    measurements: Sequence[Measurements],
    parameters: Mapping[str, Parameter],
    *,
    start_time: float = 0.0,
    guess: Guess | Sequence[Guess] | None = None,
    starts: Starts | Screening | None = None,
    grow: Sequence[float] = (),
    integration: Integration | None = None,
    max_iterations: int = 100,
    tolerance: float = 1e-3,
    horizon: Horizon | None = None,
    progress: bool | Tell = True,
) -> list[Fit]:
    """`identify` for several sets of measurements of the same channels and times, such as draws of
    the noise: one fit for each."""
    _check(scene, measurements, start_time, grow, max_iterations, tolerance)
    first = measurements[0]
    outputs = {name: series.channel for name, series in first.series.items()}
    times = first.times()
    if horizon is not None:
        horizon.warn_if_beyond(float(times[-1]))
    runs = experiment(scene, state, parameters, outputs, times, start_time, integration)
    drawn = starts if isinstance(starts, Starts) else None
    rows = start_coordinates(scene, state, parameters, guess, drawn)
    screens = None
    if isinstance(starts, Screening):
        require(len(rows) == 1, "guess", len(rows), "one guess, round which to screen", "pass one")
        coarse = coarser(integration)
        sides = experiment(scene, state, parameters, outputs, times, start_time, coarse)
        screens = Passes(starts, sides, rows[0], tuple(parameters), progress is True)
    strides = np.array([parameter.scale.stride for parameter in parameters.values()])
    ends = [*grow, float(times[-1])]
    units = {n: p.variation.unit_in(scene, state) for n, p in parameters.items()}

    fits = []
    with shown(progress, parameters, len(measurements) * len(rows)) as tell:
        for one in measurements:
            data = samples(one, len(runs.times))
            searched = partial(
                _searched, runs, data, ends, strides, tolerance, max_iterations, tell
            )
            screened: tuple[Screened, ...] = ()
            if screens is None:
                found = tuple(map(searched, rows))
            else:
                found, screened = screens.searches(data, searched)
            best = lowest(found)
            made = runs.family.scene_and_state(best.best.coordinates)
            fits.append(Fit(*made, dict(parameters), units, one, found, best, screened))
    return fits


def _searched(
    runs: Experiment,
    data: Samples,
    ends: Sequence[float],
    strides: np.ndarray,
    tolerance: float,
    max_iterations: int,
    tell: TellOf,
    start: np.ndarray,
) -> Search:
    """The windows fitted one after the other."""
    windows, at = [], start
    best: Evaluated | None = None
    for end in ends:
        part, last = data.until(runs.times, end), end == ends[-1]
        run = partial(evaluate, runs, part, end)
        best, iterations, ending = search(
            run if last else partial(_held, run, at, strides),
            at,
            strides,
            tolerance if last else max(tolerance, WINDOW_TOLERANCE),
            max_iterations,
            partial(tell, part.count),
        )
        if best.result != RESULTS.successful:
            ending = Ending.FAILED
        windows.append(Window(end, iterations, ending))
        at = best.coordinates
    assert best is not None
    return Search(start, tuple(windows), best)


def _held(
    run: Callable[[np.ndarray], Evaluated], centre: np.ndarray, strides: np.ndarray, at: np.ndarray
) -> Evaluated:
    """An evaluation, as if the centre had been measured too, with strides for noise."""
    found = run(at)
    return replace(
        found,
        residuals=np.append(found.residuals, (at - centre) / strides),
        jacobian=np.vstack([found.jacobian, np.diag(1.0 / strides)]),
    )


@contextmanager
def shown(
    progress: bool | Tell, parameters: Mapping[str, Parameter], searches: int
) -> Iterator[TellOf]:
    """What is told of each iteration: to the caller's function, or shown as a line."""
    if callable(progress):
        yield lambda _, iteration: progress(iteration)
        return
    with tqdm(
        desc="fit" if searches == 1 else f"{searches} fits",
        unit=" runs",
        leave=False,
        disable=not progress,
    ) as bar:

        def tell(count: int, iteration: Iteration) -> None:
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

        yield tell


def _check(
    scene: Scene,
    measurements: Sequence[Measurements],
    start_time: float,
    grow: Sequence[float],
    max_iterations: int,
    tolerance: float,
) -> None:
    remedy = "pass one set of measurements at least"
    require(len(measurements) > 0, "measurements", len(measurements), "not empty", remedy)
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

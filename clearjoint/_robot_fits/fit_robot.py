"""Fit of a robot's joints to its log: what the log determines, and the estimates."""

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import Float, PyTree
from typing_extensions import override

from .._export.datasets import AbstractTabular, Labelled, labelled_dataset, texts
from .._export.tables import aligned, number
from .._fields.cautions import quiet
from .._fields.checks import require
from .._identification.fit import Fit, limit_text
from .._identification.goodness_of_fit import UNLIKELY
from .._identification.identify import OnIteration, identify, warn_of
from .._identification.starts import Guess
from .._information.analysis import Identifiability, identifiability
from .._information.horizon import fit_horizon
from .._math.smoothing import wrapped
from .._measurements.robot_logs import RobotLog
from .._model.joints.base import AbstractForce
from .._parametrisation.parameter import WIDTH, Log, Parameter, free_parameters, held
from .._parametrisation.readings import sensor_errors, units_of
from .._parametrisation.variations import SeriesDelay, with_values
from .._scene_files.robot import Robot
from .._simulation.results.observe import observe
from .._simulation.results.solution import SimulationError
from .._simulation.run.saving import Saving
from .._simulation.run.simulate import simulate
from .._simulation.step import presets
from .._simulation.step.settings import Settings, settings_or
from .problem import (
    IN_PLAY,
    KINDS,
    OF_START,
    POSITION,
    STILL,
    DrivenBy,
    Find,
    Mode,
    RobotProblem,
    backlash_name,
    continuous,
    drive_name,
    is_hinge,
    robot_problem,
)

if TYPE_CHECKING:
    import xarray as xr

ROUNDS = 3
"""Largest number of fits, each with the parameters that the log determines by the last one."""
NO_PARAMETERS: Mapping[str, Parameter] = MappingProxyType({})
ENDS = -0.7, 0.7
"""Places in a play, from -1 to 1, from which a fit also starts."""
CLOSEST = 0.99
"""Largest magnitude of a place in a play to start a further fit: at 1, `Bounded` is infinite."""
PLAYS = 0.8, 1.25
"""Factors on all estimated plays, from which the fit is repeated: a collision less or more in the
motion gives minima of chi squared at plays that differ by a few percent."""
NO_PLAY = 1e-3
"""Factor on each single estimated play, from which the fit is repeated too: without play, the log
may fit as well, or better, but a search from a larger play stops in a minimum on the way."""
SHORTEST = 1.0 / 64.0
"""Share of the log in the first window if a start in a play is unknown. Over the whole log, chi
squared has minima at wrong places; the right one shows in the beginning."""
UNKNOWN_HORIZON = 1.0 / 16.0
"""Share of the log in the first window if the horizon of a fit is unknown."""
PART = 0.3
"""A parameter is named if its weight in an undetermined combination is above this share of the
smaller of two weights: that of the parameter in question, and the largest of the others."""


class Hysteresis(NamedTuple):
    """Torque, N m or N, of a joint over its position, rad or m, as logged and as predicted.

    >>> rising = np.linspace(0.0, 1.0, 5)
    >>> cj.results.Hysteresis(rising, 2.0 * rising, rising, 2.1 * rising).torque.max().item()
    2.0
    """

    position: Float[np.ndarray, " N"]
    torque: Float[np.ndarray, " N"]
    predicted_position: Float[np.ndarray, " N"]
    predicted_torque: Float[np.ndarray, " N"]


@dataclass(frozen=True)
class RobotFit(AbstractTabular):
    """Result of `fit_robot`.

    - `fit`: the `Fit` of the parameters that the log determines.
    - `robot`: the robot with the estimates.
    - `log`, `driven_by`: the arguments of `fit_robot`.
    - `undetermined`: for each parameter that the log doesn't determine, a sentence that says why.
    - `held`: value and unit at which each undetermined parameter was held: its first guess. If the
      log excludes that, or for a start position or speed, it is the last estimate, if there is one.
    - `limits`: 95 % intervals of held parameters, only those that begin at 0 or end at infinity.

    ```python
    import clearjoint as cj
    import numpy as np
    import pandas as pd

    t = np.linspace(0.0, 0.5, 101)
    robot, still = cj.load_robot("arm.urdf"), np.zeros(101)
    motion = {"elbow": 9.0 * t**2, "wrist": still}, {"elbow": 18.0 * t, "wrist": still}
    tau = robot.torques(*motion, {"elbow": 18.0, "wrist": 0.0})["elbow"] + 0.2 * 18.0 * t
    table = pd.DataFrame({"t": t, "q [rad]": 9.0 * t**2, "r [rad]": still, "tau [N m]": tau})
    torque = {"elbow": cj.LogColumn("tau", noise=0.01)}
    log = cj.RobotLog.read(table, angles={"elbow": "q", "wrist": "r"}, torques=torque)
    driven_by = {"elbow": "angle", "wrist": "angle"}
    found = cj.fit_robot(robot, log, {"elbow": ["damping"]}, driven_by)
    print(found.fit.intervals["elbow damping"])  # N m s/rad, about 0.2
    ```
    """

    fit: Fit
    robot: Robot
    log: RobotLog
    driven_by: DrivenBy
    undetermined: dict[str, str]
    held: dict[str, tuple[float, str]]
    limits: dict[str, tuple[float, float]]

    @property
    def intervals(self) -> dict[str, tuple[float, float]]:
        """95 % interval (low, high) of each value by name: those of the `fit`, and `limits`."""
        return self.fit.intervals | self.limits

    @override
    def to_xarray(self) -> "xr.Dataset":
        """Return estimates and held values along "parameter", with the unit and the bounds of the
        95 % interval. The bounds of a held value are its `limits` or, if it has none, NaN."""
        rows, along = self._rows(), ("parameter",)
        estimates, lows, highs, units = zip(*rows.values(), strict=True)
        determined = ["false" if name in self.held else "true" for name in rows]
        variables = {
            "estimate": Labelled(along, estimates),
            "low": Labelled(along, lows),
            "high": Labelled(along, highs),
            "unit": Labelled(along, texts(units)),
            "determined": Labelled(along, texts(determined)),
        }
        labels = {"parameter": Labelled(along, texts([*rows]))}
        return labelled_dataset("fit of a robot", variables, labels)

    def _rows(self) -> dict[str, tuple[float, float, float, str]]:
        """Return value, ends of the 95 % interval and unit of each estimated or held parameter."""
        estimates, units = self.fit.estimates, self.fit.units
        values = {name: (estimates[name], units[name]) for name in estimates} | self.held
        unknown, intervals = (math.nan, math.nan), self.intervals
        return {n: (x, *intervals.get(n, unknown), unit) for n, (x, unit) in values.items()}

    @override
    def __str__(self) -> str:
        table: list[tuple[str, ...]] = [("parameter", "estimate", "95 % from", "to", "unit")]
        for name, (value, low, high, unit) in self._rows().items():
            ends = ("not identifiable", "") if math.isnan(low) else (f"{low:.4g}", f"{high:.4g}")
            table.append((name, f"{value:.4g}", *ends, unit))
        reasons = "\n".join(self.undetermined.values())
        parts = "\n".join(aligned(table)), reasons, str(self.fit)
        return "\n\n".join(part for part in parts if part)

    @cached_property
    def predictions(self) -> dict[str, Float[np.ndarray, " N"]]:
        """Predicted values of each measured series, (N,), in rad, m, N m or N. Angles differ from
        the measured ones by less than half a revolution."""
        residuals, series = self.fit.residuals, self.fit.measurements.series
        return {n: np.asarray(s.values + residuals[n] * s.noise) for n, s in series.items()}

    def predict(
        self, log: RobotLog, driven_by: DrivenBy | None = None, settings: Settings | None = None
    ) -> dict[str, Float[np.ndarray, " N"]]:
        """Return the predicted values of each series of another log, (N,), in the form of
        `predictions`. How well they agree with a log that was not fitted tells what a fit is worth.

        The run begins with the log's first positions and, unless it begins at rest, their rates.
        Joints are driven as in the fit, unless `driven_by` has another drive: for another gain,
        ``{"elbow": dataclasses.replace(found.fit.scene.forces["elbow drive"], proportional=9.0)}``.
        Fitted errors of sensors, such as delays, apply. `settings`: as in `identify`.

        **Raises:** `ValueError` as `fit_robot`. `SimulationError` if the run fails.
        """
        # A drive that was fitted, such as a servo, keeps its estimates.
        drives = self.fit.scene.forces
        driven: dict[str, Mode | AbstractForce] = {
            name: mode if isinstance(mode, str) else drives[drive_name(name)]
            for name, mode in self.driven_by.items()
        }
        problem = robot_problem(self.robot, log, {}, {**driven, **(driven_by or {})})
        series, start, fit = problem.measurements.series, log.start, self.fit
        sensors = sensor_errors(fit.parameters, fit.measurements.series)
        reading = partial(sensors.reading, coordinates=fit.coordinates)
        # The first reading of a position has the sensor's errors. It is linear in the position, so
        # that the readings of the positions 0 and 1 tell how to remove the errors.
        starts = []
        for name, parameter in problem.parameters.items():
            (joint, kind), value = problem.subjects[name], float(parameter.value or 0.0)
            if kind == POSITION:
                exact, start_times = np.array([0.0, 1.0]), np.zeros(2)
                at_zero, at_one = reading(f"{joint} position", exact, start_times).tolist()
                value = (value - at_zero) / (at_one - at_zero)
            starts.append((parameter.variation, value))
        scene, state = with_values(problem.scene, problem.state, starts)
        # Times at which each series reads the motion: with a delay, these are before its sample
        # times, but not before the start.
        instants = {name: np.asarray(s.times) for name, s in series.items()}
        for name, parameter in fit.parameters.items():
            if isinstance(delay := parameter.variation, SeriesDelay):
                delayed, value = series.keys() & delay.series, fit.estimates[name]
                instants |= {n: np.maximum(instants[n] - value, start) for n in delayed}
        times = np.unique(np.concatenate([*instants.values()]))
        settings, end = settings_or(settings, presets.identification), float(times[-1])
        outputs = {name: s.channel for name, s in series.items()}
        save = Saving(times)
        run = simulate(
            scene, state, end, settings, save, outputs=outputs, start_time=start, progress=False
        )
        predicted = {}
        for name, s in series.items():
            exact = np.asarray(run.outputs[name])[np.searchsorted(times, instants[name])]
            # `reading` adds the fitted errors of the sensor, other than delays.
            difference = reading(name, exact, np.asarray(s.times) - start) - s.values
            # As in `predictions`, angles are those nearest to the measured ones.
            if s.period is not None:
                difference = wrapped(difference, s.period)
            predicted[name] = np.asarray(s.values + difference)
        return predicted

    def hysteresis(self) -> dict[str, Hysteresis]:
        """Return, by name, the `Hysteresis` of each driven joint with a logged torque and position.
        The one of the two that drives the joint is not predicted: its logged values are used."""
        loops, measured = {}, self.fit.measurements.series
        for joint in self.driven_by:
            # The position of a joint that is not logged is that of its motor.
            side = joint if joint in self.log.angles else f"{joint} motor"
            if joint not in self.log.torques or side not in self.log.angles:
                continue
            torques, angles = self.log.torques[joint], self.log.angles[side]
            torque, position, by_name = f"{joint} torque", f"{side} position", self.predictions
            # At least one of the two is compared with the log, at times that serve both here.
            times = np.asarray(measured[position if position in measured else torque].times)
            logged = (
                np.interp(times, angles.times, continuous(angles, is_hinge(self.robot, side))),
                np.interp(times, torques.times, torques.values),
            )
            predicted = [
                np.interp(times, measured[n].times, by_name[n]) if n in by_name else as_logged
                for n, as_logged in zip((position, torque), logged, strict=True)
            ]
            # `logged` counts revolutions; the measured values may jump by 2 pi.
            if position in by_name:
                predicted[0] = predicted[0] + (logged[0] - np.asarray(measured[position].values))
            loops[joint] = Hysteresis(*logged, *predicted)
        return loops


def fit_robot(
    robot: Robot,
    log: RobotLog,
    find: Find,
    driven_by: DrivenBy,
    *,
    parameters: Mapping[str, Parameter] = NO_PARAMETERS,
    settings: Settings | None = None,
    grow: Sequence[float] | None = None,
    max_iterations: int = 100,
    check_runs: int | None = 0,
    progress: bool | OnIteration = True,
) -> RobotFit:
    """Estimate play, friction, damping and inertia of a robot's joints from a log.

    ```python
    import clearjoint as cj
    import numpy as np
    import pandas as pd

    # A log: counts of an encoder on the motor's side, and currents.
    t = np.arange(0.0, 0.5, 0.005)
    counts = 2048 + np.round(400 * (1 - np.cos(12 * t)))
    table = pd.DataFrame({"t": t, "counts": counts, "i [A]": 0.4 * np.cos(12 * t)})

    gear = cj.Drive(armature=2e-6, ratio=100.0, play="0.5 deg", stiffness=800.0)
    robot = cj.load_robot("arm.urdf").with_drive("elbow", gear)
    log = cj.RobotLog.read(
        table,
        angles={"elbow motor": cj.LogColumn.encoder("counts", counts=4096, zero=2048)},
        torques={"elbow": cj.LogColumn.current("i", torque_constant=0.05, ratio=100.0)},
    )
    find = {"elbow": {"play": "1 deg", "friction": None, "inertia": None}}
    print(cj.fit_robot(robot, log, find, {"elbow": "torque"}, grow=(), max_iterations=3))
    ```

    Before the fit, the Fisher information of the log tells which parameters it determines. Others
    are held, and the result says why: at the value from which the fit starts or, if a fit has shown
    that the log excludes that value, at the estimate (see `RobotFit.held`). What is about zero,
    such as the friction of a joint without any, or infinite has an interval in `RobotFit.limits`.
    The log is compared with one run from its first time on, whose initial positions and speeds are
    parameters too, named "elbow start position" and "elbow start speed".

    **Arguments:**

    - `robot`: from `load_robot`, with a play in each joint whose play is to be found.
    - `find`: what to find of each joint, by its name: a list, or a dictionary with the value from
      which the fit starts, a number or a text with a unit, such as ``{"elbow": {"play": "1 deg",
      "friction": None}}``. For ``None`` that is the number in the robot or, for a friction or
      damping that it lacks, a tenth of the largest logged torque. Of hinges:
        - "play", rad, "stiffness", N m/rad, and "restitution" of the flanks of `Robot.with_drive`.
        - "friction", N m, independent of the speed, and "damping", N m s/rad, of the motor's side,
          and "link friction", N m. A friction that the robot lacks is a `RegularisedCoulomb`, under
          which a loaded joint creeps by at most 1e-4 rad/s.
        - "loss" of the gear, over its torque, if the `Drive` has one.
        - "armature", kg m^2, of the motor, at the joint.
        - "inertia", kg m^2, of the link about its centre of mass, along the joint's axis; its other
          moments change in proportion. "mass", kg, of the link.

      Of sliders: "friction", "damping", "link friction", "loss", "armature" and "mass".
    - `driven_by`: how joints are driven, by name; other joints move freely.
        - "angle": the joint, or its motor if that turns apart, follows its logged position,
          smoothed by as much as its noise. Its logged torque is compared with the one needed.
        - "torque": the logged torque acts, interpolated by a spline; "held torque": each value acts
          until the next. Logged positions are compared with those of the run.
        - a `Servo` or `Motor`, made with ``robot.motor_side("elbow")``; logged goals replace its
          target. Logged positions, and torques with noise, are compared.
    - `parameters`: further parameters by name, such as ``{"delay": cj.Parameter.delay("elbow
      position")}``. The series are named "elbow position" and "elbow torque".
    - `settings`, `max_iterations`, `check_runs`, `progress`: as in `identify`.
    - `grow`: ends of growing windows, s, as in `identify`; () for none. By default a fit with poor
      residuals is repeated with windows from `fit_horizon`, for starts that are wrong by a factor
      of two. If a drive train's place in its play is unknown at the start, windows from 1/64 of
      the log on are tried too. At last the fit is repeated from other plays: all a fifth smaller,
      all a quarter larger, and each in turn nearly zero.

    **Raises:** `ValueError` for names, units and modes that don't fit robot and log, for a
    torque or position that drives a joint and is missing in a part of the log, for noise that is
    unknown, and for a log that determines none of the parameters. `SimulationError` if the run with
    the starts fails. Otherwise as `identify`.

    **Warns:** as `identify`.
    """
    settings = settings_or(settings, presets.identification)
    problem = robot_problem(robot, log, find, driven_by)
    taken = sorted(set(parameters) & set(problem.parameters))
    expected = "of other names than those of the robot"
    require(not taken, "parameters", taken, expected, "rename them")
    free = {**problem.parameters, **parameters}
    require(bool(free), "find", dict(find), "not empty", 'pass {"elbow": ["friction"]}, say')
    scene, state, measured = problem.scene, problem.state, problem.measurements
    starts = {name: p.scale.value(p.coordinate_in(scene, state)) for name, p in free.items()}
    starts = {name: float(value) for name, value in starts.items()}
    values = starts  # Those of the last fit, as soon as there is one.
    units = units_of(free, scene, state, {n: s.unit for n, s in measured.series.items()})
    options: dict[str, PyTree] = {"start_time": log.start, "progress": progress}
    options |= {"max_iterations": max_iterations, "check_runs": check_runs}
    fit, undetermined, fixed, limits = None, {}, {}, {}
    for _ in range(ROUNDS):
        present = {n: Parameter(p.variation, p.scale, value=values[n]) for n, p in free.items()}
        # Without delays of sensors, by which a run cannot be differentiated.
        examined = _of_runs(present)
        report = identifiability(scene, state, examined, measured, settings, start_time=log.start)
        reasons, away = _undetermined(report, problem, examined), {}
        if fit is not None:
            # A parameter that looked determined at its start need not be so at the estimate. If the
            # log excludes the start, it is held at the estimate, with which the others were found.
            away = _away_from_starts(report, reasons, starts, fit)
        limits = {n: ends for n, ends in away.items() if ends[0] == 0.0 or math.isinf(ends[1])}
        for name, (low, high) in limits.items():
            reasons[name] = f"{_subject(name, problem)} is {limit_text(low, high, units[name])}"
        is_last = fit is not None and reasons.keys() == undetermined.keys()
        undetermined = reasons  # The names may be as before, but the texts have new numbers.
        if is_last:
            break
        expected = f"determined by the log. {' '.join(reasons.values())}"
        require(len(reasons) < len(present), "find", [*find], expected, "log another motion")
        # A position or speed at the start is held at its last estimate: the first one, from a few
        # samples, may be so wrong that it makes estimates that depend on it wrong too.
        at_last = {*_of_kind(problem, reasons, *OF_START), *away}
        fixed = {name: (values if name in at_last else starts)[name] for name in reasons}
        present |= {name: held(free[name], value) for name, value in fixed.items()}
        fit = _best_fit(problem, present, settings, grow, options)
        # The next start is the estimate, with places in plays moved away from the ends of the play.
        values = {**values, **fixed, **_inside(problem, fit)}
    assert fit is not None
    warn_of([fit])
    # The robot of the result has no drives: those of the fit follow this log.
    joints, forces = (
        {n: e for n, e in family.items() if n not in map(drive_name, driven_by)}
        for family in (fit.scene.joints, fit.scene.forces)
    )
    fitted = replace(robot, scene=replace(fit.scene, joints=joints, forces=forces))
    held_at = {name: (value, units[name]) for name, value in fixed.items()}
    return RobotFit(fit, fitted, log, dict(driven_by), undetermined, held_at, limits)


def _best_fit(
    problem: RobotProblem,
    parameters: Mapping[str, Parameter],
    settings: Settings,
    grow: Sequence[float] | None,
    options: Mapping[str, PyTree],
) -> Fit:
    """Return the best of several fits, with the searches of all.

    If a side of a drive train starts at an unknown place in its play, fits begin with the middle
    and with both ends of the play. Unless the user has given windows to `grow`, fits of the whole
    log are compared with fits of growing windows, where these may help, and with fits that start
    with other plays than the estimated ones. `options`: further arguments of `identify`.
    """
    # Chi squared may have a minimum at each end of a play in which a side starts.
    free = free_parameters(parameters)
    places = _of_kind(problem, free, IN_PLAY)
    sides = (0.0, *ENDS) if places else (0.0,)
    starts = [dict.fromkeys(places, side) for side in sides]

    def fitted(windows: Sequence[float], guesses: Sequence[Guess] = starts) -> Fit:
        # `fit_robot` warns of the best fit only, hence `quiet`.
        arguments = problem.scene, problem.state, problem.measurements, parameters, settings
        with quiet():
            return identify(*arguments, grow=windows, guess=guesses, **options)

    if grow is not None:
        return fitted(grow)
    # Neither the whole log nor windows of it lead from all starts to the lowest minimum.
    fits = [fitted(_doubled(problem, SHORTEST))] if places else []
    fit = _lowest(*fits, fitted(()))
    if fit.p_value < UNLIKELY:
        # Only a poor fit is worth the many runs that find out how long a record may be.
        windows = _windows(fit, free, problem, settings)
        fit = _lowest(fit, fitted(windows)) if windows else fit
    if plays := _of_kind(problem, free, "play"):
        # Starts at the estimates, but with all plays larger or smaller, or one of them nearly zero.
        # `_inside` moves places at an end of a play a little inward.
        found = _inside(problem, fit)
        others = [{**found, **{name: factor * found[name] for name in plays}} for factor in PLAYS]
        others += [{**found, name: NO_PLAY * found[name]} for name in plays]
        fit = _lowest(fit, fitted((), others))
    return fit


def _of_runs(parameters: Mapping[str, Parameter]) -> dict[str, Parameter]:
    # `identifiability` and `fit_horizon` refuse delays: a run cannot be differentiated by them.
    return {n: p for n, p in parameters.items() if not isinstance(p.variation, SeriesDelay)}


def _of_kind(problem: RobotProblem, parameters: Iterable[str], *kinds: str) -> list[str]:
    # Names of those `parameters` that are of one of the `kinds`, such as "play".
    return [name for name in parameters if problem.subjects.get(name, ("", ""))[1] in kinds]


def _inside(problem: RobotProblem, fit: Fit) -> dict[str, float]:
    """Return the estimates as a new start; limit a joint's place in its play to +/-`CLOSEST`."""
    places = _of_kind(problem, fit.parameters, IN_PLAY)
    limited = {name: min(max(fit.estimates[name], -CLOSEST), CLOSEST) for name in places}
    return {**fit.estimates, **limited}


def _lowest(*fits: Fit) -> Fit:
    """Return the fit with the lowest chi squared, with the searches of all."""
    lowest = min(fits, key=lambda fit: fit.chi_squared)
    return replace(lowest, searches=tuple(search for fit in fits for search in fit.searches))


def _windows(
    fit: Fit, parameters: Mapping[str, Parameter], problem: RobotProblem, settings: Settings
) -> list[float]:
    """Return the ends, s, of growing windows of the log (see `_doubled`). The first window is a
    little shorter than the longest record that a fit can use, by `fit_horizon` at the estimates of
    `fit`. If a run with these estimates fails, or if only delays are free, the first window is a
    sixteenth of the log. `parameters`: those that are free."""
    parameters = _of_runs(parameters)
    if not parameters:
        return _doubled(problem, UNKNOWN_HORIZON)
    # Possible errors of the starts, in the coordinate of each parameter's scale: for the kinds in
    # `KINDS` log(2), a factor of two on the scale `Log`, for others, such as start positions, 1.
    uncertainty = {
        name: math.log(2.0) if problem.subjects.get(name, ("", ""))[1] in KINDS else 1.0
        for name in parameters
    }
    start, end = problem.log.start, float(problem.measurements.times()[-1])
    try:
        limits = fit_horizon(
            *(fit.scene, fit.state, parameters, problem.measurements, settings),
            uncertainty=uncertainty,
            start_time=start,
        )
        # Length of the first window, a little below the horizon.
        length = 0.9 * (min(limits.single_shot, end) - start)
    except SimulationError:  # The run with the estimates fails, so that the horizon is unknown.
        return _doubled(problem, UNKNOWN_HORIZON)
    return _doubled(problem, length / (end - start))


def _doubled(problem: RobotProblem, share: float) -> list[float]:
    """Return ends of windows, s, shorter than the log. The first window is a `share` of the log,
    and each further one is twice as long as the one before."""
    start, end = problem.log.start, float(problem.measurements.times()[-1])
    ends = []
    while 0.0 < share < 1.0:
        ends.append(start + share * (end - start))
        share *= 2.0
    return ends


def _undetermined(
    report: Identifiability, problem: RobotProblem, parameters: Mapping[str, Parameter]
) -> dict[str, str]:
    """Return, for each of the `parameters` in `report` that the log does not determine, why."""
    remaining, reasons = report, {}
    # The run that tells which flanks touch is made at most once, and only if it is needed.
    flanks = cache(partial(_touched, problem, parameters))
    while remaining.names:
        ratios = remaining.deviations / remaining.limits
        if (ratios <= 1.0).all():
            break
        # Of several parameters that only together are undetermined, the one with the smallest
        # effect of its own is left out first: the others may be determined without it.
        alone = np.where(ratios > 1.0, remaining.deviations_alone / remaining.limits, 0.0)
        k = int(alone.argmax())
        name = remaining.names[k]
        reasons[name] = _reason(name, remaining, k, problem, flanks)
        remaining = _without(remaining, [name])
    return reasons


def _without(report: Identifiability, names: Collection[str]) -> Identifiability:
    # The report if the named parameters were known.
    columns = [k for k, name in enumerate(report.names) if name not in names]
    return replace(
        report,
        names=tuple(report.names[k] for k in columns),
        scales=tuple(report.scales[k] for k in columns),
        coordinates=report.coordinates[columns],
        rows=report.rows[:, columns],
    )


def _away_from_starts(
    report: Identifiability, undetermined: Collection[str], starts: Mapping[str, float], fit: Fit
) -> dict[str, tuple[float, float]]:
    """Return the 95 % intervals of those `undetermined` parameters whose interval does not contain
    the start, each as if all other undetermined parameters were known."""
    away, widening = {}, dict(zip(fit.parameters, fit.widening.tolist(), strict=True))
    for name in undetermined:
        alone = _without(report, {*undetermined} - {name})
        k = alone.names.index(name)
        scale, coordinate = alone.scales[k], float(alone.coordinates[k])
        value = float(alone.values[k])
        half = WIDTH * float(alone.deviations[k]) * widening.get(name, 1.0)
        # If the coordinate has run to infinity, the interval depends on whether it has run up.
        rising = value > starts[name]
        low, high = scale.interval(coordinate, half, rising)
        if isinstance(scale, Log) and not rising:
            # A parameter that may be zero, such as a friction, has a force proportional to it, so
            # the interval is linear in the value. The start is above it: only the upper end counts.
            low, high = 0.0, value * (1.0 + half)
        if not low <= starts[name] <= high:
            away[name] = low, high
    return away


def _subject(name: str, problem: RobotProblem) -> str:
    joint, kind = problem.subjects.get(name, ("", name))
    return f"The {kind} of {joint}" if joint else f"Parameter {name!r}"


def _touched(problem: RobotProblem, parameters: Mapping[str, Parameter]) -> dict[str, set[str]]:
    """Return, by joint, the labels of the contacts that touch at a time of the log, in the run with
    the parameters' values. The contacts of a backlash are its flanks."""
    values = [(p.variation, float(p.value or 0.0)) for p in parameters.values()]
    scene, state = with_values(problem.scene, problem.state, values)
    times, start = problem.measurements.times(), problem.log.start
    options = {"save": Saving(times), "start_time": start, "progress": False}
    solution = simulate(scene, state, float(times[-1]), **options)
    contacts = observe(scene, solution).contacts
    return {
        joint: {label for label, c in by_label.items() if np.any(c.normal_force > 0.0)}
        for joint, by_label in contacts.items()
    }


def _reason(
    name: str,
    report: Identifiability,
    k: int,
    problem: RobotProblem,
    flanks: Callable[[], Mapping[str, set[str]]],
) -> str:
    """Return a sentence on why the log does not determine the parameter `name`, whose index in
    `report` is `k`. `flanks` returns, by joint, the labels of touching contacts (`_touched`)."""
    joint, kind = problem.subjects.get(name, ("", name))
    head = f"{_subject(name, problem)} cannot be determined"
    # The run that tells which flanks touch is only made if flanks may be the reason.
    touched = flanks().get(backlash_name(joint)) if kind in ("play", "stiffness") else None
    if touched is not None and len(touched) < 2:
        if not touched:
            return f"{head}: its flanks never touch in the motion."
        if kind == "play":
            return f"{head}: the motion never reverses its load."
    samples = problem.log.angles.get(joint)
    noise = 0.0 if samples is None or samples.noise is None else samples.noise
    if (
        samples is not None
        and continuous(samples, is_hinge(problem.robot, joint)).std() <= STILL * noise
    ):
        return f"{head}: the joint does not move."
    if report.deviations_alone[k] > report.limits[k]:
        size = number(float(report.deviations_alone[k]))
        return (
            f"{head}: the log hardly depends on it (the noise allows a standard deviation of "
            f"{report.labels[k]} of {size})."
        )
    # With all others known, the parameter would be determined: others are in the combination that
    # contributes most to its uncertainty.
    worst = max(report.combinations, key=lambda c: abs(c.weights[k]) * c.standard_deviation)
    weights = {n: abs(w) for n, w in zip(report.names, worst.weights, strict=True) if n != name}
    # Small weights are left out; because of the minimum, the largest one is always named.
    large = PART * min(abs(worst.weights[k]), max(weights.values()))
    others = " and ".join(n for n, weight in weights.items() if weight > large)
    return f"{head}: the log does not distinguish its effect from that of {others}."

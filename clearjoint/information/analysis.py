"""What data could tell about parameters, before anything is measured.

Bounds of Cramér and Rao, from the sensitivities of what sensors would read. The study
`studies.identifiability` compares them with those of an event-exact solver.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from ..fields.checks import require
from ..model.bodies import State
from ..model.scene import Scene
from ..parametrisation.parameter import Parameter, coordinates_of
from ..parametrisation.scales import AbstractScale
from ..simulation.run.sensitivities import Sensitivities, sensitivities
from ..simulation.step import presets
from ..simulation.step.settings import Settings, settings_or
from . import fisher_information as information
from .fisher_information import Combination
from .sensors import Sensor, Sensors, as_sensors, outputs_of, times_of
from .text_tables import aligned, number, percent

ACCURACY_OF_DERIVATIVES = 1e3
"""Error of a sensitivity over `rtol`, about: 4e2 at 1e-9 and 2e3 at 1e-11 on the pendulum."""


@dataclass(frozen=True)
class SensorDerivatives:
    """Derivatives of a sensor's samples along the parameters' coordinates.

    `times`: (N,) s. `rows`: (N, channels, p), in units of the samples' noise.
    """

    times: Float[np.ndarray, " N"]
    rows: Float[np.ndarray, "N channels p"]


@dataclass(frozen=True)
class Identifiability:
    """What data from sensors can tell about parameters.

    Standard deviations are lower bounds: no unbiased estimate has smaller ones. They hold for
    normal noise, so small that outputs are linear in the parameters over the deviations. `of` and
    `until` give those for fewer sensors and shorter records.

    - `names`, `scales`, `coordinates`: of the p parameters, in the order of all arrays.
    - `records`: derivatives of each sensor's samples.
    - `accuracy`: relative error of the derivatives, below which a combination is not seen.

    >>> probe = cj.Sensor(x, times, noise=1e-4)
    >>> report = cj.identifiability(scene, state, {"stiffness": stiffness}, {"probe": probe})
    >>> slopes = -0.5 * times * np.sin(10.0 * times)  # d x/d log k
    >>> bool(np.isclose(report.deviations[0], 1e-4 / np.linalg.norm(slopes), rtol=1e-4))
    True
    """

    names: tuple[str, ...]
    scales: tuple[AbstractScale, ...]
    coordinates: Float[np.ndarray, " p"]
    records: dict[str, SensorDerivatives]
    accuracy: float

    def of(self, *sensors: str) -> "Identifiability":
        """What data from some of the sensors alone can tell.

        **Raises:** `ValueError` for a name that none has.
        """
        for name in sensors:
            known = f"among {sorted(self.records)}"
            require(name in self.records, "sensors", name, known, "correct the name")
        require(len(sensors) > 0, "sensors", sensors, "a name at least", "name those to take")
        return replace(self, records={name: self.records[name] for name in sensors})

    def until(self, time: float) -> "Identifiability":
        """What the samples up to a time, s, can tell.

        **Raises:** `ValueError` if there are none.
        """
        records = {}
        for name, record in self.records.items():
            early = record.times <= time
            if early.any():
                records[name] = SensorDerivatives(record.times[early], record.rows[early])
        first = float(self.times[0])
        require(len(records) > 0, "time", time, f"{first} s or later, that of a sample", "raise it")
        return replace(self, records=records)

    @property
    def times(self) -> Float[np.ndarray, " N"]:
        """All times at which there is a sample, rising, s."""
        return np.unique(np.concatenate([record.times for record in self.records.values()]))

    @property
    def root(self) -> Float[np.ndarray, "p p"]:
        """A root R (p, p) of the Fisher information of the coordinates, which is R^T R."""
        return information.root_of(self._rows()[1])

    @property
    def matrix(self) -> Float[np.ndarray, "p p"]:
        """The Fisher information (p, p) of the coordinates."""
        return self.root.T @ self.root

    @property
    def deviations(self) -> Float[np.ndarray, " p"]:
        """(p,) standard deviations of the coordinates, all estimated together. Of a `Log` scale's
        they are relative errors of the value."""
        return information.together(self.root, self.accuracy)

    @property
    def deviations_alone(self) -> Float[np.ndarray, " p"]:
        """(p,) standard deviations of the coordinates, each estimated alone."""
        return information.alone(self.root)

    @property
    def labels(self) -> list[str]:
        """Labels of the parameters' coordinates, such as "log K"."""
        return [scale.label(name) for scale, name in zip(self.scales, self.names, strict=True)]

    @property
    def values(self) -> Float[np.ndarray, " p"]:
        """(p,) values of the parameters."""
        pairs = zip(self.scales, self.coordinates, strict=True)
        return np.array([float(scale.value(u)) for scale, u in pairs])

    @property
    def slopes(self) -> Float[np.ndarray, " p"]:
        """(p,) absolute derivatives of the values to the coordinates."""
        pairs = zip(self.scales, self.coordinates, strict=True)
        return np.abs([float(scale.slope(u)) for scale, u in pairs])

    @property
    def value_deviations(self) -> Float[np.ndarray, " p"]:
        """(p,) standard deviations of the values, all estimated together."""
        return self.slopes * self.deviations

    @property
    def limits(self) -> Float[np.ndarray, " p"]:
        """(p,) standard deviations of the coordinates beyond which a parameter is not identifiable:
        an estimate then says nothing about it; see `AbstractScale.uninformative_std`."""
        pairs = zip(self.scales, self.coordinates, strict=True)
        return np.array([scale.uninformative_std(float(u)) for scale, u in pairs])

    @property
    def identifiable(self) -> dict[str, bool]:
        """Whether data can tell each parameter: its standard deviation is within its limit."""
        fine = self.deviations <= self.limits
        return dict(zip(self.names, fine.tolist(), strict=True))

    @property
    def rank(self) -> int:
        """Number of combinations that the data see at all."""
        return int(information.rank(self.root, self.accuracy))

    @property
    def condition(self) -> float:
        """Condition number of the derivatives, each parameter's column brought to unit length."""
        return float(information.condition(self.root))

    @property
    def correlation(self) -> Float[np.ndarray, "p p"]:
        """Correlation (p, p) of the estimates."""
        return information.correlation(information.covariance(self.root))

    @property
    def combinations(self) -> tuple[Combination, ...]:
        """Independent combinations of the coordinates, first the one that the data see best."""
        return information.combinations(self.root, self.accuracy)

    def over_time(self) -> np.ndarray:
        """(T, p) standard deviations of the coordinates, all estimated together from the samples up
        to each of the `times`."""
        when, rows = self._rows()
        ends = np.searchsorted(when, self.times, side="right")
        roots = information.roots_over(rows, ends.tolist())
        return information.together(roots, self.accuracy)

    def _rows(self) -> tuple[Float[np.ndarray, " N"], Float[np.ndarray, "N p"]]:
        """Times (N,) and rows (N, p) of all samples in the order of time."""
        records, p = self.records.values(), len(self.names)
        when = np.concatenate([np.repeat(r.times, r.rows.shape[1]) for r in records])
        rows = np.concatenate([r.rows.reshape(-1, p) for r in records])
        order = np.argsort(when, kind="stable")
        return when[order], rows[order]

    def __str__(self) -> str:
        """Bounds, correlations and combinations as a table."""
        return "\n".join([self._head(), "", *self._bounds(), "", *self._seen()])

    def _head(self) -> str:
        sensors, times = ", ".join(self.records), self.times
        span = f"{len(times)} instants from {times[0]:g} to {times[-1]:g} s"
        return f"Standard deviations that data can reach at best: {sensors}; {span}"

    def _bounds(self) -> list[str]:
        """A row a parameter: its bounds together and alone, and its correlations r."""
        rows: list[tuple[str, ...]] = [
            ("parameter", "value", "together", "", "alone", *(f"r({n})" for n in self.names))
        ]
        together, alone = self.value_deviations, self.slopes * self.deviations_alone
        for k, (name, fine) in enumerate(self.identifiable.items()):
            value = self.values[k]
            share = percent(together[k] / abs(value)) if value != 0.0 else "-"
            bounds = (number(together[k]), share) if fine else ("not identifiable", "-")
            correlations = [number(c, 3) for c in self.correlation[k]]
            rows.append((name, f"{value:.5g}", *bounds, number(alone[k]), *correlations))
        return aligned(rows)

    def _seen(self) -> list[str]:
        """A line for each combination, and one for each parameter that is not identifiable."""
        labels = self.labels
        rows = [("combination, from best to worst", "deviation", "")]
        for one in self.combinations:
            seen = one.standard_deviation <= self.limits[np.abs(one.weights).argmax()]
            deviation = number(one.standard_deviation)
            rows.append((one.described(labels), deviation, "" if seen else "not seen"))
        lines = aligned(rows)
        for k, (name, fine) in enumerate(self.identifiable.items()):
            if not fine:
                deviation, limit = self.deviations[k], self.limits[k]
                size = f"{deviation:.2g}" if np.isfinite(deviation) else "without bound"
                lines.append(
                    f"{name} is not identifiable: the standard deviation of {labels[k]} is {size}, "
                    f"and beyond {limit:.2g} says nothing."
                )
        return lines


def identifiability(
    scene: Scene,
    state: State,
    parameters: Mapping[str, Parameter],
    sensors: Sensors,
    settings: Settings | None = None,
    *,
    start_time: float = 0.0,
) -> Identifiability:
    """What data from sensors could tell about parameters, by one run with derivatives.

    **Arguments:**

    - `scene`, `state`, `start_time` s: as in `simulate`.
    - `parameters`: by name, at the values that are expected.
    - `sensors`: `Sensor` by name, each with its times; a measured `Series` or `Measurements` serve
      too, and their values are not looked at.
    - `settings`: how to integrate; `clearjoint.presets.derivatives` unless given.

    **Raises:** `ValueError` for arguments that no run can use; `SimulationError` if the run fails.

    >>> probe = cj.Sensor(x, times, noise=1e-4)
    >>> report = cj.identifiability(scene, state, {"stiffness": stiffness}, {"probe": probe})
    >>> report.identifiable
    {'stiffness': True}
    """
    settings = settings_or(settings, presets.derivatives)
    settings.require_tolerances("the accuracy of derivatives is to be known")
    by_name = as_sensors(sensors, scene)
    times = times_of(by_name)
    run = sensitivities(
        scene,
        state,
        float(times[-1]),
        parameters,
        outputs_of(by_name),
        times,
        settings,
        start_time=start_time,
    )
    coordinates = coordinates_of(scene, state, parameters)
    return identifiability_from(run, parameters, coordinates, by_name, settings)


def identifiability_from(
    run: Sensitivities,
    parameters: Mapping[str, Parameter],
    coordinates: Float[np.ndarray, " p"],
    sensors: Mapping[str, Sensor],
    settings: Settings,
) -> Identifiability:
    """`Identifiability` from a run that has been made already.

    **Arguments:**

    - `run`: with the sensors' outputs at all their times. The first p of its derivatives are along
      the parameters.
    - `coordinates`: (p,) of the parameters in that run.
    """
    return Identifiability(
        tuple(parameters),
        tuple(parameter.scale for parameter in parameters.values()),
        coordinates,
        {name: _derivatives(run, name, one, len(coordinates)) for name, one in sensors.items()},
        ACCURACY_OF_DERIVATIVES * settings.rtol,
    )


def _derivatives(run: Sensitivities, name: str, sensor: Sensor, p: int) -> SensorDerivatives:
    at = np.searchsorted(run.times, sensor.times)
    columns = [run.derivatives[output][at, :p] for output in outputs_of({name: sensor})]
    rows = np.stack(columns, axis=1) / sensor.noise[:, None, None]
    return SensorDerivatives(sensor.times, rows)

"""Runs of one scene at different parameters, as sensors see them.

They differ in values only, so that one compilation serves all.
"""

from dataclasses import dataclass

import numpy as np

from ..model.bodies import State
from ..model.scene import Scene
from ..parametrisation.parameter import Parameter
from ..simulation.run.sensitivities import Sensitivities, sensitivities
from ..simulation.step.settings import Settings
from . import error_growth as growth
from .analysis import Identifiability, identifiability_from
from .sensors import Sensor, outputs_of, times_of


@dataclass(frozen=True)
class PerturbedRuns:
    """Runs of a scene at different values of its parameters, observed by the same sensors."""

    scene: Scene
    state: State
    parameters: dict[str, Parameter]
    sensors: dict[str, Sensor]
    start_time: float

    def run(self, coordinates: np.ndarray, settings: Settings, *, throw: bool) -> Sensitivities:
        """A run at coordinates (p,) of the parameters.

        Its derivatives are along these and, last, along the disturbance of the initial velocity.
        Its outputs are those of the sensors, and the points and penetrations of `error_growth`.
        """
        perturbed = {
            name: Parameter(parameter.variation, parameter.scale, value=float(value))
            for (name, parameter), value in zip(
                self.parameters.items(), self._values(coordinates), strict=True
            )
        }
        times, scene = times_of(self.sensors), self.scene
        return sensitivities(
            scene,
            self.state,
            float(times[-1]),
            perturbed | {growth.DISTURBANCE: growth.disturbance(scene)},
            outputs_of(self.sensors) | growth.points(scene) | growth.penetrations(scene),
            times,
            settings,
            start_time=self.start_time,
            throw=throw,
        )

    def _values(self, coordinates: np.ndarray) -> list[float]:
        pairs = zip(self.parameters.values(), coordinates, strict=True)
        return [float(parameter.scale.value(u)) for parameter, u in pairs]

    def weights(self, times: np.ndarray) -> dict[str, np.ndarray]:
        """Weights (T,) of each output of the sensors: one over the noise, zero at times without a
        sample."""
        weights = {}
        for name, sensor in self.sensors.items():
            weight = np.zeros(len(times))
            weight[np.searchsorted(times, sensor.times)] = 1.0 / sensor.noise
            weights |= dict.fromkeys(outputs_of({name: sensor}), weight)
        return weights

    def information(
        self, run: Sensitivities, coordinates: np.ndarray, settings: Settings
    ) -> Identifiability:
        """What data of the sensors can tell about the parameters, from a run at their
        coordinates."""
        return identifiability_from(run, self.parameters, coordinates, self.sensors, settings)

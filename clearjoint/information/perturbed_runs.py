"""Runs of one scene at different parameters, as sensors see them.

They differ in values only, so that one compilation serves all.
"""

from dataclasses import dataclass

import numpy as np

from ..model.bodies import State
from ..model.scene import Scene
from ..parametrisation.parameter import Parameter
from ..simulation.sensitivities import Sensitivities, sensitivities
from ..simulation.settings import Integration
from . import error_growth as growth
from .analysis import Identifiability, identifiability_from
from .sensors import Sensor, outputs_of, times_of


@dataclass(frozen=True)
class Shots:
    """What the runs share."""

    scene: Scene
    state: State
    parameters: dict[str, Parameter]
    sensors: dict[str, Sensor]
    start_time: float

    def run(
        self, coordinates: np.ndarray, integration: Integration, *, throw: bool
    ) -> Sensitivities:
        """A run at coordinates (p,) of the parameters.

        Its derivatives are along these and, last, the disturbance of the initial velocity; its
        outputs those of the sensors, and the points and penetrations of `growth`.
        """
        given = {
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
            given | {growth.DISTURBANCE: growth.disturbance(scene)},
            outputs_of(self.sensors) | growth.points(scene) | growth.penetrations(scene),
            times,
            start_time=self.start_time,
            integration=integration,
            throw=throw,
        )

    def _values(self, coordinates: np.ndarray) -> list[float]:
        pairs = zip(self.parameters.values(), coordinates, strict=True)
        return [float(parameter.scale.value(u)) for parameter, u in pairs]

    def weights(self, times: np.ndarray) -> dict[str, np.ndarray]:
        """(T,) of each output of the sensors: one over the noise; zero where it has no sample."""
        found = {}
        for name, sensor in self.sensors.items():
            weight = np.zeros(len(times))
            weight[np.searchsorted(times, sensor.times)] = 1.0 / sensor.noise
            found |= dict.fromkeys(outputs_of({name: sensor}), weight)
        return found

    def information(
        self, found: Sensitivities, coordinates: np.ndarray, integration: Integration
    ) -> Identifiability:
        """What the sensors can tell, from a run at these coordinates."""
        return identifiability_from(found, self.parameters, coordinates, self.sensors, integration)

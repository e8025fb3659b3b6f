"""Checks of scene, state and settings before a run that computes derivatives."""

from dataclasses import replace

import numpy as np

from ...fields.checks import require
from ...model.bodies import State
from ...model.scene import Scene
from ..step.dense_output import require_dense
from ..step.discontinuity_analysis import require_declared
from ..step.method import Scheme
from ..step.settings import Settings
from .run_checks import check_precision, check_start


def derivative_scheme(
    scene: Scene, state: State, settings: Settings, start_time: float = 0.0
) -> Scheme:
    """Return method and formulation for a run with derivatives, after a check of all arguments.

    **Arguments:** `start_time`: s, the time at which the state must satisfy the constraints.

    **Raises:** `ValueError` for an invalid scene or state; for settings that derivatives don't
    support, such as a solver without dense output; and for an element that changes abruptly at
    times that it does not declare as `breakpoints`.
    """
    settings.require_double()
    check_precision(False)
    require(
        settings.landing_tolerance is not None,
        "landing_tolerance",
        None,
        "a penetration in m",
        "derivatives hold only where steps land on the begin and end of contacts",
    )
    redundant = check_start(scene, state, start_time, settings.coordinates)
    require_declared(scene)
    scheme = Scheme.on_host(settings, bool(redundant))
    require_dense(scheme.method.solver)
    tolerance = np.asarray(settings.derivative_tolerance, float)
    return replace(scheme, method=replace(scheme.method, derivative_tolerance=tolerance))

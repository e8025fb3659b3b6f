"""What is checked of a scene, a state and the settings before a run is compiled."""

import jax

from ..dynamics.assembly import (
    check_names,
    require_assembled,
    require_certain,
    require_representable,
)
from ..dynamics.constraint_report import constraint_report
from ..dynamics.coordinates import AbstractCoordinates
from ..dynamics.journals import require_in_bearings
from ..fields.caching import cached_by_numbers
from ..fields.checks import recheck, require, require_positive
from ..math.vectors import Scalar
from ..model.bodies import State
from ..model.scene import Scene


def check_precision(allow_float32: bool) -> None:
    """Check that JAX computes in 64 bits, unless single precision is allowed."""
    if not (jax.config.jax_enable_x64 or allow_float32):  # pyright: ignore
        raise ValueError(
            "JAX is set to 32-bit floats, in which penetrations of micrometres drown: call "
            "clearjoint.configure() before JAX starts, or pass allow_float32=True."
        )


def check_values(
    scene: Scene,
    state: State,
    rtol: Scalar,
    atol: Scalar | None,
    first_step: Scalar | None,
    landing_tolerance: Scalar | None,
) -> None:
    """Check the numbers of a run, those of the scene included."""
    _recheck(scene)
    check_names(scene, state)
    require_positive("rtol", rtol, "give a relative tolerance such as 1e-6", zero=True)
    for name, value, remedy, zero in (
        ("atol", atol, "give an absolute tolerance such as 1e-9", True),
        ("first_step", first_step, "give a step in s, or None", False),
        ("landing_tolerance", landing_tolerance, "give a penetration in m, or None", False),
    ):
        if value is not None:
            require_positive(name, value, remedy, zero=zero)
    require(
        bool(rtol > 0) or (atol is not None and bool(atol > 0)),
        "rtol",
        float(rtol),
        "positive unless `atol` is",
        "no step is without error; give a relative tolerance such as 1e-6",
    )


def check_structure(
    scene: Scene, state: State, t: Scalar, coordinates: AbstractCoordinates
) -> tuple[str, ...]:
    """Check the state against the constraints; the names of those that are redundant."""
    if not scene.joints:
        return ()
    require_in_bearings(scene, state)
    return _redundant(scene, state, t, coordinates)


@cached_by_numbers
def _recheck(scene: Scene) -> None:
    recheck(scene)


@cached_by_numbers
def _redundant(
    scene: Scene, state: State, t: Scalar, coordinates: AbstractCoordinates
) -> tuple[str, ...]:
    report = constraint_report(scene, state, t, coordinates)
    require_assembled(report.names, report.values, report.rates)
    require_certain(report.uncertain)
    require_representable(scene, state, coordinates)
    return report.redundant

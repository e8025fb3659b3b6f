"""Whether the lanes of a sweep can begin: what `simulate` checks of its initial state."""

from dataclasses import replace

import numpy as np

from ..dynamics.assembly import ACCEPTED_VIOLATION, require_certain, require_freedom
from ..dynamics.constraint_report import dependent, start_rows_of_lanes
from ..dynamics.coordinates import AbstractCoordinates
from .axes import Lanes


def checked_starts(
    lanes: Lanes, start_time: float, coordinates: AbstractCoordinates
) -> tuple[Lanes, bool]:
    """The lanes with those marked as bad whose constraints are nearly redundant, so that they can't
    be told from redundant ones; and whether any lane that runs has redundant constraints.

    Lanes that are not assembled are not judged here: their runs end with a result code of their
    own.

    **Raises:** `ValueError` if nothing is left to move.
    """
    require_freedom(lanes.scene, lanes.of(0)[1], coordinates)
    rows = start_rows_of_lanes(lanes.scene, lanes.scenes, lanes.states, start_time, coordinates)
    bad, redundant = dict(lanes.bad), False
    known: dict[bytes, np.ndarray] = {}
    residuals = np.concatenate([rows.values, rows.rates], axis=1)
    for lane in np.flatnonzero((np.abs(residuals) <= ACCEPTED_VIOLATION).all(axis=1)).tolist():
        if lane in bad:
            continue
        dependent_here, uncertain = dependent(rows.names, rows.left[lane], known)
        try:
            require_certain(uncertain)
            redundant = redundant or bool(dependent_here)
        except ValueError as error:
            bad[lane] = str(error)
    return replace(lanes, bad=dict(sorted(bad.items()))), redundant

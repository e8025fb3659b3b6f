"""Whether the lanes of a sweep can begin: what `simulate` checks of its initial state."""

from dataclasses import replace

from ..dynamics.assembly import is_assembled, require_certain, require_freedom
from ..dynamics.constraint_report import constraint_reports
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
    bad, redundant = dict(lanes.bad), False
    reports = constraint_reports(lanes.scene, lanes.scenes, lanes.states, start_time, coordinates)
    for lane, report in enumerate(reports):
        if lane in bad or not is_assembled(report.values, report.rates):
            continue
        try:
            require_certain(report.uncertain)
            redundant = redundant or bool(report.redundant)
        except ValueError as error:
            bad[lane] = str(error)
    return replace(lanes, bad=dict(sorted(bad.items()))), redundant

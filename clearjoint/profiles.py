"""Deviations of a bearing's wall or a journal from a circle, for `bearing_profile=` and
`journal_profile=` of a `ClearanceJoint`."""

from ._model.profiles import Harmonics as Harmonics
from ._model.profiles import PeriodicSpline as PeriodicSpline

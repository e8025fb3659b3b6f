"""Deviations of a bearing's wall or a journal from a circle, for `bearing_profile=` and
`journal_profile=` of a `ClearanceJoint`, and what varies over the mesh cycle of a `GearBacklash`:
its `transmission_error=` and its `stiffness=`."""

from ._model.clearance_joints.mesh_stiffness import StiffnessHarmonics as StiffnessHarmonics
from ._model.clearance_joints.mesh_stiffness import StiffnessSpline as StiffnessSpline
from ._model.clearance_joints.mesh_stiffness import TeethInMesh as TeethInMesh
from ._model.profiles import Harmonics as Harmonics
from ._model.profiles import PeriodicSpline as PeriodicSpline

"""Base classes and functions for laws, friction, joints, coordinates, quantities and reductions of
your own.

A class of your own is a subclass of one of these base classes; it need not be registered. Methods
compute with scalars instead of arrays: JAX arrays of shape (), but a Python float for a number that
is compiled as exactly zero or one, such as a component of the axis (1, 0, 0). `Vector`, `Matrix`,
`EulerParameters`, `Motion` and `Wrench` contain such scalars, and leave products with these zeros
and ones out of the program. `quantity` declares fields that have units, and the `require` functions
check arguments and raise errors of a common form. The functions of `clearjoint.testing` check the
finished classes.
"""

from ._dynamics.coordinates import AbstractCoordinates as AbstractCoordinates
from ._dynamics.coordinates import AbstractMechanics as AbstractMechanics
from ._dynamics.formulation import AbstractStabilisation as AbstractStabilisation
from ._dynamics.formulation import Formulation as Formulation
from ._dynamics.system import System as System
from ._fields.checks import checkable as checkable
from ._fields.checks import require as require
from ._fields.checks import require_axis as require_axis
from ._fields.checks import require_finite as require_finite
from ._fields.checks import require_point as require_point
from ._fields.checks import require_positive as require_positive
from ._fields.checks import require_range as require_range
from ._fields.checks import require_shape as require_shape
from ._fields.objects import optional_quantity as optional_quantity
from ._fields.objects import quantity as quantity
from ._math.interpolation import Slope as Slope
from ._math.rotations import normalised as normalised
from ._math.rotations import rotation_matrix as rotation_matrix
from ._math.rotations import turned as turned
from ._math.rotations import unit as unit
from ._math.rotations import within_two_turns as within_two_turns
from ._math.smoothing import norm_and_direction as norm_and_direction
from ._math.smoothing import positive_power as positive_power
from ._math.smoothing import ramp as ramp
from ._math.vectors import IDENTITY as IDENTITY
from ._math.vectors import UNIT_X as UNIT_X
from ._math.vectors import UNIT_Y as UNIT_Y
from ._math.vectors import UNIT_Z as UNIT_Z
from ._math.vectors import ZERO as ZERO
from ._math.vectors import EulerParameters as EulerParameters
from ._math.vectors import Matrix as Matrix
from ._math.vectors import Scalar as Scalar
from ._math.vectors import Vector as Vector
from ._math.vectors import pack as pack
from ._math.vectors import unpack as unpack
from ._model.bodies import NO_WRENCH as NO_WRENCH
from ._model.bodies import Motion as Motion
from ._model.bodies import Wrench as Wrench
from ._model.clearance_joints.clearance import AbstractAxialPolicy as AbstractAxialPolicy
from ._model.clearance_joints.mesh_stiffness import AbstractMeshStiffness as AbstractMeshStiffness
from ._model.contact.cylinders import AbstractCylinder as AbstractCylinder
from ._model.contact.dashpots import AbstractDashpotLaw as AbstractDashpotLaw
from ._model.contact.friction import AbstractBristleFriction as AbstractBristleFriction
from ._model.contact.friction import AbstractFriction as AbstractFriction
from ._model.contact.hunt_crossley import AbstractDampedLaw as AbstractDampedLaw
from ._model.contact.hunt_crossley import AbstractHertzianLaw as AbstractHertzianLaw
from ._model.contact.laws import AbstractContactLaw as AbstractContactLaw
from ._model.contact.laws import AbstractElasticity as AbstractElasticity
from ._model.contact.laws import AbstractElasticLaw as AbstractElasticLaw
from ._model.contact.laws import AbstractStiffness as AbstractStiffness
from ._model.contact.laws import Gap as Gap
from ._model.contact.laws import Limit as Limit
from ._model.contact.laws import contact_normal_force as contact_normal_force
from ._model.contact.laws import slip_velocity as slip_velocity
from ._model.drives.drivers import AbstractDriveTorque as AbstractDriveTorque
from ._model.drives.drivers import AbstractRotationDriver as AbstractRotationDriver
from ._model.drives.functions_of_time import AbstractFunctionOfTime as AbstractFunctionOfTime
from ._model.films import AbstractFilm as AbstractFilm
from ._model.films import FilmGap as FilmGap
from ._model.joints.base import AbstractConstraint as AbstractConstraint
from ._model.joints.base import AbstractContactJoint as AbstractContactJoint
from ._model.joints.base import AbstractForce as AbstractForce
from ._model.joints.base import Contact as Contact
from ._model.joints.base import Motions as Motions
from ._model.joints.base import Row as Row
from ._model.joints.constraint_rows import coincident_points as coincident_points
from ._model.joints.constraint_rows import perpendicular as perpendicular
from ._model.joints.constraint_rows import point_in_plane as point_in_plane
from ._model.joints.constraint_rows import rows_from_residual as rows_from_residual
from ._model.joints.constraint_rows import turning_angle as turning_angle
from ._model.joints.motion_subspaces import AbstractMotionSubspace as AbstractMotionSubspace
from ._model.joints.motion_subspaces import JointState as JointState
from ._model.joints.motion_subspaces import Relative as Relative
from ._model.joints.motion_subspaces import Twist as Twist
from ._model.joints.sampled_force import AbstractSampledForce as AbstractSampledForce
from ._model.joints.sampled_force import Periodic as Periodic
from ._model.pen import Marker as Marker
from ._model.profiles import AbstractProfile as AbstractProfile
from ._model.profiles import Deviation as Deviation
from ._parametrisation.parameter import AbstractScale as AbstractScale
from ._result_codes import result_number as result_number
from ._result_codes import result_numbers as result_numbers
from ._simulation.reductions.base import AbstractReduction as AbstractReduction
from .quantities.base import AbstractQuantity as AbstractQuantity
from .quantities.base import Component as Component
from .quantities.base import Instant as Instant
from .quantities.base import Quantity as Quantity

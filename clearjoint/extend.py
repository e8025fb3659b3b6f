"""Base classes and functions for laws, friction, joints, coordinates, quantities and reductions of
your own.

A class of your own is a subclass of `AbstractContactLaw`, `AbstractFriction`, `AbstractConstraint`,
`AbstractForce`, `AbstractContactJoint`, `AbstractAxialPolicy`, `AbstractQuantity` or another base
class of this module; it need not be registered. Methods compute with scalars instead of arrays.
Most scalars are JAX arrays of shape (). A number that is compiled as exactly zero or one, such as a
component of the axis (1, 0, 0), is a Python float instead. `Vector`, `Matrix`, `EulerParameters`,
`Motion` and `Wrench` contain scalars of both types, and leave products with these zeros and ones
out of the program. `quantity` declares
fields that have units, and the `require` functions check arguments and raise errors of a common
form. The functions of `clearjoint.testing` check the finished classes.

Users of ready laws and joints need only the names in `clearjoint` itself.
"""

from .dynamics.coordinates import AbstractCoordinates as AbstractCoordinates
from .dynamics.coordinates import AbstractMechanics as AbstractMechanics
from .dynamics.formulation import AbstractStabilisation as AbstractStabilisation
from .dynamics.formulation import Formulation as Formulation
from .dynamics.system import System as System
from .fields.checks import checkable as checkable
from .fields.checks import require as require
from .fields.checks import require_axis as require_axis
from .fields.checks import require_finite as require_finite
from .fields.checks import require_point as require_point
from .fields.checks import require_positive as require_positive
from .fields.checks import require_range as require_range
from .fields.checks import require_shape as require_shape
from .fields.objects import optional_quantity as optional_quantity
from .fields.objects import quantity as quantity
from .math.rotations import normalised as normalised
from .math.rotations import rotation_matrix as rotation_matrix
from .math.rotations import turned as turned
from .math.rotations import unit as unit
from .math.rotations import within_two_turns as within_two_turns
from .math.smoothing import norm_and_direction as norm_and_direction
from .math.smoothing import positive_power as positive_power
from .math.smoothing import ramp as ramp
from .math.vectors import IDENTITY as IDENTITY
from .math.vectors import UNIT_X as UNIT_X
from .math.vectors import UNIT_Y as UNIT_Y
from .math.vectors import UNIT_Z as UNIT_Z
from .math.vectors import ZERO as ZERO
from .math.vectors import EulerParameters as EulerParameters
from .math.vectors import Matrix as Matrix
from .math.vectors import Scalar as Scalar
from .math.vectors import Vector as Vector
from .math.vectors import pack as pack
from .math.vectors import unpack as unpack
from .model.bodies import NO_WRENCH as NO_WRENCH
from .model.bodies import Motion as Motion
from .model.bodies import Wrench as Wrench
from .model.clearance_joints.clearance import AbstractAxialPolicy as AbstractAxialPolicy
from .model.contact.cylinders import AbstractCylinder as AbstractCylinder
from .model.contact.dashpots import AbstractDashpotLaw as AbstractDashpotLaw
from .model.contact.friction import AbstractBristleFriction as AbstractBristleFriction
from .model.contact.friction import AbstractFriction as AbstractFriction
from .model.contact.hunt_crossley import AbstractDampedLaw as AbstractDampedLaw
from .model.contact.hunt_crossley import AbstractHertzianLaw as AbstractHertzianLaw
from .model.contact.laws import AbstractContactLaw as AbstractContactLaw
from .model.contact.laws import AbstractElasticity as AbstractElasticity
from .model.contact.laws import AbstractElasticLaw as AbstractElasticLaw
from .model.contact.laws import AbstractStiffness as AbstractStiffness
from .model.contact.laws import Gap as Gap
from .model.contact.laws import Limit as Limit
from .model.contact.laws import contact_normal_force as contact_normal_force
from .model.contact.laws import slip_velocity as slip_velocity
from .model.drives.drivers import AbstractDriveTorque as AbstractDriveTorque
from .model.drives.drivers import AbstractRotationDriver as AbstractRotationDriver
from .model.drives.functions_of_time import AbstractFunctionOfTime as AbstractFunctionOfTime
from .model.films import AbstractFilm as AbstractFilm
from .model.films import FilmGap as FilmGap
from .model.joints.base import AbstractConstraint as AbstractConstraint
from .model.joints.base import AbstractContactJoint as AbstractContactJoint
from .model.joints.base import AbstractForce as AbstractForce
from .model.joints.base import Contact as Contact
from .model.joints.base import Motions as Motions
from .model.joints.base import Row as Row
from .model.joints.constraint_rows import coincident_points as coincident_points
from .model.joints.constraint_rows import perpendicular as perpendicular
from .model.joints.constraint_rows import point_in_plane as point_in_plane
from .model.joints.constraint_rows import rows_from_residual as rows_from_residual
from .model.joints.constraint_rows import turning_angle as turning_angle
from .model.joints.motion_subspaces import AbstractMotionSubspace as AbstractMotionSubspace
from .model.joints.motion_subspaces import JointState as JointState
from .model.joints.motion_subspaces import Relative as Relative
from .model.joints.motion_subspaces import Twist as Twist
from .model.pen import Marker as Marker
from .model.profiles import AbstractProfile as AbstractProfile
from .model.profiles import Deviation as Deviation
from .parametrisation.parameter import AbstractScale as AbstractScale
from .quantities.base import AbstractQuantity as AbstractQuantity
from .quantities.base import Component as Component
from .quantities.base import Instant as Instant
from .quantities.base import Quantity as Quantity
from .result_codes import result_number as result_number
from .result_codes import result_numbers as result_numbers
from .simulation.reductions.base import AbstractReduction as AbstractReduction

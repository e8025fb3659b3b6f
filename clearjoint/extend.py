"""For authors of laws, friction, joints, coordinates, quantities and reductions of their own.

An element is a subclass of `AbstractContactLaw`, `AbstractFriction`, `AbstractConstraint`,
`AbstractForce`, `AbstractContactJoint`, `AbstractAxialPolicy`, `AbstractQuantity` and the like;
nothing is registered. Their methods compute with scalars, which are Python floats where a number is
zero or one by structure and JAX's otherwise: `Vector`, `Matrix`, `EulerParameters`, `Motion` and
`Wrench` hold them, and multiply what is zero or one away. Fields that hold numbers with units are
declared by `quantity`, and the `require` functions raise errors of one form. `clearjoint.testing`
checks what was made.

What a user of ready elements needs is in `clearjoint` itself.
"""

from .bodies import NO_WRENCH as NO_WRENCH
from .bodies import Motion as Motion
from .bodies import Wrench as Wrench
from .contact import AbstractContactLaw as AbstractContactLaw
from .contact import AbstractDampedLaw as AbstractDampedLaw
from .contact import AbstractHertzianLaw as AbstractHertzianLaw
from .contact import AbstractStiffness as AbstractStiffness
from .contact import Gap as Gap
from .contact import slip_velocity as slip_velocity
from .coordinates import AbstractCoordinates as AbstractCoordinates
from .coordinates import AbstractMechanics as AbstractMechanics
from .dynamics import AbstractStabilisation as AbstractStabilisation
from .dynamics import Formulation as Formulation
from .dynamics import contact_normal_force as contact_normal_force
from .fields import optional_quantity as optional_quantity
from .fields import quantity as quantity
from .fields import require as require
from .fields import require_axis as require_axis
from .fields import require_finite as require_finite
from .fields import require_point as require_point
from .fields import require_positive as require_positive
from .fields import require_range as require_range
from .fields import require_shape as require_shape
from .friction import AbstractFriction as AbstractFriction
from .instant import Instant as Instant
from .joints.axial import AbstractAxialPolicy as AbstractAxialPolicy
from .joints.base import AbstractConstraint as AbstractConstraint
from .joints.base import AbstractContactJoint as AbstractContactJoint
from .joints.base import AbstractForce as AbstractForce
from .joints.base import Contact as Contact
from .joints.base import Motions as Motions
from .joints.base import Row as Row
from .joints.drives import AbstractDriveTorque as AbstractDriveTorque
from .joints.drives import AbstractRotationDriver as AbstractRotationDriver
from .joints.freedoms import AbstractFreedom as AbstractFreedom
from .joints.freedoms import JointState as JointState
from .joints.freedoms import Relative as Relative
from .joints.freedoms import Twist as Twist
from .joints.primitives import coincident_points as coincident_points
from .joints.primitives import perpendicular as perpendicular
from .joints.primitives import point_in_plane as point_in_plane
from .joints.primitives import rows_from_residual as rows_from_residual
from .joints.primitives import turning_angle as turning_angle
from .quantities.base import AbstractQuantity as AbstractQuantity
from .quantities.base import Component as Component
from .reductions import AbstractReduction as AbstractReduction
from .reductions import Quantity as Quantity
from .results import result_number as result_number
from .results import result_numbers as result_numbers
from .rotations import normalised as normalised
from .rotations import rotation_matrix as rotation_matrix
from .rotations import turned as turned
from .rotations import unit as unit
from .rotations import within_two_turns as within_two_turns
from .scales import AbstractScale as AbstractScale
from .smoothing import norm_and_direction as norm_and_direction
from .smoothing import positive_power as positive_power
from .smoothing import ramp as ramp
from .vectors import IDENTITY as IDENTITY
from .vectors import UNIT_X as UNIT_X
from .vectors import UNIT_Y as UNIT_Y
from .vectors import UNIT_Z as UNIT_Z
from .vectors import ZERO as ZERO
from .vectors import EulerParameters as EulerParameters
from .vectors import Matrix as Matrix
from .vectors import Scalar as Scalar
from .vectors import Vector as Vector
from .vectors import pack as pack
from .vectors import unpack as unpack

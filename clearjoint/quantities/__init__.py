"""Scalar quantities of a mechanism at an instant, such as a position or a contact force.

Runs evaluate them for reductions (results such as a peak, updated at every step), for Poincaré
sections and as measured signals. Any scalar function of an `Instant`, which is the scene with its
motion at one time, can be used as a quantity. The classes below declare their units, except
`Multiplier`, whose unit depends on the constraint. Their objects compare by value, so that a run is
not compiled again for an equal quantity.

| sensor | quantity |
|---|---|
| camera | `Position`, `PointPosition` |
| velocimeter | `Velocity`, `PointVelocity` |
| accelerometer, which measures gravity too | `PointAcceleration(..., axes="body", gravity=True)` |
| accelerometer with limited bandwidth, for impacts | `clearjoint.accelerometer` |
| inclinometer, encoder | `Angle`, `JointAngle` |
| gyroscope | `AngularVelocity(..., axes="body")`, `AngularAcceleration` |
| tachometer | `JointAngularVelocity`, `JointAngularAcceleration` |
| displacement sensor | `Distance` |
| load cell | `Reaction`, `ContactForce`, `FrictionForce`, `FilmForce` |
| torque sensor | `ReactionMoment`, `MotorTorque` |
| current of a servo | `MotorCurrent` |
| proximity probe on the bearing | `JournalOffset`, `Eccentricity`, `Penetration` |
| other | a function of an `Instant`, with an explicit unit |

The arguments of these classes have the same meaning everywhere:

- `body`, `joint`: names in the scene; `body` may be "ground", except for accelerations.
- `point`: (3,) m from the body's centre of mass, in body axes.
- `component`: "x", "y" or "z", or ``None``, where it is the default, for the magnitude of the
  vector; in global axes, or in those that `axes` names, "global" or "body".
- `contact`: label of a contact of the joint. The contacts of a revolute joint with clearance are
  "V" and "W", at the two ends (bases) of the journal, with `line_points` also "point 2" and so on
  between them, and with shoulders "lower shoulder" and "upper shoulder". Other joints have other
  labels, such as "lower wall" for a slot.
- `base`: "V" or "W", one end of the journal, or ``None``, the default, for its centre.

**Raises:** `ValueError` for a value that is not allowed and, when a run begins, for a name that the
scene does not have.
"""

from .._fields.objects import without_modules as _without_modules
from .accelerometer import AccelerometerReading as AccelerometerReading
from .base import AbstractQuantity as AbstractQuantity
from .base import Component as Component
from .bodies import Acceleration as Acceleration
from .bodies import Angle as Angle
from .bodies import AngularAcceleration as AngularAcceleration
from .bodies import AngularVelocity as AngularVelocity
from .bodies import Distance as Distance
from .bodies import PointAcceleration as PointAcceleration
from .bodies import PointPosition as PointPosition
from .bodies import PointVelocity as PointVelocity
from .bodies import Position as Position
from .bodies import Velocity as Velocity
from .drives import MotorCurrent as MotorCurrent
from .drives import MotorTorque as MotorTorque
from .joints import BristleDeflection as BristleDeflection
from .joints import ContactForce as ContactForce
from .joints import Eccentricity as Eccentricity
from .joints import EntrySpeed as EntrySpeed
from .joints import FilmForce as FilmForce
from .joints import FrictionForce as FrictionForce
from .joints import JointAngle as JointAngle
from .joints import JointAngularAcceleration as JointAngularAcceleration
from .joints import JointAngularVelocity as JointAngularVelocity
from .joints import JournalOffset as JournalOffset
from .joints import Multiplier as Multiplier
from .joints import Penetration as Penetration
from .joints import PenetrationRate as PenetrationRate
from .joints import Reaction as Reaction
from .joints import ReactionMoment as ReactionMoment

__dir__ = _without_modules(globals())

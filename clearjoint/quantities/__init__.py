"""Scalar functions of an instant, for reductions, sections and measurements.

Any function of an `Instant` serves; these are values that compare equal when they mean the same,
so that using them anew compiles nothing anew, and they know their units.

| sensor | quantity |
|---|---|
| camera | `Position`, `PointPosition` |
| velocimeter | `Velocity`, `PointVelocity` |
| accelerometer, which feels gravity | `PointAcceleration(..., axes="body", gravity=True)` |
| accelerometer of a bandwidth, which makes impacts signals | `clearjoint.accelerometer` |
| inclinometer, encoder | `Angle`, `JointAngle` |
| gyroscope | `AngularVelocity(..., axes="body")`, `AngularAcceleration` |
| tachometer | `JointAngularVelocity`, `JointAngularAcceleration` |
| displacement sensor | `Distance` |
| load cell | `Reaction`, `ContactForce`, `FrictionForce`, `FilmForce` |
| torque sensor | `ReactionMoment` |
| proximity probe on the bearing | `JournalOffset`, `Eccentricity`, `Penetration` |
| another | a function of an `Instant`, with its unit given |
"""

from ..fields.readable import without_modules as _without_modules
from .accelerometer import AccelerometerReading as AccelerometerReading
from .base import AbstractQuantity as AbstractQuantity
from .base import Component as Component
from .bodies import Acceleration as Acceleration
from .bodies import Angle as Angle
from .bodies import PointAcceleration as PointAcceleration
from .bodies import PointPosition as PointPosition
from .bodies import PointVelocity as PointVelocity
from .bodies import Position as Position
from .bodies import Velocity as Velocity
from .distances import Distance as Distance
from .films import FilmForce as FilmForce
from .joints import BristleDeflection as BristleDeflection
from .joints import ContactForce as ContactForce
from .joints import Eccentricity as Eccentricity
from .joints import EntrySpeed as EntrySpeed
from .joints import FrictionForce as FrictionForce
from .joints import JointAngle as JointAngle
from .joints import JournalOffset as JournalOffset
from .joints import Multiplier as Multiplier
from .joints import Penetration as Penetration
from .joints import PenetrationRate as PenetrationRate
from .joints import Reaction as Reaction
from .joints import ReactionMoment as ReactionMoment
from .turning import AngularAcceleration as AngularAcceleration
from .turning import AngularVelocity as AngularVelocity
from .turning import JointAngularAcceleration as JointAngularAcceleration
from .turning import JointAngularVelocity as JointAngularVelocity

__dir__ = _without_modules(globals())

"""Checks of user-defined laws and elements, and access to the functions that a run evaluates.

`check_law`, `check_friction`, `check_bristles`, `check_film`, `check_constraint`, `check_force` and
`check_contact_joint` are for authors of new elements. `RunProgram` and `Stepper` provide the
functions of an integration step, to be traced, counted and timed.
"""

from ..fields.readable import without_modules as _without_modules
from .conformance import check_bristles as check_bristles
from .conformance import check_constraint as check_constraint
from .conformance import check_friction as check_friction
from .conformance import check_law as check_law
from .contact_joints import check_contact_joint as check_contact_joint
from .films import check_film as check_film
from .force_conformance import check_force as check_force
from .moving_bodies import moving as moving
from .programs import RunProgram as RunProgram
from .programs import Stepper as Stepper
from .programs import native_seconds as native_seconds

__all__ = [
    "RunProgram",
    "Stepper",
    "check_bristles",
    "check_constraint",
    "check_contact_joint",
    "check_force",
    "check_film",
    "check_friction",
    "check_law",
    "moving",
    "native_seconds",
]

__dir__ = _without_modules(globals())

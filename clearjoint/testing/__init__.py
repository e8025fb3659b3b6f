"""Checks of user-defined laws, joints and forces, for the tests of their authors.

Each `check_...` function raises an `AssertionError` that states the first problem. Each except
`check_constraint` also demands that `jax.vmap` gives the same result as a single evaluation. The
argument `motions` has the motion of each body of an element, from `moving`, by the body's name,
with "ground" if the element has it. Translating and rotating bodies make the strictest test.
"""

from .._fields.objects import without_modules as _without_modules
from .conformance import check_bristles as check_bristles
from .conformance import check_constraint as check_constraint
from .conformance import check_friction as check_friction
from .conformance import check_law as check_law
from .contact_joints import check_contact_joint as check_contact_joint
from .continuity import moving as moving
from .films import check_film as check_film
from .force_conformance import check_force as check_force
from .native_times import native_seconds as native_seconds
from .native_times import optimise_programs as optimise_programs

__dir__ = _without_modules(globals())

"""Contexts in which part of the package is missing, or another's, while programs are traced."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from types import MappingProxyType
from typing import NoReturn
from unittest.mock import patch

from ..dynamics import contact_forces, system
from ..dynamics.coordinates import MotionVariables
from ..dynamics.joint_coordinates import branches
from ..dynamics.joint_coordinates import spatial_inertia as inertia
from ..dynamics.system import System
from ..math.vectors import Scalar
from ..model.contact.friction import RegularisedCoulomb
from ..model.joints import motion_subspaces as freedoms
from ..model.plays import axial, bearing_surfaces, clearance
from ..parametrisation.parametrised_scene import AbstractFamily
from ..simulation import stepping
from ..simulation.landing import Landing

FEATURES: Mapping[str, tuple[tuple[object, str], ...]] = MappingProxyType(
    {
        "hinge": (
            (freedoms.Hinge, "rotation"),
            (freedoms.Hinge, "columns"),
            (branches, "jointed_link"),
        ),
        "link on a link": ((inertia.Inertia, "without"),),
        "clearance": (
            (clearance.ClearanceJoint, "contacts"),
            (contact_forces, "contact_normal_force"),
            (Landing, "due"),
            (Landing, "retry"),
            (stepping, "updated_memory"),
            (System, "second_rates"),
        ),
        "friction": ((RegularisedCoulomb, "force"), (bearing_surfaces, "slip_velocity")),
        "end play": ((axial.EndPlay, "shoulder_gap"),),
        "energy ledger": ((system, "ledger_powers"),),
        "sensitivities": ((AbstractFamily, "pushed"), (stepping, "_tangents_after")),
    }
)
"""Of each feature of a scene or run the functions that no scene without it calls, as owner and
name.

>>> "friction" in testing.FEATURES
True
"""


@contextmanager
def without(*features: str) -> Iterator[None]:
    """Inside, the code of `FEATURES` is missing: a call of it raises an ``AssertionError``.

    >>> with testing.without("friction"):
    ...     scene, state = cj.double_pendulum()  # a run of it calls nothing of friction
    """
    with ExitStack() as patches:
        for owner, name in (place for feature in features for place in FEATURES[feature]):
            patches.enter_context(patch.object(owner, name, _missing(name)))
        yield


def _missing(name: str) -> Callable[..., NoReturn]:
    def function(*_: object, **__: object) -> NoReturn:
        raise AssertionError(f"{name} is called by a scene that lacks the feature")

    return function


@contextmanager
def equations_of_motion(
    rates: Callable[..., tuple[MotionVariables, dict[str, Scalar]]],
) -> Iterator[None]:
    """Inside, steps are traced with other equations of motion.

    **Arguments:** `rates`: a function of the `System` (whose `scene` is in scalar form), variables,
    memory (entry speeds, m/s, by joint and contact), time, s, and, perhaps, which contacts are
    closed, by joint and contact; it returns the variables' rates and the powers of the ledger.

    >>> scene, state = extend.unpack(cj.double_pendulum())
    >>> system = extend.System(scene, extend.Formulation())
    >>> variables = system.encode(state.bodies)
    >>> def rates(system, variables, memory, t):
    ...     return jax.tree.map(jnp.zeros_like, variables), {}
    >>> import jax
    >>> with testing.equations_of_motion(rates):
    ...     stopped, _ = system.rates(variables, {}, 0.0)
    >>> sum(float(jnp.sum(jnp.abs(leaf))) for leaf in jax.tree.leaves(stopped))
    0.0
    """
    with patch.object(System, "rates", rates):
        yield

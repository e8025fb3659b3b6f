"""Contexts in which part of the package is missing while programs are traced."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from types import MappingProxyType
from typing import NoReturn
from unittest.mock import patch

from clearjoint._dynamics import contact_forces, system
from clearjoint._dynamics.joint_coordinates import inertia, trees
from clearjoint._model.clearance_joints import clearance, common
from clearjoint._model.joints import motion_subspaces as freedoms
from clearjoint._parametrisation.parametrised_scene import ParametrisedScene
from clearjoint._simulation.step import stepping
from clearjoint._simulation.step.landing import Landing
from clearjoint.extend import System
from clearjoint.frictions import RegularisedCoulomb

FEATURES: Mapping[str, tuple[tuple[object, str], ...]] = MappingProxyType(
    {
        "hinge": (
            (freedoms.Hinge, "rotation"),
            (freedoms.Hinge, "columns"),
            (trees.JointedBranch, "link"),
        ),
        "link on a link": ((inertia.Inertia, "without"),),
        "clearance": (
            (clearance.ClearanceJoint, "contacts"),
            (contact_forces, "contact_normal_force"),
            (Landing, "time_to_next_event"),
            (Landing, "retry"),
            (stepping, "updated_entry_speeds"),
            (System, "second_rates"),
        ),
        "friction": ((RegularisedCoulomb, "force"), (common, "slip_velocity")),
        "end play": ((clearance.EndPlay, "shoulder_gap"),),
        "energy ledger": ((system, "ledger_powers"),),
        "sensitivities": ((ParametrisedScene, "with_derivatives"),),
    }
)
"""Of each feature of a scene or run the functions that no scene without it calls, as owner and
name; in the order of the scenes of `studies.cost`."""


@contextmanager
def without(*features: str) -> Iterator[None]:
    """Inside, the code of `FEATURES` is missing: a call of it raises an ``AssertionError``."""
    with ExitStack() as patches:
        for owner, name in (place for feature in features for place in FEATURES[feature]):
            patches.enter_context(patch.object(owner, name, _missing(name)))
        yield


def _missing(name: str) -> Callable[..., NoReturn]:
    def function(*_: object, **__: object) -> NoReturn:
        raise AssertionError(f"{name} is called by a scene that lacks the feature")

    return function

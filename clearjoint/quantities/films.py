"""Quantities of films in joints."""

from collections.abc import Collection
from typing import ClassVar

import equinox as eqx

from ..math.vectors import Scalar
from ..model.joints.base import AbstractContactJoint
from ..model.scene import Scene
from .base import Component, part, require_component
from .instant import Instant
from .joints import AbstractJointQuantity


class FilmForce(AbstractJointQuantity):
    """Force of the film of a joint on its journal, N: its magnitude, or a global component.

    >>> force = cj.quantities.FilmForce("bearing", "y")
    >>> force.check(cj.mechanisms.rotor_in_bearing(film=cj.films.CaponeFilm(0.02))[0])
    """

    joint: str = eqx.field(static=True)
    component: Component | None = eqx.field(default=None, static=True)
    unit: ClassVar[str | None] = "N"

    def __check_init__(self):
        require_component(self.component, magnitude=True)

    def joints(self, scene: Scene) -> Collection[str]:
        """Names of the joints with a film."""
        kinds = {name: type(joint) for name, joint in scene.contact_joints().items()}
        none = AbstractContactJoint.film_wrenches
        return [name for name, kind in kinds.items() if kind.film_wrenches is not none]

    def __call__(self, now: Instant) -> Scalar:
        """The force, N."""
        joint = now.scene.contact_joints()[self.joint]
        _, journal = joint.pair()
        return part(joint.film_wrenches(now.motions)[journal].force, self.component)

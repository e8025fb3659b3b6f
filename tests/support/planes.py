"""Points of a body against a plane of the ground: what floors, blocks and guides are made of."""

from typing import Any

import equinox as eqx
import numpy as np

import clearjoint as cj
from clearjoint.extend import Contact, Motions, Scalar, Vector, slip_velocity


class Plane(cj.extend.AbstractContactJoint):
    """Points of `body` (m, body axes) stay on this side of the plane normal . x = offset."""

    body: str = eqx.field(static=True)
    points: tuple[Any, ...] = eqx.field(converter=lambda all_: tuple(np.asarray(p) for p in all_))
    normal: Any = eqx.field(converter=np.asarray)
    offset: Any
    law: cj.extend.AbstractContactLaw
    friction: cj.extend.AbstractFriction | None = None

    def pair(self) -> tuple[str, str]:
        return cj.GROUND, self.body

    def laws(self) -> dict[str, cj.extend.AbstractContactLaw]:
        return {f"point {k}": self.law for k in range(len(self.points))}

    def contacts(self, motions: Motions) -> dict[str, Contact]:
        motion, found = motions[self.body], {}
        for k, point in enumerate(self.points):
            place, velocity = motion.point(point), motion.velocity_at(point)
            gap = cj.extend.Gap(place.dot(self.normal) - self.offset, velocity.dot(self.normal))
            slip = None
            if self.friction is not None:
                slip = slip_velocity(velocity, self.normal, gap.rate)
            found[f"point {k}"] = Contact(gap, self.normal, place, point, slip)
        return found

    def friction_force(self, name: str, contact: Contact, normal_force: Scalar) -> Vector | None:
        if self.friction is None or contact.slip is None:
            return None
        return self.friction.force(normal_force, contact.slip)

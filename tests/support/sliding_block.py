"""A block that is pressed on a moving belt by its weight, so that its normal force is constant."""

import numpy as np

import clearjoint as cj

MASS, GRAVITY, STIFFNESS = 2.0, 10.0, 1e9
WEIGHT = MASS * GRAVITY
DEPTH = (WEIGHT / STIFFNESS) ** (2.0 / 3.0)
"""m, at which the belt carries the block."""


class BlockOnBelt(cj.extend.AbstractContactJoint):
    """A point of the ground's plane z = 0, which moves along x, under the centre of a body."""

    body: str
    law: cj.extend.AbstractContactLaw
    friction: cj.extend.AbstractFriction | cj.extend.AbstractBristleFriction
    belt_speed: float = 0.0  # m/s

    def pair(self):
        return "ground", self.body

    def laws(self):
        return {"belt": self.law}

    def contacts(self, motions):
        body, down = motions[self.body], cj.extend.Vector(0.0, 0.0, -1.0)
        place, velocity = body.position, body.velocity
        gap = cj.extend.Gap(-place.z, -velocity.z)
        slip = cj.extend.Vector(velocity.x - self.belt_speed, velocity.y, 0.0)
        under, centre = cj.extend.Vector(place.x, place.y, 0.0), cj.extend.Vector(0.0, 0.0, 0.0)
        return {"belt": cj.extend.Contact(gap, down, under, centre, slip)}

    def bristle_laws(self):
        has_bristles = isinstance(self.friction, cj.extend.AbstractBristleFriction)
        return {"belt": self.friction} if has_bristles else {}

    def friction_force(self, name, contact, normal_force):
        return self.friction.force(normal_force, contact.slip)


def block(friction, belt_speed=0.0, forces=None, velocity=(0.0, 0.0, 0.0), height=-DEPTH):
    """The block with forces on it, and its state at the origin."""
    joint = BlockOnBelt("block", cj.laws.Hertz(STIFFNESS), friction, belt_speed)
    scene = cj.Scene(
        {"block": cj.Body(MASS, (1e-2,) * 3)},
        {"floor": joint},
        gravity=(0.0, 0.0, -GRAVITY),
        forces=forces or {},
    )
    return scene, cj.State({"block": cj.body_state((0.0, 0.0, height), velocity=velocity)})


def along(solution, component=0):
    """Places (m) and velocities (m/s) of the block at the saved times."""
    body = solution.saved.states.bodies["block"]
    return np.asarray(body.position)[:, component], np.asarray(body.velocity)[:, component]


def deflections(solution):
    """Deflections of the block's bristles at the saved times, (K, 3) m."""
    return np.asarray(solution.saved.states.bristles["floor"]["belt"])

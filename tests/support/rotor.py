"""A rotor on a torsion spring: a sweep whose results have a closed form, and which compiles soon.

Angle w0 / w sin(w t) with w^2 = stiffness / INERTIA. The spring is a force of the tests' own; it
turns NaN when it is stiffer than it says it may be.
"""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

import clearjoint as cj
from clearjoint.extend import ZERO, Vector, Wrench, quantity, require_positive

INERTIA, SPEED, END, AFTER = 0.1, 0.5, 1.0, 0.3
TIMES = np.linspace(0.0, END, 401)
LARGEST = 1e5
Z = (0.0, 0.0, 1.0)
ORIGIN = (0.0, 0.0, 0.0)


def angle(now):
    """Of the rotor about z, rad."""
    return angle_of(now.motions["rotor"])


def angle_of(motion):
    return jnp.arctan2(motion.rotation.row_y.x, motion.rotation.row_x.x)


class TorsionSpring(cj.extend.AbstractForce):
    """A moment against the angle of a body about z."""

    body: str = eqx.field(static=True)
    stiffness: Any = quantity("N m")

    def __check_init__(self):
        require_positive("stiffness", self.stiffness, "give it in N m")

    def body_names(self):
        return ("ground", self.body)

    def wrenches(self, motions, t):
        del t
        stiffness = jnp.where(self.stiffness > LARGEST, jnp.nan, self.stiffness)
        moment = Vector(0.0, 0.0, -stiffness * angle_of(motions[self.body]))
        return {self.body: Wrench(ZERO, moment)}


class Turnings(cj.extend.AbstractReduction):
    """How often a quantity's rate changes its sign, and after how many steps the run ended."""

    quantity: Any = eqx.field(static=True)

    def start(self, now):
        return jnp.asarray(self.quantity(now)), jnp.zeros(()), jnp.zeros(())

    def update(self, tally, now):
        before, turnings, steps = tally
        here = self.quantity(now)
        return here, turnings + jnp.where(here * before < 0.0, 1.0, 0.0), steps + 1.0

    def results(self, tally, now):
        return {"": tally[1], "steps": tally[2], "end": now.time}

    def units(self):
        return {"": "1", "steps": "1", "end": "s"}


OUTPUTS = {
    "swing_angle": angle,
    "swing_spin": lambda now: spin(now),
    "zero": cj.Section(angle, {"spin": (lambda now: spin(now), "rad/s")}, count=2, after=AFTER),
    "largest": cj.Peak(angle, "rad"),
    "angle": cj.Statistics(angle, "rad"),
    "late": cj.Statistics(angle, "rad", after=0.5, until=0.75),
    "turnings": Turnings(lambda now: spin(now)),
}
SAMPLED = cj.Saving(TIMES, states=False)
"""The sample times of the quantities among the outputs."""


def spin(now):
    """Of the rotor about z, rad/s."""
    return now.motions["rotor"].spin.z


def rotor(stiffness: float = 10.0) -> tuple[cj.Scene, cj.State]:
    """The scene and its state, in the middle and turning."""
    scene = cj.Scene(
        {"rotor": cj.Body(1.0, (INERTIA, INERTIA, INERTIA))},
        {"hinge": cj.RevoluteJoint("ground", "rotor", ORIGIN, ORIGIN, Z, Z)},
        forces={"spring": TorsionSpring("rotor", stiffness)},
        gravity=(0.0, 0.0, 0.0),
    )
    return scene, cj.State({"rotor": cj.body_state(ORIGIN, spin=(0.0, 0.0, SPEED))})


def stiffness_axis(values) -> cj.Axis:
    return cj.Axis(lambda scene: scene.forces["spring"].stiffness, values)


def swept(stiffness, *, threads=1, offset=None, **options):
    """Lanes of the given stiffness."""
    axes = {"stiffness": stiffness_axis(stiffness)}
    if offset is not None:
        axes["offset"] = cj.Axis.initial(lambda state: state.bodies["rotor"].position[0], offset)
    options = {"outputs": OUTPUTS, "zipped": True, "progress": False, **options}
    if "swing_angle" in options["outputs"]:
        options.setdefault("save", SAMPLED)
    end = options.pop("end_time", END)
    return cj.sweep(*rotor(), end, axes, threads=threads, **options)

"""Derivatives across jumps of the force, at the begin and end of contacts and where time decides."""

from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest

import clearjoint as cj
from clearjoint.fields import quantity
from tests.planes import Plane

Q = cj.quantities
GRAVITY, DROP, MASS = 9.81, 5e-4, 1.0
INTEGRATION = cj.Integration(rtol=1e-10)


class Buffer(cj.AbstractContactLaw):
    """A spring, a damper beside it and a preload: max(K d + D d' + P, 0). It jumps at the onset by
    what the damper and the preload push there, and at the separation by the preload."""

    stiffness: Any = quantity("N/m")
    damping: Any = quantity("N s/m", default=0.0)
    preload: Any = quantity("N", default=0.0)
    has_memory = False

    def force(self, gap, entry_speed):
        pushed = self.elastic_force(gap) + self.damping * gap.rate
        return jnp.where(gap.depth > 0.0, jnp.maximum(pushed, 0.0), 0.0)

    def elastic_force(self, gap):
        spring = self.stiffness * gap.depth + self.preload
        return jnp.where(gap.depth > 0.0, spring, 0.0)

    def stored_energy(self, gap):
        depth = jnp.maximum(gap.depth, 0.0)
        return (0.5 * self.stiffness * depth + self.preload) * depth


def dropped(law, points=1):
    """A body that falls along X onto a plane."""
    plane = Plane("ball", ((0.0, 0.0, 0.0),) * points, (1.0, 0.0, 0.0), DROP, law)
    scene = cj.Scene(
        {"ball": cj.Body(MASS, (1.0, 1.0, 1.0))}, {"floor": plane}, gravity=(GRAVITY, 0.0, 0.0)
    )
    return scene, cj.State({"ball": cj.body_state((0.0, 0.0, 0.0))})


def arrived(end, drop, stiffness, damping, preload):
    """Place and velocity in closed form: the fall, an oscillation about rest, and the rise."""
    begin = np.sqrt(2.0 * drop / GRAVITY)
    rest = (MASS * GRAVITY - preload) / stiffness
    decay = 0.5 * damping / MASS
    w = np.sqrt(stiffness / MASS - decay**2)

    def inside(t):
        """Depth, its rate and second rate, by x = rest + exp(-decay t) (a cos + b sin)."""
        a, b = -rest, (GRAVITY * begin - decay * rest) / w
        c, s, e = np.cos(w * t), np.sin(w * t), np.exp(-decay * t)
        depth = rest + e * (a * c + b * s)
        rate = e * ((-decay * a + w * b) * c + (-decay * b - w * a) * s)
        return depth, rate, stiffness * depth + damping * rate + preload

    def let_go(t):
        depth, _, force = inside(t)
        return min(depth, force)

    low = 0.25 * np.pi / w
    high = 2.0 * np.pi / w
    for _ in range(200):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if let_go(middle) > 0.0 else (low, middle)
    depth, rate, _ = inside(low)
    flight = end - begin - low
    return np.array(
        [drop + depth + rate * flight + 0.5 * GRAVITY * flight**2, rate + GRAVITY * flight]
    )


def slope(function, value, step):
    """Derivative by central differences of fourth order."""
    at = [function(value + k * step) for k in (-2, -1, 1, 2)]
    return (at[0] - 8 * at[1] + 8 * at[2] - at[3]) / (12 * step)


LAWS = {"damper": (1e6, 800.0, 0.0), "preload": (1e6, 0.0, 60.0), "both": (1e6, 300.0, 40.0)}
END = 0.016
PARAMETERS = {
    "drop": cj.Parameter(lambda s: s.joints["floor"].offset),
    "damping": cj.Parameter(lambda s: s.joints["floor"].law.damping),
    "preload": cj.Parameter(lambda s: s.joints["floor"].law.preload),
}


def expected(law):
    stiffness, damping, preload = law
    slopes = (
        slope(lambda v: arrived(END, v, *law), DROP, 1e-7),
        slope(lambda v: arrived(END, DROP, stiffness, v, preload), damping, 1e-2),
        slope(lambda v: arrived(END, DROP, stiffness, damping, v), preload, 1e-3),
    )
    return np.stack(slopes, axis=-1)


@pytest.mark.parametrize("law", LAWS)
def test_sensitivities_across_a_jump_of_a_law(law):
    """What the damper and the preload push at once belongs in the derivatives after it."""
    scene, state = dropped(Buffer(*LAWS[law]))
    outputs = {"x": Q.Position("ball", "x"), "v": Q.Velocity("ball", "x")}
    found = cj.sensitivities(scene, state, END, PARAMETERS, outputs, [END], integration=INTEGRATION)
    values = [found.values[name][0] for name in outputs]
    derivatives = [found.derivatives[name][0] for name in outputs]
    np.testing.assert_allclose(values, arrived(END, DROP, *LAWS[law]), rtol=1e-7)
    np.testing.assert_allclose(derivatives, expected(LAWS[law]), rtol=2e-5, atol=1e-9)

"""The mean force of a step with an event, and comparisons with time."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import pytest

import clearjoint as cj
from clearjoint._dynamics.contact_events import ContactGap
from clearjoint._simulation.step.discontinuities import KINKED, compares_time
from clearjoint._simulation.step.saltation import _changes, _contact_time, _mean_force
from clearjoint.extend import ZERO, Contact, Vector, Wrench
from tests.support.planes import Plane


@pytest.mark.slow
class Step(cj.extend.AbstractContactLaw):
    """A force that begins at 60 N with the slope 1e5 N/m; what jumps there is declared."""

    force_jumps: bool = True
    slopes_jump: bool = True
    uses_entry_speed = False

    def slope_jumps(self):
        return self.slopes_jump

    def force(self, gap, entry_speed):
        return self.elastic_force(gap)

    def elastic_force(self, gap):
        return jnp.where(gap.depth > 0.0, 60.0 + 1e5 * gap.depth, 0.0)

    def stored_energy(self, gap):
        return 60.0 * gap.depth + 0.5e5 * gap.depth**2


@pytest.mark.parametrize(
    ("jumps", "inside", "past"),
    [
        # Where the force jumps, its value; where its slope does, the mean with that at the wall.
        ((True, False), 160.0, 60.0),
        ((False, True), 80.0, None),
        ((True, True), 0.5 * (160.0 + 60.0), None),
    ],
)
def test_the_mean_force_from_an_event_to_the_end_of_the_step(jumps, inside, past):
    law = Step(*jumps)
    plane = Plane("ball", ((0.0, 0.0, 0.0),), (1.0, 0.0, 0.0), 0.0, law)

    def mean(depth):
        gap = cj.extend.Gap(depth, 0.1)
        contact = Contact(gap, Vector(1.0, 0.0, 0.0), ZERO, ZERO, None)
        return float(_mean_force(plane, "point 0", contact, None, {}, {}).normal_force)

    assert mean(1e-3) == pytest.approx(inside, rel=1e-12)
    if past is not None:
        assert mean(-1e-3) == pytest.approx(past, rel=1e-12)


@pytest.mark.parametrize(("speed", "damping"), [(0.0, 0.75), (0.4, 0.75 / 4.0)])
def test_the_mean_force_of_a_contact_that_begins_has_its_present_rate_as_entry_speed(
    speed, damping
):
    """K d (1 + 1.5 (1 - c) d'/v0) by Hunt and Crossley, with d' = 0.1 m/s."""
    law = cj.laws.HuntCrossley(0.5, 1e6, exponent=1.0)
    plane = Plane("ball", ((0.0, 0.0, 0.0),), (1.0, 0.0, 0.0), 0.0, law)
    gap = cj.extend.Gap(1e-4, 0.1)
    contact = Contact(gap, Vector(1.0, 0.0, 0.0), ZERO, ZERO, None)
    mean = _mean_force(plane, "point 0", contact, jnp.asarray(speed), {}, {})
    assert float(mean.normal_force) == pytest.approx(0.5 * 100.0 * (1.0 + damping), rel=1e-12)


@pytest.mark.parametrize(
    ("before", "after", "rate", "time", "slope"),
    [
        (-1e-3, 2e-4, 0.1, 2e-3, 10.0),  # an onset
        (1e-3, -2e-4, -0.1, -2e-3, 10.0),  # an end
        (0.0, 2e-4, 0.1, 2e-3, 10.0),
        (1e-3, 0.0, -0.1, 0.0, 10.0),
        (-1e-3, -2e-4, 0.0, 0.0, 0.0),
        (1e-3, 2e-4, -0.1, 0.0, 0.0),
        (-1e-3, 2e-4, 0.0, 0.0, 0.0),
    ],
)
def test_a_contact_lacks_its_force_since_the_onset_and_has_it_too_long_after_the_end(
    before, after, rate, time, slope
):
    def gap(depth):
        return ContactGap(jnp.asarray(depth), jnp.asarray(rate))

    of_depth = jax.value_and_grad(lambda depth: _contact_time(gap(before), gap(depth)))
    assert [float(x) for x in of_depth(after)] == pytest.approx([time, slope], rel=1e-12)
    assert bool(_changes(gap(before), gap(after))) == (slope != 0.0 or rate == time == 0.0 < after)


class Varying(cj.extend.AbstractForce):
    """A force that is a function of time."""

    function: Any = eqx.field(static=True)

    def body_names(self):
        return ("ball",)

    def wrenches(self, motions, t):
        force = self.function(t) * motions["ball"].position.x
        return {"ball": Wrench(Vector(force, 0.0, 0.0), ZERO)}


def late_comparison(t):
    """A loop that compares a carried value, which depends on time from the second iteration on."""
    return jax.lax.fori_loop(0, 3, lambda k, x: (t, x[1] + (x[0] > 0.3)), (0.0, 0.0))[1]


@pytest.mark.parametrize(
    ("function", "compares"),
    [
        (lambda t: jnp.exp(-t) * jax.jit(jnp.cos)(t) + jnp.tanh(t), False),
        (lambda t: 3.0, False),
        (lambda t: jnp.where(t > 0.3, 1.0, 0.0), True),
        (lambda t: jnp.interp(t, jnp.arange(3.0), jnp.arange(3.0)), True),
        (lambda t: jax.lax.cond(t < 0.3, lambda: 1.0, lambda: 0.0), True),
        (lambda t: 1.0 * t.astype(int), True),
        (late_comparison, True),
    ],
)
def test_comparisons_with_time_are_detected(function, compares):
    assert compares_time(Varying(function)) is compares


def two(t):
    return jnp.stack([t, 0.3 + 0.0 * t])


BY_PRIMITIVE = {name: getattr(jax.lax, name) for name in ("abs", "ceil", "floor", "sign")} | {
    "round": jax.lax.round,
    "rem": lambda t: jax.lax.rem(t, 0.3),
    "max": lambda t: jax.lax.max(t, 0.3),
    "min": lambda t: jax.lax.min(t, 0.3),
    "clamp": lambda t: jax.lax.clamp(0.1, t, 0.3),
    "sort": lambda t: jax.lax.sort(two(t))[0],
    "reduce_max": lambda t: jnp.max(two(t)),
    "reduce_min": lambda t: jnp.min(two(t)),
    "cummax": lambda t: jax.lax.cummax(two(t))[1],
    "cummin": lambda t: jax.lax.cummin(two(t))[1],
}


def test_each_primitive_with_a_jump_or_kink_is_detected_by_its_name():
    """A version of JAX that renames one would make derivatives wrong without a message."""
    assert BY_PRIMITIVE.keys() == KINKED
    silent = [n for n, f in BY_PRIMITIVE.items() if not compares_time(Varying(f))]
    assert not silent

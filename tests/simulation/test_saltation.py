"""Derivatives across force discontinuities: at the onset and end of contacts, and in time."""

import math
from dataclasses import replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import clearjoint as cj
from clearjoint.extend import ZERO, Vector, Wrench, quantity
from tests.support.difference_quotients import (
    Places,
    by_differences,
    fourth_order,
    parameters_at,
)
from tests.support.one_body import ORIGIN, X, bearing, one_body
from tests.support.planes import Plane
from tests.support.push import Push
from tests.support.shaft import ON_SHAFT, Z, shaft, turned
from tests.support.slow import slow

Q = cj.quantities
GRAVITY, DROP, MASS = 9.81, 5e-4, 1.0
SETTINGS = replace(cj.presets.derivatives, rtol=1e-10)


class Buffer(cj.extend.AbstractContactLaw):
    """A spring, a parallel damper and a preload: max(K d + D d' + P, 0).

    The force jumps at the onset by the damper's force and the preload, and at the separation by the
    preload. In restitution it is multiplied by `restitution`, so it jumps at the turning point if
    that is not 1.
    """

    stiffness: Any = quantity("N/m")
    damping: Any = quantity("N s/m", default=0.0)
    preload: Any = quantity("N", default=0.0)
    restitution: Any = quantity("1", default=1.0)
    uses_entry_speed = False

    def force(self, gap, entry_speed):
        pushed = self.elastic_force(gap) + self.damping * gap.rate
        share = jnp.where(gap.rate > 0.0, 1.0, self.restitution)
        return jnp.where(gap.depth > 0.0, share * jnp.maximum(pushed, 0.0), 0.0)

    def elastic_force(self, gap):
        spring = self.stiffness * gap.depth + self.preload
        return jnp.where(gap.depth > 0.0, spring, 0.0)

    def stored_energy(self, gap):
        depth = jnp.maximum(gap.depth, 0.0)
        return (0.5 * self.stiffness * depth + self.preload) * depth


def dropped(law):
    """A body that falls along X onto a plane."""
    plane = Plane("ball", (ORIGIN,), X, DROP, law)
    return one_body("ball", {"floor": plane}, mass=MASS, gravity=(GRAVITY, 0.0, 0.0))


def arrived(end, drop, stiffness, damping, preload):
    """Position and velocity in closed form: the fall, an oscillation about rest, and the rise."""
    begin = np.sqrt(2.0 * drop / GRAVITY)
    rest = (MASS * GRAVITY - preload) / stiffness
    decay = 0.5 * damping / MASS
    w = np.sqrt(stiffness / MASS - decay**2)

    def inside(t):
        """Return depth, rate and second rate, by x = rest + exp(-decay t) (a cos + b sin)."""
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


LAWS = {"damper": (1e6, 800.0, 0.0), "preload": (1e6, 0.0, 60.0), "both": (1e6, 300.0, 40.0)}
END = 0.016
PARAMETERS = {
    "drop": cj.Parameter(lambda s: s.joints["floor"].offset),
    "damping": cj.Parameter(lambda s: s.joints["floor"].law.damping),
    "preload": cj.Parameter(lambda s: s.joints["floor"].law.preload),
}


def expected(law):
    """Derivatives of position and velocity at the end to those parameters, by differences."""
    numbers = np.array([DROP, *law])
    steps = {0: 1e-7, 2: 1e-2, 3: 1e-3}

    def ended(changed, by):
        return arrived(END, *(numbers + by * np.eye(4)[changed]))

    slopes = [fourth_order(partial(ended, place), step) for place, step in steps.items()]
    return np.stack(slopes, axis=-1)


@pytest.mark.slow
@pytest.mark.parametrize("law", LAWS)
def test_sensitivities_across_a_jump_of_a_law(law):
    """The derivatives after the onset contain the jump of the force there."""
    scene, state = dropped(Buffer(*LAWS[law]))
    outputs = {"x": Q.Position("ball", "x"), "v": Q.Velocity("ball", "x")}
    result = cj.sensitivities(scene, state, END, PARAMETERS, outputs, [END], SETTINGS)
    values = [result.outputs[name][0] for name in outputs]
    derivatives = [result.derivatives[name][0] for name in outputs]
    np.testing.assert_allclose(values, arrived(END, DROP, *LAWS[law]), rtol=1e-7)
    np.testing.assert_allclose(derivatives, expected(LAWS[law]), rtol=2e-5, atol=1e-9)


def test_sensitivities_do_not_depend_on_how_far_past_an_onset_steps_end():
    """The slope of the force jumps at the onset. Without a correction the error is 2e-6."""
    scene, state = dropped(cj.laws.Hertz(1e6, exponent=1.0))
    parameters, outputs = {"drop": PARAMETERS["drop"]}, {"x": Q.Position("ball", "x")}
    settings = replace(SETTINGS, rtol=1e-9, landing_tolerance=3e-5)
    result = cj.sensitivities(scene, state, END, parameters, outputs, [END], settings)
    exact = fourth_order(lambda by: arrived(END, DROP + by, 1e6, 0.0, 0.0)[0], 1e-7)
    assert result.derivatives["x"][0, 0] == pytest.approx(exact, rel=1e-8)


@pytest.mark.slow
def test_the_friction_moment_of_a_thrust_face_jumps_with_the_force():
    """The friction of a shoulder slows a turning shaft from the instant at which they meet."""
    end = 6e-3
    face = cj.EndPlay(0.2e-3, Buffer(1e6, 800.0), cj.frictions.LinearCoulomb(0.15, 0.05), 12e-3)
    pin = bearing(cj.laws.Hertz(1e9), "shaft", clearance=1e-4, axial=face)
    options = {"mass": MASS, "inertia": (3e-4, 3e-4, 4e-4), "gravity": (0.0, 0.0, -GRAVITY)}
    scene, state = one_body("shaft", {"pin": pin}, **options, spin=(0.0, 0.0, 60.0))

    def spin(scene):
        return cj.simulate(scene, state, end, SETTINGS).final.bodies["shaft"].spin[2]

    places: Places = {"play": (lambda s: s.joints["pin"].axial.play, 1e-7)}
    outputs = {"spin": Q.AngularVelocity("shaft", "z")}
    result = cj.sensitivities(scene, state, end, parameters_at(places), outputs, [end], SETTINGS)
    assert float(result.outputs["spin"][0]) < 59.9
    slopes = by_differences(scene, places, spin, fourth_order)
    np.testing.assert_allclose(result.derivatives["spin"][0], slopes, rtol=1e-5)


@pytest.mark.slow
def test_forward_derivatives_of_a_run_contain_the_jump_too():
    """`jax.jvp` of `simulate`, without the tangents of `sensitivities`."""
    scene, state = dropped(Buffer(*LAWS["both"]))
    settings = cj.Settings(rtol=1e-9, landing_tolerance=1e-13)

    def speed(drop):
        varied = cj.set_value(scene, lambda s: s.joints["floor"].offset, drop)
        return cj.simulate(varied, state, END, settings).final.bodies["ball"].velocity[0]

    wanted = expected(LAWS["both"])[1, 0]
    np.testing.assert_allclose(jax.jit(jax.jacfwd(speed))(DROP), wanted, rtol=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("rtol", [1e-9, 1e-10, 1e-11])
@pytest.mark.parametrize("landing", [1e-12, 1e-13])
def test_two_contacts_of_a_spring_that_begin_almost_together(rtol, landing):
    """Both bases of the double pendulum's journal meet the wall, 1e-11 m apart.

    Within the depth at which a step may land, K d(depth) is a hundredth of the change of the tilt's
    rate.
    """
    law = cj.laws.ExactRestitution(0.8, 4e8, exponent=1.0)
    scene, state = cj.mechanisms.double_pendulum(law=law)
    places: Places = {
        "e": (lambda s: s.joints["shoulder"].law.restitution, 3e-4),
        "K": (lambda s: s.joints["shoulder"].law.stiffness.stiffness, 4e4),
        "c": (lambda s: s.joints["shoulder"].clearance, 5e-8),
    }
    end, tight = 0.03, replace(cj.presets.derivatives, rtol=1e-12)

    def height(scene):
        return cj.simulate(scene, state, end, tight).final.bodies["arm 2"].position[1]

    settings = replace(cj.presets.derivatives, rtol=rtol, landing_tolerance=landing)
    outputs = {"y": Q.Position("arm 2", "y")}
    result = cj.sensitivities(scene, state, end, parameters_at(places), outputs, [end], settings)
    differences = by_differences(scene, places, height, fourth_order)
    np.testing.assert_allclose(result.derivatives["y"][0], differences, rtol=1e-6)


class Undeclared(Push):
    """The same force without declared breakpoints."""

    breakpoints = cj.extend.AbstractForce.breakpoints


def pushed(*pushes):
    forces = {f"push {k}": push for k, push in enumerate(pushes)}
    return one_body("ball", forces=forces, mass=2.0)


def start_of(k):
    return cj.Parameter(lambda s: s.forces[f"push {k}"].start)


@pytest.mark.slow
def test_derivatives_along_the_times_of_switched_forces():
    """x = sum F (t - t_s)^2/(2 m); two forces at one instant; both comparisons, < and <=."""
    scene, state = pushed(Push("ball", 4.0, 0.3), Push("ball", 1.0, 0.3, jnp.greater))
    parameters = {
        "first": start_of(0),
        "second": start_of(1),
        "force": cj.Parameter(lambda s: s.forces["push 0"].force),
    }
    outputs = {"x": Q.Position("ball", "x"), "v": Q.Velocity("ball", "x")}
    result = cj.sensitivities(scene, state, 1.0, parameters, outputs, [0.2, 0.3, 1.0])
    np.testing.assert_allclose(
        result.outputs["x"], [0.0, 0.0, 5.0 * 0.49 / 4], rtol=0.0, atol=1e-12
    )
    x, v = result.derivatives["x"], result.derivatives["v"]
    np.testing.assert_allclose(
        x, [[0, 0, 0], [0, 0, 0], [-1.4, -0.35, 0.1225]], rtol=0.0, atol=1e-9
    )
    np.testing.assert_allclose(v, [[0, 0, 0], [-2, -0.5, 0], [-2, -0.5, 0.35]], rtol=0.0, atol=1e-9)
    assert result.accepted < 12


@pytest.mark.slow
def test_forward_derivatives_of_a_run_contain_the_switch_too():
    scene, state = pushed(Push("ball", 4.0, 0.3), Push("ball", 1.0, 0.3))

    def ended(start):
        varied = cj.set_value(scene, lambda s: s.forces["push 0"].start, start)
        return cj.simulate(varied, state, 1.0).final.bodies["ball"].position[0]

    np.testing.assert_allclose(jax.jit(jax.jacfwd(ended))(0.3), -1.4, rtol=1e-9)


ONSET = np.sqrt(2.0 * DROP / GRAVITY)


@pytest.mark.parametrize(
    ("law", "end"),
    [("damper", ONSET + 1e-3), *(slow(law, END) for law in LAWS)],
)
def test_integrals_of_quantities_that_jump_at_onset_and_end(law, end):
    """An acceleration's integral is the change of the speed, also in their derivatives; the time in
    contact is the end less the onset, sqrt(2 drop/g), if the contact still lasts."""
    scene, state = dropped(Buffer(*LAWS[law]))
    (label,) = scene.joints["floor"].laws()

    def touches(now):
        return jnp.where(now.contact_gaps["floor"][label].depth > 0.0, 1.0, 0.0)

    outputs = {
        "contact": cj.Integral(touches, "s"),
        "gained": cj.Integral(Q.Acceleration("ball", "x"), "m/s"),
        "speed": Q.Velocity("ball", "x"),
    }
    predict = cj.predictor(scene, state, end, PARAMETERS, outputs, [end], SETTINGS)
    derivatives = jax.jacrev(predict)(predict.values)
    if end < END:
        assert float(predict(predict.values)["contact"]) == pytest.approx(1e-3, rel=1e-7)
        by_drop = float(derivatives["contact"]["drop"])
        assert by_drop == pytest.approx(-1.0 / (GRAVITY * ONSET), rel=1e-7)
    for name in PARAMETERS:
        of_speed = float(derivatives["speed"][name][0])
        assert of_speed != 0.0
        assert float(derivatives["gained"][name]) == pytest.approx(of_speed, rel=1e-6)


@pytest.mark.slow
def test_the_integral_of_an_acceleration_across_switched_forces():
    """The change of the speed, sum F (t - t_s)/m, by the times t_s."""
    scene, state = pushed(Push("ball", 4.0, 0.3), Push("ball", 1.0, 0.5, jnp.greater))
    parameters = {"first": start_of(0), "second": start_of(1)}
    outputs = {"gained": cj.Integral(Q.Acceleration("ball", "x"), "m/s")}
    predict = cj.predictor(scene, state, 1.0, parameters, outputs)
    gradient = jax.grad(lambda values: predict(values)["gained"])(predict.values)
    assert float(gradient["first"]) == pytest.approx(-2.0, rel=1e-9)
    assert float(gradient["second"]) == pytest.approx(-0.5, rel=1e-9)


def test_an_undeclared_switch_in_time_is_refused():
    scene, state = pushed(Undeclared("ball", 4.0, 0.3))
    outputs = {"x": Q.Position("ball", "x")}
    with pytest.raises(ValueError, match=r"forces\['push 0'\].*`breakpoints`"):
        cj.sensitivities(scene, state, 1.0, {"start": start_of(0)}, outputs, [1.0])


class Threshold(cj.extend.AbstractForce):
    """A force along X that changes in several ways where the ball passes a position, 1 m, or a
    speed, 1 m/s."""

    step: Any = quantity("N")
    kink: Any = quantity("N/m")
    ramp: Any = quantity("N")
    step_by_speed: Any = quantity("N")

    def body_names(self):
        return ("ball",)

    def wrenches(self, motions, t):
        x, v = motions["ball"].position.x - 1.0, motions["ball"].velocity.x - 1.0
        force = jnp.where(x > 0.0, self.step + self.kink * x, 0.0) + self.ramp * jnp.tanh(x / 1e-3)
        return {"ball": Wrench(Vector(force + self.step_by_speed * (v > 0.0), 0.0, 0.0), ZERO)}


NONE = 1e-20


@pytest.mark.parametrize(
    ("threshold", "position"),
    [
        (Threshold(0.5, NONE, NONE, NONE), 1.0),
        slow(Threshold(0.02, NONE, NONE, NONE), 1.0),
        (Threshold(NONE, 50.0, NONE, NONE), None),
        slow(Threshold(NONE, NONE, 0.5, NONE), None),
        (Threshold(NONE, NONE, NONE, 0.5), 0.25),
    ],
    ids=["step", "small step", "kink", "ramp", "step by speed"],
)
def test_derivatives_end_where_a_force_jumps_with_the_motion(threshold, position):
    scene, state = pushed(Push("ball", 4.0, 0.0))
    scene = cj.Scene(scene.bodies, forces={**scene.forces, "threshold": threshold})
    parameters = {"force": cj.Parameter(lambda s: s.forces["push 0"].force)}
    outputs = {"x": Q.Position("ball", "x")}
    result = cj.sensitivities(scene, state, 1.5, parameters, outputs, [0.2, 1.5], throw=False)
    if position is None:
        assert result.result == cj.RESULTS.successful
    else:
        assert result.result == cj.RESULTS.force_jumped
        np.testing.assert_allclose(result.time, np.sqrt(position), rtol=1e-3)
        np.testing.assert_allclose(result.derivatives["x"], [[0.2**2 / 4.0]], rtol=1e-8)


ENDS = ("ground", "shaft", (0.5, 0.0, 0.0), (-0.5, 0.0, 0.0))
"""Of a spring, whose points pass each other at half a revolution of the shaft."""


@pytest.mark.parametrize(
    ("force", "jumps"),
    [
        (cj.TorsionalSpring(*ON_SHAFT, 0.01), True),
        slow(cj.Motor(*ON_SHAFT, 0.0, 0.01, 0.0), True),
        slow(cj.SpringDamper(*ENDS, 0.01, 0.0, 0.1), True),
        slow(cj.SpringDamper(*ENDS, 0.01), False),
        slow(
            cj.Bushing("ground", "shaft", Z, Z, (1, 1, 1), rotational_stiffness=(0, 0, 0.01)), True
        ),
        slow(cj.Motor(*ON_SHAFT, cj.Polynomial((0.0, 5.0)), 0.0, 0.01), False),
    ],
    ids=lambda value: type(value).__name__,
)
def test_derivatives_end_where_an_angle_jumps_by_a_revolution(force, jumps):
    """And a force with it: the shaft turns past half a revolution, where a spring begins to help
    it. A spring without free length, and a motor that controls the speed, don't jump."""
    scene, outputs = shaft(force=force), {"speed": Q.AngularVelocity("shaft", "z")}
    inertia = {"inertia": cj.Parameter(lambda s: s.bodies["shaft"].inertia[2])}
    runs = turned(0.0, 5.0), 1.0, inertia, outputs, [0.3, 1.0]
    result = cj.sensitivities(scene, *runs, throw=False)
    assert result.result == (cj.RESULTS.force_jumped if jumps else cj.RESULTS.successful)
    if jumps:  # at about 5 rad/s
        assert result.time == pytest.approx(math.pi / 5.0, rel=0.1)


@pytest.mark.slow
def test_a_user_defined_law_that_jumps_inside_a_contact_ends_the_derivatives():
    scene, state = dropped(Buffer(*LAWS["damper"], 0.5))
    outputs = {"x": Q.Position("ball", "x")}
    result = cj.sensitivities(scene, state, END, PARAMETERS, outputs, [END], throw=False)
    assert result.result == cj.RESULTS.force_jumped
    assert 0.0102 < result.time < 0.0125


def test_a_user_defined_law_counts_as_discontinuous_unless_it_declares_otherwise():
    class Harder(cj.laws.Hertz):
        def force(self, gap, entry_speed):
            return super().force(gap, entry_speed) + gap.rate

    class Continuous(Buffer):
        force_jumps = False

    assert Buffer.force_jumps and Harder.force_jumps and not Continuous.force_jumps
    names = "Hertz", "HuntCrossley", "MemorylessHuntCrossley", "LankaraniNikravesh"
    assert not any(getattr(cj.laws, name).force_jumps for name in names)

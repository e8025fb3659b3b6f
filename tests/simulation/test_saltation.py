"""Derivatives across force discontinuities: at the onset and end of contacts, and in time."""

from dataclasses import replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import clearjoint as cj
from clearjoint.extend import ZERO, Vector, Wrench, quantity
from tests.support.planes import Plane

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


def dropped(law, points=1):
    """A body that falls along X onto a plane."""
    plane = Plane("ball", ((0.0, 0.0, 0.0),) * points, (1.0, 0.0, 0.0), DROP, law)
    scene = cj.Scene(
        {"ball": cj.Body(MASS, (1.0, 1.0, 1.0))}, {"floor": plane}, gravity=(GRAVITY, 0.0, 0.0)
    )
    return scene, cj.State({"ball": cj.body_state((0.0, 0.0, 0.0))})


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


def slope(function, value, step):
    """Return the derivative by central differences of fourth order."""
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
    exact = slope(lambda drop: arrived(END, drop, 1e6, 0.0, 0.0)[0], DROP, 1e-7)
    assert result.derivatives["x"][0, 0] == pytest.approx(exact, rel=1e-8)


@pytest.mark.slow
def test_the_friction_moment_of_a_thrust_face_jumps_with_the_force():
    """The friction of a shoulder slows a turning shaft from the instant at which they meet."""
    play, end = 0.2e-3, 6e-3
    shoulders = cj.EndPlay(play, Buffer(1e6, 800.0), cj.frictions.LinearCoulomb(0.15, 0.05), 12e-3)
    axes = {"bearing_axis": (0.0, 0.0, 1.0), "journal_axis": (0.0, 0.0, 1.0)}
    sizes = {"bearing_radius": 10e-3, "clearance": 1e-4, "journal_length": 20e-3}
    law = cj.laws.Hertz(1e9)
    pin = cj.ClearanceJoint("ground", "shaft", **axes, **sizes, law=law, axial=shoulders)
    shaft = cj.Body(MASS, (3e-4, 3e-4, 4e-4))
    scene = cj.Scene({"shaft": shaft}, {"pin": pin}, gravity=(0.0, 0.0, -GRAVITY))
    state = cj.State({"shaft": cj.body_state((0.0, 0.0, 0.0), spin=(0.0, 0.0, 60.0))})

    def spin(play):
        wider = cj.set_value(scene, lambda s: s.joints["pin"].axial.play, play)
        return cj.simulate(wider, state, end, SETTINGS).final.bodies["shaft"].spin[2]

    parameters = {"play": cj.Parameter(lambda s: s.joints["pin"].axial.play)}
    outputs = {"spin": Q.AngularVelocity("shaft", "z")}
    result = cj.sensitivities(scene, state, end, parameters, outputs, [end], SETTINGS)
    assert float(result.outputs["spin"][0]) < 59.9
    expected = slope(spin, play, 1e-7)
    np.testing.assert_allclose(result.derivatives["spin"][0, 0], expected, rtol=1e-5)


@pytest.mark.slow
def test_forward_derivatives_of_a_run_contain_the_jump_too():
    """`jax.jvp` of `simulate`, without the tangents of `sensitivities`."""
    scene, state = dropped(Buffer(*LAWS["both"]))

    def speed(drop):
        varied = cj.set_value(scene, lambda s: s.joints["floor"].offset, drop)
        final = cj.simulate(
            varied, state, END, cj.Settings(rtol=1e-9, landing_tolerance=1e-13)
        ).final
        return final.bodies["ball"].velocity[0]

    wanted = expected(LAWS["both"])[1, 0]
    forward = jax.jit(jax.jacfwd(speed))(DROP)
    np.testing.assert_allclose(forward, wanted, rtol=1e-3)


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
    paths = {
        "e": (lambda s: s.joints["shoulder"].law.restitution, 3e-4),
        "K": (lambda s: s.joints["shoulder"].law.stiffness.stiffness, 4e4),
        "c": (lambda s: s.joints["shoulder"].clearance, 5e-8),
    }
    end, tight = 0.03, replace(cj.presets.derivatives, rtol=1e-12)

    def height(path, change):
        moved = cj.set_value(scene, path, path(scene) + change)
        return cj.simulate(moved, state, end, tight).final.bodies["arm 2"].position[1]

    settings = replace(cj.presets.derivatives, rtol=rtol, landing_tolerance=landing)
    parameters = {name: cj.Parameter(path) for name, (path, _) in paths.items()}
    outputs = {"y": Q.Position("arm 2", "y")}
    result = cj.sensitivities(scene, state, end, parameters, outputs, [end], settings)
    differences = [
        slope(lambda by, path=path: height(path, by), 0.0, step) for path, step in paths.values()
    ]
    np.testing.assert_allclose(result.derivatives["y"][0], differences, rtol=1e-6)


class Push(cj.extend.AbstractForce):
    """A force along X on a body from a time on; `how` compares the times in several ways."""

    body: str = eqx.field(static=True)
    force: Any = quantity("N")
    start: Any = quantity("s")
    how: Any = eqx.field(default=jnp.greater_equal, static=True)

    def body_names(self):
        return (self.body,)

    def breakpoints(self):
        return self.start

    def wrenches(self, motions, t):
        force = jnp.where(self.how(t, self.start), self.force, 0.0)
        return {self.body: Wrench(Vector(force, 0.0, 0.0), ZERO)}


class Undeclared(Push):
    """The same force without declared breakpoints."""

    breakpoints = cj.extend.AbstractForce.breakpoints


def pushed(*pushes):
    forces = {f"push {k}": push for k, push in enumerate(pushes)}
    scene = cj.Scene({"ball": cj.Body(2.0, (1.0, 1.0, 1.0))}, forces=forces)
    return scene, cj.State({"ball": cj.body_state((0.0, 0.0, 0.0))})


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
    np.testing.assert_allclose(result.outputs["x"], [0.0, 0.0, 5.0 * 0.49 / 4], atol=1e-12)
    x, v = result.derivatives["x"], result.derivatives["v"]
    np.testing.assert_allclose(x, [[0, 0, 0], [0, 0, 0], [-1.4, -0.35, 0.1225]], atol=1e-9)
    np.testing.assert_allclose(v, [[0, 0, 0], [-2, -0.5, 0], [-2, -0.5, 0.35]], atol=1e-9)
    assert result.accepted < 12


@pytest.mark.slow
def test_forward_derivatives_of_a_run_contain_the_switch_too():
    scene, state = pushed(Push("ball", 4.0, 0.3), Push("ball", 1.0, 0.3))

    def ended(start):
        varied = cj.set_value(scene, lambda s: s.forces["push 0"].start, start)
        return cj.simulate(varied, state, 1.0).final.bodies["ball"].position[0]

    np.testing.assert_allclose(jax.jit(jax.jacfwd(ended))(0.3), -1.4, rtol=1e-9)


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
        pytest.param(Threshold(0.02, NONE, NONE, NONE), 1.0, marks=pytest.mark.slow),
        (Threshold(NONE, 50.0, NONE, NONE), None),
        pytest.param(Threshold(NONE, NONE, 0.5, NONE), None, marks=pytest.mark.slow),
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


@pytest.mark.slow
def test_a_user_defined_law_that_jumps_inside_a_contact_ends_the_derivatives():
    scene, state = dropped(Buffer(*LAWS["damper"], 0.5))
    outputs = {"x": Q.Position("ball", "x")}
    result = cj.sensitivities(scene, state, END, PARAMETERS, outputs, [END], throw=False)
    assert result.result == cj.RESULTS.force_jumped
    assert 0.0102 < result.time < 0.0125


def test_derivatives_need_landing():
    with pytest.raises(ValueError, match="landing_tolerance"):
        cj.sensitivities(
            *dropped(Buffer(*LAWS["both"])),
            END,
            PARAMETERS,
            {"x": Q.Position("ball", "y")},
            [END],
            cj.Settings(landing_tolerance=None),
        )


def test_a_user_defined_law_counts_as_discontinuous_unless_it_declares_otherwise():
    class Harder(cj.laws.Hertz):
        def force(self, gap, entry_speed):
            return super().force(gap, entry_speed) + gap.rate

    class Continuous(Buffer):
        force_jumps = False

    assert Buffer.force_jumps and Harder.force_jumps and not Continuous.force_jumps
    laws = (
        cj.laws.Hertz,
        cj.laws.HuntCrossley,
        cj.laws.MemorylessHuntCrossley,
        cj.laws.LankaraniNikravesh,
    )
    assert not any(law.force_jumps for law in laws)

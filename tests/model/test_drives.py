"""Drivers by closed forms: prescribed rotations, driving torques, and the work they supply."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

import clearjoint as cj
from clearjoint.extend import quantity

Z = (0.0, 0.0, 1.0)
ORIGIN = (0.0, 0.0, 0.0)
INERTIA = 0.02
SHAFT = cj.Body(1.0, (0.03, 0.03, INERTIA))


def shaft_angle(body):
    return 2.0 * np.arctan2(body.orientation[..., 3], body.orientation[..., 0])


def shaft_scene(drive, **options):
    """A shaft in a bearing about Z through its centre of mass."""
    bearing = cj.RevoluteJoint("ground", "shaft", ORIGIN, ORIGIN, Z, Z)
    scene = cj.Scene({"shaft": SHAFT}, {"bearing": bearing}, **options)
    family = scene.forces if isinstance(drive, cj.extend.AbstractForce) else scene.joints
    family["motor"] = drive
    return scene


@pytest.mark.slow
def test_prescribed_rotation_keeps_its_angle_over_a_hundred_revolutions():
    """At 60 000 rpm: angle, violation and, since nothing accelerates, no moment."""
    speed, start = 60_000 * np.pi / 30, 2.5
    scene = shaft_scene(cj.PrescribedRotation("ground", "shaft", (0, 0, 2.0), speed, start))
    half = (np.cos(0.5 * start), 0.0, 0.0, np.sin(0.5 * start))
    state = cj.State({"shaft": cj.body_state(ORIGIN, half, spin=(0, 0, speed))})
    times = np.linspace(0.0, 0.1, 501)
    solution = cj.simulate(
        scene, state, 0.1, cj.Settings(stabilisation=cj.Projection()), save=cj.Saving(times)
    )
    error = shaft_angle(solution.states.bodies["shaft"]) - (start + speed * times)
    assert np.abs(np.sin(0.5 * error)).max() < 1e-8
    observed = cj.observe(scene, solution)
    assert observed.drift["motor"].max() < 1e-8
    assert observed.drift_rate["motor"].max() < 1e-8 * speed
    assert np.abs(observed.reactions["motor"]["shaft"].moment[:, 2]).max() < 1e-6


def test_a_start_at_another_angle_is_refused_and_can_be_assembled():
    scene = shaft_scene(cj.PrescribedRotation("ground", "shaft", Z, 3.0, initial_angle=3.0))
    state = cj.State({"shaft": cj.body_state(ORIGIN)})
    with pytest.raises(ValueError, match="'motor: angle'"):
        cj.simulate(scene, state, 1.0)
    body = cj.assemble(scene, state).bodies["shaft"]
    assert shaft_angle(body) == pytest.approx(3.0, abs=1e-12)
    np.testing.assert_allclose(body.spin, (0.0, 0.0, 3.0), atol=1e-12)


class Swing(cj.extend.AbstractRotationDriver):
    """The angle amplitude sin(frequency t)."""

    amplitude: Any = quantity("rad")
    frequency: Any = quantity("rad/s")
    first: str = eqx.field(default="stator", static=True)
    second: str = eqx.field(default="rotor", static=True)
    axis: Any = quantity("1", default=Z)
    orientation: Any = quantity("1", default=(1.0, 0.0, 0.0, 0.0))

    def angle(self, t):
        return self.amplitude * jnp.sin(self.frequency * t)


@pytest.mark.slow
def test_driver_between_two_free_bodies():
    """Stator and rotor in free space: the moment accelerates their reduced inertia, angular
    momentum stays, and the kinetic energy is what the driver supplied."""
    stator, rotor, amplitude, frequency = 0.05, 0.02, 2.0, 30.0
    reduced = stator * rotor / (stator + rotor)
    scene = cj.Scene(
        {"stator": cj.Body(2.0, (0.1, 0.1, stator)), "rotor": SHAFT},
        {
            "bearing": cj.RevoluteJoint("stator", "rotor", ORIGIN, ORIGIN, Z, Z),
            "motor": Swing(amplitude, frequency),
        },
    )
    rate = amplitude * frequency
    spins = {"stator": -rate * reduced / stator, "rotor": rate * reduced / rotor}
    state = cj.State({k: cj.body_state(ORIGIN, spin=(0, 0, v)) for k, v in spins.items()})
    times = np.linspace(0.0, 0.4, 81)
    solution = cj.simulate(
        scene, state, 0.4, cj.Settings(rtol=1e-8, ledger=True), save=cj.Saving(times)
    )
    observed = cj.observe(scene, solution)
    moment = -reduced * amplitude * frequency**2 * np.sin(frequency * times)
    loads = observed.reactions["motor"]
    np.testing.assert_allclose(loads["rotor"].moment[:, 2], moment, atol=1e-5)
    np.testing.assert_allclose(loads["stator"].moment, -loads["rotor"].moment, atol=1e-12)
    bodies = solution.states.bodies
    momentum = stator * bodies["stator"].spin[:, 2] + rotor * bodies["rotor"].spin[:, 2]
    np.testing.assert_allclose(momentum, 0.0, atol=1e-12)
    energy = 0.5 * reduced * (rate * np.cos(frequency * times)) ** 2
    np.testing.assert_allclose(observed.energies["kinetic"], energy, atol=1e-6)
    np.testing.assert_allclose(observed.energies["supplied"], energy - energy[0], atol=1e-6)
    assert np.abs(observed.energies["stabilisation"]).max() < 1e-6
    assert np.abs(observed.ledger_residual()).max() < 1e-9


class Motor(cj.extend.AbstractDriveTorque):
    """A user-defined motor whose torque falls linearly with its speed."""

    stall_torque: Any = quantity("N m")
    no_load_speed: Any = quantity("rad/s")
    first: str = eqx.field(default="ground", static=True)
    second: str = eqx.field(default="shaft", static=True)
    axis: Any = quantity("1", default=Z)
    orientation: Any = quantity("1", default=(1.0, 0.0, 0.0, 0.0))

    def torque_at(self, angle, speed, t):
        return self.stall_torque * (1.0 - speed / self.no_load_speed)


class Spring(Motor):
    """A torque by the angle."""

    def torque_at(self, angle, speed, t):
        return -self.stall_torque * angle


def test_motor_runs_up_to_its_no_load_speed():
    """w = w0 (1 - exp(-t/T)) with T = inertia w0/stall torque, over some 40 revolutions."""
    torque, limit = 0.5, 100.0
    constant = INERTIA * limit / torque
    scene = shaft_scene(Motor(torque, limit))
    state = cj.State({"shaft": cj.body_state(ORIGIN)})
    times = np.linspace(0.0, 6.0, 61)
    solution = cj.simulate(
        scene, state, 6.0, cj.Settings(rtol=1e-8, ledger=True), save=cj.Saving(times)
    )
    speed = limit * (1.0 - np.exp(-times / constant))
    np.testing.assert_allclose(solution.states.bodies["shaft"].spin[:, 2], speed, atol=1e-5)
    observed = cj.observe(scene, solution)
    energy = 0.5 * INERTIA * speed**2
    np.testing.assert_allclose(observed.energies["supplied"], energy, atol=1e-4)
    assert np.abs(observed.ledger_residual()).max() < 1e-7 * energy[-1]


def test_torque_may_depend_on_the_angle():
    """A torsional oscillator from 0.3 rad at rest."""
    stiffness = 5.0
    scene = shaft_scene(Spring(stiffness, 1.0))
    half = (np.cos(0.15), 0.0, 0.0, np.sin(0.15))
    times = np.linspace(0.0, 1.0, 41)
    state = cj.State({"shaft": cj.body_state(ORIGIN, half)})
    solution = cj.simulate(scene, state, 1.0, cj.Settings(rtol=1e-8), save=cj.Saving(times))
    expected = 0.3 * np.cos(np.sqrt(stiffness / INERTIA) * times)
    np.testing.assert_allclose(shaft_angle(solution.states.bodies["shaft"]), expected, atol=1e-6)


def test_constant_torque_acts_on_both_bodies():
    drive = cj.DriveTorque("stator", "rotor", (0.0, 0.0, 5.0), torque=0.3)
    bearing = cj.RevoluteJoint("stator", "rotor", ORIGIN, ORIGIN, Z, Z)
    bodies = {"stator": cj.Body(2.0, (0.1, 0.1, 0.05)), "rotor": SHAFT}
    scene = cj.Scene(bodies, {"bearing": bearing}, {"motor": drive})
    state = cj.State({name: cj.body_state(ORIGIN) for name in bodies})
    final = cj.simulate(scene, state, 2.0).final.bodies
    np.testing.assert_allclose(final["rotor"].spin, (0, 0, 0.3 * 2.0 / INERTIA), atol=1e-9)
    np.testing.assert_allclose(final["stator"].spin, (0, 0, -0.3 * 2.0 / 0.05), atol=1e-9)


class Ramp(cj.extend.AbstractRotationDriver):
    """At rest until the start, and at constant speed from there on."""

    speed: Any = quantity("rad/s")
    start: Any = quantity("s")
    declared: bool = eqx.field(default=True, static=True)
    first: str = eqx.field(default="ground", static=True)
    second: str = eqx.field(default="shaft", static=True)
    axis: Any = quantity("1", default=Z)
    orientation: Any = quantity("1", default=(1.0, 0.0, 0.0, 0.0))

    def angle(self, t):
        return jnp.where(t < self.start, 0.0, self.speed * (t - self.start))

    def breakpoints(self):
        return self.start if self.declared else ()


class Table(Ramp):
    """An angle over time between given points."""

    times: Any = quantity("s", default=(0.0, 1.0), table=True)
    angles: Any = quantity("rad", default=(0.0, 1.0), table=True)

    def angle(self, t):
        return jnp.interp(t, self.times, self.angles)

    def breakpoints(self):
        return self.times if self.declared else ()


class Step(Ramp):
    """An angle that jumps by as many rad as the `speed` has rad/s."""

    def angle(self, t):
        return jnp.where(t < self.start, 0.0, self.speed)


def crank_and_arm(drive):
    """A driven shaft that carries an arm on a hinge beside its axis, under gravity."""
    scene = shaft_scene(drive, gravity=(0.0, -9.81, 0.0))
    scene.bodies["arm"] = cj.Body(1.0, (0.01, 0.01, 0.01))
    places = (0.3, 0.0, 0.0), (-0.2, 0.0, 0.0)
    scene.joints["pin"] = cj.RevoluteJoint("shaft", "arm", *places, Z, Z)
    state = {"shaft": cj.body_state(ORIGIN), "arm": cj.body_state((0.5, 0.0, 0.0))}
    return scene, cj.State(state)


RAMP = Ramp(10.0, 0.1)


@pytest.mark.slow
def test_a_driver_with_a_kink_is_followed_and_its_impulse_booked():
    scene, state = crank_and_arm(RAMP)
    times = [0.05, 0.1, 0.3]
    solution = cj.simulate(
        scene, state, 0.3, cj.Settings(rtol=1e-9, ledger=True), save=cj.Saving(times)
    )
    shaft = solution.states.bodies["shaft"]
    np.testing.assert_allclose(shaft_angle(shaft), [0.0, 0.0, 2.0], atol=1e-10)
    np.testing.assert_allclose(shaft.spin[:, 2], [0.0, 10.0, 10.0], atol=1e-9)
    observed = cj.observe(scene, solution)
    assert np.abs(observed.ledger_residual()).max() < 1e-7
    assert observed.energies["supplied"][1] > 1.0


@pytest.mark.slow
def test_sensitivities_across_a_kink_are_those_of_the_motion():
    """Against differences of runs; the impulse acts on the arm too."""
    scene, state = crank_and_arm(RAMP)
    places = {
        "start": lambda s: s.joints["motor"].start,
        "speed": lambda s: s.joints["motor"].speed,
    }
    found = cj.sensitivities(
        scene,
        state,
        0.3,
        {name: cj.Parameter(place) for name, place in places.items()},
        {"x": cj.quantities.Position("arm", "x"), "y": cj.quantities.Position("arm", "y")},
        [0.3],
    )

    def ended(place, value):
        final = cj.simulate(
            cj.set_value(scene, place, value), state, 0.3, cj.Settings(rtol=1e-11)
        ).final
        return final.bodies["arm"].position[:2]

    for k, (place, value, step) in enumerate(
        zip(places.values(), (0.1, 10.0), (1e-4, 1e-2), strict=True)
    ):
        around = [ended(place, value + sign * step) for sign in (1, -1)]
        slopes = [found.derivatives[axis][0, k] for axis in "xy"]
        np.testing.assert_allclose(slopes, (around[0] - around[1]) / (2 * step), rtol=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("points", [3, 6])
def test_a_table_of_angles_is_followed_however_many_there_are(points):
    times = np.linspace(0.0, 0.5, points)
    scene = shaft_scene(Table(0.0, 0.0, times=times, angles=times**2))
    state = cj.assemble(scene, cj.State({"shaft": cj.body_state(ORIGIN)}))
    final = cj.simulate(scene, state, 0.45).final.bodies["shaft"]
    assert shaft_angle(final) == pytest.approx(np.interp(0.45, times, times**2), abs=1e-9)


@pytest.mark.parametrize("size", [pytest.param(1.0, marks=pytest.mark.slow), 1e-5])
@pytest.mark.parametrize(
    "drive",
    [
        pytest.param(lambda size: Ramp(size, 0.1, declared=False), marks=pytest.mark.slow),
        pytest.param(lambda size: Step(size, 0.1), marks=pytest.mark.slow),
        lambda size: Step(size, 0.1, declared=False),
    ],
    ids=["undeclared kink", "declared step", "undeclared step"],
)
def test_a_driver_that_is_not_followed_is_reported(drive, size):
    """For any size of the jump: the run ends where the driver's angle is not smooth."""
    scene = shaft_scene(drive(size))
    state = cj.State({"shaft": cj.body_state(ORIGIN)})
    with pytest.raises(cj.SimulationError, match="breakpoints") as raised:
        cj.simulate(scene, state, 1.0)
    assert raised.value.solution.result == cj.RESULTS.not_followed
    assert raised.value.solution.time == pytest.approx(0.1, abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("preset", ["preview", "default", "accurate"])
@pytest.mark.parametrize("kink", [0.1, 0.2 - 1e-5])
def test_undeclared_kinks_of_half_a_millimetre_are_not_passed_over(preset, kink):
    """One of them is within a run's last step."""
    times, distances = jnp.array([0.0, kink, 0.2]), jnp.array([0.0, 0.0, 5e-4])
    drive = cj.PrescribedTranslation(
        "ground", "shaft", ORIGIN, ORIGIN, (1.0, 0, 0), lambda t: jnp.interp(t, times, distances)
    )
    guide = cj.PrismaticJoint("ground", "shaft", ORIGIN, ORIGIN, (1.0, 0, 0))
    scene = cj.Scene({"shaft": SHAFT}, {"guide": guide, "drive": drive})
    state = cj.State({"shaft": cj.body_state(ORIGIN)})
    solution = cj.simulate(scene, state, 0.2, getattr(cj.presets, preset), throw=False)
    assert solution.result == cj.RESULTS.not_followed
    assert solution.time == pytest.approx(kink, abs=1e-9)


@pytest.mark.slow
def test_projection_takes_no_step_of_a_driver_for_an_error_of_integration():
    """One linearised projection over 0.2 rad left the arm's hinge 2 mm open."""
    scene, state = crank_and_arm(Step(0.2, 0.1, declared=False))
    coordinates, stabilisation = cj.AbsoluteCoordinates(), cj.Projection()
    settings = cj.Settings(coordinates=coordinates, stabilisation=stabilisation)
    save = cj.Saving(np.linspace(0.0, 0.2, 21))
    solution = cj.simulate(scene, state, 0.2, settings, save, throw=False)
    assert solution.result == cj.RESULTS.not_followed
    assert solution.time == pytest.approx(0.1, abs=1e-9)
    assert all(drift.max() < 1e-9 for drift in cj.observe(scene, solution).drift.values())

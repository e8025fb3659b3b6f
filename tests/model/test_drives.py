"""Drivers by closed forms: prescribed rotations, driving torques, and the work they supply."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

import clearjoint as cj
from clearjoint.extend import quantity
from tests.support.difference_quotients import Places, by_differences, parameters_at
from tests.support.shaft import INERTIA, ON_SHAFT, ORIGIN, SHAFT, Z, angle_about, shaft, turned

ACCURATE = cj.Settings(rtol=1e-8, ledger=True)
FREE = {"stator": cj.Body(2.0, (0.1, 0.1, 0.05)), "rotor": SHAFT}
BEARING = cj.RevoluteJoint("stator", "rotor", ORIGIN, ORIGIN, Z, Z)


def test_a_start_at_another_angle_is_refused_and_can_be_assembled():
    scene = shaft(motor=cj.PrescribedRotation(*ON_SHAFT, 3.0, initial_angle=3.0))
    with pytest.raises(ValueError, match="'motor: angle'"):
        cj.simulate(scene, turned(), 1.0)
    body = cj.assemble(scene, turned()).bodies["shaft"]
    assert angle_about(body) == pytest.approx(3.0, abs=1e-12)
    np.testing.assert_allclose(body.spin, (0.0, 0.0, 3.0), rtol=0.0, atol=1e-12)


@pytest.mark.slow
def test_driver_between_two_free_bodies():
    """The moment accelerates their reduced inertia, angular momentum stays, and the kinetic energy
    is what the driver supplied."""
    stator, rotor, amplitude, frequency = 0.05, INERTIA, 2.0, 30.0
    reduced = stator * rotor / (stator + rotor)
    swing = cj.PrescribedAngle("stator", "rotor", Z, lambda t: amplitude * jnp.sin(frequency * t))
    scene = cj.Scene(FREE, {"bearing": BEARING, "motor": swing})
    rate = amplitude * frequency
    spins = {"stator": -rate * reduced / stator, "rotor": rate * reduced / rotor}
    state = cj.State({k: cj.body_state(ORIGIN, spin=(0, 0, v)) for k, v in spins.items()})
    times = np.linspace(0.0, 0.4, 81)
    solution = cj.simulate(scene, state, 0.4, ACCURATE, save=cj.Saving(times))
    observed = cj.observe(scene, solution)
    moment = -reduced * amplitude * frequency**2 * np.sin(frequency * times)
    loads = observed.reactions["motor"]
    np.testing.assert_allclose(loads["rotor"].moment[:, 2], moment, atol=1e-5)
    np.testing.assert_allclose(loads["stator"].moment, -loads["rotor"].moment, rtol=0.0, atol=1e-12)
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


def test_motor_runs_up_to_its_no_load_speed():
    """w = w0 (1 - exp(-t/T)) with T = inertia w0/stall torque, over some 40 revolutions."""
    torque, limit = 0.5, 100.0
    scene, times = shaft(motor=Motor(torque, limit)), np.linspace(0.0, 6.0, 61)
    solution = cj.simulate(scene, turned(), 6.0, ACCURATE, save=cj.Saving(times))
    speed = limit * (1.0 - np.exp(-times / (INERTIA * limit / torque)))
    np.testing.assert_allclose(solution.states.bodies["shaft"].spin[:, 2], speed, atol=1e-5)
    observed = cj.observe(scene, solution)
    energy = 0.5 * INERTIA * speed**2
    np.testing.assert_allclose(observed.energies["supplied"], energy, atol=1e-4)
    assert np.abs(observed.ledger_residual()).max() < 1e-7 * energy[-1]


class Ramp(cj.extend.AbstractFunctionOfTime):
    """At rest until the start, and at constant speed from there on."""

    speed: Any = quantity("rad/s")
    start: Any = quantity("s")

    def __call__(self, t):
        return jnp.where(t < self.start, 0.0, self.speed * (t - self.start))

    def breakpoints(self):
        return self.start


class Step(Ramp):
    """An angle that jumps by as many rad as the `speed` has rad/s."""

    def __call__(self, t):
        return jnp.where(t < self.start, 0.0, self.speed)


def undeclared(function):
    """The function without its breakpoints."""
    return lambda t: function(t)


def crank_and_arm(angle):
    """A driven shaft that carries an arm on a hinge beside its axis, under gravity."""
    scene = shaft((0.0, -9.81, 0.0), motor=cj.PrescribedAngle(*ON_SHAFT, angle))
    scene.bodies["arm"] = cj.Body(1.0, (0.01, 0.01, 0.01))
    places = (0.3, 0.0, 0.0), (-0.2, 0.0, 0.0)
    scene.joints["pin"] = cj.RevoluteJoint("shaft", "arm", *places, Z, Z)
    return scene, cj.State({**turned().bodies, "arm": cj.body_state((0.5, 0.0, 0.0))})


RAMP = Ramp(10.0, 0.1)


@pytest.mark.slow
def test_a_driver_with_a_kink_is_followed_and_its_impulse_booked():
    scene, state = crank_and_arm(RAMP)
    settings, save = cj.Settings(rtol=1e-9, ledger=True), cj.Saving([0.05, 0.1, 0.3])
    solution = cj.simulate(scene, state, 0.3, settings, save=save)
    body = solution.states.bodies["shaft"]
    np.testing.assert_allclose(angle_about(body), [0.0, 0.0, 2.0], rtol=0.0, atol=1e-10)
    np.testing.assert_allclose(body.spin[:, 2], [0.0, 10.0, 10.0], rtol=0.0, atol=1e-9)
    observed = cj.observe(scene, solution)
    assert np.abs(observed.ledger_residual()).max() < 1e-7
    assert observed.energies["supplied"][1] > 1.0


@pytest.mark.slow
def test_sensitivities_across_a_kink_are_those_of_the_motion():
    """Against differences of runs; the impulse acts on the arm too."""
    scene, state = crank_and_arm(RAMP)
    places: Places = {
        "start": (lambda s: s.joints["motor"].function.start, 1e-4),
        "speed": (lambda s: s.joints["motor"].function.speed, 1e-2),
    }
    outputs = {axis: cj.quantities.Position("arm", axis) for axis in "xy"}
    found = cj.sensitivities(scene, state, 0.3, parameters_at(places), outputs, [0.3])

    def ended(scene):
        final = cj.simulate(scene, state, 0.3, cj.Settings(rtol=1e-11)).final
        return final.bodies["arm"].position[:2]

    slopes = [found.derivatives[axis][0] for axis in "xy"]
    np.testing.assert_allclose(slopes, by_differences(scene, places, ended), rtol=1e-5)


@pytest.mark.parametrize("size", [pytest.param(1.0, marks=pytest.mark.slow), 1e-5])
@pytest.mark.parametrize(
    "angle",
    [
        pytest.param(lambda size: undeclared(Ramp(size, 0.1)), marks=pytest.mark.slow),
        pytest.param(lambda size: Step(size, 0.1), marks=pytest.mark.slow),
        lambda size: undeclared(Step(size, 0.1)),
    ],
    ids=["undeclared kink", "declared step", "undeclared step"],
)
def test_a_driver_that_is_not_followed_is_reported(angle, size):
    """For any size of the jump: the run ends where the driver's angle is not smooth."""
    scene = shaft(motor=cj.PrescribedAngle(*ON_SHAFT, angle(size)))
    with pytest.raises(cj.SimulationError, match="breakpoints") as raised:
        cj.simulate(scene, turned(), 1.0)
    assert raised.value.solution.result == cj.RESULTS.not_followed
    assert raised.value.solution.time == pytest.approx(0.1, abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("preset", ["preview", "default", "accurate"])
@pytest.mark.parametrize("kink", [0.1, 0.2 - 1e-5])
def test_undeclared_kinks_of_half_a_millimetre_are_not_passed_over(preset, kink):
    """One of them is within a run's last step."""
    line = cj.PiecewiseLinear([0.0, kink, 0.2], [0.0, 0.0, 5e-4])
    rail = "ground", "shaft", ORIGIN, ORIGIN, (1.0, 0, 0)
    drive = cj.PrescribedTranslation(*rail, undeclared(cj.extend.unpack(line)))
    scene = cj.Scene({"shaft": SHAFT}, {"guide": cj.PrismaticJoint(*rail), "drive": drive})
    solution = cj.simulate(scene, turned(), 0.2, getattr(cj.presets, preset), throw=False)
    assert solution.result == cj.RESULTS.not_followed
    assert solution.time == pytest.approx(kink, abs=1e-9)


@pytest.mark.slow
def test_projection_takes_no_step_of_a_driver_for_an_error_of_integration():
    """One linearised projection over 0.2 rad left the arm's hinge 2 mm open."""
    scene, state = crank_and_arm(undeclared(Step(0.2, 0.1)))
    coordinates, stabilisation = cj.AbsoluteCoordinates(), cj.Projection()
    settings = cj.Settings(coordinates=coordinates, stabilisation=stabilisation)
    save = cj.Saving(np.linspace(0.0, 0.2, 21))
    solution = cj.simulate(scene, state, 0.2, settings, save, throw=False)
    assert solution.result == cj.RESULTS.not_followed
    assert solution.time == pytest.approx(0.1, abs=1e-9)
    assert all(drift.max() < 1e-9 for drift in cj.observe(scene, solution).drift.values())


@pytest.mark.slow
def test_prescribed_rotation_keeps_its_angle_over_a_hundred_revolutions():
    """At 60 000 rpm: angle, violation and, since nothing accelerates, no moment."""
    speed, start = 60_000 * np.pi / 30, 2.5
    scene = shaft(motor=cj.PrescribedRotation("ground", "shaft", (0, 0, 2.0), speed, start))
    times = np.linspace(0.0, 0.1, 501)
    settings = cj.Settings(stabilisation=cj.Projection())
    solution = cj.simulate(scene, turned(start, speed), 0.1, settings, save=cj.Saving(times))
    error = angle_about(solution.states.bodies["shaft"]) - (start + speed * times)
    assert np.abs(np.sin(0.5 * error)).max() < 1e-8
    observed = cj.observe(scene, solution)
    assert observed.drift["motor"].max() < 1e-8
    assert observed.drift_rate["motor"].max() < 1e-8 * speed
    assert np.abs(observed.reactions["motor"]["shaft"].moment[:, 2]).max() < 1e-6


def test_torque_may_depend_on_the_angle():
    """A torsional oscillator from 0.3 rad at rest."""
    stiffness, times = 5.0, np.linspace(0.0, 1.0, 41)
    scene = shaft(spring=cj.TorsionalSpring(*ON_SHAFT, stiffness))
    solution = cj.simulate(scene, turned(0.3), 1.0, ACCURATE, save=cj.Saving(times))
    expected = 0.3 * np.cos(np.sqrt(stiffness / INERTIA) * times)
    np.testing.assert_allclose(angle_about(solution.states.bodies["shaft"]), expected, atol=1e-6)


def test_constant_torque_acts_on_both_bodies():
    drive = cj.DriveTorque("stator", "rotor", (0.0, 0.0, 5.0), 0.3)
    scene = cj.Scene(FREE, {"bearing": BEARING}, {"motor": drive})
    state = cj.State({name: cj.body_state(ORIGIN) for name in scene.bodies})
    final = cj.simulate(scene, state, 2.0).final.bodies
    np.testing.assert_allclose(
        final["rotor"].spin, (0, 0, 0.3 * 2.0 / INERTIA), rtol=0.0, atol=1e-9
    )
    np.testing.assert_allclose(final["stator"].spin, (0, 0, -0.3 * 2.0 / 0.05), rtol=0.0, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("points", [3, 6])
def test_a_table_of_angles_is_followed_however_many_there_are(points):
    times = np.linspace(-0.1, 0.5, points)
    table = cj.PiecewiseLinear(times, times**2)
    scene = shaft(motor=cj.PrescribedAngle(*ON_SHAFT, table))
    final = cj.simulate(scene, cj.assemble(scene, turned()), 0.45).final.bodies["shaft"]
    assert angle_about(final) == pytest.approx(np.interp(0.45, times, times**2), abs=1e-9)

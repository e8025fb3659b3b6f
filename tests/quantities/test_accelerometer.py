"""The band-limited accelerometer: an exact low-pass of two poles on the specific force."""

import math
import warnings

import numpy as np
import pytest
from scipy import signal
from scipy.spatial.transform import Rotation

import clearjoint as cj
from clearjoint import constraint_report
from clearjoint import quantities as q

FREQUENCY, GRAVITY = 120.0, 9.81
TURN = (math.cos(0.3), 0.0, 0.0, math.sin(0.3))
POINT, AXIS = (0.1, 0.02, 0.0), (1.0, 2.0, 0.0)


def mass_in_bearing(**state):
    """A mass that falls in its bearing, without damping."""
    sizes = {"bearing_radius": 10e-3, "clearance": 0.3e-3, "journal_length": 20e-3}
    held = {"law": cj.laws.Hertz(1e8), "axial": cj.FixedAxially()}
    pin = cj.ClearanceJoint("ground", "mass", **sizes, **held)
    body = cj.Body(7.0, (1e-2, 1e-2, 1e-2))
    scene = cj.Scene({"mass": body}, {"pin": pin}, gravity=(0.0, -GRAVITY, 0.0))
    return scene, cj.State({"mass": cj.body_state((0.0, 0.0, 0.0), **state)})


def with_sensor(**changed):
    usual = {"point": POINT, "axis": AXIS, "frequency": FREQUENCY}
    scene, state = mass_in_bearing(orientation=TURN, spin=(0.0, 0.0, 2.0), velocity=(0.1, 0.0, 0.0))
    return cj.accelerometer(scene, state, **({"body": "mass"} | usual | changed))


def test_it_starts_on_its_body_deflected_by_gravity():
    scene, state, reading = with_sensor()
    report = constraint_report(scene, state, 0.0)
    assert np.abs(report.values).max() < 1e-15 and np.abs(report.rates).max() < 1e-12
    turn = Rotation.from_rotvec([0.0, 0.0, 0.6])
    turned = turn.apply(AXIS) / math.sqrt(5.0)
    arm = state.bodies["mass accelerometer"].position - state.bodies["mass"].position
    deflection = (arm - turn.apply(POINT)) @ turned
    assert -((2 * math.pi * FREQUENCY) ** 2) * deflection == pytest.approx(GRAVITY * turned[1])
    reading.check(scene)
    assert reading.unit == "m/s^2" and reading == q.AccelerometerReading("mass accelerometer")


def test_sensor_names_are_unique_and_usual_values_cause_no_warning():
    scene, state = mass_in_bearing()
    options = {"axis": AXIS, "frequency": 1e3}
    with warnings.catch_warnings(action="error"):
        for name in ("near", "far"):
            scene, state, _ = cj.accelerometer(scene, state, "mass", name=name, **options)
    assert set(scene.bodies) == {"mass", "near", "far"}
    assert float(scene.bodies["far"].mass) == pytest.approx(7e-6)


MISTAKEN = {
    "another body": ({"body": "Mass"}, "`body` must be one of .*did you mean 'mass'"),
    "a name that is taken": ({"name": "pin"}, "`name` must be one that the scene does not have"),
    "no axis": ({"axis": (0, 0, 0)}, "`axis` must be a vector of non-zero length"),
    "a point in the plane": ({"point": (0.1, 0.0)}, r"`point` must be an array of shape \(3,\)"),
    "a frequency in a text": ({"frequency": "2 kHz"}, "`frequency` must be a number"),
    "no frequency": ({"frequency": 0.0}, "`frequency` must be positive"),
    "no damping": ({"damping_ratio": 0.0}, "`damping_ratio` must be positive"),
    "no mass": ({"mass": -1.0}, "`mass` must be positive"),
}


@pytest.mark.parametrize("case", MISTAKEN)
def test_invalid_sensors_are_refused(case):
    changed, message = MISTAKEN[case]
    with pytest.raises(ValueError, match=message):
        with_sensor(**changed)


def test_a_reading_names_its_sensor():
    with pytest.raises(ValueError, match=r"`sensor` must be one of the scene's \['mass accel"):
        q.AccelerometerReading("other").check(with_sensor().scene)


@pytest.mark.slow
def test_readings_are_those_of_a_filter():
    """The acceleration at the sensor's place, finely sampled across impacts, through SciPy's
    filter: as near as the sensor's own motion in its body is small."""
    scene, state, reading = with_sensor()
    times = np.linspace(0.0, 0.03, 30_001)
    raw = [q.PointAcceleration("mass", POINT, one, axes="body", gravity=True) for one in ("x", "y")]
    outputs, save = {"reading": reading, "x": raw[0], "y": raw[1]}, cj.Saving(times, states=False)
    found = cj.simulate(
        scene, state, times[-1], cj.presets.derivatives, save, outputs=outputs
    ).outputs
    force = (found["x"] + 2.0 * found["y"]) / math.sqrt(5.0)
    speed = 2.0 * math.pi * FREQUENCY
    filter_of_two_poles = signal.lti([speed**2], [1.0, math.sqrt(2.0) * speed, speed**2])
    at_rest = GRAVITY * (math.sin(0.6) + 2.0 * math.cos(0.6)) / math.sqrt(5.0)
    _, expected, _ = signal.lsim(filter_of_two_poles, force - at_rest, times)
    peak = np.max(np.abs(expected))
    assert np.max(np.abs(force)) > 1.5 * peak > 1.0
    np.testing.assert_allclose(found["reading"], expected + at_rest, rtol=0.0, atol=3e-5 * peak)

"""Settings and savings are checked where they are made, and where a call can't honour them."""

import inspect
from dataclasses import FrozenInstanceError, replace

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import clearjoint as cj
from clearjoint import presets
from tests.support.rotor import INERTIA, SPEED, angle, rotor, stiffness_axis

FINER = ("preview", "default", "accurate", "reference")
NAMES = (*FINER, "derivatives", "identification")
RUNNERS = (
    cj.simulate,
    cj.sweep,
    cj.sensitivities,
    cj.identifiability,
    cj.fit_horizon,
    cj.identify,
    cj.identify_many,
    cj.minimise,
)
STIFFNESS = {"stiffness": cj.Parameter(lambda s: s.forces["spring"].stiffness)}
SENSORS = {"angle": cj.Sensor(angle, [0.1, 0.2], 1e-3)}
FIXED = cj.Settings(controller=diffrax.ConstantStepSize(), first_step=1e-3)


@pytest.mark.parametrize("function", RUNNERS, ids=lambda function: function.__name__)
def test_whatever_integrates_takes_settings_and_repeats_none_of_them(function):
    taken = inspect.signature(function).parameters
    assert taken["settings"].annotation == cj.Settings | None
    assert taken["settings"].kind is inspect.Parameter.POSITIONAL_OR_KEYWORD
    assert not set(cj.Settings.__dataclass_fields__) & set(taken)


@pytest.mark.parametrize("name", NAMES)
def test_presets_are_settings_that_cannot_be_changed(name):
    preset = getattr(presets, name)
    assert preset == replace(preset) and isinstance(preset, cj.Settings)
    with pytest.raises(FrozenInstanceError):
        preset.rtol = 1.0


def test_numbers_of_numpy_are_those_of_python():
    settings = cj.Settings(rtol=np.float64(1e-8), max_steps=np.int64(100), ledger=np.True_)
    given = settings.rtol, settings.max_steps, settings.ledger
    assert [*map(type, given)] == [float, int, bool]


def test_presets_get_finer():
    tolerances = [getattr(presets, name).rtol for name in FINER]
    assert tolerances == sorted(tolerances, reverse=True)
    assert presets.default == cj.Settings()


def test_fits_take_the_states_of_derivatives_and_looser_slopes():
    loose = presets.identification.derivative_tolerance
    assert presets.identification == replace(presets.derivatives, derivative_tolerance=loose)
    assert loose > presets.derivatives.derivative_tolerance


CLIPPED = diffrax.ClipStepSizeController(
    diffrax.PIDController(rtol=1e-6, atol=1e-9), jump_ts=np.array([0.1])
)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"rtol": -1e-6}, r"`rtol` must be zero or positive, but is -1e-06: .*such as 1e-6"),
        ({"rtol": 0.0}, "`rtol` must be positive unless `atol` is"),
        ({"rtol": 0.0, "atol": 0.0}, "`rtol` must be positive unless `atol` is"),
        ({"rtol": None}, "`rtol` must be a number, but is None: give a relative tolerance"),
        ({"atol": np.nan}, "`atol` must be finite"),
        ({"first_step": 0.0}, "`first_step` must be positive, but is 0.0: give a step in s"),
        ({"landing_tolerance": -1e-9}, "`landing_tolerance` must be positive"),
        ({"derivative_tolerance": None}, "`derivative_tolerance` must be a number, but is None"),
        ({"derivative_tolerance": 0.0}, "`derivative_tolerance` must be positive"),
        ({"max_steps": 1e6}, "`max_steps` must be a whole number"),
        ({"solver": diffrax.Tsit5}, r"`solver` must be an object such as diffrax.Tsit5\(\)"),
        ({"solver": diffrax.KenCarp4()}, "`solver` must be a solver of ordinary"),
        ({"controller": 1e-3}, "`controller` must be an object such as diffrax.PIDController"),
        ({"controller": CLIPPED}, "`controller` must be without `step_ts` and `jump_ts`"),
        ({"coordinates": "joint"}, r"`coordinates` must be an object such as JointCoordinates\(\)"),
        ({"stabilisation": None}, r"`stabilisation` must be an object such as Baumgarte\(\)"),
        ({"ledger": "no"}, "`ledger` must be True or False, but is 'no'"),
        ({"redundant": 1}, "`redundant` must be True or False"),
        ({"allow_float32": 0}, "`allow_float32` must be True or False"),
    ],
)
def test_what_no_run_can_use_is_refused_at_once(given, message):
    with pytest.raises(ValueError, match=message):
        cj.Settings(**given)


def test_tolerances_may_be_those_of_lanes():
    scene, state = rotor()

    def attempts(rtol):
        return cj.simulate(scene, state, 0.2, cj.Settings(rtol=rtol)).attempts

    lanes = jax.vmap(attempts)(jnp.asarray([1e-4, 1e-10]))
    assert lanes.tolist() == [int(attempts(1e-4)), int(attempts(1e-10))]


@pytest.mark.parametrize(
    ("times", "message"),
    [
        ([0.2, 0.1], "a rising"),
        ([], "a rising"),
        ([[0.1]], "a rising"),
        ([0.1, np.nan], "a rising"),
        ([0.0, 1.0, 1.0], "without repetition.*numpy.unique"),
    ],
)
def test_times_to_save_at_rise(times, message):
    with pytest.raises(ValueError, match=f"`times` must be {message}"):
        cj.Saving(times)


def sensitivities(settings):
    return cj.sensitivities(*rotor(), 0.2, STIFFNESS, {"angle": angle}, [0.2], settings)


def horizon(settings):
    return cj.fit_horizon(*rotor(), STIFFNESS, SENSORS, settings, uncertainty={"stiffness": 0.1})


def sweep(settings, outputs=None):
    axes = {"stiffness": stiffness_axis([10.0, 20.0])}
    return cj.sweep(*rotor(), 0.2, axes, outputs, settings, progress=False)


def screened(settings):
    data = cj.Measurements({"angle": cj.Series(angle, [0.1, 0.2], [0.0, 0.0], 1e-3, unit="rad")})
    return cj.identify(*rotor(), data, STIFFNESS, settings, starts=cj.Screening())


SINGLE, ACROSS = cj.Settings(allow_float32=True), cj.Settings(landing_tolerance=None)
IMPLICIT = cj.Settings(solver=diffrax.Kvaerno3(), atol=1e-9)
SECTION = {"zero": cj.Section(angle, {"angle": (angle, "rad")}, 1)}


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: sensitivities(SINGLE), "`allow_float32` must be False for sweeps and runs with"),
        (lambda: sensitivities(ACROSS), "`landing_tolerance` must be a penetration in m"),
        (lambda: sensitivities(IMPLICIT), "`solver` must be an explicit Runge-Kutta method"),
        (lambda: horizon(FIXED), "`controller` must be None where .* give rtol and atol"),
        (
            lambda: cj.identifiability(*rotor(), STIFFNESS, SENSORS, FIXED),
            "`controller` must be None where the accuracy of derivatives",
        ),
        (lambda: screened(FIXED), "`controller` must be None where runs of several tolerances"),
        (lambda: sweep(SINGLE), "`allow_float32` must be False for sweeps"),
        (lambda: sweep(IMPLICIT, SECTION), "`solver` must be an explicit Runge-Kutta method"),
        (lambda: sweep({"rtol": 1e-8}), "`settings` must be Settings or None, but is 'dict'"),
        (
            lambda: cj.simulate(*rotor(), 1.0, cj.Saving([0.5])),
            "`settings` must be Settings or None, but is 'Saving': pass cj.Settings",
        ),
        (
            lambda: cj.simulate(*rotor(), 1.0, None, [0.5]),
            "`save` must be a Saving or None, but is 'list': pass cj.Saving",
        ),
        (
            lambda: cj.simulate_nonsmooth(*rotor(), 1.0, cj.Saving(steps=True), step=1e-3),
            "`steps` must be False of a run with rigid contacts",
        ),
    ],
)
def test_what_a_call_cannot_honour_is_refused(call, message):
    with pytest.raises(ValueError, match=message):
        call()


@pytest.mark.parametrize("kept", ["steps", "impacts"])
@pytest.mark.parametrize("transformed", [jax.jit, jax.jacfwd], ids=["jit", "jacfwd"])
def test_what_no_transformed_run_records_is_refused(kept, transformed):
    scene, state = rotor()

    def turned(end):
        return cj.simulate(scene, state, end, save=cj.Saving(**{kept: True})).time

    with pytest.raises(ValueError, match=f"`{kept}` must be False under a transformation of JAX"):
        transformed(turned)(0.2)


@pytest.mark.slow
def test_derivatives_have_a_ledger_if_it_is_asked_for():
    """The work of a constant torque T, T times the angle: T (w0 t + T t^2 / 2 I)."""
    torque, time = 0.2, 0.1
    scene, state = rotor()
    motor = cj.DriveTorque("ground", "rotor", (0, 0, 1), torque)
    found = cj.sensitivities(
        replace(scene, forces={"motor": motor}),
        state,
        time,
        {"torque": cj.Parameter(lambda s: s.forces["motor"].torque)},
        {"work": lambda now: now.work["supplied"]},
        [time],
        replace(presets.derivatives, ledger=True),
    )
    turn, bend = SPEED * time, time**2 / INERTIA
    assert found.outputs["work"][0] == pytest.approx(torque * turn + 0.5 * torque**2 * bend)
    assert found.derivatives["work"][0, 0] == pytest.approx(turn + torque * bend)


def test_derivatives_take_a_first_step_and_a_controller_of_ones_own():
    """Heun's rule in steps of 1 ms, against the closed form w0 / w sin(w t), w^2 = k / I."""
    found = sensitivities(replace(FIXED, solver=diffrax.Heun()))
    assert found.attempts == found.accepted == 200
    stiffness, time = 10.0, 0.2
    w = np.sqrt(stiffness / INERTIA)
    slope = SPEED / w**2 * (w * time * np.cos(w * time) - np.sin(w * time))
    assert found.outputs["angle"][0] == pytest.approx(SPEED / w * np.sin(w * time), rel=1e-4)
    along = found.derivatives["angle"][0, 0]
    assert along == pytest.approx(slope * w / (2.0 * stiffness), rel=1e-4)


@pytest.mark.parametrize("end", [5e-324, 1e-310, 1e-300])
def test_spans_that_are_zero_to_the_processor_are_refused(end):
    """It takes subnormal numbers for zero, and a run of such steps would never end."""
    scene, state = cj.mechanisms.double_pendulum()
    axis = {"clearance": cj.Axis(lambda s: s.joints["shoulder"].clearance, [1e-4, 2e-4])}
    for call in (
        lambda: cj.simulate(scene, state, end),
        lambda: cj.simulate_nonsmooth(scene, state, end, step=1e-3),
        lambda: cj.sweep(scene, state, end, axis, {"n": cj.ImpactCount("shoulder")}),
    ):
        with pytest.raises(ValueError, match="`end_time` must be at least"):
            call()

"""Failed lanes have result codes and don't change the others; invalid sweeps are refused."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

import clearjoint as cj
from tests.support.datasets import assert_same_bits
from tests.support.rotor import END, LARGEST, angle, rotor, stiffness_axis, swept

GOOD = np.array([1.0, 5.0, 20.0, 80.0])
FEW = cj.Settings(max_steps=500)


@pytest.fixture(scope="module")
def good():
    return swept(GOOD, settings=FEW)


def codes(found) -> list[str]:
    names = found.result.attrs["flag_meanings"].split()
    by_number = dict(zip(found.result.attrs["flag_values"], names, strict=True))
    return [by_number[int(code)] for code in found.result.values]


def beside_the_good(good, stiffness, offset=0.0):
    """The lane of the given stiffness, which fails among good ones; those have the same bits as
    without it."""
    with pytest.warns(UserWarning, match="1 of 5 lanes failed"):
        found = swept(
            np.insert(GOOD, 2, stiffness), offset=np.insert(0 * GOOD, 2, offset), settings=FEW
        )
    others = found.isel(lane=[0, 1, 3, 4])
    assert_same_bits(others, good)
    assert codes(others) == ["successful"] * 4
    return found.isel(lane=[2])


def test_step_limit_of_a_stiff_lane(good):
    lane = beside_the_good(good, 1e4)
    assert codes(lane) == ["max_steps_reached"]
    assert int(lane.attempts[0]) == 500
    reached = float(lane.time_reached[0])
    assert 0.1 < reached < END
    saved = lane.saved_time <= reached
    assert np.isfinite(lane.swing_angle[0, saved.values]).all()
    assert np.isnan(lane.swing_angle[0, ~saved.values]).all()
    assert np.isfinite(lane.largest[0])


def test_law_that_turns_nan(good):
    """Steps shrink until the time no longer moves; the state is that of the start."""
    lane = beside_the_good(good, 2 * LARGEST)
    assert codes(lane) == ["step_too_small"]
    assert float(lane.time_reached[0]) == 0.0
    assert np.isfinite(lane.final_spin).all()


def test_value_that_a_scene_refuses(good):
    lane = beside_the_good(good, -3.0)
    assert codes(lane) == ["bad_parameters"]
    assert float(lane.time_reached[0]) == 0.0
    assert int(lane.attempts[0]) == -1 and np.isnan(lane.final_spin).all()


def test_state_off_the_ideal_joint(good):
    lane = beside_the_good(good, 20.0, offset=1e-3)
    assert codes(lane) == ["not_assembled"]
    assert float(lane.time_reached[0]) == 0.0 and int(lane.attempts[0]) == 0


def test_the_warning_names_the_constraint_and_its_remedy_leads_to_runs():
    scene, state = rotor()
    (name,) = [n for n, joint in scene.joints.items() if isinstance(joint, cj.RevoluteJoint)]

    def path(scene):
        return scene.joints[name].point_first[0]

    values, outputs = [0.0, 0.01], {"angle": cj.Peak(angle, "rad")}
    given = scene, state, 1e-3
    with pytest.warns(UserWarning) as warned:
        cj.sweep(*given, {"x": cj.Axis(path, values)}, outputs=outputs, progress=False)
    (message,) = [str(w.message) for w in warned if "not_assembled" in str(w.message)]
    assert "Lane 1: Argument `state` must be consistent in its positions (residual of" in message
    assert f"constraint '{name}" in message and "0.01: call assemble" in message

    def make(scene, state, value):
        scene = cj.set_value(scene, path, value)
        return scene, cj.assemble(scene, state)

    assert "cj.Axis.change(make, values)" in message
    axis = cj.Axis.change(make, values)
    found = cj.sweep(*given, {"x": axis}, outputs=outputs, progress=False)
    assert codes(found) == ["successful", "successful"]


def held_at_two_points(distance: float) -> tuple[cj.Scene, cj.State]:
    """The rotor on a ball, and on an axis at a distance from it."""
    scene, _ = rotor()
    away = (0.0, 0.0, distance)
    joints = {
        "ball": cj.SphericalJoint("ground", "rotor", (0, 0, 0), (0, 0, 0)),
        "axis": cj.InlineJoint("ground", "rotor", away, away, (0, 0, 1)),
    }
    return replace(scene, joints=joints), STILL


STILL = cj.State({"rotor": cj.body_state((0.0, 0.0, 0.0))})
ABSOLUTE = cj.AbsoluteCoordinates()


def distances(values) -> cj.Axis:
    """Between ball and axis."""
    return cj.Axis.change(lambda scene, state, d: (held_at_two_points(d)[0], state), values, "m")


def test_lanes_that_simulate_refuses():
    """For constraints that nearly depend on others, and for numbers of the initial state."""
    axes = {
        "d": distances([1e-6, 0.2]),
        "norm": cj.Axis.initial(lambda s: s.bodies["rotor"].orientation[0], [1.0, 2.0]),
    }
    scene, state = held_at_two_points(0.2)
    options = {"settings": cj.Settings(coordinates=ABSOLUTE), "progress": False}
    with pytest.warns(UserWarning, match=r"Lane 0: .*nearly depend on the others.*ball"):
        found = cj.sweep(scene, state, 0.1, axes, zipped=True, **options)
    assert codes(found) == ["bad_parameters"] * 2
    with pytest.raises(ValueError, match="nearly depend on the others"):
        cj.simulate(*held_at_two_points(1e-6), 0.1, **options)


def test_sweep_of_a_structure_that_cannot_move_is_refused():
    joints = {"weld": cj.FixedJoint("ground", "rotor", (0, 0, 0), (0, 0, 0))}
    fixed = replace(rotor()[0], joints=joints)
    with pytest.raises(ValueError, match="`coordinates`.*a degree of freedom is left"):
        cj.sweep(fixed, STILL, END, AXES)


def test_nothing_is_said_of_success():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        swept(GOOD)


AXES = {"stiffness": stiffness_axis(GOOD)}
LATER = lambda scene: 2.0 if scene.forces["spring"].stiffness > 10 else -1.0  # noqa: E731
UNEVEN = lambda scene: np.linspace(0, 1, int(scene.forces["spring"].stiffness))  # noqa: E731
SWING = {"swing": angle}


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"end_time": 0.0}, r"`end_time`.*after start_time = 0\.0.*\[0\.0\]"),
        ({"end_time": LATER}, r"`end_time`.*is \[-1\.0\]"),
        ({"settings": {"rtol": 1e-8}}, "`settings` must be Settings or None"),
        ({"outputs": SWING, "save": cj.Saving([0.0, 2.0])}, "`times`.*end_time"),
        ({"outputs": SWING, "save": cj.Saving(UNEVEN)}, r"`times`.*equally many.*\[1, 5, 20"),
        ({"outputs": SWING}, r"`times`.*outputs\['swing'\].*cj\.Saving\(times\)"),
        ({"outputs": {"force": 3}}, r"outputs\['force'\].*a quantity, a reduction, a Section"),
        ({"outputs": {"final_spin": angle}, "save": cj.Saving([1.0])}, "final_spin.*rename"),
        ({"outputs": {"attempts": cj.Peak(angle, "rad")}}, "attempts.*rename"),
        ({"outputs": {"stiffness": cj.Peak(angle, "rad")}}, "stiffness.*rename the axis"),
        ({"outputs": {"lost": cj.DissipatedEnergy()}}, r"Settings\(ledger=True\)"),
        ({"axes": {}}, "`axes`.*at least one axis"),
        ({"axes": {"body": stiffness_axis(GOOD)}}, "body.*rename the axis"),
        (
            {"axes": {"saved_time": stiffness_axis(GOOD)}, "save": cj.Saving([1.0])},
            "saved_time.*rename the axis",
        ),
        ({"axes": {**AXES, "k": stiffness_axis([1.0])}, "zipped": True}, "equally many"),
        ({"axes": {"gravity": cj.Axis(lambda s: s.gravity, GOOD)}}, r"`value`.*shape \(3,\)"),
        ({"executor": 3}, "`executor`.*dask.distributed.Client"),
        ({"save": cj.Saving(impacts=True)}, r"`impacts`.*ImpactTable\(20\)"),
        ({"save": cj.Saving(steps=True)}, r"`steps`.*simulate\(\)"),
        ({"save": cj.Saving([1.0]), "outputs": {"saved_spin": angle}}, "saved_spin.*rename"),
        ({"save": [1.0]}, "`save` must be a Saving or None"),
    ],
)
def test_what_no_sweep_can_use_is_refused(changes, says):
    arguments = {"end_time": END, "axes": AXES, **changes}
    with pytest.raises(ValueError, match=says):
        cj.sweep(*rotor(), **arguments)


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: cj.Axis(lambda s: s.gravity[1], []), "`values`.*row"),
        (lambda: cj.Axis(lambda s: s.gravity[1], 3.0), "`values`.*row"),
        (lambda: cj.Axis(lambda s: s.gravity[1], [np.nan]), "`values`.*finite"),
        (lambda: cj.Axis(lambda s: s.gravity[1], ["fast"]), "number"),
        (
            lambda: cj.Axis(stiffness_axis(GOOD).variation, GOOD, "N/m"),
            "`unit` must be None for a variation.*'N/m'",
        ),
        (lambda: cj.Axis("gravity", GOOD), "`path`.*lambda scene"),
        (lambda: cj.Axis.initial("spin", GOOD), "`path`.*lambda state"),
        (lambda: cj.Axis.change(None, GOOD), "`make`.*lambda scene, state, value"),
        (lambda: cj.Section(angle, {}, 1), "`channels`.*by name"),
        (lambda: cj.Section(angle, {"x": 3}, 1), r"`channels\['x'\]`.*pair"),
        (lambda: cj.Section(angle, {"time": (angle, "rad")}, 1), "`channels`.*time.*rename"),
        (lambda: cj.Statistics(angle, "rad", after=1.0, until=0.5), "`until`.*later than after = "),
    ],
)
def test_axes_and_outputs_check_themselves(make, says):
    with pytest.raises(ValueError, match=says):
        make()


def test_changes_of_the_structure_are_bad_lanes():
    """What a function of the user's does is only known lane by lane."""
    empty = cj.Axis.change(lambda scene, state, value: (scene, cj.State({})), [1.0])
    with pytest.warns(UserWarning, match="change numbers only"):
        found = cj.sweep(*rotor(), END, {"nothing": empty}, threads=1)
    assert codes(found) == ["bad_parameters"]

"""The entry speed of a contact at its onset: in saved states, restarts, sections and derivatives,
and of a contact that rests at the start."""

import re
import warnings
from dataclasses import replace

import jax
import numpy as np
import pytest

import clearjoint as cj
from tests.support.difference_quotients import central
from tests.support.dropped_rod import dropped_rod
from tests.support.one_body import one_body

GRAVITY, MASS = 9.81, 7.02


def damped(restitution=0.5, stiffness=1e10, kind=cj.laws.LankaraniNikravesh):
    return kind(restitution, stiffness)


def row_of(solution, k):
    return jax.tree.map(lambda leaf: leaf[k], solution.saved.states)


def depth(now):
    return cj.quantities.Penetration("pin", "V")(now)


def height(now):
    return -depth(now)


SPEED = {"speed": (cj.quantities.EntrySpeed("pin", "V"), "m/s")}


def kept(times):
    """Return what all runs of the rod keep, so that they share one program."""
    sections = {"onsets": cj.Section(depth, SPEED, 4), "ends": cj.Section(height, SPEED, 4)}
    return {"save": cj.Saving(times, impacts=True), "outputs": sections}


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(10))
def test_runs_continue_from_any_instant_of_their_onsets(seed):
    """Runs that continue from states saved around their onset end like one without interruption."""
    rng = np.random.default_rng(seed)
    kinds = cj.laws.LankaraniNikravesh, cj.laws.HuntCrossley, cj.laws.ExactRestitution
    law = damped(rng.uniform(0.3, 0.9), 10 ** rng.uniform(9, 11), kinds[rng.integers(3)])
    options = {"line_points": 3} if seed % 3 == 0 else {}
    scene, state = dropped_rod(law, clearance=10 ** rng.uniform(-4, -3), **options)
    end, settings = 0.016, cj.presets.accurate

    def run(state, times, start=0.0):
        options = {"start_time": start, "progress": False}
        return cj.simulate(scene, state, end, settings, **kept(times), **options)

    whole = run(state, [end])
    onset = whole.impacts.onset[0]
    # From the same floating-point number to beyond the step that lands on the onset.
    delays = np.append([0.0, np.spacing(onset)], 10.0 ** rng.uniform(-17.5, -10.0, 10))
    times = np.unique(onset + delays)
    saved = run(state, times)
    speed = np.linalg.norm(whole.final.bodies["rod"].velocity)
    for k, time in enumerate(times):
        again = run(row_of(saved, k), [end], time)
        change = again.final.bodies["rod"].velocity - whole.final.bodies["rod"].velocity
        assert np.linalg.norm(change) < 1e-5 * speed, (time - onset, row_of(saved, k).entry_speeds)


def test_sections_at_the_onset_and_the_end_of_contacts_have_their_entry_speeds():
    solution = cj.simulate(*dropped_rod(damped()), 0.05, **kept([0.05]), progress=False)
    impacts = solution.impacts.of("pin", "V")
    expected = impacts.entry_speed[:3]
    assert np.all(expected > 0.01)
    for name, times in {"onsets": impacts.onset, "ends": impacts.separation}.items():
        crossings = solution.outputs[name]
        np.testing.assert_allclose(crossings.values["speed"][:3], expected, rtol=1e-12)
        np.testing.assert_allclose(crossings.times[:3], times[:3], rtol=0.0, atol=2e-11)


@pytest.mark.slow
def test_a_section_at_an_onset_has_the_force_after_its_jump():
    """The force of a damper at zero depth is the damping times the entry speed. The third impact
    begins within a step that starts at the end of the second."""
    law = cj.laws.KelvinVoigt(0.5, 1e7, 3.0)
    depth, force = cj.quantities.Penetration("pin", "V"), cj.quantities.ContactForce("pin", "V")
    section = cj.Section(depth, {"force": (force, "N")}, 3)
    options = {"save": cj.Saving(impacts=True), "outputs": {"onsets": section}}
    solution = cj.simulate(*dropped_rod(law), 0.03, progress=False, **options)
    crossings, impacts = solution.outputs["onsets"], solution.impacts.of("pin", "V")
    np.testing.assert_allclose(crossings.times[:2], impacts.onset[:2], rtol=0.0, atol=2e-11)
    gap = cj.extend.Gap(1e-300, impacts.entry_speed[:2])
    expected = law.force(gap, None)
    np.testing.assert_allclose(crossings.values["force"][:2], expected, rtol=1e-6)
    assert len(crossings.times) == 3
    assert crossings.values["force"][2] > 1.0


@pytest.mark.parametrize("seed", range(6))
def test_resting_parts_are_held_at_their_static_depth(seed):
    """It is (F/K)^(1/n) for the force F of each contact that carries the load."""
    rng = np.random.default_rng(seed)
    stiffness, exponent = 10 ** rng.uniform(7, 11), rng.uniform(1.0, 2.5)
    law = cj.laws.ExactRestitution(0.8, stiffness, exponent=exponent)
    load, size = rng.normal(size=3), 10 ** rng.uniform(-1, 3)
    load *= size / np.linalg.norm(load)
    axis = np.cross(load, rng.normal(size=3))
    pair, gap = ("ground", "part"), {"clearance": 1e-3, "law": law}
    axes = {"bearing_axis": axis, "journal_axis": axis}
    flat = {"half_length": 0.05, "half_height": 0.02, "slider_axis": axis, "slider_normal": load}
    slot = {"play": 2e-3, "pin_radius": 0.02, "slot_normal": load, "slot_axis": axis}
    journal = {"bearing_radius": 0.02, "journal_length": 0.03, **axes}
    cases = [
        (1, cj.BallInSocket(*pair, socket_radius=0.02, **gap)),
        (2, cj.ClearanceJoint(*pair, **journal, **gap)),
        (1, cj.ClearanceJoint(*pair, line_points=4, **journal, **gap)),
        (1, cj.PinInSlot(*pair, law=law, **slot)),
        (2, cj.SliderInGuide(*pair, guide_normal=load, **flat, **gap)),
    ]
    for contacts, joint in cases:
        ideal = joint.resting_joint(load)
        point = vars(ideal).get("point_first", vars(ideal).get("point"))
        depth = np.linalg.norm(point) - 1e-3
        expected = (size / contacts / stiffness) ** (1.0 / exponent)
        assert depth == pytest.approx(expected, rel=1e-8, abs=1e-15), type(joint).__name__


@pytest.mark.slow
def test_a_resting_ball_has_the_entry_speed_of_an_impact_with_its_elastic_energy():
    law = cj.laws.ExactRestitution(0.8, 1e9)
    joint = cj.BallInSocket("ground", "part", socket_radius=0.02, clearance=1e-3, law=law)
    options = {"mass": 3.0, "inertia": (1e-3,) * 3, "gravity": (0, 0, -GRAVITY)}
    state = cj.assemble(*one_body("part", {"pin": joint}, **options), resting=["pin"])
    depth = (3.0 * GRAVITY / 1e9) ** (2 / 3)
    assert state.bodies["part"].position[2] == pytest.approx(-1e-3 - depth, abs=1e-15)
    speed = np.sqrt(2.0 * 1e9 * depth**2.5 / 2.5 / 3.0)
    assert state.entry_speeds["pin"]["ball"] == pytest.approx(speed, rel=1e-6)


def test_a_resting_start_needs_few_steps_and_stays_at_rest():
    """Without an entry speed, the law's smallest one made the contact rigid, with 77 505 steps."""
    scene, guess = dropped_rod(damped(0.9))
    state = cj.assemble(scene, guess, resting=["pin"])
    solution = cj.simulate(scene, state, 0.2, **kept([0.2]), progress=False)
    assert solution.attempts < 1500
    # The force of each base is half of the reaction of an ideal joint when the arm is let go, and
    # the journal stays at its depth.
    force = 0.5 * MASS * GRAVITY * (1.0 - 0.25 * MASS / (0.5855 + 0.25 * MASS))
    depth = (force / 1e10) ** (2 / 3)
    soon = cj.simulate(scene, state, 2e-4, **kept([2e-4]), progress=False)
    for bodies in (state.bodies, soon.final.bodies):
        journal = bodies["rod"].position[1] - 0.5 * 2.0 * bodies["rod"].orientation[3]
        assert journal - 0.5e-3 == pytest.approx(depth, rel=0.02)


def test_a_failed_run_names_the_contact_whose_damping_makes_it_stiff():
    scene, _ = dropped_rod(damped(0.9))
    state = cj.State({"rod": cj.body_state((0.5, 0.5e-3 + 1e-15, 0.0))})
    settings = cj.Settings(max_steps=3000)
    with pytest.raises(
        cj.SimulationError, match="Contact 'V'.*LankaraniN.*entry_speed_floor="
    ) as raised:
        cj.simulate(scene, state, 0.2, settings, **kept([0.2]), progress=False)
    # The advice is followed.
    floor = float(str(raised.value).split("entry_speed_floor=")[1].split("`")[0])
    pin = scene.joints["pin"]
    pin = replace(pin, law=replace(pin.law, entry_speed_floor=floor))
    scene = replace(scene, joints={"pin": pin})
    assert cj.simulate(scene, state, 0.2, settings, **kept([0.2]), progress=False).attempts < 1500


@pytest.mark.parametrize("depth", [2e-12, 1e-7])
def test_a_start_inside_the_wall_without_entry_speed_warns(depth):
    scene, _ = dropped_rod(damped())
    bodies = {"rod": cj.body_state((0.5, 0.5e-3 + depth, 0.0), velocity=(0.0, 0.1, 0.0))}
    speeds = {"pin": {"V": 0.1, "W": 0.1}}
    with pytest.warns(cj.UnusualValueWarning, match=r"state.entry_speeds\['pin'\]\['V'\]"):
        cj.simulate(scene, cj.State(bodies), 0.001, **kept([0.001]), progress=False)
    known = cj.State(bodies, entry_speeds=speeds)
    cj.simulate(scene, known, 0.001, **kept([0.001]), progress=False)


@pytest.mark.slow
def test_derivatives_of_a_run_that_starts_at_the_wall_are_those_of_its_onset():
    """They are compared with differences of runs. The clearance is only increased: the contact then
    begins later."""
    scene, _ = dropped_rod(damped(0.5, 1e9))

    def state(speed):
        body = cj.body_state((0.5, 0.5e-3 + 1e-17, 0.0), velocity=(0.0, speed, 0.0))
        return cj.State({"rod": body})

    def clearance(scene):
        return scene.joints["pin"].clearance

    parameters = {
        "clearance": cj.Parameter(clearance),
        "speed": cj.Parameter.initial(lambda s: s.bodies["rod"].velocity[1]),
    }
    outputs, times = {"y": cj.quantities.Position("rod", "y")}, [0.001, 0.002, 0.004]
    found = cj.sensitivities(scene, state(0.1), 0.004, parameters, outputs, times, progress=False)
    along = found.derivatives["y"]

    def heights(speed=0.0, wider=0.0):
        varied = cj.set_value(scene, clearance, 0.5e-3 + wider)
        settings, save = cj.presets.reference, cj.Saving(times)
        run = cj.simulate(varied, state(0.1 + speed), 0.004, settings, save, progress=False)
        return np.asarray(run.saved.states.bodies["rod"].position)[:, 1]

    np.testing.assert_allclose(along[:, 1], central(heights, 1e-6), rtol=1e-5)
    by_clearance = (heights(wider=1e-9) - heights()) / 1e-9
    np.testing.assert_allclose(along[:, 0], by_clearance, rtol=5e-5)


def falling(height, stiffness):
    """Arguments of `sensitivities` for a ball that falls and rebounds, and its derivative by the
    height in the limit of a rigid impact.

    y = -h + 0.8 v (t - t1) - g (t - t1)^2/2, where v = g t1 and t1 = sqrt(2 h/g).
    """
    law, end_speed = cj.laws.ExactRestitution(0.8, stiffness), np.sqrt(2.0 * GRAVITY * height)
    slot = cj.PinInSlot("ground", "ball", play=2.0 * height, pin_radius=0.01, law=law)
    scene, state = one_body("ball", {"slot": slot}, inertia=(1e-3,) * 3, gravity=(0, -GRAVITY, 0))
    fall = end_speed / GRAVITY
    parameters = {"h": cj.Parameter.initial(lambda s: s.bodies["ball"].position[1])}
    outputs, end = {"y": cj.quantities.Position("ball", "y")}, 1.25 * fall
    after = end - fall
    rigid = (0.8 * GRAVITY * (after - fall) + GRAVITY * after) / end_speed
    return (scene, state, end, parameters, outputs, [end]), rigid


@pytest.mark.slow
@pytest.mark.parametrize("height", [1.0, 50.0, 500.0])
@pytest.mark.parametrize("stiffness", [1e10, 1e11, 1e12, 1e13])
def test_derivatives_after_a_long_fall_are_those_of_a_rigid_impact(height, stiffness):
    """They differ by the duration of the contact, which is below a hundredth of the fall's. From
    500 m the message's advice is followed, a larger `derivative_tolerance`."""
    arguments, rigid = falling(height, stiffness)
    settings = cj.presets.derivatives
    if height > 100.0:
        settings = replace(settings, derivative_tolerance=1e3)
    along = cj.sensitivities(*arguments, settings, progress=False).derivatives["y"][0, 0]
    end_speed = np.sqrt(2.0 * GRAVITY * height)
    contact = 3.0 * (1.0 / stiffness) ** 0.4 * end_speed**-0.2
    assert along == pytest.approx(rigid, rel=20.0 * contact * GRAVITY / end_speed + 1e-3)


@pytest.mark.slow
def test_loose_tolerances_after_a_stiff_impact_warn_with_one_that_helps():
    """At the default of runs without derivatives, this derivative is wrong by a quarter."""
    arguments, rigid = falling(50.0, 1e13)
    loose = cj.Settings(rtol=1e-6)
    with pytest.warns(cj.UnusualValueWarning, match="derivatives by 'h' may be wrong") as caught:
        along = cj.sensitivities(*arguments, loose, progress=False).derivatives["y"][0, 0]
    assert abs(along / rigid - 1.0) > 0.1
    (advice,) = [
        float(found[1])
        for warning in caught
        if (found := re.search(r"tighten `rtol` to ([\d.e-]+\d)", str(warning.message)))
    ]
    with warnings.catch_warnings():
        warnings.filterwarnings("error", message="The derivatives")
        tight = cj.sensitivities(*arguments, replace(loose, rtol=advice), progress=False)
    assert tight.derivatives["y"][0, 0] == pytest.approx(rigid, rel=2e-3)

"""Figures of artificial motions: drawn values against closed forms, and units."""

from dataclasses import replace

import equinox as eqx
import matplotlib.pyplot as plt
import numpy as np
import pytest
import xarray as xr
from matplotlib.colors import to_rgba

import clearjoint as cj
from clearjoint import plot
from clearjoint.plot.report_page import joint_rows
from tests.support.drawn_axes import labels, legend
from tests.support.observations import observation_of
from tests.support.recorded_journal import ContactObservation
from tests.support.tumbling_bearing import CLEARANCE, TIMES, solution_of

CODES = {"flag_values": [0, 1], "flag_meanings": "successful max_steps_reached"}


def seen_contact(penetration, rate, force, angle=0.0) -> cj.results.Observation:
    """An observation of one base at equal intervals, in contact at an angle; the other is free."""
    count = len(penetration)
    times = np.linspace(0.0, 1e-3 * (count - 1), count)
    angle = np.broadcast_to(angle, (count,))
    across = np.stack([np.cos(angle), np.sin(angle), np.zeros(count)], axis=1)

    def base(depth, force, rate):
        depth = np.asarray(depth, float)
        size = (CLEARANCE + depth)[:, None]
        still = np.zeros((count, 3))
        parts = depth, rate, CLEARANCE + depth, size * across, force, None, across, still, still
        return ContactObservation(*parts)

    flying = base(np.full(count, -1e-4), np.zeros(count), np.zeros(count))
    contacts = {"pin": {"V": base(penetration, np.asarray(force), rate), "W": flying}}
    nothing = dict.fromkeys(("kinetic", "mechanical"), np.zeros(count))
    return observation_of(times, contacts=contacts, energies=nothing)


ROUGH = np.array([-1, 1, 3, 2, -1, -1, 2, 4, 3, 2, 3, 2, -1, 1])
"""Penetration, µm: flight, a single maximum, flight, two maxima in one contact, flight, a start."""
RISING = np.array([1, 1, 1, -1, -1, 1, 1, 1, -1, -1, 1, -1, -1, 1])
FREE, IMPACT, FOLLOWING = plot.ContactPhase


def rough() -> cj.results.Observation:
    return seen_contact(1e-6 * ROUGH, 1e-3 * RISING, np.maximum(ROUGH, 0) * 1e4)


def test_contacts_with_several_maxima_are_following_after_the_first():
    expected = [FREE, *[IMPACT] * 3, *[FREE] * 2, *[IMPACT] * 2, *[FOLLOWING] * 4, FREE, IMPACT]
    assert plot.contact_phases(rough(), "pin").tolist() == expected
    lying = seen_contact(np.full(3, 1e-6), np.zeros(3), np.ones(3))
    assert plot.contact_phases(lying, "pin").tolist() == [FOLLOWING] * 3
    depths, rates = 1e-6 * np.array([-1, 1, 3, 2, 2]), np.array([1, 1, 1, -1, -1])
    staying = seen_contact(depths, rates, np.ones(5))
    expected = [FREE, IMPACT, IMPACT, FOLLOWING, FOLLOWING]
    assert plot.contact_phases(staying, "pin").tolist() == expected


def test_the_timeline_has_bars_and_shares_of_the_time():
    axes = plot.motion_timeline(rough())
    assert axes.get_xlabel() == "time, ms"
    assert [tick.get_text() for tick in axes.get_yticklabels()] == ["pin"]
    assert legend(axes) == ["free flight", "impact", "following"]
    spans = {
        bars.get_label(): [tuple(path.get_extents().intervalx) for path in bars.get_paths()]
        for bars in axes.collections
    }
    assert spans["impact"] == [(1.0, 4.0), (6.0, 8.0)]
    assert spans["following"] == [(8.0, 12.0)]
    assert "31 / 38 / 31 %" in [text.get_text() for text in axes.texts]
    shown = plot.motion_timeline(rough(), window=(0.002, 0.005))
    assert shown.get_xlim() == (2.0, 5.0)
    assert "33 / 67 / 0 %" in [text.get_text() for text in shown.texts]
    heights = [np.ptp(bars.get_paths()[0].get_extents().intervaly) for bars in axes.collections]
    assert len(set(heights)) == 3


def test_forces_are_drawn_over_time():
    above = plot.contact_forces(rough(), "pin")
    assert labels(above) == ("time, ms", "normal force, kN")
    np.testing.assert_allclose(above.get_lines()[0].get_ydata(), 10.0 * np.maximum(ROUGH, 0))
    (line,) = plot.joint_forces(rough()).get_lines()
    np.testing.assert_allclose(line.get_ydata(), 10.0 * np.maximum(ROUGH, 0))
    contacts = rough().contacts["pin"]
    on_both = eqx.tree_at(lambda seen: seen.contacts["pin"]["W"], rough(), contacts["V"])
    (line,) = plot.joint_forces(on_both).get_lines()
    np.testing.assert_allclose(line.get_ydata(), 20.0 * np.maximum(ROUGH, 0))
    styles = [(line.get_color(), line.get_linestyle()) for line in above.get_lines()]
    assert len(set(styles)) == 2 and len({style for _, style in styles}) == 2
    assert plot.style.fitting_unit(np.array([2e4, np.nan]), "N") == (1e-3, "kN")


def test_a_late_window_has_a_suitable_unit():
    long = rough()
    long = eqx.tree_at(lambda seen: seen.times, long, 1e3 * long.times)
    whole, part = (plot.contact_forces(long, "pin", window=span) for span in (None, (0.1, 1.2)))
    assert whole.get_xlabel() == "time, s"
    assert part.get_xlabel() == "time, ms"
    assert part.get_xlim() == (100.0, 1200.0)
    for axes in (
        plot.motion_timeline(long, window=(0.1, 1.2)),
        plot.energy_ledger(long, window=(0.1, 1.2))[1],
    ):
        assert (axes.get_xlabel(), axes.get_xlim()) == ("time, ms", (100.0, 1200.0))


def test_the_area_of_the_loop_is_the_dissipated_energy():
    turn = np.linspace(-np.pi, np.pi, 2001)
    depth, force = 5e-6 * (1.0 + np.cos(turn)), 400.0 * (1.0 + np.cos(turn) - 0.2 * np.sin(turn))
    seen = seen_contact(depth, np.zeros(2001), force)
    rows = [("pin", "V", 0.0, 2.0, 2.0, 0.1, 0.1, 800.0, 1.0, 1e-5)]
    impacts = cj.results.Impacts.of_rows(rows)
    axes = plot.hysteresis(seen, impacts)
    assert labels(axes) == ("penetration, µm", "contact force, N")
    area = np.pi * 5e-6 * 400.0 * 0.2
    assert plot.enclosed_energy(seen, impacts, 0) == pytest.approx(area, rel=1e-5)
    assert legend(axes)[0] == "impact 1 at 0.0 ms: 1.26 mJ"
    with pytest.raises(ValueError, match="`impacts` must be at least one impact"):
        plot.hysteresis(seen, impacts.of("pin", "W"))
    few = seen_contact(depth[:1], np.zeros(1), force[:1])
    for rare in (few, eqx.tree_at(lambda seen: seen.times, few, np.array([5.0]))):
        with pytest.raises(ValueError, match="`observation` must be .* observe every step"):
            plot.hysteresis(rare, impacts)
    with pytest.raises(ValueError, match="`count` must be"):
        plot.hysteresis(seen, impacts, count=0)
    with pytest.raises(ValueError, match="`window` must be an interval with observed times"):
        plot.eccentricities(seen, "pin", 1e-3, window=(7.0, 8.0))
    with pytest.raises(ValueError, match="`window` must be an interval within .*7.0, 8.0"):
        plot.contact_forces(seen, "pin", window=(7.0, 8.0))


def test_directions_of_contact_add_up_to_the_impulse():
    angle = 2.0 * np.pi * (np.arange(721) + 0.5) / 720
    force = 1e3 * (1.0 + np.cos(angle))
    seen = seen_contact(np.full(721, 1e-6), np.zeros(721), force, angle)
    axes = plot.contact_rose(seen, "pin", sectors=12)
    bars = np.array([bar.get_height() for bar in axes.containers[0]])
    assert axes.get_xlabel() == "impulse, N s"
    assert bars.sum() == pytest.approx(np.trapezoid(force, seen.times))
    ends = 2.0 * np.pi * np.arange(13) / 12
    exact = np.diff(ends + np.sin(ends)) * 1e3 * 0.72 / (2.0 * np.pi)
    np.testing.assert_allclose(bars, exact, atol=0.2)
    axes = plot.contact_rose(seen, "pin", weight="force", sectors=12, section=plot.XY)
    assert axes.get_xlabel() == "largest normal force, N"
    tallest = [bar.get_height() for bar in axes.containers[0]][:3]
    at_ends = 1000.0 * (1.0 + np.cos(np.pi / 6 * np.arange(3)))
    np.testing.assert_allclose(tallest, at_ends, atol=5.0)
    assert axes.get_xticklabels()[0].get_text() == "X, 0°"
    assert [to_rgba(bars[0].get_facecolor())[3] for bars in axes.containers] == [1.0, 0.0]


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda s: plot.contact_rose(s, "pinn"), r"`joint` must be .*\['pin'\], but is 'pinn'"),
        (lambda s: plot.contact_rose(s, "pin", weight="mass"), "`weight` must be 'impulse' or"),
        (lambda s: plot.contact_rose(s, "pin", sectors=0), "`sectors` must be a whole number"),
        (lambda s: plot.contact_rose(s, "pin", axes=plt.subplots()[1]), "`axes` must be polar"),
        (lambda s: plot.contact_phases(s, "pinn"), "`joint` must be one of those"),
    ],
)
def test_wrong_arguments_are_refused(call, message):
    with pytest.raises(ValueError, match=message):
        call(rough())


def test_a_scene_without_contacts_has_no_timeline():
    seen = observation_of(TIMES)
    for draw in (plot.motion_timeline, plot.joint_forces):
        with pytest.raises(ValueError, match="`observation` must be of a scene with contacts"):
            draw(seen)


def energies(**more) -> cj.results.Observation:
    stored = {"kinetic": 3.0 * TIMES, "gravity": 5.0 - 9.0 * TIMES, "contacts": 0.5 * TIMES}
    whole = stored | {"springs": 0.5 * TIMES, "mechanical": 5.0 - 5.0 * TIMES} | more
    return observation_of(TIMES, energies=whole)


def test_the_ledger_has_energies_and_drift():
    ledger = {"normal damping": 2.0 * TIMES, "friction": 4.0 * TIMES, "supplied": 1.1 * TIMES}
    above, below = plot.energy_ledger(energies(**ledger))
    drawn = {line.get_label(): line.get_ydata()[-1] for line in above.get_lines()}
    expected = {"kinetic": 180.0, "potential, 0 at the start": -540.0, "elastic": 60.0}
    expected |= {"dissipated": 360.0, "work of drivers and loads": 66.0}
    assert drawn == pytest.approx(expected)
    assert labels(above) == ("", "energy, mJ") and labels(below) == ("time, ms", "drift, mJ")
    assert below.get_lines()[0].get_ydata()[-1] == pytest.approx(60.0 * (-5.0 + 6.0 - 1.1))
    assert below.get_title(loc="right") == "at most 0.01 of the largest change above"
    assert len({line.get_linestyle() for line in above.get_lines()}) >= 4


def test_without_a_ledger_the_change_of_the_mechanical_energy_is_drawn():
    _, below = plot.energy_ledger(energies())
    assert below.get_ylabel() == "mechanical,\nsince start, mJ"
    assert below.get_lines()[0].get_ydata()[-1] == pytest.approx(-300.0)


def record(amplitude, cycles, count=400, end=0.2) -> xr.DataArray:
    """A harmonic with some cycles in the record, about a mean of 3."""
    times = end * np.arange(count) / count
    values = 3.0 + amplitude * np.cos(2.0 * np.pi * cycles * times / end + 0.3)
    return xr.DataArray(values, {"time": times}, ("time",), "velocity", {"units": "m/s"})


@pytest.mark.parametrize(
    ("taper", "cycles", "error"),
    [("boxcar", 20, 1e-12), ("hann", 20, 1e-12), ("flattop", 20.4, 2e-3)],
)
def test_a_harmonic_has_its_amplitude_in_the_spectrum(taper, cycles, error):
    found = plot.amplitude_spectrum(record(0.7, cycles), taper)
    assert found["frequency"][0] == pytest.approx(5.0) and len(found) == 200
    assert float(found.max()) == pytest.approx(0.7, rel=error)
    assert float(found["frequency"][np.argmax(found.values)]) == pytest.approx(5.0 * round(cycles))
    assert found.attrs["units"] == "m/s"
    half = plot.amplitude_spectrum(record(0.7, 200).copy(data=3.0 + 0.7 * (-1.0) ** np.arange(400)))
    assert float(half[-1]) == pytest.approx(0.7)


def test_a_spectrum_has_units_on_its_axes():
    axes = plot.spectrum_of(record(7e-3, 20, end=0.002))
    assert labels(axes) == ("frequency, kHz", "amplitude of velocity, mm/s")
    x, y = axes.get_lines()[0].get_data()
    assert (x[np.argmax(y)], y.max()) == (pytest.approx(10.0), pytest.approx(7.0))
    assert axes.get_yscale() == "log" and axes.get_xlim() == (0.0, pytest.approx(100.0))
    assert axes.get_title(loc="right") == "window: hann; lines 500 Hz apart"


def test_unequal_intervals_have_no_spectrum():
    uneven = record(1.0, 5).assign_coords(time=np.geomspace(1e-3, 1.0, 400))
    with pytest.raises(ValueError, match="equal intervals of time, but is 'intervals from.*linsp"):
        plot.spectrum_of(uneven)
    with pytest.raises(ValueError, match="`record` must be at least 4 samples"):
        plot.amplitude_spectrum(record(1.0, 1, count=3))


def swept() -> xr.Dataset:
    """Crossings, and worn volumes."""
    lane = ("clearance",)
    hits = np.full((5, 4), np.nan)
    hits[:, :3] = 1e-3 * np.arange(1, 4)
    volumes = {
        f"wear_{base} {k}": (lane, np.full(5, 1e-15 * k * times_first))
        for base, times_first in (("V", 1), ("W", 2))
        for k in range(1, 7)
    }
    return xr.Dataset(
        {
            "result": (lane, np.zeros(5, "int8"), CODES),
            "top_count": (lane, np.full(5, 3)),
            "top_time": (("clearance", "top_number"), hits, {"units": "s"}),
            "top_x": (("clearance", "top_number"), hits, {"units": "m"}),
            "top_y": (("clearance", "top_number"), 2e3 * hits, {"units": "m/s"}),
            **volumes,
        },
        {"clearance": ("clearance", 1e-4 * np.arange(1.0, 6.0), {"units": "m"})},
    )


def test_wear_is_drawn_in_its_sectors():
    lane = swept().isel(clearance=0)
    axes = plot.wear(lane, "wear")
    assert axes.get_xlabel() == "worn volume, 10³ µm³"
    first, second = ([bar.get_height() for bar in bars] for bars in axes.containers)
    np.testing.assert_allclose(first, np.arange(1, 7))
    np.testing.assert_allclose(second, 2 * np.arange(1, 7))
    np.testing.assert_allclose([bar.get_y() for bar in axes.containers[1]], first)
    middles = [bar.get_x() + 0.5 * bar.get_width() for bar in axes.containers[0]]
    np.testing.assert_allclose(middles, 2.0 * np.pi * (np.arange(6) + 0.5) / 6)
    with pytest.raises(ValueError, match="`lane` must be a single lane"):
        plot.wear(swept(), "wear")


def test_sections_of_a_run_and_of_a_lane():
    values = {"x": 1e-3 * np.arange(1, 4), "y": 2.0 * np.arange(1, 4)}
    crossings = cj.results.Crossings(TIMES[:3], values, {"x": "m", "y": "m/s"})
    for axes in (
        plot.poincare_section(crossings),
        plot.poincare_section_of_lane(swept().isel(clearance=0), "top", ("x", "y")),
    ):
        assert labels(axes) == ("x, mm", "y, m/s")
        points = axes.collections[0].get_offsets()
        np.testing.assert_allclose(points, [(1, 2), (2, 4), (3, 6)])
    with pytest.raises(ValueError, match=r"`channels` must be two of .*\['x', 'y'\]"):
        plot.poincare_section(crossings, ("x", "z"))
    pending = swept().isel(clearance=0).assign(top_count=-1)
    with pytest.raises(ValueError, match="`lane` must be a lane that has run"):
        plot.poincare_section_of_lane(pending, "top", ("x", "y"))


def test_an_orbit_has_the_observed_clearance(turning):
    seen, _, _ = turning
    axes = plot.journal_orbit(seen, "pin")
    path, *_, circle = (np.hypot(*line.get_data()) for line in axes.get_lines())
    np.testing.assert_allclose(path, 0.5, rtol=3e-3)
    np.testing.assert_allclose(circle, 0.5, rtol=1e-9)
    assert labels(axes)[0] == "eccentricity along the bearing's x, mm"
    assert axes.get_aspect() == 1.0
    small = plot.journal_orbit(seen, "pin", 1e-4)
    assert labels(small)[0] == "eccentricity along the bearing's x, µm"
    np.testing.assert_allclose(np.hypot(*small.get_lines()[-1].get_data()), 100.0)


def test_a_phase_portrait_has_rates_of_the_equations_of_motion():
    times = np.linspace(0.0, 0.4, 9)
    still, upright = np.zeros((9, 3)), np.tile((1.0, 0.0, 0.0, 0.0), (9, 1))
    position, velocity = still.copy(), still.copy()
    position[:, 1], velocity[:, 1] = 3.0 * times - 5.0 * times**2, 3.0 - 10.0 * times
    states = cj.State({"ball": cj.BodyState(position, upright, velocity, still)})
    scene = cj.Scene({"ball": cj.Body(1.0, (1e-3, 1e-3, 1e-3))}, gravity=(0.0, -10.0, 0.0))
    solution = solution_of(cj.results.Trajectory(times, states))
    axes = plot.phase_portrait(scene, solution, cj.quantities.Position("ball", "y"))
    assert labels(axes) == ("position of ball y, mm", "rate of position of ball y, m/s")
    x, y = axes.get_lines()[0].get_data()
    np.testing.assert_allclose(x, 1e3 * position[:, 1], rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(y, velocity[:, 1], rtol=0.0, atol=1e-12)
    with pytest.raises(ValueError, match="`unit` must be an SI unit for this quantity"):
        plot.series(scene, solution, lambda now: now.time)
    with pytest.raises(ValueError, match="quantity: .*`body` must be one of"):
        plot.series(scene, solution, cj.quantities.Position("bell", "y"))


def test_a_report_lists_play_law_and_friction_of_lubricated_joints_shoulders_and_lines():
    law, friction = cj.laws.LankaraniNikravesh(0.7, 2e9), cj.frictions.RegularisedCoulomb(0.2)
    sizes = {"bearing_radius": 10e-3, "clearance": 50e-6, "journal_length": 20e-3, "law": law}
    dry, film = cj.ClearanceJoint("ground", "rod", **sizes), cj.films.CaponeFilm(0.02)
    rubbing = replace(dry, friction=friction)
    faces = replace(dry, axial=cj.EndPlay(1e-4, law, friction, radius=8e-3))
    joints = {
        "bare": dry,
        "wall": cj.LubricatedJoint(rubbing, film),
        "faces": faces,
        "faces with film": cj.LubricatedJoint(faces, film),
        "line": replace(rubbing, line_points=3),
        "line with film": cj.LubricatedJoint(replace(rubbing, line_points=3), film),
    }
    scene = cj.Scene({"rod": cj.Body(1.0, (1e-3, 1e-3, 1e-3))}, joints)
    cells = {name: rest for name, _, _, *rest in joint_rows(scene, 9)}
    assert cells.pop("bare") == ["50 µm", "LankaraniNikravesh, c 0.7", "none"]
    for name, rest in cells.items():
        assert rest == ["50 µm", "LankaraniNikravesh, c 0.7", "RegularisedCoulomb, µ 0.2"], name

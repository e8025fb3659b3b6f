"""Legibility of figures: smooth paths, suitable scales, no hidden curves."""

import dataclasses
from itertools import product

import equinox as eqx
import matplotlib.pyplot as plt
import numpy as np
import pytest
import xarray as xr
from matplotlib.text import Annotation
from scipy.spatial.transform import Rotation

import clearjoint as cj
from clearjoint import plot
from clearjoint.plot.report_page import impact_rows
from tests.plot.test_pictures import CODES, record, seen_contact
from tests.support.drawn_axes import labels, legend
from tests.support.observations import observation_of
from tests.support.tumbling_bearing import CLEARANCE, TIMES, solution_of


def thrown(times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities of a body in free flight, which spins about z at 30 rad/s."""
    start, gravity = np.array([1.0, 2.0, 3.0]), np.array([0.0, -9.81, 0.0])
    t = times[:, None]
    velocity = start + gravity * t
    return start * t + 0.5 * gravity * t**2, velocity


def flight(times: np.ndarray) -> cj.State:
    position, velocity = thrown(times)
    spin = np.tile((0.0, 0.0, 30.0), (len(times), 1))
    turn = Rotation.from_rotvec(spin * times[:, None]).as_quat(scalar_first=True)
    turn[1::2] *= -1.0  # the same rotations
    return cj.State({"ball": cj.BodyState(position, turn, velocity, spin)})


def test_free_flight_inside_a_step_is_a_parabola_and_spins_on():
    ends = np.array([0.0, 0.01, 0.013, 0.013, 0.04])
    steps = cj.results.Trajectory(ends, flight(ends))
    wanted = np.linspace(0.0, 0.04, 37)
    found = steps.between(wanted).states.bodies["ball"]
    exact = flight(wanted).bodies["ball"]
    np.testing.assert_allclose(found.position, exact.position, rtol=0.0, atol=1e-15)
    np.testing.assert_allclose(found.velocity, exact.velocity, rtol=0.0, atol=1e-13)
    np.testing.assert_allclose(np.linalg.norm(found.orientation, axis=1), 1.0, rtol=1e-14)
    turned = np.abs(np.sum(found.orientation * exact.orientation, axis=1))
    angle = 2.0 * np.arccos(np.minimum(turned, 1.0))
    assert angle.max() < 2e-4  # of 0.81 rad in the longest step
    np.testing.assert_allclose(found.spin, exact.spin, atol=0.02)
    at_ends = steps.between(ends).states.bodies["ball"]
    np.testing.assert_array_equal(at_ends.position, steps.states.bodies["ball"].position)
    with pytest.raises(ValueError, match="`times` must be between"):
        steps.between([0.0, 0.05])
    with pytest.raises(ValueError, match="two states of the trajectory or more"):
        cj.results.Trajectory(ends[:1], flight(ends[:1])).between()


def test_steps_are_divided_where_bodies_move_in_curves():
    ends = np.array([0.0, 0.02, 0.02 + 1e-5, 0.02 + 2e-5])
    dense = cj.results.Trajectory(ends, flight(ends)).between()
    assert set(ends) <= set(dense.times.tolist())
    np.testing.assert_array_equal(dense.interpolated, ~np.isin(dense.times, ends))
    assert np.diff(dense.times).max() <= 0.05 / 30.0 * (1.0 + 1e-9)
    assert len(dense) == 12 + 4 + 3  # 16 parts by the bend, and the short steps as they are


def in_flight(tumbling, times) -> cj.results.Trajectory:
    """The journal thrown in a bearing at rest, from its middle to the wall."""
    first = tumbling.solution.saved.states.bodies["bearing"].orientation[0]
    still = np.zeros((len(times), 3))
    bearing = cj.BodyState(still, np.tile(first, (len(times), 1)), still, still)
    velocity, bend = 20e-3 * SIDEWAYS, -4.0 * np.cross(AXIS, SIDEWAYS)
    t = times[:, None]
    centre = np.array([0.2, -0.1, 0.3]) + velocity * t + 0.5 * bend * t**2
    journal = cj.BodyState(centre, bearing.orientation, velocity + bend * t, still)
    return cj.results.Trajectory(times, cj.State({"bearing": bearing, "journal": journal}))


AXIS = np.array([1.0, 2.0, 2.0]) / 3.0
SIDEWAYS = np.cross(AXIS, (0.0, 0.0, 1.0)) / np.linalg.norm(np.cross(AXIS, (0.0, 0.0, 1.0)))


@pytest.mark.slow
def test_a_report_draws_a_flight_between_two_steps_as_a_curve(tumbling):
    times = np.array([0.0, 0.01])
    steps = in_flight(tumbling, times)
    solution = dataclasses.replace(solution_of(steps), steps=steps)
    page = plot.report(tumbling.scene, solution)
    orbit = next(axes for axes in page.findobj(plt.Axes) if axes.get_title() == "pin: orbit")
    x, y = orbit.get_lines()[0].get_data()
    drawn = x + 1j * y
    t = np.linspace(0.0, 0.01, 101)
    exact = 1e3 * (20e-3 * t - 0.5j * 4.0 * t**2)
    exact = exact * (drawn[-1] / exact[-1])  # the picture's axes are turned
    between = np.interp(t, times[-1] * np.linspace(0.0, 1.0, len(drawn)), drawn)
    assert np.abs(between - exact).max() < 2e-3 * 1e3 * CLEARANCE
    assert orbit.get_legend_handles_labels()[1][0] == "bases V and W"


def alike(seen: cj.results.Observation) -> cj.results.Observation:
    """Both bases move as base V does."""
    return eqx.tree_at(lambda s: s.contacts["pin"]["W"], seen, seen.contacts["pin"]["V"])


DEPTHS = 1e-6 * np.array([1.0, 2.0, 3.0, 2.0, 1.5])


def test_bases_that_move_alike_share_a_curve():
    seen = alike(seen_contact(DEPTHS, np.zeros(5), 1e6 * DEPTHS))
    for draw in (plot.journal_orbit, plot.eccentricities, plot.contact_forces):
        names = legend(draw(seen, "pin"))
        assert names[0] == "bases V and W" and "base W" not in names
    rose = plot.contact_rose(seen, "pin")
    (bars,) = rose.containers
    assert bars.get_label() == "bases V and W"
    total = 2.0 * np.trapezoid(1e6 * DEPTHS, seen.times)
    assert sum(bar.get_height() for bar in bars) == pytest.approx(1e3 * total)
    (bars,) = plot.contact_rose(seen, "pin", weight="force").containers
    assert max(bar.get_height() for bar in bars) == pytest.approx(3.0)


def test_without_contact_no_bar_is_seen():
    axes = plot.contact_rose(seen_contact(-DEPTHS, np.zeros(5), 0.0 * DEPTHS), "pin")
    assert axes.get_ylim() == (0.0, 1.0)  # bars of no length lie in the centre


def test_a_journal_at_the_wall_shows_its_penetration():
    seen = alike(seen_contact(DEPTHS, np.zeros(5), 1e6 * DEPTHS))
    axes = plot.eccentricities(seen, "pin")
    assert labels(axes)[1] == "eccentricity − clearance, µm"
    np.testing.assert_allclose(axes.get_lines()[0].get_ydata(), 1e6 * DEPTHS, rtol=1e-6)
    assert axes.get_ylim()[1] < 4.0
    flying = plot.eccentricities(seen_contact(DEPTHS, np.zeros(5), DEPTHS), "pin")
    assert labels(flying)[1] == "eccentricity, mm"


@pytest.mark.parametrize(
    ("large", "small", "scale"),
    [
        (1000.0, [0.0, 10.0, 0.0, 9.0, 0.0, 11.0, 0.0, 10.0, 0.0], "log"),
        (12.0, [0.0, 10.0, 0.0, 9.0, 0.0, 11.0, 0.0, 10.0, 0.0], "linear"),
        (500.0, [2.0] * 20, "log"),
        (1000.0, [100.0] * 20, "log"),
    ],
    ids=["impacts", "impacts alike", "lying", "lying at a tenth"],
)
def test_small_forces_are_visible_after_a_large_one(large, small, scale):
    force = np.array([0.0, large, *small])
    seen = seen_contact(1e-7 * force - 1e-9, np.zeros(len(force)), force)
    axes = plot.contact_forces(seen, "pin")
    assert axes.get_yscale() == scale
    low, high = axes.get_ylim()
    least = force[force > 0.0].min()
    assert low < least and high > large
    share = axes.transAxes.inverted().transform(axes.transData.transform((0.0, least)))[1]
    assert share > 0.15
    assert plot.contact_forces(seen, "pin", logarithmic=False).get_yscale() == "linear"
    assert plot.joint_forces(seen, logarithmic=True).get_yscale() == "log"


def test_simultaneous_impacts_of_both_bases_share_a_row():
    row = (0.01, 0.0101, 1e-4, 0.1, 0.09, 100.0, 0.0, 1e-6)
    first = (0.02, 0.0201, 1e-4, 0.1, 0.09, 90.0, 0.0, 1e-6)
    harder = (0.02003, 0.0201, 0.7e-4, 0.1, 0.09, 95.0, 0.0, 1e-6)
    later = (0.02012, 0.0203, 1.8e-4, 0.1, 0.09, 80.0, 0.0, 1e-6)
    rows = [("pin", "W", *row), ("pin", "V", *row), ("pin", "V", *first), ("pin", "W", *harder)]
    rows += [("other", "V", *row), ("pin", "V", *later)]
    found = impact_rows(cj.results.Impacts.of_rows(rows), 8)
    assert sorted(found[0][:2] + found[1][:2]) == ["V", "V and W", "other", "pin"]
    assert [(*cells[:2], cells[6]) for cells in found[2:]] == [
        ("pin", "V and W", "95.0"),
        ("pin", "V", "80.0"),
    ]


def crossed(unit: str = "m") -> cj.results.Crossings:
    values = {"x": CLEARANCE * np.cos(TIMES), "y": CLEARANCE * np.sin(TIMES)}
    return cj.results.Crossings(TIMES, values, dict.fromkeys("xy", unit))


def test_a_section_has_equal_scales_circle_colour_bar_and_no_transient():
    crossings = crossed()
    axes = plot.poincare_section(crossings, clearance=CLEARANCE, after=0.03)
    assert labels(axes) == ("x, µm", "y, µm") and axes.get_aspect() == 1.0
    np.testing.assert_allclose(np.hypot(*axes.get_lines()[0].get_data()), 1e6 * CLEARANCE)
    kept = TIMES >= 0.03
    heights = axes.collections[0].get_offsets()[:, 1]
    np.testing.assert_allclose(heights, 1e6 * CLEARANCE * np.sin(TIMES[kept]))
    bar = next(other for other in axes.figure.axes if other is not axes)
    assert bar.get_ylabel() == "number of the crossing"
    np.testing.assert_array_equal(axes.collections[0].get_array(), 1 + np.flatnonzero(kept))
    assert axes.get_title(loc="right") == f"{kept.sum()} of {len(TIMES)} crossings, from 0.03 s on"
    assert plot.poincare_section(crossings).get_aspect() == 1.0
    with pytest.raises(ValueError, match="`after` must be at most that of the last crossing"):
        plot.poincare_section(crossings, after=1.0)
    with pytest.raises(ValueError, match="`clearance` must be None for channels"):
        plot.poincare_section(crossed("m/s"), clearance=CLEARANCE)


def test_a_spectrum_ends_at_half_the_sampling_rate_with_its_tick():
    axes = plot.spectrum_of(record(1.0, 20, count=3001, end=0.3001))
    assert axes.get_xlim() == (0.0, 5.0)
    assert 5.0 in axes.get_xticks()
    long = record(1.0, 20).rename("velocity of the second rocker of the left mechanism y")
    axes = plot.spectrum_of(long)
    assert "\n" in axes.get_ylabel()
    axes.figure.canvas.draw()
    box = axes.yaxis.label.get_window_extent()
    assert box.y0 >= 0.0 and box.y1 <= axes.figure.bbox.height


@pytest.mark.parametrize(
    ("values", "scale"),
    [(np.geomspace(1e-4, 4e-4, 5), "log"), (np.linspace(1e-4, 4e-4, 5), "linear")],
)
def test_geometric_axes_of_sweeps_are_logarithmic(values, scale):
    results = {
        "result": ("clearance", np.zeros(5, "int8"), CODES),
        "force": ("clearance", np.geomspace(1.0, 4.0, 5), {"units": "N"}),
    }
    data = xr.Dataset(results, {"clearance": ("clearance", values, {"units": "m"})})
    axes = plot.against(data, "force")
    assert (axes.get_xscale(), axes.get_yscale()) == (scale, "linear")
    axes.figure.canvas.draw()
    shown = [tick for tick in axes.get_xticks() if 100.0 <= tick <= 400.0]
    assert len(shown) >= 3
    wide = xr.concat([data, data], dim="e").assign_coords(e=[0.1, 0.2])
    assert plot.parameter_map(wide, "force", "clearance", "e").get_xscale() == scale


def boxes_of_texts(page):
    """The boxes of all visible texts of a page, in pixels."""
    page.draw_without_rendering()
    texts = [text for text in page.findobj(plt.Text) if text.get_visible() and text.get_text()]
    return {text: text.get_window_extent() for text in texts if text.figure is not None}


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_no_text_of_a_report_is_cut_off_or_on_another(seed):
    """Many joints with long names and laws, in a random order."""
    random = np.random.default_rng(seed)
    law = cj.laws.Hertz(1e9)
    rubbing = cj.frictions.RegularisedCoulomb(0.2)
    places = product(("pin", "foot"), ("left", "upper right"), range(3))
    names = [f"{kind} of the {side} rocker {k}" for kind, side, k in places]
    random.shuffle(names)
    bodies = {f"link {name}": cj.Body(1.0, (1e-3, 1e-3, 1e-3)) for name in names}
    joints = {}
    for k, (name, body) in enumerate(zip(names, bodies, strict=True)):
        sizes = {"bearing_radius": 10e-3, "clearance": 1e-4, "journal_length": 20e-3}
        played = cj.ClearanceJoint("ground", body, **sizes, law=law, friction=rubbing)
        joints[name] = played if k < 4 else cj.FixedJoint("ground", body, (0, 0, 0), (0, 0, 0))
    scene = cj.Scene(bodies, joints)
    times = np.linspace(0.0, 0.05, 30)
    swing = 5e-5 * np.stack([np.sin(300 * times), np.cos(200 * times), 0 * times], 1)
    still, turn = np.zeros_like(swing), np.tile((1.0, 0.0, 0.0, 0.0), (len(times), 1))
    states = cj.State({body: cj.BodyState(swing, turn, still, still) for body in bodies})
    impact = 0.01, 0.0101, 1e-4, 0.1, 0.09, 1234.5, 0.0, 1e-6
    rows = [(name, "V", *impact) for name in names[:4]]
    motion = cj.results.Trajectory(times, states)
    page = plot.report(scene, solution_of(motion, cj.results.Impacts.of_rows(rows)))
    boxes = boxes_of_texts(page)
    written = " ".join(text.get_text().replace("\n", " ") for text in boxes)
    # Each word of the table is there; long names are broken into lines.
    assert all(word in written for name in names for word in (name, *name.split()))
    of_axes = [axis.label for a in page.findobj(plt.Axes) for axis in (a.xaxis, a.yaxis)]
    names_of_axes = {label: boxes[label] for label in of_axes if label in boxes}
    cells = {text: box for text, box in boxes.items() if isinstance(text, Annotation)}
    for family in (names_of_axes, cells):
        drawn = list(family.items())
        for k, (text, box) in enumerate(drawn):
            assert box.x0 >= 0.0 and box.x1 <= page.bbox.width, text
            clash = [str(other) for other, its in drawn[:k] if box.shrunk(0.98, 0.9).overlaps(its)]
            assert clash == [], (str(text), clash)


@pytest.mark.parametrize("draw", [plot.journal_orbit, plot.eccentricities, plot.contact_forces])
def test_a_title_is_above_the_legend(draw):
    axes = draw(seen_contact(DEPTHS, np.zeros(5), 1e6 * DEPTHS), "pin")
    axes.set_title("title")
    axes.figure.draw_without_rendering()
    title, legend = axes.title.get_window_extent(), axes.get_legend().get_window_extent()
    assert legend.y1 <= title.y0 + 1.0 and title.y1 <= axes.figure.bbox.height


def test_the_drift_between_steps_is_that_at_their_ends():
    """A step of 0.1 s in which the work of a drive grows by a square, but the ledger by a line."""
    times = np.linspace(0.0, 0.2, 21)
    energies = {"kinetic": times**2, "mechanical": times**2, "supplied": 0.2 * times}
    inside = ~np.isin(np.arange(21), (0, 20))
    seen = observation_of(times, energies=energies, interpolated=inside)
    assert np.abs(seen.ledger_residual()).max() < 1e-15

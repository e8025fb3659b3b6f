"""Figures of motion, contact forces and orbits of artificial states."""

import equinox as eqx
import numpy as np
import pytest
import xarray as xr

from clearjoint import plot
from clearjoint.quantities import Position
from tests.support.tumbling_bearing import AXIS, CLEARANCE, COUNT, TIMES

WINDOW = (0.01, 0.03)
AROUND = slice(9, 31)
"""Instants in the window, and one on each side."""


def test_the_orbit_in_a_moving_bearing_is_relative_to_the_bearing(turning):
    seen, _, rotations = turning
    offset = seen.contacts["pin"]["V"].offset
    np.testing.assert_allclose(offset[:, 2], -10e-3, rtol=0.0, atol=1e-12)
    orbit = plot.eccentricity_vectors(seen, "pin", "V")
    np.testing.assert_allclose(orbit, offset[:, :2])
    # In axes of the bearing made by hand, which turn with it, up to a turn about its axis.
    x = np.cross(AXIS, (1.0, 0.0, 0.0)) / np.linalg.norm(np.cross(AXIS, (1.0, 0.0, 0.0)))
    section = {"x": rotations @ x, "y": rotations @ np.cross(AXIS, x)}
    by_hand = plot.eccentricity_vectors(seen, "pin", "V", section) @ (1.0, 1.0j)
    ratio = orbit @ (1.0, 1.0j) / by_hand
    np.testing.assert_allclose(ratio, ratio[0], rtol=1e-9)
    assert abs(ratio[0]) == pytest.approx(1.0)
    angles = np.unwrap(np.angle(orbit @ (1.0, 1.0j)))
    assert abs(angles[-1] - angles[0]) == pytest.approx(2.0 * np.pi * (1 - 1 / COUNT))


def test_only_bases_of_journals_have_an_eccentricity(turning):
    base = turning[0].contacts["pin"]["V"]
    flat = eqx.tree_at(lambda base: (base.offset, base.eccentricity), base, (None, None))
    flat = eqx.tree_at(lambda seen: seen.contacts["pin"]["V"], turning[0], flat)
    with pytest.raises(ValueError, match='`base` must be a base of a journal, but is .*pass "V"'):
        plot.eccentricity_vectors(flat, "pin", "V")


def test_curves_on_the_same_axes_have_different_looks():
    angle = np.linspace(0.0, 1.0, 5)
    axes = plot.style.axes_or_new(None)
    axes.plot(angle, angle, color=np.array((0.5, 0.5, 0.5)))
    for name in "ab":
        plot.over_angle({name: (angle, angle)}, "force, N", axes=axes)
    looks = [(line.get_color(), line.get_linestyle()) for line in axes.get_lines()[1:]]
    assert looks == [(plot.style.BLUE, "-"), (plot.style.VERMILLION, "--")]


@pytest.mark.parametrize("draw", [plot.position, plot.acceleration])
def test_motion_takes_a_window(turning, draw):
    seen, trajectory, _ = turning
    data = {"one": trajectory if draw is plot.position else seen}
    (line,) = draw(data, "bearing", "X", window=WINDOW).get_lines()
    np.testing.assert_allclose(line.axes.get_xlim(), WINDOW)
    np.testing.assert_allclose(line.get_xdata(), TIMES[AROUND])
    if draw is plot.position:
        np.testing.assert_allclose(line.get_ydata(), TIMES[AROUND])
    assert len(draw(data, "bearing").get_lines()[0].get_xdata()) == COUNT


def vectors(observation, section):
    return plot.eccentricity_vectors(observation, "pin", "V", section)


@pytest.mark.parametrize(
    ("record", "taper", "message"),
    [
        (np.ones(5), "hann", "`record` must be an xarray.DataArray .*, but is 'ndarray'"),
        (xr.DataArray(np.ones(5)), "hann", '`record` must be .* with the coordinate "time"'),
        (xr.DataArray([1.0, np.nan, 0.0, 2.0], {"time": range(4)}), "hann", "`record` must be fin"),
        (xr.DataArray(np.ones(4), {"time": range(4)}), "blunt", "taper: .*blunt"),
    ],
)
def test_records_without_a_spectrum_are_refused(record, taper, message):
    with pytest.raises(ValueError, match=message):
        plot.amplitude_spectrum(record, taper)


def test_a_record_without_a_name_has_a_spectrum_of_values():
    record = xr.DataArray(np.sin(np.arange(50.0)), {"time": np.arange(50.0)})
    assert plot.spectrum_of(record).get_ylabel() == "amplitude of values"


def test_a_quantity_keeps_its_unit(tumbling):
    scene, solution, _ = tumbling
    with pytest.raises(ValueError, match="`unit` must be the quantity's own, 'm', but is 'mm'"):
        plot.series(scene, solution, Position("journal", "x"), unit="mm")


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda s, t: plot.contact_forces(s, "pinn"), r"`joint` must be .*\['pin'\], but is 'pin"),
        (lambda s, t: plot.orbit_in_contact(s, "pin", "U", 1e-3), r"`contact` must be .*'V', 'W'"),
        (lambda s, t: plot.contact_and_reaction(s, ("pin", "V"), ("elbow", "arm")), "`joint` must"),
        (lambda s, t: plot.position({"": t}, "bearing", "x"), "`component` must be one of .*'x'"),
        (lambda s, t: plot.path({"": t}, "bearing", ("X", "U")), "`component` must be one of"),
        (lambda s, t: plot.position({"": t}, "arm"), r"`body` must be .*\['bearing', 'journal'\]"),
        (lambda s, t: plot.acceleration({"": s}, "arm"), r"`body` must be one of those observed"),
        (
            lambda s, t: plot.journal_orbit(s, "pin", -1.0),
            "`clearance` must be positive, but is -1",
        ),
        (lambda s, t: plot.clearance_circle(None, 0.0), "`clearance` must be positive, but is 0.0"),
        (
            lambda s, t: plot.journal_frames(s, "pin", 1e-3, []),
            "`instants` must be a row of finite",
        ),
        (lambda s, t: plot.journal_frames(s, "pin", 1e-3, [np.nan]), "`instants` must be a row of"),
        (lambda s, t: plot.journal_frames(s, "pin", 0.0, [0.0]), "`clearance` must be positive"),
        (lambda s, t: plot.journal_frames(s, "pin", 1e-3, [0.0], columns=0), "`columns` must be a"),
        (lambda s, t: plot.animate_journal(s, "pin", 1e-3, "a.mp4", [0.0]), "`file` must be with"),
        (
            lambda s, t: vectors(s, {"X": (2, 0, 0), "Y": (0, 1, 0)}),
            "`section` must be two perpend",
        ),
        (
            lambda s, t: vectors(s, {"X": (1, 0, 0), "Y": (0.6, 0.8, 0)}),
            "`section` must be two per",
        ),
        (lambda s, t: vectors(s, {"X": (1, 0, 0)}), "`section` must be two perpendicular unit"),
    ],
)
def test_wrong_names_are_refused(turning, call, message):
    with pytest.raises(ValueError, match=message):
        call(*turning[:2])


def test_frames_show_the_journal_at_the_nearest_instants(turning):
    """Base V above base W, further instants below both; the journal is as far off as it has been,
    over the clearance, and dark while it touches."""
    seen, _, _ = turning
    instants = TIMES[[3, 20, 41]] + 1e-5
    figure = plot.journal_frames(seen, "pin", CLEARANCE, instants, columns=2)
    grid = np.array(figure.axes).reshape(4, 2)
    titles = [axes.get_title() for axes in (*grid[0], grid[2, 0])]
    assert titles == [f"{time * 1e3:.1f} ms" for time in TIMES[[3, 20, 41]]]
    gap = {}
    for base, row in (("V", 0), ("W", 1)):
        offsets = plot.eccentricity_vectors(seen, "pin", base)[[3, 20, 41]] / CLEARANCE
        journals = [axes.patches[-1] for axes in (*grid[row], grid[row + 2, 0])]
        gap[base] = np.array([journal.center for journal in journals]) / offsets
        touching = seen.contacts["pin"][base].penetration[[3, 20, 41]] > 0.0
        light = np.array([sum(journal.get_facecolor()[:3]) for journal in journals])
        assert touching.any() and light[touching].max() < light[~touching].min()
    np.testing.assert_allclose(gap["V"], gap["V"][0, 0], rtol=1e-9)
    np.testing.assert_allclose(gap["W"], gap["V"][0, 0], rtol=1e-9)

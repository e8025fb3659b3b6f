"""Figures of sweeps: names, units, scales, and failed lanes of an artificial data set."""

import numpy as np
import pytest
import xarray as xr
from matplotlib.colors import LogNorm

from clearjoint import plot
from tests.support.drawn_axes import labels, legend

CODES = {"flag_values": [-1, 0, 1], "flag_meanings": "pending successful max_steps_reached"}
CLEARANCES = np.geomspace(5e-5, 1e-3, 9)
RESTITUTIONS = np.linspace(0.2, 1.0, 5)


def dataset() -> xr.Dataset:
    """Forces that grow with the clearance to 0.4; lane (2, 1) failed and (5, 3) is pending."""
    shape = (9, 5)
    result = np.zeros(shape, dtype="int8")
    result[2, 1], result[5, 3] = 1, -1
    force = 5e3 * CLEARANCES[:, None] ** 0.4 * (1.0 + RESTITUTIONS)
    hits = np.broadcast_to(CLEARANCES[:, None, None], (*shape, 4)) * np.arange(1, 5)
    dims = ("clearance", "restitution")
    angle = np.linspace(0, 2 * np.pi, 50)
    path = 0.8 * CLEARANCES[:, None, None] * np.ones((9, 5, 1))
    return xr.Dataset(
        {
            "result": (dims, result, CODES),
            "peak_force": (dims, force, {"units": "N"}),
            "impacts": (dims, np.full(shape, 7), {"units": "1"}),
            "hit_speed": ((*dims, "hit_number"), hits, {"units": "m/s"}),
            "saved_time": ((*dims, "saved_number"), np.ones((9, 5, 1)) * angle, {"units": "s"}),
            "orbit_x": ((*dims, "saved_number"), path * np.cos(angle), {"units": "m"}),
            "orbit_y": ((*dims, "saved_number"), path * np.sin(angle), {"units": "m"}),
        },
        {
            "clearance": ("clearance", CLEARANCES, {"units": "m"}),
            "restitution": ("restitution", RESTITUTIONS, {"units": "1"}),
        },
    )


def failing() -> xr.Dataset:
    return dataset().isel(restitution=1)


def test_against_has_units_points_and_crosses():
    axes = plot.against(failing(), "peak_force")
    assert labels(axes) == ("clearance, mm", "peak force, N")
    assert axes.get_xscale() == "log" and axes.get_yscale() == "linear"
    points, crosses = axes.get_lines()
    x, y = points.get_data()
    assert np.isnan(y[2]) and np.isfinite(np.delete(y, 2)).all()
    assert x[0] == pytest.approx(0.05) and y[0] == pytest.approx(5e3 * 5e-5**0.4 * 1.4)
    assert crosses.get_xdata() == pytest.approx(CLEARANCES[[2]] * 1e3)
    assert legend(axes) == ["peak force, restitution 0.4", "failed or pending: 1"]
    assert crosses.get_color() == points.get_color()


def test_four_outputs_in_one_axes_differ_in_colour_and_label():
    data, axes = dataset().drop_sel(clearance=CLEARANCES[[2, 5]]), None
    for restitution in RESTITUTIONS[:4]:
        axes = plot.against(data.sel(restitution=restitution), "peak_force", axes=axes)
    assert len({line.get_color() for line in axes.get_lines()}) == 4
    expected = [f"peak force, restitution {r:.4g}" for r in RESTITUTIONS[:4]]
    assert legend(axes) == expected
    assert labels(axes) == ("clearance, mm", "peak force, N")
    plot.against(data.isel(restitution=4), "peak_force", label="last", colour="k", axes=axes)
    assert legend(axes)[-1] == "last" and axes.get_lines()[-1].get_color() == "k"


def test_further_outputs_keep_the_units_of_the_axes():
    data = failing()
    data["mean_force"] = (1e4 * data["peak_force"]).assign_attrs(units="N")
    data["energy"] = data["peak_force"].assign_attrs(units="J")
    axes = plot.against(data, "peak_force")
    plot.against(data, "mean_force", axes=axes)
    assert labels(axes) == ("clearance, mm", "peak force, mean force, N")
    drawn = [line.get_ydata()[0] for line in axes.get_lines() if line.get_marker() == "o"]
    assert drawn[1] == pytest.approx(1e4 * drawn[0])
    with pytest.raises(ValueError, match="the unit of 'peak force, mean force, N', but is 'J'"):
        plot.against(data, "energy", axes=axes)
    with pytest.raises(ValueError, match="axes of data in 1, but is 'peak force, mean force, N'"):
        plot.against(data, "impacts", axes=axes)
    two = plot.convergence(data, "peak_force")
    plot.convergence(data, "mean_force", axes=two)
    assert len({line.get_color() for line in two.get_lines()}) == 2


@pytest.mark.parametrize("unit", ["kg", "m^2", "1/s", "N m/rad"])
def test_numbers_and_data_with_any_unit_share_no_axes(unit):
    data = failing().rename(impacts="N")  # a name like a unit
    data["load"] = data["peak_force"].assign_attrs(units=unit)
    for first, second in (("load", "N"), ("N", "load"), ("N", "peak_force")):
        axes = plot.against(data, first)
        with pytest.raises(ValueError, match="draw it into new axes"):
            plot.against(data, second, axes=axes)
        assert len(plot.against(data, first, axes=axes).get_lines()) == 4


def test_the_law_of_lanes_that_have_a_logarithm_is_seen():
    data = failing().assign_coords(clearance=("clearance", [-1.0, 0.0, 1, 2, 3, 4, 5, 6, 7]))
    line = plot.convergence(data, "peak_force").get_lines()[1]
    assert np.isfinite(line.get_ydata()).all() and line.get_xdata() == pytest.approx([2.0, 7.0])


def test_a_logarithm_ends_where_values_are_negative():
    data = failing()
    data["force"] = (data["peak_force"] ** 4).assign_attrs(units="N")
    data["change"] = (-data["peak_force"]).assign_attrs(units="N")
    axes = plot.against(data, "force")
    assert axes.get_yscale() == "log"
    assert plot.against(data, "change", axes=axes).get_yscale() == "linear"


def test_against_another_axis_takes_a_plain_number():
    axes = plot.against(dataset().isel(clearance=0), "impacts")
    assert labels(axes) == ("restitution", "impacts")
    assert axes.get_xscale() == "linear"
    assert axes.get_legend() is None


def test_large_and_small_units():
    data = failing()
    data["peak_force"] = (data["peak_force"] * 100).assign_attrs(units="N")
    data["energy"] = (data["peak_force"] * 1e-9).assign_attrs(units="J")
    data["acceleration"] = data["peak_force"].assign_attrs(units="m/s^2")
    names = "peak_force", "energy", "acceleration"
    found = [labels(plot.against(data, name))[1] for name in names]
    assert found == ["peak force, kN", "energy, µJ", "acceleration, m/s²"]


def test_against_a_zipped_sweep():
    data = failing().rename_dims(clearance="lane").reset_index("clearance").reset_coords()
    data = data.set_coords("clearance")
    drawn = plot.against(data, "peak_force", "clearance")
    assert labels(drawn) == ("clearance, mm", "peak force, N")
    with pytest.raises(ValueError, match="axis"):
        plot.against(data, "peak_force")


def test_selected_texts_are_in_the_legend():
    data = failing().assign_coords(body="the_$ball$", component="x")
    axes = plot.against(data, "peak_force")
    expected = r"peak force, restitution 0.4, body the_\$ball\$, component x"
    assert legend(axes)[0] == expected


def test_running_median_omits_gaps():
    positions = np.array([4.0, 1.0, 2.0, 3.0, 5.0])
    values = np.array([40.0, 10.0, np.nan, 90.0, 50.0])
    middle, height = plot.running_median(positions, values, 3)
    assert middle.tolist() == [3.0, 4.0]
    assert height.tolist() == [40.0, 50.0]
    with pytest.raises(ValueError, match="width"):
        plot.running_median(positions, values, 5)


def test_map_shows_units_and_failures():
    axes = plot.parameter_map(dataset(), "peak_force", "clearance", "restitution")
    assert labels(axes) == ("clearance, mm", "restitution")
    (mesh,) = axes.collections
    assert mesh.colorbar.ax.get_ylabel() == "peak force, N"
    drawn = mesh.get_array()
    assert drawn.shape == (5, 9)
    assert np.argwhere(np.ma.getmaskarray(drawn)).tolist() == [[1, 2], [3, 5]]
    assert axes.patch.get_hatch() == "////"
    assert legend(axes) == ["failed or pending: 2"]


def test_map_takes_logarithmic_colours_over_decades():
    data = dataset()
    data["peak_force"] = (data["peak_force"] ** 4).assign_attrs(units="N")
    axes = plot.parameter_map(data, "peak_force", "clearance", "restitution")
    assert isinstance(axes.collections[0].norm, LogNorm)


def test_map_takes_lanes_in_any_order_and_cells_lie_around_their_values():
    data = dataset()
    data["peak_force"][4, 4] = np.inf
    mixed = data.isel(clearance=[3, 0, 8, 1, 7, 2, 5, 6, 4], restitution=[4, 1, 0, 3, 2])
    axes = plot.parameter_map(mixed, "peak_force", "clearance", "restitution")
    ordered = plot.parameter_map(data, "peak_force", "clearance", "restitution")
    (mesh,), (other,) = axes.collections, ordered.collections
    np.testing.assert_array_equal(mesh.get_coordinates(), other.get_coordinates())
    np.testing.assert_array_equal(mesh.get_array().filled(-1.0), other.get_array().filled(-1.0))
    assert legend(axes) == ["failed or pending: 3"]
    x, y = np.asarray(mesh.get_coordinates())[0, :, 0], np.asarray(mesh.get_coordinates())[:, 0, 1]
    assert axes.get_xscale() == "log" and axes.get_yscale() == "linear"
    assert np.sqrt(x[1:] * x[:-1]) == pytest.approx(1e3 * CLEARANCES)
    assert (y[1:] + y[:-1]) / 2.0 == pytest.approx(RESTITUTIONS)


def test_map_of_a_single_value_has_visible_cells():
    for lanes in ({"clearance": [0]}, {"restitution": [0]}, {"clearance": [0], "restitution": [0]}):
        data = dataset().isel(lanes)
        (mesh,) = plot.parameter_map(data, "peak_force", "clearance", "restitution").collections
        x, y = mesh.get_coordinates()[0, :, 0], mesh.get_coordinates()[:, 0, 1]
        assert (np.diff(x) > 0.0).all() and (np.diff(y) > 0.0).all()


def test_bifurcation_has_a_dot_for_each_crossing():
    axes = plot.bifurcation(failing(), "hit", "speed")
    assert labels(axes) == ("clearance, mm", "speed, mm/s")
    (dots,) = axes.collections
    assert len(dots.get_offsets().compressed()) == 2 * 4 * 8
    assert legend(axes) == ["failed or pending: 1"]


def test_bifurcation_shows_the_number_of_the_crossing():
    axes = plot.bifurcation(dataset().isel(restitution=0), "hit", "speed", number=True)
    (dots,) = axes.collections
    assert sorted(set(dots.get_array().tolist())) == [1, 2, 3, 4]
    assert dots.colorbar.ax.get_ylabel() == "number of the crossing"


def test_bifurcation_without_crossings_is_empty():
    data = dataset().isel(restitution=0)
    none = data.assign(hit_speed=data["hit_speed"] * np.nan)
    (dots,) = plot.bifurcation(none, "hit", "speed", number=True).collections
    assert len(dots.get_offsets().compressed()) == 0
    dots.figure.draw_without_rendering()


def test_convergence_finds_the_rate():
    axes = plot.convergence(failing(), "peak_force", within=(1e-4, 1e-3))
    assert axes.get_xscale() == axes.get_yscale() == "log"
    assert "rate 0.40" in legend(axes)
    points, line, crosses = axes.get_lines()
    assert line.get_xdata()[0] >= 0.1
    expected = 5e3 * (line.get_xdata() * 1e-3) ** 0.4 * 1.4
    assert line.get_ydata() == pytest.approx(expected)
    assert plot.power_law_exponent(failing(), "peak_force") == pytest.approx(0.4)
    for find in (plot.convergence, plot.power_law_exponent):
        with pytest.raises(ValueError, match="`within` must be an interval with swept values"):
            find(failing(), "peak_force", within=(2.0, 3.0))


def test_orbit_lies_in_the_clearance_circle():
    lane = dataset().isel(clearance=8, restitution=0)
    axes = plot.orbit(lane, ("orbit_x", "orbit_y"), 1e-3, window=(0.0, np.pi))
    assert labels(axes) == ("orbit_x, mm", "orbit_y, mm")
    path, start, circle = axes.get_lines()
    assert np.hypot(*path.get_data()) == pytest.approx(0.8)
    assert (path.get_ydata() > -1e-12).all()
    assert start.get_data() == (pytest.approx([0.8]), pytest.approx([0.0]))
    assert np.hypot(*circle.get_data()) == pytest.approx(1.0)
    assert axes.get_aspect() == 1.0


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda data: plot.against(data, "peak_force"), "name it"),
        (lambda data: plot.against(data, "peak_force", "clearance"), "select along"),
        (lambda data: plot.against(data.isel(restitution=0), "force"), "force"),
        (lambda data: plot.against(data, "peak_force", "speed"), r"\['speed'\]"),
        (lambda data: plot.against(data.isel(clearance=0), "impacts", "clearance"), "value left"),
        (
            lambda data: plot.bifurcation(data.isel(clearance=0), "hit", "speed", "clearance"),
            r"`axis` must be .* value left, but is \['clearance'\]",
        ),
        (lambda data: plot.power_law_exponent(data, "peak_force", "speed"), r"\['speed'\]"),
        (lambda data: plot.parameter_map(data, "peak_force", "speed", "mass"), "'mass', 'speed'"),
        (lambda data: plot.orbit(data, ("orbit_x", "orbit_y"), 1e-3), "a single lane"),
        (lambda data: plot.orbit(data.isel(restitution=0), ("path_x", "y"), 1e-3), "path_x"),
        (
            lambda data: plot.orbit(
                data.isel(clearance=0, restitution=0), ("orbit_x", "peak_force"), 1e-3
            ),
            "a single lane, with 'peak_force' over time",
        ),
        (
            lambda data: plot.against(data.isel(restitution=0), "peak_force", median=99),
            "median: .*lower it",
        ),
        (lambda data: plot.running_median([1, 2, 3], [1, 2], 2), "`values` must be of the shape"),
        (lambda data: plot.parameter_map(data, "hit_speed", "clearance", "restitution"), "select"),
    ],
)
def test_errors_list_the_known_names(call, message):
    with pytest.raises(ValueError, match=message):
        call(dataset())

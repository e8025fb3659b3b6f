"""Names with any characters, in all figures and files."""

import dataclasses

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
import xarray as xr
from matplotlib.text import Annotation

import clearjoint as cj
from clearjoint import plot
from tests.plot.test_pictures import CODES
from tests.support.tumbling_bearing import TIMES, solution_of

JOINTS = ("_$x^$ \\frac{1 50% Größe", "$x^$ long\n" * 20)
BODIES = ("$x^$ " + "n" * 200, "_$\\frac{$")
CHANNELS = ("$x^$ 50% _Größe 轴", "$x^$" * 50)
NEWTON = {"units": "N"}


@pytest.fixture(scope="module")
def renamed(tumbling):
    """A journal in two bearings at the same position, and its motion."""
    scene, solution, _ = tumbling
    names = dict(zip(("bearing", "journal"), BODIES, strict=True))
    pin = scene.joints["pin"]
    pin = dataclasses.replace(pin, bearing_body=BODIES[0], journal_body=BODIES[1])
    scene = cj.Scene({names[n]: b for n, b in scene.bodies.items()}, dict.fromkeys(JOINTS, pin))
    states = cj.State({names[n]: s for n, s in solution.saved.states.bodies.items()})
    rows = [
        (name, "V", 0.01 * k, 0.01 * k + 1e-3, 1e-3, 0.1, 0.09, 10.0 * k, 0.0, 1e-6)
        for k, name in enumerate(JOINTS, 1)
    ]
    final = cj.State({name: cj.body_state((0.0, 0.0, 0.0)) for name in BODIES})
    solution = solution_of(cj.results.Trajectory(TIMES, states), cj.results.Impacts.of_rows(rows))
    solution = dataclasses.replace(solution, final=final)
    return scene, solution, cj.observe(scene, solution)


def drawn(figure) -> list[str]:
    """The texts of a drawn figure; invalid mathematics would raise an error."""
    figure.canvas.draw()
    return [text.get_text() for text in figure.findobj(plt.Text)]


@pytest.mark.slow
@pytest.mark.filterwarnings("error:constrained_layout")
def test_a_report_and_its_tables_take_any_name(renamed):
    scene, solution, _ = renamed
    page = plot.report(scene, solution, title="from 5$ ^ $6 \\frac{")
    texts = drawn(page)
    assert any(r"\$x^\$ \frac{1 50%" in text for text in texts)
    width = page.bbox.width
    for cell in page.findobj(Annotation):
        box = cell.get_window_extent()
        assert box.x0 >= 0.0 and box.x1 <= width, cell.get_text()


@pytest.mark.slow
def test_pictures_of_a_run_take_any_name(renamed):
    scene, solution, seen = renamed
    position = cj.quantities.Position(BODIES[0], "x")
    for axes in (
        plot.journal_orbit(seen, JOINTS[0]),
        plot.position({"run": solution.saved}, BODIES[0]),
        plot.acceleration({"run": seen}, BODIES[1]),
        plot.phase_portrait(scene, solution, position),
    ):
        drawn(axes.figure)


@pytest.mark.slow
def test_a_view_takes_any_name(renamed, tmp_path):
    scene, solution, _ = renamed
    view = cj.view(scene, solution, forces=False, frames=2, title="$a^$ \\frac{ 5%")
    assert view.save(tmp_path / "view.png").stat().st_size > 5_000


def test_files_and_prints_take_any_name(renamed, tmp_path):
    _, solution, seen = renamed
    for result in (solution, solution.saved, seen, solution.impacts):
        assert repr(result)
        result.to_csv(tmp_path / "out.csv")
        columns = pd.read_csv(tmp_path / "out.csv", index_col=0).columns.tolist()
        assert columns == result.to_dataframe().columns.tolist()
        result.to_netcdf(tmp_path / "out.nc")
        written = result.to_xarray()
        with xr.open_dataset(tmp_path / "out.nc", engine="scipy") as read:
            for name, variable in written.variables.items():
                if variable.dtype.kind in "OU":
                    assert read[name].values.tolist() == variable.values.tolist()


@pytest.mark.parametrize("name", CHANNELS)
def test_channels_and_sensors_take_any_name(name, tmp_path):
    values = {name: 1e-3 * np.arange(1, 4), "z": 2.0 * np.arange(1, 4)}
    crossings = cj.results.Crossings(TIMES[:3], values, {name: "m", "z": "m/s"})
    drawn(plot.poincare_section(crossings).figure)
    rows = np.ones((len(TIMES), 2))
    found = cj.results.Sensitivities(
        (name, "mass"), TIMES, {name: TIMES}, {name: rows}, 0.1, cj.RESULTS.successful, 2, 1,
        units={name: "m"}, scales=(name, "mass"),
    )  # fmt: skip
    for result in (crossings, found):
        assert repr(result)
        result.to_csv(tmp_path / "out.csv")
        assert name in pd.read_csv(tmp_path / "out.csv").columns[1]
        result.to_netcdf(tmp_path / "out.nc")
        with xr.open_dataset(tmp_path / "out.nc", engine="scipy") as read:
            names = {str(n): str(v.attrs.get("original_name", n)) for n, v in read.items()}
            assert name in names.values()
            key = next(key for key, original in names.items() if original == name)
            np.testing.assert_array_equal(read[key].values, result.to_xarray()[name].values)


def test_a_variable_without_a_name_is_refused(tmp_path):
    with pytest.raises(ValueError, match="`name` must be at least one character"):
        cj.results.Crossings(TIMES[:1], {"": TIMES[:1]}).to_netcdf(tmp_path / "out.nc")


@pytest.mark.slow
def test_pictures_of_a_sweep_and_a_fit_take_any_name():
    numbers = np.arange(1.0, 5.0)
    for name in CHANNELS:
        peak = f"peak {name}"
        results = {"result": (name, np.zeros(4, "int8"), CODES), peak: (name, numbers, NEWTON)}
        data = xr.Dataset(results, {name: (name, numbers, {"units": "m"}), "c, $": 0.5})
        axes = plot.against(data, peak)
        plot.against(data, peak, axes=axes)
        drawn(axes.figure)
        drawn(plot.convergence(data, peak).figure)

    class Found:
        parameters = CHANNELS
        correlation = np.eye(len(CHANNELS))

    drawn(plot.correlations(Found()).figure)

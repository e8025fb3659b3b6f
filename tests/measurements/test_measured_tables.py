"""Measurements from files, and errors for invalid files."""

import gzip
import math

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import clearjoint as cj
from clearjoint import quantities as q

PROBE = cj.Channel(q.JournalOffset("pin", "x"), noise=1.0)
ANGLE = cj.Channel(q.Angle("arm", (0, 0, 1)), noise=0.5)
FILE = """# a rig
t [ms];probe x [µm];angle;state

0;1.5;90;on
1;2,5;91;on
2.5;-0.25;92;off
"""


@pytest.fixture
def written(tmp_path):
    """Writes a text to a file, and returns its path."""

    def write(text, name="rig.csv"):
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return path

    return write


def test_columns_become_series_in_si(written):
    degrees = cj.Channel(ANGLE.quantity, noise=[0.5, 0.5, 1.0], unit="deg")
    path = written(FILE.replace("2,5", "2.5"))
    channels = {"probe x": PROBE, "angle": degrees}
    data = cj.read_csv(path, channels, sep=";", comment="#")
    assert list(data.series) == ["probe x", "angle"]
    for series in data.series.values():
        np.testing.assert_allclose(series.times, [0.0, 1e-3, 2.5e-3], rtol=1e-14)
    np.testing.assert_allclose(data["probe x"].values, [1.5e-6, 2.5e-6, -0.25e-6], rtol=1e-14)
    np.testing.assert_allclose(data["probe x"].noise, 1e-6, rtol=1e-14)
    np.testing.assert_allclose(data["angle"].values, np.deg2rad([90, 91, 92]), rtol=1e-14)
    np.testing.assert_allclose(data["angle"].noise, np.deg2rad([0.5, 0.5, 1.0]), rtol=1e-14)
    assert (data["angle"].unit, data["angle"].name) == ("rad", "angle")


def test_options_reach_pandas_and_noise_may_be_common(written, tmp_path):
    text = "time, p [mm]\n1, 0.1234567890123456789\n2, 3e-2\n"
    path = tmp_path / "rig.csv.gz"
    with gzip.open(path, "wt") as file:
        file.write(text)
    channels = {"p": cj.Channel(PROBE.quantity)}
    data = cj.read_csv(path, channels, time="time", time_unit="h", noise=0.1)
    np.testing.assert_allclose(data["p"].times, [3600.0, 7200.0], rtol=1e-14)
    assert data["p"].values[0] == pytest.approx(0.12345678901234567e-3, rel=1e-14)
    np.testing.assert_allclose(data["p"].noise, 1e-4, rtol=1e-14)
    comma = written("t;p [m]\n0,5;1,25\n1,5;2,5\n")
    data = cj.read_csv(comma, {"p": PROBE}, sep=";", decimal=",")
    np.testing.assert_array_equal(data["p"].values, [1.25, 2.5])
    np.testing.assert_array_equal(data["p"].times, [0.5, 1.5])
    with pytest.warns(pd.errors.ParserWarning, match="Falling back"):
        spaced = cj.read_csv(written("t |  p [m]\n0 |  2\n"), {"p": PROBE}, sep=r" \| +")
    np.testing.assert_array_equal(spaced["p"].values, [2.0])


def test_a_choice_of_columns_keeps_their_names_and_units(written):
    path = written("t,a [deg],p [mm]\n0,90,1\n1,91,2\n")
    data = cj.read_csv(path, {"p": PROBE}, usecols=["t", "p [mm]"], dtype={"p [mm]": float})
    np.testing.assert_allclose(data["p"].values, [1e-3, 2e-3], rtol=1e-14)


GAPS = "t,p [mm],a [deg]\n0,1,\n1,bad,5\n2,3,NaN\n3,4,6\n4,inf,7\n"


def test_missing_samples_are_left_out_of_their_series_alone(written):
    spread = cj.Channel(PROBE.quantity, noise=[1.0, 2.0, 3.0, 4.0, 5.0])
    data = cj.read_csv(written(GAPS), {"p": spread, "a": ANGLE}, missing="drop")
    np.testing.assert_array_equal(data["p"].times, [0.0, 2.0, 3.0])
    np.testing.assert_allclose(data["p"].values, [1e-3, 3e-3, 4e-3], rtol=1e-14)
    np.testing.assert_allclose(data["p"].noise, [1e-3, 3e-3, 4e-3], rtol=1e-14)
    np.testing.assert_array_equal(data["a"].times, [1.0, 3.0, 4.0])


GOOD = "t,p [mm]\n0,1\n1,2\n2,3\n"
BARE = "t,p\n0,1\n1,2\n"


@pytest.mark.parametrize(
    ("text", "channel", "message"),
    [
        (GOOD.replace("2,3", "0.5,3"), PROBE, r"^Row 3 of column 't' of '.*rig.csv' must be later "
         r"than the row before, but is 0\.5: sort"),
        (GOOD.replace("2,3", "1,3"), PROBE, "^Row 3 of column 't' .*but is 1: .*merge repeated"),
        (GOOD.replace("\n1,", "\n,"), PROBE, r"^Row 2 of column 't' .*finite number, but is nan"),
        (GOOD.replace("1,2", "1,"), PROBE, "^Row 2 of column 'p' of '.*rig.csv' must be a finite "
         'number, but is nan: correct it, or pass missing="drop"'),
        (GOOD.replace("1,2", "1,2 mm"), PROBE, "^Row 2 of column 'p' .*but is '2 mm'"),
        (GOOD.replace("p ", "q "), PROBE, r"among the columns of '.*', \['t', 'q'\], but is 'p'"),
        (GOOD.replace("t,", "time,"), PROBE, r"`time` must be among the columns of '.*', \['time'"),
        (BARE, PROBE, r"^The unit of column 'p' of '.*rig.csv' must be known.*`name \[unit\]`"),
        (BARE.replace("p", "p [kg]"), PROBE, "^In column 'p' of '.*rig.csv': .*unit of 'm', but i"),
        (GOOD.replace("t,", "t [kg],"), PROBE, "^In column 't' of '.*rig.csv': .*unit of 's', but"),
        (GOOD, cj.Channel(PROBE.quantity, 1.0, "m"), "`unit of column 'p'.* the channel's 'm', bu"),
        (GOOD, cj.Channel(PROBE.quantity, -1.0), r"^In column 'p' .*`noise of 'p'\[0\]` must be"),
        (GOOD, cj.Channel(PROBE.quantity), r"`noise` must be a standard deviation, but is None"),
        (GOOD.replace("p [mm]", "t [s]"), PROBE, "`time` must be unique in '.*', but is 't'"),
        ("t,p [mm],p [mm]\n0,1,5\n", PROBE, "`channels` must be unique in '.*', but is 'p'"),
        ("t,p [mm]\n0,True\n1,False\n", PROBE, "^Row 1 of column 'p' .* not a truth value"),
        ("t,p [mm]\n0,\n1,True\n", PROBE, "^Row 2 of column 'p' .* not a truth value, but is True"),
        ("", PROBE, "^File '.*rig.csv' must have a header and rows, but is empty"),
        (GOOD, PROBE.quantity, r"`channels\['p'\]` must be a Channel, but is 'JournalOffset'"),
        (GOOD.replace("1,2", "1,0,2,5"), PROBE, r"^File '.*rig.csv' must have as many fields"),
        ("t,p [mm]\n0,5,1,25\n", PROBE, "^File '.*rig.csv' must have .* Pass the `sep`, `decimal`"),
        (GOOD, cj.Channel(PROBE.quantity, [1.0, 2.0]), r"`noise` must be of shape \(3,\), but"),
        ("t,p [mm]\n", PROBE, "In column 'p' of .*`times of 'p'` must be a row of times"),
    ],
)  # fmt: skip
def test_invalid_files_are_refused(written, text, channel, message):
    with pytest.raises(ValueError, match=message):
        cj.read_csv(written(text), {"p": channel})


def test_text_that_is_not_utf8_names_the_file_and_the_remedy(tmp_path):
    path = tmp_path / "rig.csv"
    path.write_bytes("t,p [µm]\n0,1\n".encode("latin-1"))
    with pytest.raises(ValueError, match=r'^File .*rig.csv.* byte 0xb5 .*encoding="latin-1"'):
        cj.read_csv(path, {"p": PROBE})
    data = cj.read_csv(path, {"p": PROBE}, encoding="latin-1")
    np.testing.assert_allclose(data["p"].values, [1e-6], rtol=1e-14)


def test_a_column_twice_is_no_fault_where_it_is_not_read(written):
    text = "# a rig\nt;a [m];p [mm];a [m]\n0;1;2;3\n"
    data = cj.read_csv(written(text), {"p": PROBE}, sep=";", comment="#")
    np.testing.assert_allclose(data["p"].values, [2e-3], rtol=1e-14)
    named = written("0,1\n1,2\n")
    data = cj.read_csv(named, {"p": PROBE}, names=["t", "p [mm]"])
    np.testing.assert_allclose(data["p"].values, [1e-3, 2e-3], rtol=1e-14)


def test_missing_times_and_unknown_choices_are_refused(written):
    with pytest.raises(ValueError, match="^Row 2 of column 't'"):
        cj.read_csv(written(GOOD.replace("\n1,", "\n,")), {"p": PROBE}, missing="drop")
    with pytest.raises(ValueError, match="`missing` must be one of .*'skip'"):
        cj.read_csv(written(GOOD), {"p": PROBE}, missing="skip")  # pyright: ignore


def dataset(**attributes):
    return xr.Dataset(
        {
            "p": ("time", [1.0, 2.0, 3.0], {"units": "mm"}),
            "bare": ("time", [1.0, 2.0, 3.0]),
            "pair": (("time", "side"), np.ones((3, 2)), {"units": "mm"}),
        },
        {"time": ("time", [0.0, 1.0, 2.0], attributes)},
    )


def test_variables_of_a_dataset_become_series():
    data = cj.from_xarray(dataset(units="ms"), {"p": PROBE})
    np.testing.assert_allclose(data["p"].times, [0.0, 1e-3, 2e-3], rtol=1e-14)
    np.testing.assert_allclose(data["p"].values, [1e-3, 2e-3, 3e-3], rtol=1e-14)
    seconds = cj.from_xarray(dataset(), {"bare": cj.Channel(PROBE.quantity, unit="m")}, noise=2.0)
    np.testing.assert_array_equal(seconds["bare"].times, [0.0, 1.0, 2.0])
    np.testing.assert_array_equal(seconds["bare"].noise, 2.0)
    gap = dataset()
    gap["p"][1] = math.nan
    np.testing.assert_array_equal(
        cj.from_xarray(gap, {"p": PROBE}, missing="drop")["p"].times, [0.0, 2.0]
    )


def unsorted():
    return dataset().isel(time=[0, 2, 1])


def gap():
    changed = dataset()
    changed["p"][2] = math.nan
    return changed


@pytest.mark.parametrize(
    ("make", "name", "message"),
    [
        (dataset, "bare", "^The unit of variable 'bare' of the dataset must be known"),
        (dataset, "q", r"among the variables of the dataset, \['p', 'bare', 'pair'\], but is 'q'"),
        (dataset, "pair", r"`channels\['pair'\]` must be of one dimension, .*'side'"),
        (unsorted, "p", "^Row 3 of variable 'time' of the dataset must be later .* 1.0: sort"),
        (gap, "p", "^Row 3 of variable 'p' of the dataset must be a finite number, but is nan"),
        (lambda: dataset().drop_vars("time"), "p", r"a variable along one of the coordinates"),
        (
            lambda: dataset().assign_coords(time=np.array([1, 2, 3], "datetime64[s]")),
            "p",
            "`variable 'time' of the dataset` must be numbers, not dates",
        ),
    ],
)
def test_invalid_datasets_are_refused(make, name, message):
    with pytest.raises(ValueError, match=message):
        cj.from_xarray(make(), {name: PROBE})


def test_a_torque_is_read_from_a_table_in_one_call(tmp_path):
    path = tmp_path / "torque.csv"
    path.write_text("t [ms],torque [N cm],angle [deg]\n0,0,0\n100,250,1\n")
    torque = cj.function_from_csv(path, "torque", "N m")
    assert float(torque(0.05)) == pytest.approx(1.25, rel=1e-15)
    switched = cj.function_from_csv(path, "torque", "N m", cj.PiecewiseConstant)
    assert float(switched(0.05)) == 0.0 and float(switched(0.1)) == pytest.approx(2.5)
    with pytest.raises(ValueError, match="column 'angle' of .*torque.csv.*a unit of 'N m'"):
        cj.function_from_csv(path, "angle", "N m")
    with pytest.raises(ValueError, match="`column` must be among the columns of"):
        cj.function_from_csv(path, "torqe", "N m")

"""Logs of robots from tables: units, encoders, currents, and errors for what is not valid."""

from functools import partial

import numpy as np
import pandas as pd
import pytest

import clearjoint as cj

TIMES = np.array([10.0, 10.5, 11.5, 12.0])
ANGLES = np.array([0.1, 0.2, -0.3, 0.4])  # rad


@pytest.mark.parametrize("kind", ["table", "csv", "no header", "parquet", "lists"])
def test_every_source_gives_the_same_log(kind, tmp_path):
    data = {"t [ms]": 1e3 * TIMES, "q [deg]": np.degrees(ANGLES), "i [mA]": [1.0, 2.0, 3.0, 4.0]}
    table, source, options = pd.DataFrame(data), tmp_path / "log.csv", {}
    columns = "t", ("q",), "i"
    if kind == "table":
        source = table
    elif kind == "csv":
        table.to_csv(source, index=False)
    elif kind == "no header":
        table.to_csv(source, index=False, header=False)
        columns, options = ("0 [ms]", (1, "deg"), "2 [mA]"), {"header": None}
    else:
        pytest.importorskip("pyarrow")
        source = tmp_path / "LOG.PARQUET"
        if kind == "lists":
            state = [np.array(row) for row in zip(data["q [deg]"], data["i [mA]"], strict=True)]
            table = pd.DataFrame({"t [ms]": data["t [ms]"], "state": state})
            columns = "t", ("state.0 [deg]",), "state.1 [mA]"
        table.to_parquet(source)
    time, position, current = columns
    angles = {"elbow": cj.LogColumn(*position, noise=0.5)}
    scale = {"ratio": -100.0, "zero": 1.0, "noise": 2.0}
    torques = {"elbow": cj.LogColumn.current(current, 0.05, **scale)}
    log = cj.RobotLog.read(source, time=time, angles=angles, torques=torques, **options)
    angle, torque = log.angles["elbow"], log.torques["elbow"]
    np.testing.assert_allclose(angle.times, TIMES - 10.0, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(angle.values, ANGLES, rtol=1e-12)
    assert angle.noise == pytest.approx(np.radians(0.5)) and angle.unit == "rad"
    np.testing.assert_allclose(torque.values, -5e-3 * np.arange(4.0), rtol=0.0, atol=1e-15)
    assert torque.noise == pytest.approx(0.01)


@pytest.mark.parametrize("unit", ["", " [rad]"])
def test_a_number_in_brackets_after_a_name_is_an_index(unit, tmp_path):
    columns = {f"/state/position[{k}]{unit}": (k + 1.0) * ANGLES for k in range(3)}
    pd.DataFrame({"t": TIMES, **columns}).to_csv(tmp_path / "log.csv", index=False)
    angles = {"elbow": cj.LogColumn(f"/state/position[1]{unit}", None if unit else "rad")}
    log = cj.RobotLog.read(tmp_path / "log.csv", time="t", angles=angles)
    np.testing.assert_allclose(log.angles["elbow"].values, 2.0 * ANGLES)


def test_times_may_be_dates(tmp_path):
    dates = pd.to_datetime(1e9 + TIMES, unit="s", utc=True)
    table = pd.DataFrame({"stamp": dates, "q [rad]": ANGLES})
    texts = table.assign(stamp=[date.isoformat().replace("+00:00", "Z") for date in dates])
    texts.to_csv(tmp_path / "log.csv", index=False)
    for source in (table, tmp_path / "log.csv"):
        log = cj.RobotLog.read(source, time="stamp", angles={"elbow": "q"})
        np.testing.assert_allclose(log.angles["elbow"].times, TIMES - 10.0, atol=1e-6)
    # At the end of summer time, the hour from two to three is repeated.
    clock = [f"2025-10-26T02:{time}" for time in ("59:59+02:00", "00:00+01:00", "00:02+01:00")]
    late = pd.DataFrame({"stamp": clock, "q [rad]": ANGLES[:3]})
    log = cj.RobotLog.read(late, time="stamp", angles={"elbow": "q"})
    np.testing.assert_array_equal(log.angles["elbow"].times, [0.0, 1.0, 3.0])
    wrong = texts.assign(stamp=["2025-11-12T10:03:29.555Z", "later", "latest", "last"])
    with pytest.raises(ValueError, match="Row 1 of column 'stamp'.*a finite number"):
        cj.RobotLog.read(wrong, time="stamp", angles={"elbow": "q"})


def test_counts_of_an_encoder_become_angles():
    table = pd.DataFrame({"t": TIMES, "raw": [2048, 3072, 1024, 2049]})
    forward = cj.LogColumn.encoder("raw", counts=4096, zero=2048)
    backward = cj.LogColumn.encoder("raw", counts=4096, zero=2048, reverse=True, noise=1.0)
    log = cj.RobotLog.read(table, angles={"a": forward, "b": backward})
    quarter = np.pi / 2
    expected = [0.0, quarter, -quarter, 2 * np.pi / 4096]
    np.testing.assert_allclose(log.angles["a"].values, expected, rtol=1e-14)
    np.testing.assert_allclose(log.angles["b"].values, np.negative(expected), rtol=1e-14)
    assert log.angles["a"].noise == pytest.approx(2 * np.pi / 4096 / np.sqrt(12.0))
    assert log.angles["b"].noise == pytest.approx(2 * np.pi / 4096)


def test_a_part_of_a_log_keeps_its_times_and_lost_samples_are_left_out():
    values = [1.0, np.nan, 3.0, 4.0]
    table = pd.DataFrame({"t": TIMES, "x [mm]": values})
    log = cj.RobotLog.read(table, angles={"slide": "x"}, missing="drop")
    np.testing.assert_allclose(log.angles["slide"].times, [0.0, 1.5, 2.0])
    assert log.angles["slide"].unit == "m" and log.angles["slide"].noise is None
    part = log.between(1.0, 2.0)
    np.testing.assert_allclose(part.angles["slide"].times, [1.5, 2.0])
    np.testing.assert_allclose(part.angles["slide"].values, [3e-3, 4e-3])
    assert (part.start, part.end) == (1.5, 2.0)
    with pytest.raises(ValueError, match="two samples of 'slide'.*the log is from 0 to 2 s"):
        log.between(0.1, 1.0)


GOOD = {"t": [0.0, 0.1, 0.2, 0.3], "q [deg]": [0.0, 1.0, 2.0, 3.0]}


@pytest.mark.parametrize(
    ("changed", "column", "message"),
    [
        ({"t": [0.0, 0.2, 0.1, 0.3]}, "q", "Row 3 .*sort the rows, merge repeated times"),
        ({"t": [0.0, 0.1, 0.2, 3.3]}, "q", r"a gap from 0.2 to 3.3 s: pass largest_gap=3.3"),
        ({"t": [0.0, 0.08, 0.16, 1.199]}, "q", "a gap from 0.16 to 1.199 s: pass largest_gap=1.1"),
        ({"t": [], "q [deg]": []}, "q", "`column 'q' .*must be two numbers or more, but is 0"),
        ({"q [deg]": [0.0, np.nan, 1.0, 2.0]}, "q", "Row 2 .*finite number.*missing=.drop"),
        ({}, "p", "angles.*'elbow'.*among the columns of the table, .'t', 'q'., but is 'p'"),
        ({}, "q [rad]", "unit.*that of the table, 'deg', but is 'rad'"),
        ({"q [deg]": GOOD["t"], "p": GOOD["t"]}, "p", 'unit .*must be known.*write "p .rad."'),
        ({}, cj.LogColumn.current("q", 0.1), "a unit of 'A', but is 'deg'"),
    ],
)
def test_wrong_tables_are_refused(changed, column, message):
    table = pd.DataFrame({**GOOD, **changed})
    with pytest.raises(ValueError, match=message):
        cj.RobotLog.read(table, angles={"elbow": column})


def read_good(**options):
    return cj.RobotLog.read(pd.DataFrame(GOOD), **options)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: cj.LogColumn("q", noise=0.0), "`noise` must be positive"),
        (lambda: cj.LogColumn("q", factor=0.0), "`factor` must be not zero, but is 0.0"),
        (lambda: cj.LogColumn("q", zero=np.nan), "`zero` must be finite"),
        (lambda: cj.LogColumn("q", zero="1 deg"), "`zero` must be a number or .*but is '1 deg'"),
        (partial(read_good, angles={"a": "q"}, largest_gap="1 s"), "`largest_gap` must be a numb"),
        (lambda: cj.LogColumn.encoder("q", counts=-3), "`counts` must be positive"),
        (lambda: cj.LogColumn.current("i", torque_constant=0.0), "`torque_constant`"),
        (read_good, "`angles` must be columns by joint"),
        (partial(read_good, angles={"elbow": "q"}, missing="omit"), "`missing` must.*is 'omit'"),
    ],
)
def test_wrong_columns_are_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


@pytest.mark.parametrize("first", ["1000", "20240101", "5"])
def test_times_may_be_numbers_in_texts(first):
    """As `csv.DictReader` returns them. "1000" and "20240101" could also be dates."""
    milliseconds = int(first) + np.arange(5)
    table = pd.DataFrame({"t": [str(t) for t in milliseconds], "q [rad]": np.arange(5.0)})
    log = cj.RobotLog.read(table, time="t [ms]", angles={"elbow": "q"})
    np.testing.assert_allclose(log.angles["elbow"].times, 1e-3 * np.arange(5), atol=1e-12)

"""The benchmark measures all candidates, and they simulate the same motion."""

import json
from contextlib import redirect_stdout
from importlib.util import find_spec
from io import StringIO

import numpy as np
import pytest

from studies.benchmark import __main__ as benchmark
from studies.benchmark import pendulum

PROGRAMS = ["clearjoint, Tsit5"] * 2 + ["clearjoint, Dopri8"] * 2 + ["SciPy, DOP853"] * 2
if find_spec("exudyn"):
    PROGRAMS += ["Exudyn"] * 2


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    return tmp_path_factory.mktemp("benchmark") / "quick.json"


@pytest.fixture(scope="module")
def printed(file):
    with redirect_stdout(StringIO()) as output:
        benchmark.main(["pendulum", "--quick", "--json", str(file)])
    return output.getvalue().split("\n")


@pytest.fixture(scope="module")
def rows(printed, file):
    del printed
    return json.loads(file.read_text())["rows"]


def test_table_has_a_row_for_every_candidate(printed):
    table = [line.strip("|").split("|") for line in printed if line.startswith("|")]
    assert [cells[0].strip() for cells in table[2:]] == PROGRAMS
    assert {len(cells) for cells in table} == {len(pendulum.COLUMNS)}


def test_missing_exudyn_is_said(monkeypatch, capsys):
    monkeypatch.setattr(pendulum, "find_spec", lambda name: None)
    names = [candidate.name for candidate in pendulum.baseline_candidates()]
    assert names == ["SciPy, DOP853"] * 2
    assert "Exudyn is not installed (pip install" in capsys.readouterr().out


def test_candidates_agree(rows):
    ends = np.array([row["r2_m"] for row in rows])
    assert [row["simulated_s"] for row in rows] == [pendulum.QUICK] * len(PROGRAMS)
    np.testing.assert_allclose(ends, ends[:1].repeat(len(ends), axis=0), rtol=0.0, atol=1e-5)
    assert all(row["error_m"] < 1e-5 for row in rows)


def test_tighter_settings_cost_more_and_err_less(rows):
    for looser, tighter in zip(rows[::2], rows[1::2], strict=True):
        assert looser["program"] == tighter["program"]
        assert looser["right_hand_sides"][0] < tighter["right_hand_sides"][0]
        assert looser["error_m"] > tighter["error_m"]


def test_steps_are_counted(rows):
    for row, stages in zip(rows[:4], (6, 6, 13, 13), strict=True):
        (accepted,), (tried,) = row["steps_accepted"], row["steps_tried"]
        assert 0 < accepted < tried
        assert row["right_hand_sides"] == [stages * tried]
    assert all(row["steps_accepted"][0] > 0 and row["seconds"][0] > 0.0 for row in rows)


def test_repeats_must_be_positive(capsys):
    with pytest.raises(SystemExit):
        benchmark.parse(["first-result", "--repeats", "0"])
    assert "--repeats must be at least 1" in capsys.readouterr().err

"""The study of posteriors: its statistics, and a quick run."""

from types import SimpleNamespace
from typing import Any

import numpy as np

from studies.posterior.__main__ import main, parse
from studies.posterior.draws import HEAD, Row


def test_shares_of_intervals_that_contain_the_truth():
    case: Any = SimpleNamespace(label="case", truth={"a": 1.0, "b": 2.0})
    ends = [{"a": (0.5, 1.5), "b": (3.0, 4.0)}, {"a": (0.9, 1.1), "b": (1.0, 3.0)}]
    found: Any = [
        SimpleNamespace(intervals=one, weights=np.ones(k + 1), runs=10, failed=1, seconds=2.0)
        for k, one in enumerate(ends)
    ]
    row = Row(case, found)
    assert row.inside.tolist() == [[True, False], [True, True]]
    cells = row.cells()
    assert len(cells) == len(HEAD)
    assert cells[:6] == ("case", "2", "a 100, b 50", "1", "10", "2")


def test_the_quick_study_prints_a_row_and_draws_the_points(tmp_path, capsys):
    assert parse([]).draws == 50
    main(["--quick", "--output", str(tmp_path)])
    assert "| backlash, 50 ms | 1 |" in capsys.readouterr().out
    assert (tmp_path / "posterior.png").stat().st_size > 5000

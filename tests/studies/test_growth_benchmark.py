"""The benchmark of growth: times of first answers in fresh processes, and their parts."""

import json

import pytest

from studies.benchmark.growth import main


@pytest.mark.slow
def test_quick_benchmark_of_growth(tmp_path):
    main(["--quick", "--output", str(tmp_path)])
    rows = json.loads((tmp_path / "growth.json").read_text())["rows"]
    found = [(row["of"], row["number"], row["compiler"]) for row in rows]
    assert found == [("ideal joints", 1, "native"), ("ideal joints", 2, "native")]
    for row in rows:
        assert all(row[part] > 0.0 for part in ("tracing", "lowering", "writing", "compiling"))
    assert (tmp_path / "growth.png").stat().st_size > 5_000

"""The benchmark of gradients has a row for each way, and they agree."""

import json

import pytest

from studies import benchmark


@pytest.mark.slow
def test_quick_benchmark_of_gradients(tmp_path):
    file = tmp_path / "quick.json"
    benchmark.main(["gradients", "--quick", "--json", str(file)])
    rows = json.loads(file.read_text())["rows"]
    assert [row.get("way", "cost") for row in rows] == [
        "forward, `jax.jacfwd`",
        "reverse, `jax.grad`",
        "central differences",
        "cost",
    ]
    for row in rows[:3]:
        assert row["error by log c"] < 0.1 and row["error by e"] < 0.1
        assert row["times the plain run"] > 0.0
    assert rows[3]["parameters"] == 1 and rows[3]["reverse: MB"] > rows[3]["forward: MB"] > 0.0

"""The benchmark of gradients has a row for each way, and they agree."""

import json

import pytest

from studies.benchmark import __main__ as benchmark


@pytest.mark.slow
def test_quick_benchmark_of_gradients(tmp_path):
    file = tmp_path / "quick.json"
    benchmark.main(["gradients", "--quick", "--json", str(file)])
    rows = json.loads(file.read_text())["rows"]
    accuracies, (plain, *controlled), (cost,) = rows[:4], rows[4:8], rows[8:]
    assert [row["way"] for row in accuracies] == [
        "forward, `jax.jacfwd`",
        "reverse, `jax.grad`",
        "error-controlled, `cj.sensitivities`",
        "central differences",
    ]
    for row in accuracies:
        assert row["error by log c"] < 0.1 and row["error by e"] < 0.1
        assert row["times the plain run"] > 0.0
    assert accuracies[2]["error by log c"] < 1e-4 and accuracies[2]["error by log K"] < 1e-3
    assert [row["parameters"] for row in (plain, *controlled)] == [0, 1, 1, 1]
    assert controlled[0]["attempts"] > plain["attempts"] and plain["times the plain run"] == 1.0
    attempts = [row["attempts"] for row in controlled]
    assert attempts == sorted(attempts, reverse=True)
    assert all(row["largest error"] < 1e-2 for row in controlled)
    assert cost["parameters"] == 1 and cost["reverse: MB"] > cost["forward: MB"] > 0.0

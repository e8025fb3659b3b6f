"""The benchmark of first calls times fresh processes, and sets them beside what they should be."""

import json

import pytest

from studies.benchmark import __main__ as benchmark
from studies.benchmark import first_calls


def test_quick_benchmark_of_first_calls(tmp_path, capsys):
    file = tmp_path / "quick.json"
    benchmark.main(["first-calls", "--quick", "--json", str(file)])
    rows = json.loads(file.read_text())["rows"]
    run = "double pendulum, simulate"
    found = [(row["what"], row["cache"]) for row in rows]
    assert found == [("import", ""), (run, "empty"), (run, "filled")]
    _, cold, warm = rows
    assert 0.0 < warm["processor s"] < 0.5 * cold["processor s"]
    for row in rows:
        assert row["times the aim"] * row["aim"] == pytest.approx(row["processor s"])
    table = [line for line in capsys.readouterr().out.splitlines() if line.startswith("|")]
    assert len(table) == 2 + len(rows)


@pytest.mark.parametrize("first", first_calls.CALLS, ids=str)
def test_what_is_called_is_part_of_its_mechanism(first):
    make, joint, body = first_calls.MECHANISMS[first.mechanism]
    scene, state = make()
    assert joint in scene.joints and body in scene.bodies and set(state.bodies) == set(scene.bodies)

"""The study of mutants: which changes are made, which tests are run, and what is counted."""

import json

import pytest

from studies.common.fresh_process import ROOT
from studies.mutants import __main__ as study
from studies.mutants.mutations import in_random_order, mutants_of
from studies.mutants.recording import Recording

SOURCE = '''
"""A module: 1 + 1."""
SIZE = 3 * 4

class Law:
    size: int = 5

    def force(self, x: "int | None", factor: float = 2.0) -> float:
        """Return 1 + 1."""
        if not x or (  # or, and
            x < 1
            or x is None
        ):
            raise ValueError(f"{x + 1}" + "!")
        return np.where(x > 0.5, -np.sin(x) ** factor, (factor)) @ max(x, "a" + "b")

    def __repr__(self):
        return 1 + 1

def text(x) -> str:
    return "a" * x
'''
CHANGES = [
    ("2.0", "3.0"),
    ("not ", ""),
    ("or", "and"),
    ("<", "<="),
    ("<", ">="),
    ("1", "0"),
    ("or", "and"),
    ("is", "is not"),
    (">", "<="),
    (">", ">="),
    ("0.5", "1.5"),
    ("-", ""),
    ("-np.sin(x) ** factor, (factor", "factor, (-np.sin(x) ** factor"),
    ("sin", "cos"),
    ("**", "*"),
    ("@", "*"),
    ("max", "min"),
]


@pytest.fixture(scope="module")
def in_order():
    """All mutants of the kernels."""
    return in_random_order(ROOT, study.ROOMS, study.SEED)


def source_file(folder, text):
    file = folder / "clearjoint" / "_model" / "law.py"
    file.parent.mkdir(parents=True)
    file.write_text(text)
    return file


def test_each_operator_of_functions_is_changed(tmp_path):
    found = mutants_of(tmp_path, source_file(tmp_path, SOURCE))
    assert [(m.old, m.new) for m in found] == CHANGES
    assert {(m.room, m.function) for m in found} == {("model", "Law.force")}
    for mutant in found:
        changed = mutant.applied(SOURCE)
        compile(changed, "law.py", "exec")
        assert changed == SOURCE[: mutant.start] + mutant.new + SOURCE[mutant.end :]


def test_the_order_does_not_depend_on_other_functions(tmp_path):
    file = source_file(tmp_path, SOURCE)
    before = in_random_order(tmp_path, ["model"], 1)
    file.write_text("def more(x):\n    return x + 1\n" + SOURCE)
    after = in_random_order(tmp_path, ["model"], 1)
    assert len(after) == len(before) + 2
    assert [m.identity for m in after if m.function != "more"] == [m.identity for m in before]


def test_tests_that_execute_the_statement_come_first_and_the_cheapest_before_others(tmp_path):
    mutant = mutants_of(tmp_path, source_file(tmp_path, SOURCE))[-1]
    assert mutant.lines == (15, 15)
    room, dear, cheap, of_file = "tests/model/test_a.py::x", "t.py::dear", "t.py::cheap", "u.py::x"
    seconds = {room: 1.0, dear: 4.0, cheap: 1.0, of_file: 0.5, "v.py::x": 0.1}
    recording = Recording(seconds, {mutant.file: {"15": [dear, cheap], "7": [of_file, dear]}})
    assert recording.tests_for(mutant, 100.0) == [cheap, dear, of_file, room]
    # The last two groups have a quarter of the time.
    assert recording.tests_for(mutant, 8.0) == [cheap, dear, of_file, room]
    assert recording.tests_for(mutant, 3.0) == [cheap, of_file]
    assert recording.total([dear, room]) == 5.0 and recording.cheapest() == "v.py::x"


@pytest.mark.parametrize(("part", "expected"), [("test", {2, 3}), ("again", {1})])
def test_an_interrupted_command_continues(part, expected, in_order, tmp_path, monkeypatch):
    mutants = in_order[:4]
    caught = {mutants[0].identity: True, mutants[1].identity: False}
    rows = [{"identity": name, "caught": found} for name, found in caught.items()]
    (tmp_path / "outcomes.jsonl").write_text("\n".join(map(json.dumps, rows)) + "\n")
    Recording({"a": 1.0}, {}).write(tmp_path / "recording.json")
    run = []
    monkeypatch.setattr(study, "is_equivalent", lambda mutant: False)
    monkeypatch.setattr(study, "in_random_order", lambda *arguments: in_order)
    monkeypatch.setattr(study.Study, "test", lambda self, mutants, recording: run.extend(mutants))
    study.main([part, "--count", "4", "--output", str(tmp_path)])
    assert {mutants.index(mutant) for mutant in run} == expected


@pytest.mark.slow
def test_the_quick_study_catches_a_wrong_friction_law(in_order, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(study, "in_random_order", lambda *arguments: in_order)
    *_, whole = study.main(["--quick", "--output", str(tmp_path)])
    assert whole[:3] == ["all", "1", "1"]
    (outcome,) = study.read(tmp_path / "outcomes.jsonl").values()
    assert outcome["by"].startswith(f"{study.QUICK_TESTS}::")
    assert "RegularisedCoulomb.ratio" in capsys.readouterr().out


def test_reasons_of_equivalence_belong_to_mutants_of_today(in_order):
    assert study.equivalents()
    known = {(m.file, m.function, m.code, m.old, m.new) for m in in_order}
    assert set(study.equivalents()) <= known

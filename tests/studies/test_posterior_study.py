"""The study of posteriors: its statistics, its file of draws, and a quick run."""

import json
from dataclasses import asdict

import numpy as np
import pytest

from studies.posterior.__main__ import main, parse
from studies.posterior.draws import HEAD, Draw, cells, cover
from studies.posterior.exact import posteriors


def draw(seed, a, b):
    truth, found = {"a": 1.0, "b": 2.0}, (seed + 1, 90.0, 10, 1, 2.0)
    return Draw("name", "label", 64, seed, truth, {"a": a, "b": b}, *found)


DRAWS = [draw(0, (0.5, 1.5), (3.0, 4.0)), draw(1, (0.9, 1.1), (1.0, 3.0))]


def test_shares_of_intervals_that_contain_the_truth():
    assert DRAWS[0].inside == {"a": True, "b": False}
    row = cells(DRAWS)
    assert len(row) == len(HEAD)
    # Ends by Wilson's formula: (n p + z^2 / 2 ± z sqrt(n p (1 - p) + z^2 / 4)) / (n + z^2).
    shares = "a 100 (34 to 100), b 50 (9 to 91)"
    assert row == ("label", "2", shares, "1", "90, 90", "10", "2", "2")


def test_draws_in_the_file_are_not_computed_again(tmp_path):
    file = tmp_path / "draws.jsonl"
    other = {"number": 32}
    lines = [asdict(one) for one in DRAWS] + [asdict(DRAWS[0]) | other]
    file.write_text("".join(json.dumps(line) + "\n" for line in lines))

    def never():
        raise RuntimeError("computed")

    kept = cover("name", never, 2, 64, file)
    assert [one.inside for one in kept] == [one.inside for one in DRAWS]
    assert len(cover("name", never, 1, 32, file)) == 1
    with pytest.raises(RuntimeError, match="computed"):
        cover("name", never, 3, 64, file)


def test_exact_posteriors_of_a_linear_problem_cover_the_truth_as_often_as_stated():
    # One parameter with the standard error 1, whose prior is flat: the runs are spread evenly.
    values = np.linspace(-8.0, 8.0, 801)
    design = np.full(16, 0.25)
    shifts = np.multiply.outer(values, design)
    below, draws = (values < 0.0)[:, None], 2000
    shares, effective = posteriors(shifts, below, np.zeros(801), draws)
    assert abs((shares < 0.025).mean() - 0.025) < 0.015
    assert abs((shares > 0.975).mean() - 0.025) < 0.015
    # The integral of a weight exp(-x^2 / 2), squared, over that of its square is 2 sqrt(pi).
    np.testing.assert_allclose(np.median(effective), 2.0 * np.sqrt(np.pi) / 0.02, rtol=0.02)


@pytest.mark.slow
def test_the_quick_study_prints_a_row_and_draws_the_intervals(tmp_path, capsys):
    assert parse([]).draws == 50
    main(["--quick", "--output", str(tmp_path)])
    assert "| backlash, 50 ms | 1 |" in capsys.readouterr().out
    assert (tmp_path / "posterior.png").stat().st_size > 5000
    assert len((tmp_path / "draws.jsonl").read_text().splitlines()) == 1

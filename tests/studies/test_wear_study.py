"""The study of wear, in its quick setting."""

import re

import numpy as np
import pytest

from studies.wear.__main__ import main

pytestmark = pytest.mark.slow


def test_stages_of_two_lengths_agree(tmp_path):
    lines = main(["profile", "--quick", "--output", str(tmp_path)])
    assert (tmp_path / "profile.png").stat().st_size > 3000
    differences = [re.search(r"difference of the mean ([-+][\d.]+) %", line) for line in lines]
    numbers = [float(found[1]) for found in differences if found]
    assert len(numbers) == 2 and all(abs(number) < 0.5 for number in numbers)


def test_a_groove_approaches_that_of_a_rigid_journal(tmp_path):
    lines = main(["groove", "--quick", "--output", str(tmp_path)])
    pairs = [re.search(r"([\d.]+) µm, a rigid journal ([\d.]+) µm", line) for line in lines]
    depths = np.array([[float(number) for number in found.groups()] for found in pairs if found])
    differences = 1.0 - depths[:, 0] / depths[:, 1]
    assert len(depths) > 4 and (np.diff(differences) < 0.0).all() and 0.0 < differences[-1] < 0.04
    assert abs(float(re.search(r"relative error (\S+)$", lines[-1])[1])) < 1e-6


def test_derivatives_of_the_life_are_those_of_differences(tmp_path):
    lines = main(["life", "--quick", "--output", str(tmp_path)])
    pairs = [re.search(r"(\S+) cycles, by differences (\S+)", line) for line in lines]
    numbers = [[float(number) for number in found.groups()] for found in pairs if found]
    life = float(re.search(r"(\S+) cycles$", lines[0])[1])
    assert len(numbers) == 3
    for derivative, difference in numbers:
        assert derivative == pytest.approx(difference, abs=3e-3 * life)


def test_differences_over_short_steps_have_the_derivative(tmp_path):
    """Of the depths after two numbers of cycles, to 1.5e-4 of them; 1 % is too long a step."""
    lines = main(["steps", "--quick", "--output", str(tmp_path)])
    rows = [[float(number) for number in line.split(": ")[1].split(", ")] for line in lines]
    derivative, *differences = np.array(rows)
    distances = np.abs(np.array(differences) - derivative).max(axis=1)
    assert distances[0] > 5e-4 and (distances[1:] < 1.5e-4).all()

"""The catalogue: errors of its quick checks, and the agreement of the README with the checks."""

import re
from pathlib import Path

import pytest

from studies.catalogue.__main__ import FAMILIES
from studies.catalogue.check import HEAD

TABLES = (Path(__file__).parents[2] / "studies" / "catalogue" / "README.md").read_text("utf-8")
ROWS = [line.strip("| ").split(" | ") for line in TABLES.splitlines() if line.startswith("| `")]


@pytest.fixture(scope="module")
def checks():
    return [check for family in FAMILIES.values() for check in family.checks(True)]


@pytest.mark.slow
def test_errors_are_within_the_allowed_ones(checks):
    assert len(checks) > 25
    assert [check for check in checks if not check.error <= check.within] == []


@pytest.mark.slow
def test_readme_has_every_checked_entry(checks):
    listed = {tuple(row[:3]) for row in ROWS}
    assert [check.entry for check in checks if tuple(check.cells()[:3]) not in listed] == []


def test_every_entry_has_its_figure():
    assert len(ROWS) > 70
    for row in ROWS:
        assert len(row) == len(HEAD), row
        link = re.fullmatch(r"\[[^]]+\]\(([^)]+\.png)\)", row[-1])
        assert link, row
        assert (Path(__file__).parents[2] / "studies" / "catalogue" / link[1]).exists(), row

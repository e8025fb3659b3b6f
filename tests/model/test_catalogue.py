"""The catalogue of laws, films, joints, drives, plays and mechanisms against closed forms,
published values and independent programs: the checks of `studies.catalogue`."""

from pathlib import Path

import pytest

from studies.catalogue.__main__ import FAMILIES
from tests.support.slow import slow_but

TABLES = (Path(__file__).parents[2] / "studies" / "catalogue" / "README.md").read_text("utf-8")
ROWS = [line.strip("| ").split(" | ") for line in TABLES.splitlines() if line.startswith("| `")]
FAST = "Normal laws", "Line contact", "Friction", "Films"
"""Families that hardly integrate in the quick setting."""


@pytest.mark.parametrize("family", slow_but(FAST, FAMILIES))
def test_errors_are_within_the_allowed_ones(family):
    checks = FAMILIES[family].checks(quick=family in FAST)
    assert [check.cells() for check in checks if not check.holds] == []
    listed = {tuple(row[:3]) for row in ROWS}
    assert [check.entry for check in checks if tuple(check.cells()[:3]) not in listed] == []

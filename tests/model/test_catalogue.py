"""Motions of joints, drives, plays and mechanisms against closed forms, published values and
independent programs: the checks of `studies.catalogue` that are not quick."""

import pytest

from studies.catalogue import joints, mechanisms, mechanisms_with_play, plays


@pytest.mark.slow
@pytest.mark.parametrize("family", [joints, mechanisms, mechanisms_with_play, plays])
def test_errors_of_the_catalogue_are_within_the_allowed_ones(family):
    assert [check.cells() for check in family.checks(quick=False) if not check.holds] == []

"""The study of cost: its tables, and that absent features of a scene add nothing to its program."""

import pytest

from studies.cost import coordinates, features

CASES = features.cases()
NAMES = list(CASES)


@pytest.mark.slow
def test_quick_features_have_times(tmp_path):
    found = features.measure(quick=True)
    assert [cost.name for cost in found] == NAMES[:2]
    features.figure(found).savefig(tmp_path / "figure.png")
    assert len(features.table(found)) == 3


@pytest.mark.slow
def test_joint_coordinates_do_not_drift_and_take_fewer_steps():
    absolute, joint = coordinates.measure([coordinates.IDEAL])
    assert (absolute.coordinates, joint.coordinates) == ("absolute", "joint")
    assert 0 < joint.attempts < absolute.attempts
    assert joint.drift < 1e-14 < absolute.drift < 1e-8
    assert len(coordinates.table([absolute, joint])[1]) == len(coordinates.table([])[0])

"""The study of gradients: quick searches for a wall and for a torque."""

import numpy as np
import pytest

from studies.gradients import torque, wall
from studies.gradients.searches import search_table


@pytest.mark.slow
def test_quick_fit_of_the_wall(tmp_path):
    found = wall.measure(quick=True)
    assert found.search.difference < 1e-5
    assert found.search.history.min() < 0.2 * found.search.history[0]
    assert found.touched.any() and not found.touched.all()
    assert len(wall.table(found)) == 5
    assert len(search_table({"wall": found.search})) == 2
    wall.figure(found).savefig(tmp_path / "wall.png")


@pytest.mark.slow
def test_quick_search_of_the_torque(tmp_path):
    found = torque.measure(quick=True)
    assert found.search.difference < 1e-2
    assert found.search.history.min() < found.search.history[0]
    assert abs(found.after.turned - np.pi) < 0.1
    assert len(torque.table(found)) == 3
    torque.figure(found).savefig(tmp_path / "torque.png")

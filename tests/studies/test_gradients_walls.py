"""The study of gradients: quick searches for a wall and for a torque."""

import numpy as np
import pytest

import clearjoint as cj
from studies.gradients import torque, wall
from studies.gradients.searches import search_table


def test_the_worn_wall_leaves_one_point_of_contact():
    angles = np.linspace(0.0, 2.0 * np.pi, 65)[:-1]
    values = wall.worn(angles)
    assert values.max() == pytest.approx(30e-6, rel=0.02) and values.min() < 1e-7
    # `Scene` warns of two points of contact if the clearance is smaller than the curvature allows.
    spline = cj.profiles.PeriodicSpline.through(values).at(np.linspace(0.0, 6.28, 400))
    assert wall.CLEARANCE + np.min(spline.value + spline.bend) > 0.0


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

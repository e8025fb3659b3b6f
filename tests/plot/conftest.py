"""Fixtures of the tests of figures."""

import matplotlib.pyplot as plt
import pytest

import clearjoint as cj
from tests.support.tumbling_bearing import tumbling_bearing


@pytest.fixture(autouse=True)
def no_figure_stays():
    yield
    plt.close("all")


@pytest.fixture(scope="module")
def tumbling():
    return tumbling_bearing()


@pytest.fixture(scope="module")
def turning(tumbling):
    """Observation of a journal that moves around its bearing, its states, and the rotations of the
    bearing."""
    scene, solution, rotations = tumbling
    return cj.observe(scene, solution), solution.saved, rotations

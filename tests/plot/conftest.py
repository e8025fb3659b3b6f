"""What tests of figures share."""

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
    """What is seen of a journal that runs round in a bearing, its states, and the bearing's
    rotations."""
    scene, solution, rotations = tumbling
    return cj.observe(scene, solution), solution.saved, rotations

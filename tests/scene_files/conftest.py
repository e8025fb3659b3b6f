"""Robots from texts."""

import warnings
from collections.abc import Callable

import pytest

import clearjoint as cj


@pytest.fixture
def read_robot(tmp_path) -> Callable[..., cj.results.Robot]:
    """Read a robot from the text of a file, `robot.xml` or `robot.urdf`, without warnings."""

    def read_robot(text: str, **options) -> cj.results.Robot:
        path = tmp_path / ("robot.xml" if text.startswith("<mujoco") else "robot.urdf")
        path.write_text(text)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", cj.NotCarriedOverWarning)
            return cj.load_robot(path, **options)

    return read_robot

"""The humanoid with play and servos in clearjoint and in MuJoCo."""

import numpy as np
import pytest

from studies.benchmark.humanoid import FLANKS, HEAD, RATE, Here, There, humanoid, main


@pytest.mark.slow
def test_both_programs_have_the_same_motion(capsys):
    pytest.importorskip("mujoco")
    rows = main(["--quick"])
    assert rows[0] == HEAD and len(rows) == 4
    assert all(row[2] != "-" for row in rows[1:])
    assert "| damper" in capsys.readouterr().out
    robot, span = humanoid(**next(iter(FLANKS.values()))), 8.0 / RATE
    here, there = Here(robot, span).run(1e-7), There(robot, span, "RK4").run(256)
    assert here.shape == there.shape == (9, 29)
    assert np.abs(here).max() > 1e-3
    np.testing.assert_allclose(here, there, atol=1e-4)

"""The study of contact laws runs, and its loops lose what the laws deliver."""

import numpy as np
import pytest

import clearjoint as cj
from studies.contact_laws.__main__ import main
from studies.contact_laws.curves import MASS, SPEED, STIFFNESS, loop


def test_the_study_runs_quickly(tmp_path):
    main(["--quick", "--output", str(tmp_path)])
    assert {path.name for path in tmp_path.iterdir()} == {
        "forces.png",
        "loops.png",
        "restitution.png",
    }


def test_the_area_of_a_loop_is_the_energy_lost():
    law = cj.laws.HuntCrossley(0.5, STIFFNESS)
    depth, force = loop(law, 2000)
    lost = np.trapezoid(force, depth)
    expected = 0.5 * MASS * SPEED**2 * (1.0 - float(law.delivered_restitution()) ** 2)
    assert lost == pytest.approx(expected, rel=1e-3)

"""The study of contact laws: energies of its loops, and its models of a joint."""

import numpy as np
import pytest

import clearjoint as cj
from studies.contact_laws.__main__ import main
from studies.contact_laws.comparison import DURATION, accuracies, reference, slopes
from studies.contact_laws.curves import MASS, SPEED, STIFFNESS, loop
from studies.contact_laws.models import MODELS

RIGID = MODELS[3]


@pytest.mark.slow
def test_quick_figures_of_the_laws_are_drawn(tmp_path):
    main(["laws", "--quick", "--output", str(tmp_path)])
    for name in ("forces", "loops", "restitution"):
        assert (tmp_path / f"{name}.png").stat().st_size > 5000


@pytest.mark.parametrize("law", [cj.laws.LankaraniNikravesh, cj.laws.HuntCrossley])
def test_the_area_of_a_loop_is_the_energy_lost(law):
    law = law(0.5, STIFFNESS)
    depth, force = loop(law, 2000)
    lost = np.trapezoid(force, depth)
    expected = 0.5 * MASS * SPEED**2 * (1.0 - float(law.delivered_restitution()) ** 2)
    assert lost == pytest.approx(expected, rel=1e-3)


@pytest.mark.slow
def test_rigid_contact_is_near_the_reference():
    (found,) = accuracies([RIGID], reference(), DURATION)
    assert found.steps == 40_000 and found.seconds > 0.0
    assert 0.0 < found.early_error < 15e-6


@pytest.mark.slow
def test_rigid_contact_has_no_derivative_by_the_clearance():
    (found,) = slopes([RIGID])
    near, far = found.differences
    assert found.forward == near == 0.0
    assert far == pytest.approx(-155.3e-6, rel=0.5)

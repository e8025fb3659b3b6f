"""The study of backlash, and its closed form."""

import importlib.util

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from studies.backlash import shafts
from studies.backlash.shafts import END, PLAY, SPEED, exact, relative

pytestmark = pytest.mark.slow
needs_mujoco = pytest.mark.skipif(
    importlib.util.find_spec("mujoco") is None,
    reason="MuJoCo is not installed: pip install -e '.[mujoco]'",
)


def test_the_exact_motion_is_that_of_small_steps():
    def rates(_, y):
        beyond, side = abs(y[0]) - 0.5 * PLAY, np.sign(y[0])
        push = shafts.FREQUENCY**2 * beyond + 2.0 * shafts.DAMPING * shafts.FREQUENCY * side * y[1]
        return y[1], -side * max(push, 0.0) * (beyond > 0.0)

    found = solve_ivp(rates, (0.0, END), (0.0, SPEED), rtol=1e-9, atol=1e-13, max_step=1e-5)
    angle, rate = relative(np.array([END]))
    assert float(angle[0]) == pytest.approx(found.y[0, -1], abs=1e-6)
    assert float(rate[0]) == pytest.approx(found.y[1, -1], rel=1e-4)


def test_its_derivative_is_that_of_differences():
    end, change = np.array([END]), 1e-6 * PLAY
    more, less = (float(relative(end, PLAY + s * change)[0][0]) for s in (1.0, -1.0))
    assert shafts.exact_derivative(END) == pytest.approx(
        -0.2 * (more - less) / (2.0 * change), rel=1e-6
    )
    assert exact(end)[0].energy < 0.5 * 1e-3 * SPEED**2


@needs_mujoco
def test_quick_study_finds_the_differences_of_its_readme(tmp_path):
    from studies.backlash.__main__ import main
    from studies.backlash.trials import CLEARJOINT, derivatives, limits, motions

    main(["--quick", "--output", str(tmp_path)])
    assert {path.name for path in tmp_path.iterdir()} == {"backlash.png"}
    for trials, most in ((motions(True), 1e-5), (derivatives(True), 1e-3)):
        ours = [trial.errors[0] for trial in trials if trial.who == CLEARJOINT]
        theirs = [trial.errors[0] for trial in trials if trial.who != CLEARJOINT]
        assert max(ours) < most and max(ours) < 0.1 * min(theirs)
    _, written, _, default = limits(True)
    assert float(written[1]) < 0.5 * float(default[1])


@needs_mujoco
def test_both_tend_to_the_exact_motion():
    from studies.backlash import ours, recipe

    truth = exact(np.array([END]))[0]
    (here, _), (there, _) = ours.run(1e-8), recipe.run(1e-6, "RK4")
    np.testing.assert_allclose(here.angles, truth.angles, rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(there.angles, truth.angles, atol=1e-6)
    assert here.energy == pytest.approx(truth.energy, rel=1e-6)
    assert there.energy == pytest.approx(truth.energy, rel=1e-3)

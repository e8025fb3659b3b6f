"""Figure of the motion, and of errors of motion and derivative over time taken."""

from collections.abc import Sequence

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from clearjoint.plot import style
from studies.backlash import ours, recipe
from studies.backlash.shafts import END, PLAY, relative
from studies.backlash.trials import Trial

MARKERS = "osD^"


def figure(runs: Sequence[Trial], slopes: Sequence[Trial]) -> Figure:
    """Draw all three panels."""
    shown, panels = plt.subplots(1, 3, figsize=(13.0, 4.6), layout="constrained")
    _motion(panels[0])
    _work(panels[1], runs, "largest error of an angle, rad")
    _work(panels[2], slopes, "relative error of the derivative by the play")
    return shown


def _motion(axes: Axes) -> None:
    times = np.linspace(0.0, END, 1001)
    axes.axhspan(-500.0 * PLAY, 500.0 * PLAY, color="0.93", label="play")
    exact = 1e3 * np.asarray(relative(times)[0])
    axes.plot(1e3 * times, exact, color="0.6", linewidth=5.0, label="exact")
    axes.plot(1e3 * times, 1e3 * ours.path(times), color=style.BLUE, label="clearjoint")
    kinds = (
        ("MuJoCo, step 0.5 ms", 5e-4, False, style.VERMILLION),
        ("MuJoCo's own limit, 2 ms", 2e-3, True, style.GREEN),
    )
    for (label, step, own_limit, colour), marker in zip(kinds, MARKERS, strict=False):
        at, angle = recipe.path(step, "implicitfast", own_limit)
        look = {"marker": marker, "markersize": 3, "linewidth": 1.0}
        axes.plot(1e3 * at, 1e3 * angle, color=colour, label=label, **look)
    style.dress(axes, "time, ms", "motor against link, mrad")
    axes.legend(loc="upper right", bbox_to_anchor=(1.0, 0.75), frameon=False, fontsize=9)


def _work(axes: Axes, trials: Sequence[Trial], quantity: str) -> None:
    names = list(dict.fromkeys(trial.who for trial in trials))
    for name, (colour, dash), marker in zip(names, style.LINES, MARKERS, strict=False):
        rows = [trial for trial in trials if trial.who == name]
        times = [1e3 * trial.seconds for trial in rows]
        errors = [trial.errors[0] for trial in rows]
        axes.loglog(times, errors, color=colour, linestyle=dash, marker=marker, label=name)
    style.dress(axes, "time, ms", quantity)
    axes.legend(frameon=False, fontsize=9)

"""The three parts of the study; each draws a figure and returns its findings as text."""

import time

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

import clearjoint as cj
from clearjoint.extend import Scalar
from clearjoint.plot import style
from studies.common.output import Output
from studies.statistics import shadowing

PIN = shadowing.PIN
FORCE = shadowing.FORCE
PERIOD = 60.0 / 5000.0
"""Duration of a revolution at 5000 1/min, s."""
CLEARANCE, TOLERANCE = 0.1e-3, 5e-6
"""Nominal radial clearance and the standard deviation of its manufacture, m."""
SHIFTS, WEIGHTS = (-1.5, -0.5, 0.5, 1.5), np.array([1.0, -27.0, 27.0, -1.0]) / 24.0
"""Central difference of fourth order: shifts of the clearance in deviations, and weights. One of
second order over a deviation would include a third derivative that is not small."""
SHOWN = ("force", "load_mean", "load_rms")


def _clearance(scene: cj.Scene) -> Scalar:
    return scene.joints[PIN].clearance


CLEARANCES = cj.Axis(_clearance, np.geomspace(2e-5, 2e-4, 8))


def outputs() -> dict[str, cj.extend.AbstractReduction]:
    """Return peak, mean and root mean square of the pin force after the first revolution."""
    return {
        "force": cj.Peak(FORCE, "N", after=PERIOD),
        "load": cj.Statistics(FORCE, "N", after=PERIOD),
    }


def ensemble(output: Output) -> list[str]:
    """Show how starts that differ by 1e-9 m/s spread, over the clearance."""
    revolutions, draws, exponents = (2, 10, 2) if output.quick else (10, 100, 4)
    scene, state = cj.mechanisms.slider_crank(CLEARANCE)
    found = cj.ensemble(
        scene,
        state,
        revolutions * PERIOD,
        {"clearance": CLEARANCES},
        outputs(),
        draws=draws,
        exponents=exponents,
        progress=False,
    )
    figure = Figure(figsize=(10.0, 4.0), layout="constrained")
    left, right = figure.subplots(1, 2)
    micrometres, levels = 1e6 * found["clearance"].values, found["force_quantile"].values
    left.fill_between(micrometres, levels[:, 0], levels[:, -1], color=style.LIGHT)
    left.plot(micrometres, found["force_mean"], "o-", color=style.BLUE, markersize=4)
    style.dress(left, "radial clearance, µm", "peak force, N: mean, 5 % and 95 %")
    rate, error = found["lyapunov_exponent"], found["lyapunov_exponent_standard_error"]
    right.errorbar(micrometres, PERIOD * rate, PERIOD * error, fmt="o-", color=style.BLUE)
    right.axhline(0.0, color=style.GREY, linewidth=1.0)
    style.dress(right, "radial clearance, µm", "largest Lyapunov exponent,\n1/revolution")
    for axes in (left, right):
        axes.set_xscale("log")
        axes.set_xticks([20, 50, 100, 200], ["20", "50", "100", "200"], minor=False)
        axes.minorticks_off()
    output.save(figure, "ensemble")
    return [
        f"{float(c) * 1e6:.3g} µm: peak force {float(mean):.0f} ± {float(sd):.2g} N (deviation), "
        f"exponent {float(r) * PERIOD:.2f} ± {float(e) * PERIOD:.2f} per revolution"
        for c, mean, sd, r, e in zip(
            found["clearance"],
            found["force_mean"],
            found["force_deviation"],
            rate,
            error,
            strict=True,
        )
    ]


def manufactured(clearance: float, draws: int, seed: int) -> xr.Dataset:
    """Return the derivatives by a nominal clearance, m, from a number of runs."""
    scene, state = cj.mechanisms.slider_crank(clearance)
    uncertain = {"clearance": cj.Uncertain(_clearance, deviation=TOLERANCE)}
    return cj.statistics_derivatives(
        scene, state, 2 * PERIOD, uncertain, outputs(), draws=draws, seed=seed, progress=False
    )


def derivatives(output: Output) -> list[str]:
    """Compare intervals of 400 estimates with differences of four large ensembles."""
    draws, large, cases = (100, 200, 3) if output.quick else (1000, 100_000, 400)
    start = time.perf_counter()
    found = [manufactured(CLEARANCE, draws, seed) for seed in range(cases)]
    seconds = (time.perf_counter() - start) / cases
    start = time.perf_counter()
    ensembles = [manufactured(CLEARANCE + shift * TOLERANCE, large, 1000) for shift in SHIFTS]
    seconds_large = time.perf_counter() - start
    lines = [f"{draws} runs take {seconds:.1f} s, four ensembles of {large} {seconds_large:.0f} s"]
    figure = Figure(figsize=(11.0, 3.6), layout="constrained")
    for axes, name in zip(figure.subplots(1, len(SHOWN)), SHOWN, strict=True):
        means, errors = (
            np.array([float(one[f"{name}_{part}"]) for one in ensembles])
            for part in ("mean", "standard_error")
        )
        truth = WEIGHTS @ means / TOLERANCE
        error = np.linalg.norm(WEIGHTS * errors) / TOLERANCE
        values = np.array([float(one[f"{name}_derivative"][0]) for one in found])
        own = np.array([float(one[f"{name}_derivative_standard_error"][0]) for one in found])
        held = np.abs(values - truth) <= 1.96 * own
        drawn = slice(100)
        axes.errorbar(
            np.arange(cases)[drawn],
            1e-6 * values[drawn],
            1.96e-6 * own[drawn],
            fmt=".",
            color=style.BLUE,
        )
        axes.axhspan(
            1e-6 * (truth - 1.96 * error),
            1e-6 * (truth + 1.96 * error),
            color=style.VERMILLION,
            alpha=0.4,
        )
        style.dress(axes, "case", f"derivative of {name}, N/µm")
        # The same differences of four ensembles of m/4 runs each.
        difference = error * np.sqrt(4.0 * large / draws)
        lines.append(
            f"{name}: differences {truth * 1e-6:.3g} ± {error * 1e-6:.2g} N/µm; "
            f"{held.sum()} of {cases} intervals hold it; standard error of {draws} runs "
            f"{own.mean() * 1e-6:.2g}, of differences with as many runs "
            f"{difference * 1e-6:.2g} N/µm: {(difference / own.mean()) ** 2:.1f} times the cost"
        )
    output.save(figure, "derivatives")
    # Tangents and shadowing take half a minute.
    return lines if output.quick else lines + _other_methods(draws)


def _other_methods(draws: int) -> list[str]:
    """Return derivatives of the mean pin force by the score method and from tangents."""
    scene, state = cj.mechanisms.slider_crank(CLEARANCE)
    tolerance = cj.Uncertain(_clearance, deviation=TOLERANCE)
    axes = cj.design(scene, state, {"clearance": tolerance}, draws, "random")
    runs = cj.sweep(
        scene, state, 2 * PERIOD, axes, {"load": outputs()["load"]}, zipped=True, progress=False
    )
    z, y = (axes["clearance"].values - CLEARANCE) / TOLERANCE, runs["load_mean"].values
    lines = []
    for name, f in {"score": y, "score with the mean subtracted": y - y.mean()}.items():
        terms = f * z / TOLERANCE
        error = terms.std() / np.sqrt(draws)
        lines.append(f"{name}: {terms.mean() * 1e-6:.3g} ± {error * 1e-6:.2g} N/µm")
    return lines + _by_tangents(axes["clearance"].values[: 3 if draws < 1000 else 40], draws)


def _by_tangents(clearances: np.ndarray, draws: int) -> list[str]:
    """Return derivatives of the mean pin force from tangents at clearances, m, as findings.

    Shadowing is an average over a long motion, and is compared with the regression for this.
    """
    long = 10
    scene, state = cj.mechanisms.slider_crank(CLEARANCE)
    regression = cj.statistics_derivatives(
        scene,
        state,
        long * PERIOD,
        {"clearance": cj.Uncertain(_clearance, deviation=TOLERANCE)},
        {"load": outputs()["load"]},
        draws=draws,
        progress=False,
    )
    value, error = (
        1e-6 * float(regression[f"load_mean_derivative{end}"][0]) for end in ("", "_standard_error")
    )
    lines = [f"regression for {long} revolutions: {value:.3g} ± {error:.2g} N/µm"]
    methods = {"tangents": (2, shadowing.continued), "shadowing": (long, shadowing.shadow)}
    for name, (revolutions, tangents_of) in methods.items():
        runs = [shadowing.segments(clearance, revolutions, PERIOD) for clearance in clearances]
        terms = [shadowing.mean_force(run, tangents_of(run), PERIOD) * 1e-6 for run in runs]
        quartiles = ", ".join(f"{value:.3g}" for value in np.percentile(terms, [25, 50, 75]))
        lines.append(
            f"{name} of {len(terms)} runs of {revolutions} revolutions in "
            f"{min(map(len, runs))} to {max(map(len, runs))} segments: mean {np.mean(terms):.3g} ± "
            f"{np.std(terms) / np.sqrt(len(terms)):.2g} N/µm, quartiles {quartiles}"
        )
    return lines


def offset_guide(scene: cj.Scene, state: cj.State, offset: Scalar) -> tuple[cj.Scene, cj.State]:
    """Move the guide and the slider across the guide, m: the guide misses the crank's axis."""
    scene = cj.set_value(scene, lambda s: s.joints["guide"].point_first[1], offset)
    return scene, cj.set_value(state, lambda s: s.bodies["slider"].position[1], offset)


def sensitivity(output: Output) -> list[str]:
    """Return Sobol indices of the peak force in the first revolution and later."""
    draws = 8 if output.quick else 256
    scene, state = cj.mechanisms.slider_crank(
        CLEARANCE, friction=cj.frictions.RegularisedCoulomb(0.05)
    )
    uncertain = {
        "clearance": cj.Uncertain(_clearance, between=(5e-5, 2e-4)),
        "restitution": cj.Uncertain(lambda s: s.joints[PIN].law.restitution, between=(0.6, 0.95)),
        "stiffness": cj.Uncertain(
            lambda s: s.joints[PIN].law.stiffness.young_modulus, between=(100e9, 210e9)
        ),
        "friction": cj.Uncertain(
            lambda s: s.joints[PIN].friction.coefficient, between=(0.01, 0.15)
        ),
        "misalignment": cj.Uncertain(
            cj.Parameter.change(offset_guide, 0.0, unit="m"), half_width=20e-6
        ),
    }
    found = cj.sobol_indices(
        scene,
        state,
        3 * PERIOD,
        uncertain,
        {
            "first": cj.Peak(FORCE, "N", until=PERIOD),
            "later": cj.Peak(FORCE, "N", after=PERIOD),
        },
        draws=draws,
        progress=False,
    )
    figure = Figure(figsize=(9.0, 3.6), layout="constrained")
    lines = [f"{found.attrs['runs']} runs, {int(found['failed'])} failed"]
    for axes, name in zip(figure.subplots(1, 2, sharey=True), ("first", "later"), strict=True):
        for shift, (order, color) in enumerate(
            {"first_order": style.BLUE, "total_order": style.VERMILLION}.items()
        ):
            value = found[f"{name}_{order}"].values
            ends = [found[f"{name}_{order}_{end}"].values for end in ("low", "high")]
            bars = np.abs(np.array(ends) - value)
            axes.bar(
                np.arange(5) + 0.4 * shift,
                value,
                0.38,
                yerr=bars,
                color=color,
                label=order.replace("_", " "),
            )
            numbers = (
                f"{key} {v:.2f} ({low:.2f} to {high:.2f})"
                for key, v, low, high in zip(uncertain, value, *ends, strict=True)
            )
            lines.append(f"{name} peak, {order.replace('_', ' ')}: {', '.join(numbers)}")
        axes.set_xticks(np.arange(5) + 0.2, list(uncertain), rotation=30)
        axes.set_title(f"peak force: {name} revolution{'s' * (name == 'later')}")
        style.dress(axes, "", "share of the variance")
    figure.axes[0].legend(frameon=False)
    output.save(figure, "sensitivity")
    return lines

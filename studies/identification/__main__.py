"""Parameters of the double pendulum from made-up measurements, and which starts lead to them.

    python -m studies.identification [--quick] [--output FOLDER]
    python -m studies.identification today [--starts 10] [--genetic 2] [--quick]

c = 0.5 mm, e = 0.9, steel, 0.1 s at 10 kHz, seen by proximity probes at both bases (5 µm),
accelerometers at both arms' centres (5 m/s^2) or a camera (positions of both centres, 75 µm).
Young's modulus starts a factor 5 off, restitution at 0.6, the clearance 20 % off. A table says how
each search ended, and after how many runs with and without derivatives, beside the Cramér-Rao
bounds; figures of the fits go to the output folder. ``--quick`` fits the probes to 0.03 s.

The second is what one would do without derivatives: see `studies.identification.today`.
"""

import argparse
import sys
from collections.abc import Sequence

import matplotlib
import matplotlib.pyplot as plt
import numpy as np

import clearjoint as cj
from clearjoint import plot
from studies.common.identification_problem import SENSORS, STARTS, TRUTH, fit, ideal
from studies.common.output import Output, add_options
from studies.identification import today


def study(sensor: str, hows: Sequence[str], end_time: float, output: Output) -> None:
    """Fit from all starts in all ways, print how it went, and draw the best."""
    clean, bounds = ideal(sensor, end_time)
    data = clean.with_noise(np.random.default_rng(1))
    errors = ", ".join(f"{name} {bound:.2g}" for name, bound in bounds.items())
    print(f"\n{sensor} to {end_time} s; Cramér-Rao bounds of the coordinates: {errors}")
    fit(data, TRUTH, "at once", end_time)  # compiles
    fits = []
    for label, guess in {"truth": TRUTH, **STARTS}.items():
        for how in hows:
            attempt = fit(data, guess, how, end_time)
            found = attempt.found
            fits.append(found)
            values = ", ".join(f"{name} {value:.5g}" for name, value in found.estimates.items())
            fit_of = found.chi_squared / found.samples
            runs = f"{attempt.runs:5d} + {attempt.screening:4d} runs"
            print(
                f"{label:14s}{how:20s}{found.ending.name:11s}chi2/N {fit_of:8.4f}  "
                f"{runs} {attempt.seconds:6.1f} s  {values}",
                flush=True,
            )
    best = min(fits, key=lambda found: found.chi_squared)
    print(f"\n{best}")
    plot.fitted(best)
    output.save(plt.gcf(), sensor)
    plot.correlations(best)
    output.save(plt.gcf(), f"{sensor}_correlation")


def main_of_today(arguments: Sequence[str]) -> None:
    """Compare with searches that have no derivatives."""
    parser = argparse.ArgumentParser(
        prog="identification today", description=(today.__doc__ or "").partition("\n")[0]
    )
    parser.add_argument("--quick", action="store_true", help="two near starts, 0.03 s")
    parser.add_argument("--starts", type=int, default=10, help="near and far, each")
    parser.add_argument("--genetic", type=int, default=2, help="genetic searches with Exudyn")
    options = parser.parse_args(arguments)
    cj.configure()
    today.run(options.quick, options.starts, options.genetic)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the study."""
    arguments = sys.argv[1:] if arguments is None else arguments
    if arguments[:1] == ["today"]:
        main_of_today(arguments[1:])
        return
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    add_options(parser, "the probes to 0.03 s")
    parser.add_argument("--sensors", nargs="+", choices=SENSORS, default=list(SENSORS))
    options = parser.parse_args(arguments)
    cj.configure()
    matplotlib.use("Agg")
    output = Output.of(__file__, options)
    if options.quick:
        study("probes", ("at once",), 0.03, output)
        return
    for sensor in options.sensors:
        hows = ["at once", "windows", "windows, 12 starts", "screened"]
        if sensor == "accelerometers":
            hows.append("velocities first")
        study(sensor, hows, 0.1, output)


if __name__ == "__main__":
    main()

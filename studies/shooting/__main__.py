"""The double pendulum identified from a record five times as long as a single run can use.

    python -m studies.shooting [--draws 3] [--quick] [--output FOLDER]

Proximity probes (5 µm, 10 kHz) over 0.187 s, the guess of `studies.identification` that is stiff
and wide: a single run at once, a single run over growing windows, and multiple shooting, from a
fit to the first 60 ms, in windows of 10 ms. The figure follows the first draw: what the estimates
are off while the record grows. ``--quick`` ends at 0.08 s and leaves out the single runs.
"""

import argparse
import warnings

import numpy as np

import clearjoint as cj
from studies.common.identification_problem import TRUTH, WINDOWS, ideal
from studies.common.output import Output, add_options
from studies.horizon.trials import said
from studies.shooting.fits import END, by_shots, figure, single


def main(arguments: list[str] | None = None) -> None:
    """Print the table and draw the figure."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--draws", type=int, default=3)
    add_options(parser, "0.08 s, and no single runs")
    options = parser.parse_args(arguments)
    cj.configure()
    output = Output.of(__file__, options)
    end = 0.08 if options.quick else END
    limits = said(0.05 if options.quick else 0.2)
    limit = min(guess.since for guess in limits.guesses)
    clean, _ = ideal("probes", end)
    print(f"{end} s, {end / limit:.2g} times the horizon of the worst guess")
    heads = ["way", "chi2/N", *(f"{n}: error (standard error)" for n in TRUTH), "runs", "s"]
    print(f"| {' | '.join(heads)} |\n{'|---' * len(heads)}|", flush=True)
    for draw in range(1 if options.quick else options.draws):
        data = clean.with_noise(np.random.default_rng(draw))
        if draw == 0 and not options.quick:
            single_runs(data, limits)
        attempt, found = by_shots(data, end)
        print(attempt.row(), flush=True)
        print(f"  {found.fit.ending.value}; largest gap {np.abs(found.gaps).max():.1e}", flush=True)
        if draw == 0:
            output.save(figure(found, limit), "shooting")


def single_runs(data: cj.Measurements, limits: cj.Horizon) -> None:
    """Print the rows of fits by a single run, and what the first warned of."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        print(single(data, limits, []).row(), flush=True)
    print(*(f"(warned: {one.message})" for one in caught), sep="\n")
    grow = [*WINDOWS, *np.arange(0.1, END, 0.01)]
    print(single(data, None, grow).row(), flush=True)


if __name__ == "__main__":
    main()

"""For how long the double pendulum can be fitted by a single run, said and tried.

    python -m studies.horizon [--quick] [--output FOLDER]

The horizon by the sensitivities alone (`cj.fit_horizon`), for journal probes of 5 µm at 10 kHz and
guesses wrong by a factor 5 in stiffness, 1.8 in the logit of the restitution (0.6 for 0.9) and 20 %
in clearance; and fits by Levenberg and Marquardt (SciPy's) of all three parameters from the same
guesses, to noise-free records of different lengths, with the same derivatives. A fit succeeds if it
ends with a misfit below the noise.
"""

import argparse

import clearjoint as cj
from studies.common.output import Output, add_options
from studies.horizon.trials import END, LENGTHS, comparison, figure, said


def main(arguments: list[str] | None = None) -> None:
    """Print the horizon, draw the figure, and try fits unless the study is quick."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    add_options(parser, "a run of 0.05 s, and no fits")
    options = parser.parse_args(arguments)
    cj.configure()
    found = said(0.05 if options.quick else END)
    print(f"{found}\n")
    Output.of(__file__, options).save(figure(found), "horizon")
    if not options.quick:
        for row in comparison(found, LENGTHS):
            print(row, flush=True)


if __name__ == "__main__":
    main()

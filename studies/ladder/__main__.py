"""A ladder of models for one joint: what each costs, and what it loses.

    python -m studies.ladder [--quick]

The paper's double pendulum (clearance 0.5 mm, restitution 0.9) with five models of its shoulder.
Three tables and a figure:

- Cost of four seconds, and the largest error of either arm's position against the event-exact
  reference, before the horizon of 0.15 s.
- Beyond the horizon, over four seconds and runs that start 1 nm apart: energy lost, impacts, peak
  force.
- The derivative of arm 2's height by the logarithm of the clearance at 25 ms, between the first and
  the second impact: by `jax.jvp`, by central differences, and the reference's.
"""

import argparse

import clearjoint as cj
from studies.common.output import Output, add_options
from studies.ladder.comparison import (
    ACCURACY,
    DURATION,
    FINE,
    RUNS,
    SLOPES,
    STATISTICS,
    accuracy_rows,
    figure,
    markdown,
    reference,
    slope_rows,
    statistics_rows,
)
from studies.ladder.models import MODELS


def main(arguments: list[str] | None = None) -> None:
    """Measure, print the tables, and draw."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    add_options(parser, "one model, without statistics and figure")
    options = parser.parse_args(arguments)
    cj.configure()
    truth = reference()
    models = (MODELS[3],) if options.quick else MODELS
    print(markdown(ACCURACY, accuracy_rows(models, truth, DURATION)), end="\n\n")
    print(markdown(SLOPES, slope_rows(models)), end="\n\n")
    if not options.quick:
        kept = tuple(model for model in models if model.name != FINE)
        print(markdown(STATISTICS, statistics_rows(kept, DURATION, RUNS)))
        Output.of(__file__, options).save(figure(truth), "ladder")


if __name__ == "__main__":
    main()

"""Contact laws compared with each other, and models of a joint from ideal to compliant.

    python -m studies.contact_laws [laws | models] [--quick] [--output results/contact_laws]

- `laws`: elastic forces, hysteresis loops, and requested against delivered restitution. Elastic
  forces are those of a steel journal of 9.5 mm in a bearing of 10 mm, 20 mm long. Loops are free
  impacts of 2 kg at 0.1 m/s with one spring for all laws. The delivered restitution has a closed
  form, or is found by free impacts.
- `models`: cost, errors, statistics and derivatives of models of the double pendulum's shoulder.
"""

import argparse
import warnings

import clearjoint as cj
from studies.common.output import Output, add_options
from studies.common.report import markdown
from studies.contact_laws import comparison, figures
from studies.contact_laws.curves import delivered_table, elastic_table
from studies.contact_laws.models import MODELS


def laws(output: Output) -> None:
    """Print the tables of forces and restitutions, and draw."""
    print(markdown(elastic_table()))
    print("\n" + markdown(delivered_table(output.quick)))
    output.save(figures.forces(), "forces")
    output.save(figures.loops(output.quick), "loops")
    output.save(figures.restitution(output.quick), "restitution")


def models(output: Output) -> None:
    """Print the tables of the models, and draw."""
    warnings.filterwarnings("ignore", category=cj.LeftBearingWarning)
    truth = comparison.reference()
    chosen = (MODELS[3],) if output.quick else MODELS
    accuracies = comparison.accuracies(chosen, truth, comparison.DURATION)
    print(markdown([comparison.ACCURACY_HEAD, *(row.cells() for row in accuracies)]), flush=True)
    slopes = comparison.slopes(chosen)
    print("\n" + markdown([comparison.SLOPES_HEAD, *(row.cells() for row in slopes)]), flush=True)
    if not output.quick:
        chosen = [model for model in MODELS if model.name not in comparison.NO_STATISTICS]
        statistics = comparison.statistics(chosen, comparison.DURATION, comparison.RUNS)
        rows = [row.cells() for row in statistics]
        print("\n" + markdown([comparison.STATISTICS_HEAD, *rows]), flush=True)
        output.save(comparison.figure(truth), "models")


PARTS = {"laws": laws, "models": models}


def main(arguments: list[str] | None = None) -> None:
    """Run the parts that the command line names."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("part", nargs="?", choices=[*PARTS, "all"], default="all")
    add_options(parser, "few points, no laws that need simulated impacts, one model")
    options = parser.parse_args(arguments)
    cj.configure()
    output = Output.of(__file__, options)
    for name in PARTS if options.part == "all" else [options.part]:
        PARTS[name](output)


if __name__ == "__main__":
    main()

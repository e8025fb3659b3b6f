"""Normal contact laws side by side: force, hysteresis, and requested against delivered restitution.

    python -m studies.contact_laws [--quick] [--output results/contact_laws]

Elastic forces are those of a journal of 9.5 mm in a bearing of 10 mm, 20 mm long, both of steel.
Loops are free impacts of 2 kg at 0.1 m/s with one spring for all laws. What a law delivers is known
in closed form, or found by free impacts.
"""

import argparse

import clearjoint as cj
from studies.common.output import Output, add_options
from studies.common.report import markdown
from studies.contact_laws.curves import delivered_table, line_table
from studies.contact_laws.figures import forces, loops, restitution


def main(arguments: list[str] | None = None) -> None:
    """Print the tables, and draw."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    add_options(parser, "few points, and no laws that need impacts to be integrated")
    options = parser.parse_args(arguments)
    cj.configure()
    output = Output.of(__file__, options)
    print(markdown(line_table()))
    print("\n" + markdown(delivered_table(options.quick)))
    output.save(forces(), "forces")
    output.save(loops(options.quick), "loops")
    output.save(restitution(options.quick), "restitution")


if __name__ == "__main__":
    main()

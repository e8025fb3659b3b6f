"""Accuracy of stiffness, restitution and clearance that five kinds of sensors can give.

    python -m studies.identifiability [--quick] [--output results/identifiability]

The tables contain Cramér-Rao bounds of all three parameters together, for the double pendulum (0.5
mm, restitution 0.9, steel), and known bounds by central differences of an event-exact solver in
quadruple precision. Both records have 1000 samples: 0.05 s at 20 kHz and 0.1 s at 10 kHz. (The
source of the known bounds says 10 kHz for both, but only 20 kHz gives its numbers for 0.05 s.)
Young's modulus is the parameter of the stiffness K, which is proportional to it; the clearance
changes K too.

Cameras and accelerometers measure all three components of both arms' centres, probes the two
components across the bearing at both bases, the hinge all three of its reaction, contacts the
normal force of both bases.
"""

import argparse

import clearjoint as cj
from studies.common.output import Output, add_options
from studies.identifiability.instruments import (
    INSTRUMENTS,
    LENGTHS,
    SAMPLES,
    figure,
    report,
    table,
)


def main(arguments: list[str] | None = None) -> None:
    """Print tables and reports, and draw the figure."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    add_options(parser, "the shorter record alone, coarse")
    options = parser.parse_args(arguments)
    cj.configure()
    output = Output.of(__file__, options)
    lengths = LENGTHS[:1] if options.quick else LENGTHS
    for column, length in enumerate(lengths):
        found = report(length)
        print(f"{length} s, {SAMPLES} samples\n\n{table(found, column)}\n")
        for name in INSTRUMENTS:
            print(f"{found.of(name)}\n")
        if length == lengths[-1]:
            output.save(figure(found), "record_length")


if __name__ == "__main__":
    main()

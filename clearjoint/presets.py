"""Three named settings of `simulate`, `sweep` and `Integration`, from `studies.speed_accuracy`.

    cj.simulate(scene, start, end_time, **cj.presets.study)

The numbers are those of the paper's double pendulum, measured on 2026-11-21. Over 0.1 s and eleven
contacts, against the extended-precision reference: largest error of a position, and of a peak force
relative to the largest, in the table of impacts and by `Peak`, which sees the ends of steps only.
Over 2 s, mostly in contact: energy that the ledger does not account for, of that exchanged, and
processor time of a call of `simulate`, compilation apart, of which some 10 ms are no stepping.

The default of `simulate` lies between `look` and `study`: at `rtol` 1e-6 5e-10 m, 1e-6 and 2e-5 of
the force, 8e-8 of the energy, 56 ms. The three share a compiled program.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import diffrax

look: Mapping[str, Any] = MappingProxyType({"solver": diffrax.Tsit5(), "rtol": 1e-4})
"""For a look: 1e-7 m, 3e-4 and 2e-3 of the force, 6e-5 of the energy, in 43 ms (15 900 attempts of
six right-hand sides). Not for gradients."""

study: Mapping[str, Any] = MappingProxyType({"solver": diffrax.Tsit5(), "rtol": 1e-8})
"""For a study: 4e-12 m, 1e-8 and 7e-6 of the force, 6e-10 of the energy, in 140 ms (65 200 attempts
of six right-hand sides). Derivatives by `sensitivities` are right to 4e-6."""

reference: Mapping[str, Any] = MappingProxyType({"solver": diffrax.Dopri8(), "rtol": 1e-10})
"""For a reference: 5e-14 m, 7e-8 and 3e-6 of the force, 2e-13 of the energy, in 151 ms (36 800
attempts of 13 right-hand sides). Compiles twice as long: a first call takes 9 s instead of 5, and
of `sensitivities` two minutes."""

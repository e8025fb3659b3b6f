"""Three named settings of `simulate` and `sweep`, on the Pareto front of `studies.speed_accuracy`.

    cj.simulate(scene, start, end_time, **cj.presets.study)

The numbers are those of the paper's double pendulum: largest error of a position over 0.1 s and
eleven contacts, against the extended-precision reference; energy that the ledger does not account
for over 2 s, two thirds of it contact, relative to the energy exchanged; time of these 2 s in one
run on one core, compilation apart.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import diffrax

look: Mapping[str, Any] = MappingProxyType({"solver": diffrax.Tsit5(), "rtol": 1e-4})
"""For a look."""

study: Mapping[str, Any] = MappingProxyType({"solver": diffrax.Dopri8(), "rtol": 1e-6})
"""For a study."""

reference: Mapping[str, Any] = MappingProxyType({"solver": diffrax.Dopri8(), "rtol": 1e-10})
"""For a reference."""

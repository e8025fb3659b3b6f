"""Three named settings of `simulate`, `sweep` and `Integration`, from `studies.speed_accuracy`.

    cj.simulate(scene, start, end_time, **cj.presets.study)

The numbers are those of the paper's double pendulum. Over 0.1 s and eleven contacts, against the
extended-precision reference: largest error of a position, and of the peak forces in the table of
impacts relative to the largest. Over 2 s, mostly in contact: energy that the ledger does not
account for, relative to the energy exchanged; and processor time of a call of `simulate`,
compilation apart. The default of `simulate` lies between `look` and `study`, at `rtol` 1e-6: 5e-10
m, 1e-6, 8e-8 and 56 ms.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import diffrax

look: Mapping[str, Any] = MappingProxyType({"solver": diffrax.Tsit5(), "rtol": 1e-4})
"""For a look."""

study: Mapping[str, Any] = MappingProxyType({"solver": diffrax.Tsit5(), "rtol": 1e-8})
"""For a study."""

reference: Mapping[str, Any] = MappingProxyType({"solver": diffrax.Dopri8(), "rtol": 1e-10})
"""For a reference."""

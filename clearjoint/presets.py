"""Three named settings of `simulate`, `sweep` and `Integration`.

    cj.simulate(scene, start, end_time, **cj.presets.study)

The default of `simulate` lies between `look` and `study`, and shares their compiled program. What
each setting gives and takes is measured by `studies.speed_accuracy`: its README.md has the table.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import diffrax

look: Mapping[str, Any] = MappingProxyType({"solver": diffrax.Tsit5(), "rtol": 1e-4})
"""For a look. Not for gradients."""
study: Mapping[str, Any] = MappingProxyType({"solver": diffrax.Tsit5(), "rtol": 1e-8})
"""For a study, and for gradients by `sensitivities`."""
reference: Mapping[str, Any] = MappingProxyType({"solver": diffrax.Dopri8(), "rtol": 1e-10})
"""To test against. Compiles twice as long."""

"""Named settings of runs.

    cj.simulate(scene, start, end_time, cj.presets.accurate)

`default` is what `simulate` and `sweep` take unless told otherwise. It lies between `preview` and
`accurate`, which share its compiled program. What each gives and takes is measured by
`studies.speed_accuracy`: its README.md has the table.
"""

from dataclasses import replace

import diffrax

from .settings import Settings

default = Settings()
"""Of `simulate` and `sweep`.

>>> cj.presets.default.rtol
1e-06
"""
preview = Settings(rtol=1e-4)
"""For a look. Not for gradients.

>>> cj.presets.preview.rtol
0.0001
"""
accurate = Settings(rtol=1e-8)
"""For a study.

>>> from dataclasses import replace
>>> replace(cj.presets.accurate, ledger=True).rtol
1e-08
"""
reference = Settings(solver=diffrax.Dopri8(), rtol=1e-10)
"""To test against. Compiles twice as long.

>>> cj.presets.reference.rtol
1e-10
"""
derivatives = Settings(rtol=1e-9, landing_tolerance=1e-13, max_steps=1_000_000)
"""For derivatives: what `sensitivities` takes unless told otherwise, and what is made of it, such
as `fit_horizon`. An onset found within 1e-13 m leaves no error in the derivative of the entry
speed.

>>> cj.presets.derivatives.landing_tolerance
1e-13
"""
identification = replace(derivatives, derivative_tolerance=1e3)
"""For fits, whose slopes need three digits: the default of `identify` and `identify_many`. A fifth
fewer steps than `derivatives`, states as accurate.

>>> cj.presets.identification.derivative_tolerance
1000.0
"""

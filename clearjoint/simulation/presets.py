"""Named settings of runs.

    cj.simulate(scene, start, end_time, cj.presets.study)

`default` is what `simulate` and `sweep` take unless told otherwise. It lies between `look` and
`study`, which share its compiled program. What each gives and takes is measured by
`studies.speed_accuracy`: its README.md has the table.
"""

from dataclasses import replace

import diffrax

from .settings import Settings

default = Settings()
"""Of `simulate` and `sweep`."""
look = Settings(rtol=1e-4)
"""For a look. Not for gradients."""
study = Settings(rtol=1e-8)
"""For a study."""
reference = Settings(solver=diffrax.Dopri8(), rtol=1e-10)
"""To test against. Compiles twice as long."""
derivatives = Settings(rtol=1e-9, landing_tolerance=1e-13, max_steps=1_000_000)
"""For derivatives: what `sensitivities` takes unless told otherwise, and what is made of it, such
as `horizon`. An onset found within 1e-13 m leaves no error in the derivative of the entry speed."""
identification = replace(derivatives, derivative_tolerance=1e3)
"""For fits, whose slopes need three digits: what `identify`, `identify_many` and fits by multiple
shooting take unless told otherwise. A fifth fewer steps than `derivatives`, states as accurate."""

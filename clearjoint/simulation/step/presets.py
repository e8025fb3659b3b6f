"""Named settings of runs.

    cj.simulate(scene, start, end_time, cj.presets.accurate)

`default` is the default of `simulate` and `sweep`. It lies between `preview` and `accurate`; the
three share one compiled program. `studies/speed_accuracy/README.md` has a table of their accuracy
and run time.
"""

from dataclasses import replace

import diffrax

from .settings import Settings

default = Settings()
"""Default of `simulate` and `sweep`.

>>> cj.presets.default.rtol
1e-06
"""
preview = Settings(rtol=1e-4)
"""For quick looks at a motion; not accurate enough for gradients.

>>> cj.presets.preview.rtol
0.0001
"""
accurate = Settings(rtol=1e-8)
"""For studies.

>>> from dataclasses import replace
>>> replace(cj.presets.accurate, ledger=True).rtol
1e-08
"""
reference = Settings(solver=diffrax.Dopri8(), rtol=1e-10)
"""For reference solutions. Compiling takes twice as long.

>>> cj.presets.reference.rtol
1e-10
"""
derivatives = Settings(rtol=1e-9, landing_tolerance=1e-13, max_steps=1_000_000)
"""Default of `sensitivities` and of functions that use it, such as `fit_horizon`. Landing within
1e-13 m leaves no visible error in the derivatives of entry speeds.

>>> cj.presets.derivatives.landing_tolerance
1e-13
"""
identification = replace(derivatives, derivative_tolerance=1e3)
"""Default of `identify` and `identify_many`: three digits in derivatives are enough for fits. It
takes a fifth fewer steps than `derivatives`, with states of the same accuracy.

>>> cj.presets.identification.derivative_tolerance
1000.0
"""

"""Ready-made `Settings` of runs, by purpose.

    cj.simulate(scene, state, end_time, cj.presets.accurate)

In order of accuracy: `preview`, `default`, `accurate`, `reference`. The first three share one
compiled program. `derivatives` and `identification` are for runs with derivatives.
`studies/speed_accuracy/README.md` has a table of errors and run times.
"""

from dataclasses import replace

import diffrax

from .settings import Settings

default = Settings()
"""Settings that `simulate` and `sweep` use if none are given.

>>> cj.presets.default.rtol
1e-06
"""
preview = Settings(rtol=1e-4)
"""Settings for quick looks at a motion; not accurate enough for gradients.

>>> cj.presets.preview.rtol
0.0001
"""
accurate = Settings(rtol=1e-8)
"""Settings for studies whose numbers are reported, and those that `settle` uses if none are given.

>>> from dataclasses import replace
>>> replace(cj.presets.accurate, ledger=True).rtol
1e-08
"""
reference = Settings(solver=diffrax.Dopri8(), rtol=1e-10)
"""Settings for reference solutions, with which others are compared. Their integration method is of
order 8, and its program takes twice as long to compile.

>>> cj.presets.reference.rtol
1e-10
"""
derivatives = Settings(rtol=1e-9, landing_tolerance=1e-13, max_steps=1_000_000)
"""Settings that `sensitivities`, and functions that call it, such as `fit_horizon`, use if none are
given. Steps end within 1e-13 m of penetration at each onset of a contact, so that their adjustment
leaves no visible error in the derivatives of entry speeds.

>>> cj.presets.derivatives.landing_tolerance
1e-13
"""
identification = replace(derivatives, derivative_tolerance=1e3)
"""Settings that `identify`, `identify_many` and `posterior` use if none are given. Derivatives have
three correct digits, enough for fits; motions are those of `derivatives`, in a fifth fewer steps.

>>> cj.presets.identification.derivative_tolerance
1000.0
"""

"""Named settings of runs: `default`, `look`, `study`, `reference`,
`derivatives` and `identification`.

They are those of `clearjoint.simulation.step.presets`, which says what each is for.
"""

from .simulation.step.presets import default as default
from .simulation.step.presets import derivatives as derivatives
from .simulation.step.presets import identification as identification
from .simulation.step.presets import look as look
from .simulation.step.presets import reference as reference
from .simulation.step.presets import study as study

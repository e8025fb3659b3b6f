"""Named settings of runs: `default`, `look`, `study`, `reference`,
`derivatives` and `identification`.

They are those of `clearjoint.simulation.presets`, which says what each is for.
"""

from .simulation.presets import default as default
from .simulation.presets import derivatives as derivatives
from .simulation.presets import identification as identification
from .simulation.presets import look as look
from .simulation.presets import reference as reference
from .simulation.presets import study as study

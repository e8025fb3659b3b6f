"""Named settings of runs: `default`, `preview`, `accurate`, `reference`, `derivatives` and
`identification`.

They differ mainly in accuracy; `clearjoint.simulation.step.presets` tells what each of them is for.
"""

from .simulation.step.presets import accurate as accurate
from .simulation.step.presets import default as default
from .simulation.step.presets import derivatives as derivatives
from .simulation.step.presets import identification as identification
from .simulation.step.presets import preview as preview
from .simulation.step.presets import reference as reference

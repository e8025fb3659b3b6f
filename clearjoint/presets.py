"""Named settings of runs: `default`, `preview`, `accurate`, `reference`, `derivatives` and
`identification`; `clearjoint._simulation.step.presets` tells what each of them is for."""

from ._simulation.step.presets import accurate as accurate
from ._simulation.step.presets import default as default
from ._simulation.step.presets import derivatives as derivatives
from ._simulation.step.presets import identification as identification
from ._simulation.step.presets import preview as preview
from ._simulation.step.presets import reference as reference

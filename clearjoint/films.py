"""Laws for the hydrodynamic force of the lubricant in a bearing, passed as `film=` to a
`LubricatedJoint`.

In formulas mu is the `viscosity`, Pa s, R the bearing radius, L the film length and c the radial
clearance. Use `CaponeFilm` for short bearings, `ButenschoenFilm` for widths up to the diameter.
"""

from ._model.films import ButenschoenFilm as ButenschoenFilm
from ._model.films import CaponeFilm as CaponeFilm
from ._model.films import PinkusSternlichtFilm as PinkusSternlichtFilm

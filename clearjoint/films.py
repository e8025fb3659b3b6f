"""Laws for the hydrodynamic force of the lubricant in a bearing, passed as `film=` to a
`LubricatedJoint`.

In formulas mu is the `viscosity`, Pa s, R the bearing's radius, L the film's length and c the
radial clearance. Choose `CaponeFilm` for short bearings, and `ButenschoenFilm` for widths up to the
diameter.
"""

from ._model.films import ButenschoenFilm as ButenschoenFilm
from ._model.films import CaponeFilm as CaponeFilm
from ._model.films import PinkusSternlichtFilm as PinkusSternlichtFilm

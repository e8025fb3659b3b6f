"""Laws for the hydrodynamic force of the lubricant in a bearing, passed as `film=` to a
`LubricatedJoint`."""

from ._model.films import ButenschoenFilm as ButenschoenFilm
from ._model.films import CaponeFilm as CaponeFilm
from ._model.films import PinkusSternlichtFilm as PinkusSternlichtFilm

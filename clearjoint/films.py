"""Laws for the hydrodynamic force of the lubricant in a bearing, passed as `film=` to a
`LubricatedJoint`."""

from .model.films import ButenschoenFilm as ButenschoenFilm
from .model.films import CaponeFilm as CaponeFilm
from .model.films import PinkusSternlichtFilm as PinkusSternlichtFilm

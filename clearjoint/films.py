"""Laws for the hydrodynamic force of the lubricant in a bearing, passed as `film=` to a
`LubricatedJoint`."""

from .fields.objects import without_modules as _without_modules
from .model.films import ButenschoenFilm as ButenschoenFilm
from .model.films import CaponeFilm as CaponeFilm
from .model.films import PinkusSternlichtFilm as PinkusSternlichtFilm

__dir__ = _without_modules(globals())

"""Hydrodynamic forces of the lubricant in a bearing, passed as `film=` to a `LubricatedJoint`."""

from .fields.readable import without_modules as _without_modules
from .model.film.butenschoen import ButenschoenFilm as ButenschoenFilm
from .model.film.capone import CaponeFilm as CaponeFilm
from .model.film.pinkus_sternlicht import PinkusSternlichtFilm as PinkusSternlichtFilm

__dir__ = _without_modules(globals())

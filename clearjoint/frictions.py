"""Friction laws of contacts, passed as `friction=` to a joint with clearance.

Regularised laws have no force at zero sliding speed, so surfaces creep slowly instead of sticking.
Surfaces stick only with the laws `Dahl`, `LuGre` and `ElastoPlastic`, which have bristles: elastic
deflections of the surfaces.
"""

from ._model.contact.friction import Ambrosio as Ambrosio
from ._model.contact.friction import BengisuAkay as BengisuAkay
from ._model.contact.friction import BrownMcPhee as BrownMcPhee
from ._model.contact.friction import Dahl as Dahl
from ._model.contact.friction import ElastoPlastic as ElastoPlastic
from ._model.contact.friction import LinearCoulomb as LinearCoulomb
from ._model.contact.friction import LuGre as LuGre
from ._model.contact.friction import RegularisedCoulomb as RegularisedCoulomb
from ._model.contact.friction import Stribeck as Stribeck
from ._model.contact.friction import Threlfall as Threlfall

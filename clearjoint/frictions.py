"""Friction laws of contacts, passed as `friction=` to a joint with clearance.

Regularised laws have no force at zero sliding speed, so surfaces creep slowly instead of sticking.
Surfaces stick only with the laws `Dahl`, `LuGre` and `ElastoPlastic`, which have bristles: elastic
deflections of the surfaces.
"""

from .model.contact.friction import Ambrosio as Ambrosio
from .model.contact.friction import BengisuAkay as BengisuAkay
from .model.contact.friction import BrownMcPhee as BrownMcPhee
from .model.contact.friction import Dahl as Dahl
from .model.contact.friction import ElastoPlastic as ElastoPlastic
from .model.contact.friction import LinearCoulomb as LinearCoulomb
from .model.contact.friction import LuGre as LuGre
from .model.contact.friction import RegularisedCoulomb as RegularisedCoulomb
from .model.contact.friction import Stribeck as Stribeck
from .model.contact.friction import Threlfall as Threlfall

"""Friction laws of contacts, passed as `friction=` to a joint with clearance.

Laws without bristles have no force at the slip speed zero, so surfaces creep slowly instead of
sticking. Surfaces stick only with `Dahl`, `LuGre` and `ElastoPlastic`, which have bristles: elastic
deflections of the surfaces. In formulas v is the slip speed, `coefficient` mu,
`regularisation_speed` v_d, m/s; of friction that falls with the speed, `breakaway` is mu_S, the
maximum, and `kinetic` mu_C, the limit at high speed.
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

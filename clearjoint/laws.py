"""Contact laws for the normal force, passed as `law=` to a joint with clearance.

A law computes the force from the penetration delta, m, its rate, m/s, and often the entry speed,
the rate at the onset of the contact. Hunt-Crossley laws have the force K delta^n (1 + chi
rate/entry speed), with a damping factor chi; `extend.AbstractDampedLaw` lists their arguments.
`stiffness` is K, N/m^n: a number, a `RavnStiffness` for spheres, or a cylinder such as
`LiuCylinder` for line contacts, whose force replaces K delta^n; `extend.AbstractCylinder` explains
the symbols. `restitution` is c, the requested ratio of rebound speed to entry speed: choose
`ExactRestitution` to get it, and other laws to reproduce published results.
"""

from ._model.contact.cylinders import DubowskyFreudensteinCylinder as DubowskyFreudensteinCylinder
from ._model.contact.cylinders import EsduCylinder as EsduCylinder
from ._model.contact.cylinders import GoldsmithCylinder as GoldsmithCylinder
from ._model.contact.cylinders import GreenwoodTripp as GreenwoodTripp
from ._model.contact.cylinders import JohnsonCylinder as JohnsonCylinder
from ._model.contact.cylinders import LiuCylinder as LiuCylinder
from ._model.contact.cylinders import PereiraCylinder as PereiraCylinder
from ._model.contact.cylinders import PerssonCylinder as PerssonCylinder
from ._model.contact.cylinders import RadzimovskyCylinder as RadzimovskyCylinder
from ._model.contact.cylinders import RoughCylinders as RoughCylinders
from ._model.contact.dashpots import BordbarHyppanen as BordbarHyppanen
from ._model.contact.dashpots import ElastoGap as ElastoGap
from ._model.contact.dashpots import FloresKelvinVoigt as FloresKelvinVoigt
from ._model.contact.dashpots import ImpactFunction as ImpactFunction
from ._model.contact.dashpots import Jankowski as Jankowski
from ._model.contact.dashpots import KelvinVoigt as KelvinVoigt
from ._model.contact.dashpots import KuwabaraKono as KuwabaraKono
from ._model.contact.dashpots import Ristow as Ristow
from ._model.contact.dashpots import SpringDashpot as SpringDashpot
from ._model.contact.dashpots import Tsuji as Tsuji
from ._model.contact.dashpots import clamped_restitution as clamped_restitution
from ._model.contact.hunt_crossley import CarvalhoMartins as CarvalhoMartins
from ._model.contact.hunt_crossley import ExactRestitution as ExactRestitution
from ._model.contact.hunt_crossley import Flores2011 as Flores2011
from ._model.contact.hunt_crossley import GharibHurmuzlu as GharibHurmuzlu
from ._model.contact.hunt_crossley import Gonthier as Gonthier
from ._model.contact.hunt_crossley import HerbertMcWhannell as HerbertMcWhannell
from ._model.contact.hunt_crossley import Hertz as Hertz
from ._model.contact.hunt_crossley import HuGuo as HuGuo
from ._model.contact.hunt_crossley import HuntCrossley as HuntCrossley
from ._model.contact.hunt_crossley import LankaraniNikravesh as LankaraniNikravesh
from ._model.contact.hunt_crossley import LeeWang as LeeWang
from ._model.contact.hunt_crossley import MemorylessHuntCrossley as MemorylessHuntCrossley
from ._model.contact.hunt_crossley import PantWijeyewickrema as PantWijeyewickrema
from ._model.contact.hunt_crossley import SafaeifarFarshidianfar as SafaeifarFarshidianfar
from ._model.contact.hunt_crossley import YePounding as YePounding
from ._model.contact.hunt_crossley import ZhiyingQishao as ZhiyingQishao
from ._model.contact.hunt_crossley import delivered_restitution as delivered_restitution
from ._model.contact.hunt_crossley import exact_damping_factor as exact_damping_factor
from ._model.contact.laws import GivenStiffness as GivenStiffness
from ._model.contact.laws import RavnStiffness as RavnStiffness

"""Contact laws for the normal force, their stiffnesses, and the restitution that they deliver.

The force of a law follows from the penetration and its rate, and that of cylinders in contact along
a line also from the length of the journal. A contact law is passed as `law=` to a joint with
clearance."""

from .fields.readable import without_modules as _without_modules
from .model.contact.asperities import GreenwoodTripp as GreenwoodTripp
from .model.contact.asperities import RoughCylinders as RoughCylinders
from .model.contact.bounded_damping import ElastoGap as ElastoGap
from .model.contact.bounded_damping import FloresKelvinVoigt as FloresKelvinVoigt
from .model.contact.bounded_damping import ImpactFunction as ImpactFunction
from .model.contact.cylinders import LiuCylinder as LiuCylinder
from .model.contact.cylinders import PereiraCylinder as PereiraCylinder
from .model.contact.cylinders import PerssonCylinder as PerssonCylinder
from .model.contact.damping_factors import CarvalhoMartins as CarvalhoMartins
from .model.contact.damping_factors import ExactRestitution as ExactRestitution
from .model.contact.damping_factors import Flores2011 as Flores2011
from .model.contact.damping_factors import GharibHurmuzlu as GharibHurmuzlu
from .model.contact.damping_factors import Gonthier as Gonthier
from .model.contact.damping_factors import HerbertMcWhannell as HerbertMcWhannell
from .model.contact.damping_factors import HuGuo as HuGuo
from .model.contact.damping_factors import HuntCrossley as HuntCrossley
from .model.contact.damping_factors import LankaraniNikravesh as LankaraniNikravesh
from .model.contact.damping_factors import LeeWang as LeeWang
from .model.contact.damping_factors import PantWijeyewickrema as PantWijeyewickrema
from .model.contact.damping_factors import SafaeifarFarshidianfar as SafaeifarFarshidianfar
from .model.contact.damping_factors import YePounding as YePounding
from .model.contact.damping_factors import ZhiyingQishao as ZhiyingQishao
from .model.contact.dashpots import BordbarHyppanen as BordbarHyppanen
from .model.contact.dashpots import Jankowski as Jankowski
from .model.contact.dashpots import KelvinVoigt as KelvinVoigt
from .model.contact.dashpots import KuwabaraKono as KuwabaraKono
from .model.contact.dashpots import Ristow as Ristow
from .model.contact.dashpots import Tsuji as Tsuji
from .model.contact.dashpots import clamped_restitution as clamped_restitution
from .model.contact.hunt_crossley import Hertz as Hertz
from .model.contact.hunt_crossley import MemorylessHuntCrossley as MemorylessHuntCrossley
from .model.contact.laws import GivenStiffness as GivenStiffness
from .model.contact.laws import RavnStiffness as RavnStiffness
from .model.contact.logarithmic_cylinders import (
    DubowskyFreudensteinCylinder as DubowskyFreudensteinCylinder,
)
from .model.contact.logarithmic_cylinders import EsduCylinder as EsduCylinder
from .model.contact.logarithmic_cylinders import GoldsmithCylinder as GoldsmithCylinder
from .model.contact.logarithmic_cylinders import JohnsonCylinder as JohnsonCylinder
from .model.contact.logarithmic_cylinders import RadzimovskyCylinder as RadzimovskyCylinder
from .model.contact.restitution import delivered_restitution as delivered_restitution
from .model.contact.restitution import exact_damping_factor as exact_damping_factor

__dir__ = _without_modules(globals())

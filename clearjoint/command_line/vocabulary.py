"""Classes that study files may name."""

import inspect
from types import ModuleType

import diffrax

from .. import quantities
from ..dynamics.absolute_coordinates import AbsoluteCoordinates
from ..dynamics.joint_coordinates.coordinates import JointCoordinates
from ..dynamics.stabilisation import Baumgarte, Projection, Unstabilised
from ..identification.screening.screening import Screening
from ..identification.starts import Starts
from ..parametrisation.scales import Bounded, Linear, Log
from ..simulation.reductions import reductions, wear
from ..simulation.reductions.reductions import AbstractReduction
from ..sweeps.outputs import ImpactTable

METHODS = (AbsoluteCoordinates, JointCoordinates, Baumgarte, Projection, Unstabilised)
SOLVERS = (
    diffrax.Tsit5,
    diffrax.Dopri5,
    diffrax.Dopri8,
    diffrax.Bosh3,
    diffrax.Heun,
    diffrax.Euler,
)
OTHERS = (Linear, Log, Bounded, Starts, Screening, ImpactTable)


def _concrete(module: ModuleType, family: type) -> list[type]:
    classes = vars(module).values()
    own = [kind for kind in classes if inspect.isclass(kind) and issubclass(kind, family)]
    return [kind for kind in own if not inspect.isabstract(kind)]


CLASSES: tuple[type, ...] = (
    *_concrete(quantities, quantities.AbstractQuantity),
    *_concrete(reductions, AbstractReduction),
    *_concrete(wear, AbstractReduction),
    *METHODS,
    *SOLVERS,
    *OTHERS,
)
"""Quantities, what sweeps keep, scales, starts of fits, and what settings take."""

"""Normal contact laws: the force from penetration, its rate, and the memory of the impact.

What every law has. Laws of the Hunt-Crossley family are in `hunt_crossley` and `damping_factors`,
those with a dashpot beside the spring in `dashpots`. A law of another form subclasses
`AbstractContactLaw`; `clearjoint.testing.check_law` tells whether it behaves.
"""

import abc
from collections.abc import Callable
from typing import TYPE_CHECKING, ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import PyTree

from ...fields.conversion import AbstractConverting
from ...math.vectors import Scalar
from .gap import Gap
from .limits import Limit
from .stiffness import AbstractElasticity, as_stiffness

UNKNOWN_ENTRY_SPEED = 1e9
"""Entry speed, m/s, given to a contact that exists before the motion starts: its impact was not
seen, so it is taken as elastic, for which an entry speed beyond all others stands."""


class AbstractContactLaw(AbstractConverting):
    """A normal force law.

    A subclass gives the force and the stored energy; a law with `uses_entry_speed` gets the entry
    speed of the present contact, found at the true onset and kept to the separation.

    `force_jumps`: whether the force may be other than zero right after the onset or before the
    separation, as that of a parallel damper is. What follows of it, derivatives above all, is then
    taken into account, for one more evaluation a step. A class that has a `force` of its own and
    says nothing is taken to jump: declare ``force_jumps = False`` for one that begins and ends at
    zero.

    ```python
    import clearjoint as cj
    import jax.numpy as jnp
    from clearjoint.testing import check_law

    class Elastomer(cj.extend.AbstractContactLaw):
        stiffness: float  # N/m
        damping: float  # s/m
        uses_entry_speed = False
        force_jumps = False

        def elastic_force(self, gap):
            return self.stiffness * jnp.maximum(gap.depth, 0.0)

        def force(self, gap, entry_speed):
            return self.elastic_force(gap) * jnp.maximum(1.0 + self.damping * gap.rate, 0.0)

        def stored_energy(self, gap):
            return 0.5 * self.stiffness * jnp.maximum(gap.depth, 0.0) ** 2

    law = Elastomer(stiffness=1e8, damping=0.5)
    check_law(law)
    scene, state = cj.mechanisms.double_pendulum(law=law)
    ```
    """

    if TYPE_CHECKING:  # pyright takes equinox's for a field
        uses_entry_speed: ClassVar[bool]
    else:
        uses_entry_speed: eqx.AbstractClassVar[bool]
    force_jumps = True

    def __init_subclass__(cls, **options: object):
        super().__init_subclass__(**options)
        if "force" in cls.__dict__ and "force_jumps" not in cls.__dict__:
            cls.force_jumps = True

    @abc.abstractmethod
    def force(self, gap: Gap, entry_speed: Scalar | None) -> Scalar:
        """Normal force in N, never negative; `entry_speed` is ``None`` without memory."""

    @abc.abstractmethod
    def elastic_force(self, gap: Gap) -> Scalar:
        """The part of the force that comes from stored energy, N."""

    @abc.abstractmethod
    def stored_energy(self, gap: Gap) -> Scalar:
        """Elastic energy in J."""

    def onset_offset(self) -> Scalar:
        """Distance ahead of the surface at which the force begins, m; 0 for an exact law."""
        return 0.0

    def slope_jumps(self) -> bool:
        """Whether the force's slope by the depth may jump where it begins, as that of a spring
        does. Steps that end there are smooth then in spite of it; a law that says no is spared
        that, and one evaluation of the motion at each end of a contact."""
        return True

    def limits(self, gap: Gap) -> tuple[Limit, ...]:
        """What of a gap the law holds for, if not for all; beyond, one is warned."""
        del gap
        return ()


class AbstractElasticLaw(AbstractContactLaw):
    """A law whose `stiffness`, a number or an `AbstractElasticity`, says its elastic force.

    >>> issubclass(cj.laws.Hertz, extend.AbstractElasticLaw), cj.laws.Hertz(1e9).stiffness
    (True, GivenStiffness(stiffness=1000000000.0))
    """

    stiffness: eqx.AbstractVar[AbstractElasticity]

    @classmethod
    def field_converter(cls, name: str) -> Callable[[PyTree], PyTree]:
        """A number given as the `stiffness` is a `GivenStiffness`."""
        return as_stiffness if name == "stiffness" else super().field_converter(name)

    def limits(self, gap: Gap) -> tuple[Limit, ...]:
        """Those of the stiffness."""
        return self.stiffness.limits(gap)


def contact_normal_force(law: AbstractContactLaw, gap: Gap, entry_speed: Scalar | None) -> Scalar:
    """Normal force of a contact, N. Without an entry speed on record (memory zero) the present rate
    stands for it, which it is at the onset.

    >>> law, gap = cj.laws.HuntCrossley(0.8, 1e9), extend.Gap(depth=1e-4, rate=0.1)
    >>> print(f"{extend.contact_normal_force(law, gap, entry_speed=0.1):.1f} N")  # 1000 (1 + 0.3)
    1300.0 N
    """
    if law.uses_entry_speed:
        assert entry_speed is not None
        entry_speed = jnp.where(entry_speed > 0.0, entry_speed, gap.rate)
    return law.force(gap, entry_speed)

"""Interface of the normal contact laws: force from penetration, its rate, and the entry speed.

Laws of the Hunt-Crossley family are in `hunt_crossley` and `damping_factors`, laws with a parallel
dashpot in `dashpots`. Other laws subclass `AbstractContactLaw`; test them with
`clearjoint.testing.check_law`.
"""

import abc
from collections.abc import Callable
from typing import TYPE_CHECKING, ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import PyTree

from ...fields.checks import require
from ...fields.conversion import AbstractConverting
from ...math.vectors import Scalar
from .gap import Gap
from .limits import Limit
from .stiffness import AbstractElasticity, GivenStiffness, as_stiffness

UNKNOWN_ENTRY_SPEED = 1e9
"""Entry speed, m/s, of a contact that exists at the start of the motion.

Its impact is unknown; the large value makes the contact elastic.
"""


class AbstractContactLaw(AbstractConverting):
    """Base class of normal force laws.

    A subclass defines the force, its elastic part and the stored energy, and two class attributes:

    - `uses_entry_speed`: whether the law needs the entry speed of the current contact, which is
      determined at the onset and kept until separation.
    - `force_jumps`: whether the force may be nonzero right after the onset or before separation, as
      with a parallel damper. Derivatives then include the effect of the jump, at the cost of one
      more evaluation per step. A class that defines `force` without this attribute is assumed to
      jump: set ``force_jumps = False`` if the force starts and ends at zero.

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

    if TYPE_CHECKING:  # pyright mistakes AbstractClassVar for a field
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
        """Return the normal force, N, never negative.

        **Arguments:** `gap`: penetration, m, and its rate, m/s. `entry_speed`: m/s, or ``None`` for
        a law that doesn't use the entry speed.
        """

    @abc.abstractmethod
    def elastic_force(self, gap: Gap) -> Scalar:
        """Return the conservative part of the force, N: the derivative of the stored energy."""

    @abc.abstractmethod
    def stored_energy(self, gap: Gap) -> Scalar:
        """Return the elastic energy at a gap, J, zero without contact."""

    def onset_offset(self) -> Scalar:
        """Return the distance of the surfaces at which the force begins, m; 0 by default."""
        return 0.0

    def slope_jumps(self) -> bool:
        """Return whether the derivative of the force by the penetration may jump at the onset.

        It does for a linear spring. If ``True``, the default, steps that end at an onset are
        corrected for the kink. ``False`` saves one evaluation of the motion at each end of a
        contact.
        """
        return True

    def limits(self, gap: Gap) -> tuple[Limit, ...]:
        """Return the validity limits of the law at a gap; an empty tuple by default.

        A warning is issued if a limit is exceeded.
        """
        del gap
        return ()


class AbstractElasticLaw(AbstractContactLaw):
    """A law whose elastic force is defined by its `stiffness`, a number or an `AbstractElasticity`.

    >>> issubclass(cj.laws.Hertz, extend.AbstractElasticLaw), cj.laws.Hertz(1e9).stiffness
    (True, GivenStiffness(stiffness=1000000000.0))
    """

    stiffness: eqx.AbstractVar[AbstractElasticity]

    @classmethod
    def field_converter(cls, name: str) -> Callable[[PyTree], PyTree]:
        """Return a converter that wraps a number given as `stiffness` in a `GivenStiffness`."""
        return as_stiffness if name == "stiffness" else super().field_converter(name)

    def limits(self, gap: Gap) -> tuple[Limit, ...]:
        """Return the validity limits of the stiffness at a gap."""
        return self.stiffness.limits(gap)


class AbstractPowerLaw(AbstractElasticLaw):
    """Base class of laws with the elastic force K delta^n, N, for the penetration delta, m.

    `stiffness` is K in N/m^n or an `AbstractElasticity`; `exponent` is n.
    """

    exponent: eqx.AbstractVar[float]

    def slope_jumps(self) -> bool:
        """Return ``False`` if the exponent is above one: the force then starts with zero slope."""
        return not self.stiffness.begins_flat(self.exponent)

    def elastic_force(self, gap: Gap) -> Scalar:
        """Return K delta^n, N."""
        return self.stiffness.force(gap, self.exponent)

    def stored_energy(self, gap: Gap) -> Scalar:
        """Return K delta^(n+1)/(n+1), J."""
        return self.stiffness.energy(gap, self.exponent)


def require_flat_law(law: object, surfaces: str) -> None:
    """Check that a law can be used between flat surfaces: its stiffness must not depend on radii.

    **Raises:** `ValueError` that names the `surfaces`.
    """
    require(
        isinstance(law, AbstractContactLaw),
        "law",
        law,
        "an AbstractContactLaw",
        "pass a law such as HuntCrossley(0.5, 1e8)",
    )
    if isinstance(law, AbstractElasticLaw):
        require(
            isinstance(law.stiffness, GivenStiffness),
            "law",
            type(law.stiffness).__name__,
            "a law with an explicit stiffness",
            f"{surfaces} are flat, so pass a number in N/m^n as the law's stiffness",
        )


def contact_normal_force(law: AbstractContactLaw, gap: Gap, entry_speed: Scalar | None) -> Scalar:
    """Return the normal force of a contact, N.

    **Arguments:** `law`: the normal law. `gap`: penetration, m, and its rate, m/s. `entry_speed`:
    m/s; ``None`` for a law that doesn't use the entry speed, 0 before the onset is recorded. The
    current rate then replaces the entry speed, with which it agrees at the onset.

    >>> law, gap = cj.laws.HuntCrossley(0.8, 1e9), extend.Gap(depth=1e-4, rate=0.1)
    >>> print(f"{extend.contact_normal_force(law, gap, entry_speed=0.1):.1f} N")  # 1000 (1 + 0.3)
    1300.0 N
    """
    if law.uses_entry_speed:
        assert entry_speed is not None
        entry_speed = jnp.where(entry_speed > 0.0, entry_speed, gap.rate)
    return law.force(gap, entry_speed)

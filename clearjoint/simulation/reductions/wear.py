"""Wear of a bearing's wall, accumulated during a run."""

import math

import equinox as eqx
import jax.numpy as jnp

from ...fields.checks import require_count, require_positive
from ...math.smoothing import norm_and_direction
from ...math.vectors import Scalar, Vector
from ...model.clearance_joints.journal_bases import BASES, HasJournal
from ...model.contact.gap import slip_velocity
from ...model.scene import Scene
from ...quantities.base import require_known
from ...quantities.instant import Instant
from .reductions import AbstractWindowedReduction

WearTally = tuple[Scalar, dict[str, list[Scalar]], dict[str, list[Scalar]]]
"""The latest instant, s; the rates of wear there, m^3/s, and the volumes so far, m^3, by base and
sector."""


class ArchardWear(AbstractWindowedReduction):
    r"""Wear volumes of a bearing's wall, m^3: "" of both bases of the journal together, "V" and "W"
    of each base, and "V 1", "V 2", ... of each sector.

    $$\frac{dV}{dt} = \frac{k F_N |v_t|}{H}$$

    dV = k F_N |v_t|/H dt is integrated by Simpson's rule in each step. Sectors have equal angles
    about the bearing's axis and are fixed to the bearing; the first one begins at the x axis of the
    bearing's frame, that of `JournalOffset`, and their order is from x to y. The geometry of the
    wall does not change: the mean wear depth of a sector is its volume over its area. Only the dry
    contact causes wear, not a film.

    **Arguments:**

    - `joint`: name of a clearance joint.
    - `coefficient`: k, without unit; `hardness`: H, Pa.
    - `sectors`: number of sectors.
    - `after`, `until`: s, the window of time, as for `Peak`.

    **Source:** J. F. Archard 1953.

    >>> wear = cj.ArchardWear("shoulder", coefficient=1e-4, hardness=2e9, sectors=8)
    >>> list(wear.units())[:4]
    ['', 'V', 'W', 'V 1']
    """

    joint: str = eqx.field(static=True)
    coefficient: float = eqx.field(static=True)
    hardness: float = eqx.field(static=True)
    sectors: int = eqx.field(default=12, static=True)

    def __check_init__(self):
        require_positive("coefficient", self.coefficient, "give k, such as 1e-5", zero=True)
        require_positive("hardness", self.hardness, "give H in Pa, such as 2e9")
        require_count("sectors", self.sectors, "give a number of sectors")

    def check(self, scene: Scene) -> None:
        """Check that the scene has the joint, and that it has a journal."""
        joints = scene.contact_joints()
        journals = [name for name, joint in joints.items() if isinstance(joint, HasJournal)]
        require_known("joint", self.joint, journals)

    def start(self, now: Instant) -> WearTally:
        """Return the rates at the start, and zero volumes."""
        none: dict[str, list[Scalar]] = {base: [jnp.zeros(())] * self.sectors for base in BASES}
        return now.time, self._rates(now), none

    def update(self, tally: WearTally, now: Instant) -> WearTally:
        """Add the volumes of the step's part in the window."""
        before, at_start, volumes = tally
        latest = at_end = self._rates(now)
        window, length, middle = self._window(), now.time - before, now.middle
        if not window.is_whole:
            a, b = window.fractions(before, now.time)
            at_start, at_end = self._rates(now.inside(a)), self._rates(now.inside(b))
            length, middle = length * (b - a), now.inside(0.5 * (a + b))
        at_middle, sixth = self._rates(middle), length / 6.0
        worn = {
            base: [
                volume + sixth * (start + 4.0 * middle + end)
                for volume, start, middle, end in zip(
                    volumes[base], at_start[base], at_middle[base], at_end[base], strict=True
                )
            ]
            for base in BASES
        }
        return now.time, latest, worn

    def results(self, tally: WearTally, now: Instant) -> dict[str, Scalar]:
        """Return the wear volumes up to the end of the run, or in the window, m^3."""
        _, _, volumes = tally
        of_bases = {base: sum(family[1:], family[0]) for base, family in volumes.items()}
        of_sectors = {
            self._label(base, k): volume
            for base, family in volumes.items()
            for k, volume in enumerate(family)
        }
        both = [of_bases[base] for base in BASES]
        volumes_by_name = {"": sum(both[1:], both[0]), **of_bases, **of_sectors}
        window = self._window()
        return {name: window.if_reached(v, now.time) for name, v in volumes_by_name.items()}

    def units(self) -> dict[str, str]:
        """Return m^3 for each."""
        of_sectors = [self._label(base, k) for base in BASES for k in range(self.sectors)]
        return dict.fromkeys(("", *BASES, *of_sectors), "m^3")

    def _label(self, base: str, sector: int) -> str:
        return f"{base} {sector + 1}"

    def _rates(self, now: Instant) -> dict[str, list[Scalar]]:
        """Return the rates of wear by base and sector, m^3/s."""
        return {base: self._rates_at(now, base) for base in BASES}

    def _rates_at(self, now: Instant, base: str) -> list[Scalar]:
        joint, force = now.scene.joints[self.joint], now.contacts[self.joint][base]
        assert isinstance(joint, HasJournal)
        speed = self._sliding_speed(now, base)
        rate = jnp.asarray(self.coefficient / self.hardness * force.normal_force * speed, float)
        offset = joint.journal_offset(now.motions, base)
        turns = jnp.arctan2(offset.y, offset.x) / (2.0 * math.pi)
        sector = jnp.floor((turns - jnp.floor(turns)) * self.sectors)
        # Rounding may make the fraction of a turn exactly 1.
        sector = jnp.minimum(sector, self.sectors - 1)
        return [jnp.where(sector == k, rate, 0.0) for k in range(self.sectors)]

    def _sliding_speed(self, now: Instant, base: str) -> Scalar:
        """Return the sliding speed at a base, m/s, also in a joint without friction."""
        contact = now.contacts[self.joint][base].contact
        first, second = (
            now.motions[name] for name in now.scene.contact_joints()[self.joint].pair()
        )
        sliding: Vector = second.velocity_at(contact.arm_second) - first.velocity_at(
            contact.arm_first
        )
        slip = slip_velocity(sliding, contact.normal, sliding.dot(contact.normal))
        return norm_and_direction(slip)[0]

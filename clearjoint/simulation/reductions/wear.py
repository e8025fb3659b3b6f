"""Reduction for the wear of a bearing's wall by Archard's law."""

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
"""State of `ArchardWear`: the latest time, s; the rates of wear there, m^3/s; and the worn volumes
so far, m^3. Rates and volumes are dicts by base ("V", "W") of lists by sector."""


class ArchardWear(AbstractWindowedReduction):
    r"""Volumes, m^3, that sliding contacts wear off a bearing's wall.

    $$\frac{dV}{dt} = \frac{k F_N |v_t|}{H}$$

    with the volume V, m^3, the normal contact force F_N, N, and the sliding speed |v_t|, m/s,
    integrated by Simpson's rule in each step. The results are named "" (both bases of the journal
    together), "V" and "W" (each base), and "V 1", "V 2", ..., "W 1", ... (sectors of each base).
    Sectors have equal angles about the bearing's axis and are fixed to the bearing. Sector 1 begins
    at the x axis of the bearing's frame, the frame of `JournalOffset`; the angle grows from x to y.
    The geometry of the wall does not change: the mean wear depth of a sector is its volume over its
    area. Only the dry contact causes wear, not a film.

    **Arguments:**

    - `joint`: name of a clearance joint with a journal.
    - `coefficient`: k, without unit; `hardness`: H, Pa.
    - `sectors`: number of sectors of each base.
    - `after`, `until`: s, the window of time, by default the whole run. All results are NaN if the
      run ended before the window.

    **Raises:** `ValueError` for a number outside of its range, and for a window that does not end
    after its start.

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
        """Check that the scene has the joint, and that the joint has a journal.

        **Raises:** `ValueError` that lists the names of such joints.
        """
        joints = scene.contact_joints()
        journals = [name for name, joint in joints.items() if isinstance(joint, HasJournal)]
        require_known("joint", self.joint, journals)

    def start(self, now: Instant) -> WearTally:
        """Return the tally at the start of the run, with volumes of zero."""
        none: dict[str, list[Scalar]] = {base: [jnp.zeros(())] * self.sectors for base in BASES}
        return now.time, self._rates(now), none

    def update(self, tally: WearTally, now: Instant) -> WearTally:
        """Return the tally with the volumes added that wear in the part of the step in the
        window."""
        before, at_start, volumes = tally
        latest = at_end = self._rates(now)
        window, length, middle = self._window(), now.time - before, now.middle
        if not window.is_whole:
            a, b = window.fractions(before, now.time)
            at_start, at_end = self._rates(now.inside(a)), self._rates(now.inside(b))
            length, middle = length * (b - a), now.inside(0.5 * (a + b))
        # Simpson's rule: rates at both ends and in the middle of the part in the window.
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
        """Return the worn volumes, m^3, by result name; NaN if the run ended before the window."""
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
        """Return "m^3" for each result."""
        of_sectors = [self._label(base, k) for base in BASES for k in range(self.sectors)]
        return dict.fromkeys(("", *BASES, *of_sectors), "m^3")

    def _label(self, base: str, sector: int) -> str:
        return f"{base} {sector + 1}"

    def _rates(self, now: Instant) -> dict[str, list[Scalar]]:
        """Return the rates of wear, m^3/s, as a dict by base of lists by sector."""
        return {base: self._rates_at(now, base) for base in BASES}

    def _rates_at(self, now: Instant, base: str) -> list[Scalar]:
        """Return the rate of wear of each sector at a base, m^3/s; only the sector in contact
        wears."""
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
        """Return the sliding speed of the surfaces at a base, m/s; defined without friction too."""
        contact = now.contacts[self.joint][base].contact
        first, second = (
            now.motions[name] for name in now.scene.contact_joints()[self.joint].pair()
        )
        sliding: Vector = second.velocity_at(contact.arm_second) - first.velocity_at(
            contact.arm_first
        )
        slip = slip_velocity(sliding, contact.normal, sliding.dot(contact.normal))
        return norm_and_direction(slip)[0]

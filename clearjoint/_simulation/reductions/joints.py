"""Reductions of joints: number of impacts, dissipated energy, and wear."""

import math
from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from typing_extensions import override

from ..._fields.checks import require_count, require_positive
from ..._math.smoothing import norm_and_direction, where
from ..._math.vectors import Condition, Scalar, Vector, add
from ..._model.clearance_joints.journal_bases import BASES, HasJournal, require_bases_only
from ..._model.contact.laws import slip_velocity
from ..._model.scene import Scene
from ...quantities.base import Instant, Quantity, require_known
from .base import AbstractWindowedReduction

LOSSES = ("normal damping", "friction", "film")
"""Names of the integrals of the energy ledger, J, that are losses in joints."""


class CountTally(NamedTuple):
    """Tally of `ImpactCount`: the number of onsets in the window so far; by label, whether each
    contact touches; the end of the latest step, s, or ``None`` if the window is the whole run."""

    count: Scalar
    touching: dict[str, Condition]
    time: Scalar | None


class ImpactCount(AbstractWindowedReduction):
    """Number of impacts of a joint: the onsets of all of its contacts together.

    A contact that exists at the start of the run does not count, nor does one that begins and ends
    within one step, which is rare with the default `landing_tolerance` of `Settings`.

    **Arguments:** `joint`: name of a joint with contacts; `after`, `until`: s, the window of time,
    by default the whole run; see `Peak`.

    >>> cj.ImpactCount("shoulder")
    ImpactCount(joint='shoulder')
    """

    joint: str = eqx.field(static=True)

    @override
    def check(self, scene: Scene) -> None:
        require_known("joint", self.joint, scene.contact_joints())

    def _touching(self, now: Instant) -> dict[str, Condition]:
        return {label: gap.depth > 0.0 for label, gap in now.contact_gaps[self.joint].items()}

    @override
    def start(self, now: Instant) -> CountTally:
        window = self._window(now)
        count = window.if_ahead(jnp.zeros(()), now.time)
        return CountTally(count, self._touching(now), None if window.is_whole else now.time)

    @override
    def update(self, tally: CountTally, now: Instant) -> CountTally:
        count, after = tally.count, self._touching(now)
        for label, touches in after.items():
            # A contact that touches now, but did not at the end of the step before.
            begins = touches & ~tally.touching[label]
            if tally.time is not None:
                begins = begins & self._window(now).holds(self._onset(label, tally.time, now))
            count = count + jnp.where(begins, 1.0, 0.0)
        return CountTally(count, after, None if tally.time is None else now.time)

    def _onset(self, label: str, before: Scalar, now: Instant) -> Scalar:
        # To first order, the time since the onset is the penetration at the end of the step over
        # the rate there; zero if the surfaces already move apart. It is at most the step's length.
        gap = now.contact_gaps[self.joint][label]
        since = gap.depth / jnp.where(gap.rate > 0.0, gap.rate, jnp.inf)
        return now.time - jnp.clip(since, 0.0, now.time - before)

    @override
    def results(self, tally: CountTally, now: Instant) -> dict[str, Scalar]:
        return {"": self._window(now).if_reached(tally.count, now.time)}

    @override
    def units(self) -> dict[str, str]:
        return {"": "1"}


class LossTally(NamedTuple):
    """Tally of a reduction of losses. `begin`, `time`: start of the run and end of the latest step,
    s. `at_begin`, `at_end`: energies, J, dissipated up to the start and up to the end of the
    window. While the start or the end lies ahead, its energy is that up to `time`. If the window is
    the whole run, `at_begin` is the energy at `begin`, and `time` and `at_end` are ``None``."""

    begin: Scalar
    at_begin: Scalar
    time: Scalar | None
    at_end: Scalar | None


class AbstractLossReduction(AbstractWindowedReduction):
    """Base class of reductions of the energy that joints dissipate in a window, taken from the
    energy ledger of the run."""

    needs_ledger = True
    differentiated = ("",)

    @override
    def observed(self) -> tuple[Quantity, ...]:
        return (_lost,)

    @override
    def start(self, now: Instant) -> LossTally:
        window = self._window(now)
        lost = window.if_ahead(_lost(now), now.time)
        tally = LossTally(begin=now.time, at_begin=lost, time=now.time, at_end=lost)
        return tally._replace(time=None, at_end=None) if window.is_whole else tally

    @override
    def update(self, tally: LossTally, now: Instant) -> LossTally:
        if tally.time is None or tally.at_end is None:  # the window is the whole run
            return tally
        lost, window, step_begin = _lost(now), self._window(now), tally.time

        # The losses up to an edge of the window, which lies at `fraction` of this step. Before the
        # edge, they are the losses so far. In the step across the edge, they are the losses at the
        # edge, by dense output. After the edge, they stay as `before` this step.
        def up_to(edge: Scalar, fraction: Scalar, before: Scalar) -> Scalar:
            at_edge = _lost(now.inside(fraction))
            return jnp.where(now.time <= edge, lost, jnp.where(step_begin < edge, at_edge, before))

        x_begin, x_end = window.fractions(step_begin, now.time)
        at_begin = up_to(window.start, x_begin, tally.at_begin)
        at_end = up_to(window.end, x_end, tally.at_end)
        return tally._replace(at_begin=at_begin, time=now.time, at_end=at_end)

    def _inside(self, tally: LossTally, now: Instant) -> Scalar:
        return (_lost(now) if tally.at_end is None else tally.at_end) - tally.at_begin


class DissipatedEnergy(AbstractLossReduction):
    """Energy, J, dissipated in joints by normal damping, friction and films.

    It needs `Settings(ledger=True)`. Energy that bristles store is not included, nor is energy
    dissipated in an earlier run whose ledger this run continues.

    **Arguments:** `after`, `until`: s, the window of time, by default the whole run; see `Peak`.

    >>> outputs = {"losses": cj.DissipatedEnergy()}  # needs Settings(ledger=True)
    >>> outputs["losses"].needs_ledger
    True
    """

    @override
    def combined(self, values: jax.Array, instants: tuple[float, ...]) -> dict[str, Scalar]:
        return {"": values[1, 0] - values[0, 0]}

    @override
    def results(self, tally: LossTally, now: Instant) -> dict[str, Scalar]:
        return {"": self._window(now).if_reached(self._inside(tally, now), now.time)}

    @override
    def units(self) -> dict[str, str]:
        return {"": "J"}


class MeanPowerLost(AbstractLossReduction):
    """Mean power, W, lost in joints to normal damping, friction and films, in the window.

    It needs `Settings(ledger=True)`. The mean is over the part of the window that the run covers.

    **Arguments:** `after`, `until`: s, the window of time, by default the whole run; see `Peak`.

    >>> outputs = {"heating": cj.MeanPowerLost(after=0.5)}  # needs Settings(ledger=True)
    >>> outputs["heating"].units()
    {'': 'W'}
    """

    @override
    def combined(self, values: jax.Array, instants: tuple[float, ...]) -> dict[str, Scalar]:
        return {"": (values[1, 0] - values[0, 0]) / (instants[1] - instants[0])}

    @override
    def results(self, tally: LossTally, now: Instant) -> dict[str, Scalar]:
        window = self._window(now)
        # Of the part of the window that the run covers; not positive if there is no such part.
        duration = jnp.minimum(now.time, window.end) - jnp.maximum(tally.begin, window.start)
        reached, lost = duration > 0.0, self._inside(tally, now)
        return {"": jnp.where(reached, lost / jnp.where(reached, duration, 1.0), jnp.nan)}

    @override
    def units(self) -> dict[str, str]:
        return {"": "W"}


def _lost(now: Instant) -> Scalar:
    lost: Scalar = 0.0
    for name in LOSSES:
        lost = add(lost, now.work.get(name, 0.0))
    # The ledger counts the energy that bristles store as dissipated by friction.
    if (stored := now.bristle_energy) is not None:
        lost = lost - stored
    return lost


WearTally = tuple[Scalar, dict[str, list[Scalar]], dict[str, list[Scalar]]]
"""Tally of `ArchardWear`: the end of the latest step, s; the rates of wear then, m^3/s; and the
volumes worn so far, m^3. Both are dictionaries by base, of lists with a number for each sector."""


class ArchardWear(AbstractWindowedReduction):
    r"""Volumes, m^3, that sliding contacts wear off a bearing's wall, by Archard's law.

    $$\frac{dV}{dt} = \frac{k F_N |v_t|}{H}$$

    with the volume V, m^3, the normal contact force F_N, N, and the sliding speed |v_t|, m/s, is
    integrated by Simpson's rule in each step. The bases "V" and "W" are the end circles of the
    journal, where it touches the wall. The results are named "" (both bases together), "V" and "W"
    (each base), and "V 1", "V 2", ..., "W 1", ... (the sectors of the wall at each base).

    Sectors have equal angles about the bearing's axis and are fixed to the bearing. Sector 1 begins
    at the x axis of the bearing's frame, whose z axis is the bearing's axis (see the quantity
    `JournalOffset`); the angle grows from x to y. The mean wear depth of a sector is its worn
    volume over its area. Wear does not change the shape of the wall in the simulation. Only the dry
    contact causes wear, not a film.

    **Arguments:**

    - `joint`: name of a clearance joint with a journal that touches the wall at its bases only.
    - `coefficient`: k, without unit; `hardness`: H, Pa.
    - `sectors`: number of sectors of each base.
    - `after`, `until`: s, the window of time, by default the whole run; see `Peak`.

    **Raises:** `ValueError` for a negative `coefficient`, or `hardness` or `sectors` not positive.

    **Source:** J. F. Archard, Contact and rubbing of flat surfaces (1953).

    >>> wear = cj.ArchardWear("shoulder", coefficient=1e-4, hardness=2e9, sectors=8)
    >>> list(wear.units())[:4]
    ['', 'V', 'W', 'V 1']
    """

    joint: str = eqx.field(static=True)
    coefficient: float = eqx.field(static=True)
    hardness: float = eqx.field(static=True)
    sectors: int = eqx.field(default=12, static=True)

    @override
    def __check_init__(self):
        require_positive("coefficient", self.coefficient, "give k, such as 1e-5", zero=True)
        require_positive("hardness", self.hardness, "give H in Pa, such as 2e9")
        require_count("sectors", self.sectors, "give a number of sectors")

    @override
    def check(self, scene: Scene) -> None:
        joints = scene.contact_joints()
        journals = [name for name, joint in joints.items() if isinstance(joint, HasJournal)]
        require_known("joint", self.joint, journals)
        require_bases_only("joint", self.joint, joints[self.joint].laws())

    @override
    def start(self, now: Instant) -> WearTally:
        zero = self._window(now).if_ahead(jnp.zeros(()), now.time)
        return now.time, self._rates(now), {base: [zero] * self.sectors for base in BASES}

    @override
    def update(self, tally: WearTally, now: Instant) -> WearTally:
        # If the window is the whole run, the rates at the start of the step are known: they are
        # those at the end of the step before. In other windows, the rates at both ends of the part
        # of the step that is in the window come from the dense output.
        before, at_start, volumes = tally
        latest = at_end = self._rates(now)
        window, length, middle = self._window(now), now.time - before, now.middle
        # A step that ends at a jump of forces is integrated with the rates just before the jump.
        # The next step starts with `latest`, the rates after it.
        if now.jumps is not None:
            at_end = jax.tree.map(partial(where, now.jumps), self._rates(now.just_before), latest)
        if not window.is_whole:
            a, b = window.fractions(before, now.time)
            at_start = self._rates(now.inside(a))
            # At the latest just before a jump at the end of the step, as above.
            at_end = self._rates(now.inside(jnp.minimum(b, now.last_fraction)))
            length, middle = length * (b - a), now.inside(0.5 * (a + b))
        # Simpson's rule: rates at both ends and in the middle of the part in the window.
        at_middle, sixth = self._rates(middle), length / 6.0

        def worn(volume: Scalar, start: Scalar, middle: Scalar, end: Scalar) -> Scalar:
            return volume + sixth * (start + 4.0 * middle + end)

        return now.time, latest, jax.tree.map(worn, volumes, at_start, at_middle, at_end)

    @override
    def results(self, tally: WearTally, now: Instant) -> dict[str, Scalar]:
        _, _, volumes = tally
        # Sums begin with the first volume: from the number 0, there would be one more operation.
        of_bases = {base: sum(sectors[1:], sectors[0]) for base, sectors in volumes.items()}
        of_sectors = {
            self._label(base, k): volume
            for base, sectors in volumes.items()
            for k, volume in enumerate(sectors)
        }
        totals = [of_bases[base] for base in BASES]
        volumes_by_name = {"": sum(totals[1:], totals[0]), **of_bases, **of_sectors}
        window = self._window(now)
        return {name: window.if_reached(v, now.time) for name, v in volumes_by_name.items()}

    @override
    def units(self) -> dict[str, str]:
        of_sectors = [self._label(base, k) for base in BASES for k in range(self.sectors)]
        return dict.fromkeys(("", *BASES, *of_sectors), "m^3")

    def _label(self, base: str, sector: int) -> str:
        return f"{base} {sector + 1}"

    def _rates(self, now: Instant) -> dict[str, list[Scalar]]:
        joint, rates = now.scene.joints[self.joint], {}
        assert isinstance(joint, HasJournal)
        for base in BASES:
            force, speed = now.contacts[self.joint][base], sliding_speed(now, self.joint, base)
            rate = jnp.asarray(self.coefficient / self.hardness * force.normal_force * speed, float)
            offset = joint.journal_offset(now.motions, base)
            # The angle about the axis, in turns, of which the whole turns are dropped.
            turns = jnp.arctan2(offset.y, offset.x) / (2.0 * math.pi)
            sector = jnp.floor((turns - jnp.floor(turns)) * self.sectors)
            # Rounding may make the fraction of a turn exactly 1.
            sector = jnp.minimum(sector, self.sectors - 1)
            # Only the sector at which the base touches the wall is worn.
            rates[base] = [jnp.where(sector == k, rate, 0.0) for k in range(self.sectors)]
        return rates


def sliding_speed(now: Instant, joint: str, label: str) -> Scalar:
    """Return the speed, m/s, at which the surfaces of a contact, such as "V", slide on each other.
    The motion gives the speed, because only contact forces with friction have a `slip`."""
    contact = now.contacts[joint][label].contact
    pair = now.scene.contact_joints()[joint].pair()
    first, second = (now.motions[name] for name in pair)
    at_second, at_first = contact.arm_second, contact.arm_first
    sliding: Vector = second.velocity_at(at_second) - first.velocity_at(at_first)
    slip = slip_velocity(sliding, contact.normal, sliding.dot(contact.normal))
    return norm_and_direction(slip)[0]

"""Reductions of joints: number of impacts, dissipated energy, and wear, which are updated at every
accepted step of a run.

An onset is the beginning of a contact. An `Instant` is a scene with its motion at one time of a
run. The energy ledger consists of integrals of dissipated and supplied powers since the start of a
run, J, which the solver computes with `Settings(ledger=True)`. Bristles are elastic deflections of
the surfaces in friction laws that can stick; the ledger counts their energy as friction, although
they may return it.
"""

import math
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp

from ..._fields.checks import require_count, require_positive
from ..._math.smoothing import norm_and_direction
from ..._math.vectors import Condition, Scalar, Vector, add
from ..._model.clearance_joints.journal_bases import BASES, HasJournal, require_bases_only
from ..._model.contact.laws import slip_velocity
from ..._model.scene import Scene
from ...quantities.base import Instant, require_known
from .base import AbstractWindowedReduction

LOSSES = ("normal damping", "friction", "film")
"""Names of the integrals of the energy ledger, J, that are losses in joints."""


class CountTally(NamedTuple):
    """Tally of `ImpactCount`, the data that it carries from step to step.

    - `count`: number of onsets so far.
    - `touching`: whether each contact of the joint touches at the end of the latest step, by its
      label.
    - `time`: s, the end of the latest step; ``None`` if the window is the whole run.
    """

    count: Scalar
    touching: dict[str, Condition]
    time: Scalar | None


class ImpactCount(AbstractWindowedReduction):
    """Number of impacts of a joint: the onsets of all of its contacts together.

    A contact that exists at the start of the run does not count. An onset is found from the
    contacts at both ends of a step. A contact that begins and ends within one step is therefore not
    counted. Such contacts are rare where steps end at onsets, as they do with the default
    `landing_tolerance` of `Settings`.

    **Arguments:**

    - `joint`: name of the joint.
    - `after`, `until`: s, the window of time, by default the whole run; onsets outside of it do not
      count. The result is NaN if the run ended before the window.

    **Raises:** `ValueError` if `after` or `until` is NaN or not a single number, or `until` is not
    later than `after`.

    >>> cj.ImpactCount("shoulder")
    ImpactCount(joint='shoulder')
    """

    joint: str = eqx.field(static=True)

    def check(self, scene: Scene) -> None:
        """Check that the scene has the joint, and that the joint has contacts.

        **Raises:** `ValueError` if not; the message lists the names of joints with contacts.
        """
        require_known("joint", self.joint, scene.contact_joints())

    def _touching(self, now: Instant) -> dict[str, Condition]:
        return {label: gap.depth > 0.0 for label, gap in now.contact_gaps[self.joint].items()}

    def start(self, now: Instant) -> CountTally:
        """Return the tally at the start of the run, with a count of zero."""
        time = None if self._window(now).is_whole else now.time
        return CountTally(jnp.zeros(()), self._touching(now), time)

    def update(self, tally: CountTally, now: Instant) -> CountTally:
        """Return the tally after a step. The count grows by one for each contact that began in the
        step and in the window."""
        count, after = tally.count, self._touching(now)
        for label, touches in after.items():
            begins = touches & ~tally.touching[label]
            if tally.time is not None:
                begins = begins & self._window(now).holds(self._onset(label, tally.time, now))
            count = count + jnp.where(begins, 1.0, 0.0)
        return CountTally(count, after, None if tally.time is None else now.time)

    def _onset(self, label: str, before: Scalar, now: Instant) -> Scalar:
        """Return the time, s, at which a contact with a `label` began in the step from the time
        `before`, s, to the instant `now`.

        To first order, the penetration at the end of the step, over its rate there, is the time
        since the onset. If the surfaces already move apart at the end of the step, the result is
        the time of this end. It is never before the start of the step.
        """
        gap = now.contact_gaps[self.joint][label]
        since = gap.depth / jnp.where(gap.rate > 0.0, gap.rate, jnp.inf)
        return now.time - jnp.clip(since, 0.0, now.time - before)

    def results(self, tally: CountTally, now: Instant) -> dict[str, Scalar]:
        """Return the number of onsets in the window; NaN if the run ended before the window."""
        return {"": self._window(now).if_reached(tally.count, now.time)}

    def units(self) -> dict[str, str]:
        """Return "1": a count has no unit."""
        return {"": "1"}


class LossTally(NamedTuple):
    """Tally of a reduction of losses, the data that it carries from step to step.

    Energies are those that the ledger has counted as dissipated, without the energy that bristles
    have stored.

    - `begin`: s, the start of the run.
    - `at_begin`: J, energy dissipated up to the start of the window; up to the end of the latest
      step as long as the run has not reached the start of the window; up to the start of the run if
      the run starts later than this.
    - `time`: s, the end of the latest step.
    - `at_end`: J, energy dissipated up to the end of the window, with the same two exceptions for
      the end of the window instead of its start.

    `time` and `at_end` are ``None`` if the window is the whole run. The ledger at the end of the
    run then takes the place of `at_end`.
    """

    begin: Scalar
    at_begin: Scalar
    time: Scalar | None
    at_end: Scalar | None


class AbstractLossReduction(AbstractWindowedReduction):
    """Base class of reductions of the energy that joints dissipate in a window of time.

    The energy is taken from the ledger, the integrals of powers that the solver computes with
    `Settings(ledger=True)`.
    """

    needs_ledger = True

    def start(self, now: Instant) -> LossTally:
        """Return the tally at the start of the run.

        The energy that counts as dissipated at the start is zero, unless the run continues from the
        ledger or the bristles of an earlier run.
        """
        lost, whole = _lost(now), self._window(now).is_whole
        return LossTally(now.time, lost, None if whole else now.time, None if whole else lost)

    def update(self, tally: LossTally, now: Instant) -> LossTally:
        """Return the tally after the step that ends at `now`, with the energies up to the edges of
        the window updated."""
        if tally.time is None or tally.at_end is None:
            return tally
        lost, window = _lost(now), self._window(now)
        # Before an edge of the window, the tally has the losses so far. In the step across the
        # edge, it gets the losses at the edge, by dense output. Then they stay.
        at_begin, at_end = [
            jnp.where(now.time <= edge, lost, jnp.where(tally.time < edge, _lost(inside), known))
            for edge, inside, known in zip(
                (window.start, window.end),
                map(now.inside, window.fractions(tally.time, now.time)),
                (tally.at_begin, tally.at_end),
                strict=True,
            )
        ]
        return LossTally(tally.begin, at_begin, now.time, at_end)

    def _inside(self, tally: LossTally, now: Instant) -> Scalar:
        """Return the energy, J, dissipated in the part of the window that the run covers, from the
        last tally and the end of the run."""
        return (_lost(now) if tally.at_end is None else tally.at_end) - tally.at_begin


class DissipatedEnergy(AbstractLossReduction):
    """Energy, J, dissipated in joints by normal damping, friction and films.

    It needs `Settings(ledger=True)`, with which the solver integrates the dissipated powers.

    If the run continues the ledger of an earlier run, the energy that the earlier run dissipated is
    not included. Energy that bristles store is not included either.

    **Arguments:** `after`, `until`: s, the window of time, by default the whole run. The result is
    NaN if the run ended before the window.

    **Raises:** `ValueError` if `after` or `until` is NaN or not a single number, or `until` is not
    later than `after`.

    >>> outputs = {"losses": cj.DissipatedEnergy()}  # needs Settings(ledger=True)
    >>> outputs["losses"].needs_ledger
    True
    """

    def results(self, tally: LossTally, now: Instant) -> dict[str, Scalar]:
        """Return the energy, J, dissipated in the window; NaN if the run ended before it."""
        return {"": self._window(now).if_reached(self._inside(tally, now), now.time)}

    def units(self) -> dict[str, str]:
        """Return "J" for the energy."""
        return {"": "J"}


class MeanPowerLost(AbstractLossReduction):
    """Mean power, W, lost in joints to normal damping, friction and films.

    It needs `Settings(ledger=True)`, with which the solver integrates the dissipated powers.

    **Arguments:** `after`, `until`: s, the window of time, by default the whole run. The mean is
    over the part of the window that the run covers; it is NaN if there is no such part.

    **Raises:** `ValueError` if `after` or `until` is NaN or not a single number, or `until` is not
    later than `after`.

    >>> outputs = {"heating": cj.MeanPowerLost(after=0.5)}  # needs Settings(ledger=True)
    >>> outputs["heating"].units()
    {'': 'W'}
    """

    def results(self, tally: LossTally, now: Instant) -> dict[str, Scalar]:
        """Return the mean power, W, over the part of the window that the run covers; NaN if there
        is no such part."""
        window = self._window(now)
        duration = jnp.minimum(now.time, window.end) - jnp.maximum(tally.begin, window.start)
        reached, lost = duration > 0.0, self._inside(tally, now)
        return {"": jnp.where(reached, lost / jnp.where(reached, duration, 1.0), jnp.nan)}

    def units(self) -> dict[str, str]:
        """Return "W" for the mean power."""
        return {"": "W"}


def _lost(now: Instant) -> Scalar:
    """Return the energy, J, that the ledger has counted as dissipated in joints up to an instant,
    without the energy that bristles have stored."""
    lost: Scalar = 0.0
    for name in LOSSES:
        lost = add(lost, now.work.get(name, 0.0))
    if (stored := now.bristle_energy) is not None:
        lost = lost - stored
    return lost


WearTally = tuple[Scalar, dict[str, list[Scalar]], dict[str, list[Scalar]]]
"""Tally of `ArchardWear`, the data that it carries from step to step: the time at the end of the
latest step, s; the rates of wear at that time, m^3/s; and the worn volumes so far, m^3. Rates and
volumes are dictionaries. For each base ("V" and "W", the end circles of the journal) they contain a
list with one number for each sector of the bearing's wall."""


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
    - `after`, `until`: s, the window of time, by default the whole run. All results are NaN if the
      run ended before the window.

    **Raises:** `ValueError` if `coefficient` is negative, `hardness` not positive or `sectors` not
    a positive integer, if `after` or `until` is NaN or not a single number, or if `until` is not
    later than `after`.

    **Source:** J. F. Archard, Contact and rubbing of flat surfaces (1953).

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
        """Check that the scene has the joint, and that the joint has a journal that touches the
        wall at its bases only.

        **Raises:** `ValueError` for a joint without a journal, or an unknown one, with a list of
        the joints with a journal; `ValueError` for a journal that touches the wall between its
        bases too, with the names of those contacts.
        """
        joints = scene.contact_joints()
        journals = [name for name, joint in joints.items() if isinstance(joint, HasJournal)]
        require_known("joint", self.joint, journals)
        require_bases_only("joint", self.joint, joints[self.joint].laws())

    def start(self, now: Instant) -> WearTally:
        """Return the tally at the start of the run: its time, the rates of wear then, and worn
        volumes of zero."""
        none: dict[str, list[Scalar]] = {base: [jnp.zeros(())] * self.sectors for base in BASES}
        return now.time, self._rates(now), none

    def update(self, tally: WearTally, now: Instant) -> WearTally:
        """Return the tally after a step. The volumes worn in the part of the step that is in the
        window are added."""
        # If the window is the whole run, the rates at the start of the step are known: they are
        # those at the end of the step before. In other windows, the rates at both ends of the part
        # of the step that is in the window come from the dense output.
        before, at_start, volumes = tally
        latest = at_end = self._rates(now)
        window, length, middle = self._window(now), now.time - before, now.middle
        if not window.is_whole:
            a, b = window.fractions(before, now.time)
            at_start, at_end = self._rates(now.inside(a)), self._rates(now.inside(b))
            length, middle = length * (b - a), now.inside(0.5 * (a + b))
        # Simpson's rule: rates at both ends and in the middle of the part in the window.
        at_middle, sixth = self._rates(middle), length / 6.0
        worn = jax.tree.map(
            lambda volume, start, middle, end: volume + sixth * (start + 4.0 * middle + end),
            *(volumes, at_start, at_middle, at_end),
        )
        return now.time, latest, worn

    def results(self, tally: WearTally, now: Instant) -> dict[str, Scalar]:
        """Return the worn volumes, m^3, by name of the result, such as "", "V" and "V 1"; NaN if
        the run ended before the window."""
        _, _, volumes = tally
        of_bases = {base: sum(family[1:], family[0]) for base, family in volumes.items()}
        of_sectors = {
            self._label(base, k): volume
            for base, family in volumes.items()
            for k, volume in enumerate(family)
        }
        both = [of_bases[base] for base in BASES]
        volumes_by_name = {"": sum(both[1:], both[0]), **of_bases, **of_sectors}
        window = self._window(now)
        return {name: window.if_reached(v, now.time) for name, v in volumes_by_name.items()}

    def units(self) -> dict[str, str]:
        """Return "m^3" for each result."""
        of_sectors = [self._label(base, k) for base in BASES for k in range(self.sectors)]
        return dict.fromkeys(("", *BASES, *of_sectors), "m^3")

    def _label(self, base: str, sector: int) -> str:
        return f"{base} {sector + 1}"

    def _rates(self, now: Instant) -> dict[str, list[Scalar]]:
        """Return the rates of wear at an instant, m^3/s: for each base, a list with one number for
        each sector."""
        return {base: self._rates_at(now, base) for base in BASES}

    def _rates_at(self, now: Instant, base: str) -> list[Scalar]:
        """Return the rate of wear of each sector of one base at an instant, m^3/s.

        Only one sector wears: the one in the direction from the bearing's axis to the base's
        centre, in which the base touches the wall. Without contact all rates are zero.
        """
        joint, force = now.scene.joints[self.joint], now.contacts[self.joint][base]
        assert isinstance(joint, HasJournal)
        speed = sliding_speed(now, self.joint, base)
        rate = jnp.asarray(self.coefficient / self.hardness * force.normal_force * speed, float)
        offset = joint.journal_offset(now.motions, base)
        # The angle about the axis, in turns, of which the whole turns are dropped.
        turns = jnp.arctan2(offset.y, offset.x) / (2.0 * math.pi)
        sector = jnp.floor((turns - jnp.floor(turns)) * self.sectors)
        # Rounding may make the fraction of a turn exactly 1.
        sector = jnp.minimum(sector, self.sectors - 1)
        return [jnp.where(sector == k, rate, 0.0) for k in range(self.sectors)]


def sliding_speed(now: Instant, joint: str, label: str) -> Scalar:
    """Return the speed, m/s, at which the surfaces of a contact slide on each other.

    It is computed from the motion, since forces of contacts without friction contain no sliding
    speed.

    **Arguments:** `now`: the instant; `joint`: name of the joint; `label`: label of its contact,
    such as "V".
    """
    contact = now.contacts[joint][label].contact
    pair = now.scene.contact_joints()[joint].pair()
    first, second = (now.motions[name] for name in pair)
    at_second, at_first = contact.arm_second, contact.arm_first
    sliding: Vector = second.velocity_at(at_second) - first.velocity_at(at_first)
    slip = slip_velocity(sliding, contact.normal, sliding.dot(contact.normal))
    return norm_and_direction(slip)[0]

"""The revolute joint with clearance and a film of lubricant in it."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from ...fields.checks import require
from ...fields.declarations import quantity
from ...fields.types import Single
from ...math.rotations import unit
from ...math.smoothing import norm_and_direction, ramp
from ...math.vectors import Scalar, Vector
from ..bodies import NO_WRENCH, Wrench
from ..contact.bristles import AbstractBristleFriction
from ..contact.gap import Gap
from ..contact.laws import AbstractContactLaw
from ..contact.limits import Limit, caution_beyond
from ..film.laws import AbstractFilm, FilmGap
from ..joints.base import (
    AbstractConstraint,
    AbstractContactJoint,
    Attachment,
    Contact,
    Motions,
    Row,
)
from ..pen import AbstractPen
from .clearance import ClearanceJoint
from .journal_bases import BASES, SIDES, JournalBase

NODES, WEIGHTS = (
    0.5 * (rule + shift)
    for rule, shift in zip(np.polynomial.legendre.leggauss(8), (1.0, 0.0), strict=True)
)


def share_of_contact(depth: Scalar, transition: Scalar) -> Scalar:
    """0 up to the surface, 1 from a depth `transition` on, m; smooth between."""
    part = jnp.clip(depth / transition, 0.0, 1.0)
    return part * part * (3.0 - 2.0 * part)


class FadingIn(AbstractContactLaw):
    """A law of which a part acts, from none at the surface to all at a depth `transition`, m."""

    law: AbstractContactLaw
    transition: Single
    uses_entry_speed: bool = eqx.field(static=True)  # pyright: ignore
    force_jumps = False

    def force(self, gap: Gap, entry_speed: Scalar | None) -> Scalar:
        """The part of the law's force, N."""
        return self._share(gap) * self.law.force(gap, entry_speed)

    def elastic_force(self, gap: Gap) -> Scalar:
        """The part of the law's elastic force, N."""
        return self._share(gap) * self.law.elastic_force(gap)

    def stored_energy(self, gap: Gap) -> Scalar:
        """The integral of the elastic force by parts, J: by Gauss's rule in the root of the depth,
        in which energies that grow with halves of powers are polynomials."""
        end = jnp.clip(gap.depth, 0.0, self.transition)
        removed: Scalar = 0.0
        for node, weight in zip(NODES, WEIGHTS, strict=True):
            depth = end * node * node
            part = depth / self.transition
            slope = 6.0 * part * (1.0 - part) / self.transition
            here = Gap(depth, gap.rate, gap.bearing_radius, gap.clearance)
            energy = self.law.stored_energy(here)
            removed = removed + weight * 2.0 * node * end * slope * energy
        return self._share(gap) * self.law.stored_energy(gap) - removed

    def slope_jumps(self) -> bool:
        """No: whatever the law does, its part begins flat."""
        return False

    def limits(self, gap: Gap) -> tuple[Limit, ...]:
        """Those of the law."""
        return self.law.limits(gap)

    def _share(self, gap: Gap) -> Scalar:
        return share_of_contact(gap.depth, self.transition)


THINNEST_FILM = 1e-3
"""Least height of a film over the clearance."""


class LubricatedJoint(AbstractContactJoint):
    """A clearance joint whose journal a film carries, and whose wall touches it where that fails.

    The film is as long as the journal; half of its force acts at each base, from where that base
    is. Force and reaction act half-way between the two axes, and the drag with them, so that the
    film keeps the angular momentum, and takes all its power from the motion: "film" in the ledger.

    Contact sets in where the journal touches the wall, and has taken over from the film at a
    further depth, smoothly: the blend of P. Flores et al. 2006 with a continuous slope. The film is
    at most as thin as the eccentricity ratio `largest_ratio` makes it, since its force would be
    infinite at the wall.

    A film lets the journal touch slowly, which a law that divides by the entry speed answers with
    vast damping: where the wall shall carry load, give `dry` a law without memory.

    **Arguments:**

    - `dry`: the `ClearanceJoint` without the film, from which all geometry comes.
    - `film`: the `AbstractFilm`.
    - `transition`: m, depth at which the contact has taken over; some hundredths of the clearance.
    - `largest_ratio`: eccentricity ratio up to which the film is followed, 0.5 to 0.999. It is
      approached within a tenth of the remaining gap.

    **Raises:** `ValueError` for values that no joint can have. **Warns:** `LawRangeWarning` of a
    bearing that the film's law does not hold for.

    ```python
    import clearjoint as cj

    dry = cj.ClearanceJoint(
        "ground", "rotor", bearing_radius=25e-3, clearance=50e-6, journal_length=20e-3,
        law=cj.laws.Hertz(1e10), axial=cj.FixedAxially(),
    )
    joint = cj.LubricatedJoint(dry, cj.films.CaponeFilm(viscosity=0.02), transition=1e-6)
    scene = cj.Scene({"rotor": cj.Body(5.0, (5e-3, 5e-3, 1e-2))}, {"bearing": joint})
    ```
    """

    dry: ClearanceJoint
    film: AbstractFilm
    transition: Single = quantity("m", positive=True, remedy="give a depth in m, such as 1e-6")
    largest_ratio: Single = quantity(
        "1",
        default=0.99,
        within=(0.5, 1.0 - THINNEST_FILM),
        remedy="give an eccentricity ratio such as 0.99",
    )

    def __check_init__(self):
        for name, kind in (("dry", ClearanceJoint), ("film", AbstractFilm)):
            value = getattr(self, name)
            require(
                isinstance(value, kind),
                name,
                type(value).__name__,
                f"one of {kind.__name__}",
                "pass the joint without its film, and then a film such as CaponeFilm(0.02)",
            )

    def _caution_together(self) -> None:
        for limit in self.film.limits(self.dry.bearing_radius, self.dry.journal_length):
            caution_beyond((limit,), limit.quantity)

    @property
    def clearance(self) -> Single:
        """Radial, m."""
        return self.dry.clearance

    def pair(self) -> tuple[str, str]:
        """The bearing's body and the journal's."""
        return self.dry.pair()

    def attachments(self) -> tuple[Attachment, ...]:
        """The centres of bearing and journal."""
        return self.dry.attachments()

    def laws(self) -> dict[str, AbstractContactLaw]:
        """The law of each base, which fades in, and of each shoulder if there are any."""
        return {
            name: FadingIn(law, self.transition, law.uses_entry_speed) if name in BASES else law
            for name, law in self.dry.laws().items()
        }

    def contacts(self, motions: Motions) -> dict[str, Contact]:
        """Contact geometry of the joint without the film."""
        return self.dry.contacts(motions)

    def film_wrenches(self, motions: Motions) -> dict[str, Wrench]:
        """What the film does to the bearing's body and to the journal's."""
        bases = self.dry.journal_bases(motions)
        on_bearing, on_journal = NO_WRENCH, NO_WRENCH
        for sign in SIDES:
            to_bearing, to_journal = self._half_of_film(motions, bases.at(sign))
            on_bearing, on_journal = on_bearing + to_bearing, on_journal + to_journal
        return dict(zip(self.pair(), (on_bearing, on_journal), strict=True))

    def _half_of_film(self, motions: Motions, base: JournalBase) -> tuple[Wrench, Wrench]:
        """What the film at a base does to the bearing's body and to the journal's."""
        bearing, journal = (motions[name] for name in self.pair())
        eccentricity = base.centre + base.reach
        half_way = eccentricity * 0.5
        in_journal = base.local - journal.components(half_way)
        on_axis = self.dry.bearing_point + unit(self.dry.bearing_axis) * base.height
        in_bearing = on_axis + bearing.components(half_way)
        moving = journal.velocity_at(in_journal) - bearing.velocity_at(in_bearing)
        moving = moving - base.axis * moving.dot(base.axis)
        spin = (journal.direction(journal.spin) - bearing.direction(bearing.spin)).dot(base.axis)
        gap = self._gap(base.axis, eccentricity, moving, spin)
        share = 0.5 * self._share_of_film(eccentricity)
        force, torque = self.film.force(gap) * share, base.axis * (self.film.drag(gap) * share)
        return (
            bearing.wrench(-force, in_bearing) + bearing.torque(-torque),
            journal.wrench(force, in_journal) + journal.torque(torque),
        )

    def _gap(self, axis: Vector, eccentricity: Vector, moving: Vector, spin: Scalar) -> FilmGap:
        """The gap, no thinner than it may be, for an eccentricity in m and the speed in m/s of what
        is half-way between the axes."""
        dry = self.dry
        offset, rate = eccentricity * (1.0 / dry.clearance), moving * (1.0 / dry.clearance)
        ratio, _ = norm_and_direction(offset)
        near = 0.1 * (1.0 - self.largest_ratio)
        excess = ramp(ratio - self.largest_ratio, near)
        offset = offset * (1.0 - excess / jnp.maximum(ratio, 0.5 * self.largest_ratio))
        return FilmGap(
            axis, offset, rate, spin, dry.bearing_radius, dry.clearance, dry.journal_length
        )

    def _share_of_film(self, eccentricity: Vector) -> Scalar:
        size, _ = norm_and_direction(eccentricity)
        return 1.0 - share_of_contact(size - self.dry.clearance, self.transition)

    def friction_force(self, name: str, contact: Contact, normal_force: Scalar) -> Vector | None:
        """Dry friction on the journal at a base, N."""
        return self.dry.friction_force(name, contact, normal_force)

    def bristle_laws(self) -> dict[str, AbstractBristleFriction]:
        """The bristle law of both bases, if the dry joint has one."""
        return self.dry.bristle_laws()

    def deepest(self) -> dict[str, Scalar]:
        """The journal's radius at both bases."""
        return self.dry.deepest()

    def law_limits(self, name: str, depth: Scalar) -> tuple[Limit, ...]:
        """Those of the law of a base, or of a shoulder."""
        return self.dry.law_limits(name, depth)

    def journal_offset(self, motions: Motions, base: str | None = None) -> Vector:
        """From the bearing's centre to the journal's, or to one of its bases, m, in the bearing's
        frame."""
        return self.dry.journal_offset(motions, base)

    def relative_angle(self, motions: Motions) -> Row:
        """The journal's angle about the bearing's axis, rad within (-pi, pi], as a row."""
        return self.dry.relative_angle(motions)

    def slid_out(self, motions: Motions) -> Scalar | None:
        """How far an axially free journal is beyond a bearing as long as itself, m."""
        return self.dry.slid_out(motions)

    def centred_joint(self) -> AbstractConstraint:
        """The ideal joint that holds the journal in the middle."""
        return self.dry.centred_joint()

    def resting_joint(self, load: np.ndarray) -> AbstractConstraint | None:
        """The ideal joint that holds the journal at the wall, where the load, (3,) N, presses."""
        return self.dry.resting_joint(load)

    def anchor(self) -> tuple[str, Vector, Vector] | None:
        """The journal's centre at the bearing's, or the other way round, if one is the ground's."""
        return self.dry.anchor()

    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        """The axial constraint of a policy that holds the centre; else none."""
        return self.dry.rows(motions, t)

    def draw(self, pen: AbstractPen) -> None:
        """The joint without the film."""
        self.dry.draw(pen)

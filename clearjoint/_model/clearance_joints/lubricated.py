"""A revolute joint with clearance and a lubricant film, and the equilibrium of its journal."""

from dataclasses import replace
from functools import wraps
from typing import NamedTuple

import jax
import jax.numpy as jnp
import optimistix
from jaxtyping import Complex, Float, PyTree
from typing_extensions import override

from ..._compilation.xla import Compiled
from ..._fields.checks import require, require_positive, require_shape
from ..._fields.objects import on_device, optional_quantity, quantity
from ..._fields.types import ArrayLike, Single
from ..._math.interpolation import gauss_rule
from ..._math.rotations import unit
from ..._math.smoothing import norm_and_direction, ramp
from ..._math.vectors import UNIT_Z, Scalar, Vector, unpack
from ..bodies import Wrench
from ..contact.friction import FrictionLaw
from ..contact.laws import (
    AbstractContactLaw,
    AbstractLawAround,
    Gap,
    caution_beyond,
    require_instance,
)
from ..films import AbstractFilm, FilmGap
from ..joints.base import AbstractContactJoint, Motions
from .clearance import ClearanceJoint
from .journal_bases import SIDES, JournalBase

NODES, WEIGHTS = gauss_rule(8)
"""Gauss quadrature for the energy of `BlendedContactLaw`, exact for a power law with the exponent 1
or 1.5: the integrand is then a polynomial of degree 9 or 10."""


def blending_factor(depth: Scalar, transition: Scalar) -> Scalar:
    """Return a factor that rises smoothly from 0 at a depth of 0 m to 1 at `transition`, m."""
    ratio = jnp.clip(depth / transition, 0.0, 1.0)
    return ratio * ratio * (3.0 - 2.0 * ratio)


class BlendedContactLaw(AbstractLawAround):
    """A contact law times the `blending_factor` of the penetration, so that the force begins
    smoothly; `transition`, m, is the penetration at which the factor reaches 1."""

    transition: Single
    force_jumps = False

    @override
    def force(self, gap: Gap, entry_speed: Scalar | None) -> Scalar:
        return self._factor(gap) * self.law.force(gap, entry_speed)

    @override
    def elastic_force(self, gap: Gap) -> Scalar:
        return self._factor(gap) * self.law.elastic_force(gap)

    @override
    def stored_energy(self, gap: Gap) -> Scalar:
        # By parts, the integral of factor times force is factor times energy, less the integral of
        # the factor's slope times the energy. For this second integral, Gauss quadrature in the
        # square root of the depth is accurate for energies that grow with half-integer powers. With
        # depth = end node^2, an interval d(node) has the length 2 end node d(node) in depth.
        end = jnp.clip(gap.depth, 0.0, self.transition)
        removed: Scalar = 0.0
        for node, weight in zip(NODES, WEIGHTS, strict=True):
            depth = end * node * node
            ratio = depth / self.transition
            slope = 6.0 * ratio * (1.0 - ratio) / self.transition
            node_gap = replace(gap, depth=depth)
            energy = self.law.stored_energy(node_gap)
            removed = removed + weight * 2.0 * node * end * slope * energy
        return self._factor(gap) * self.law.stored_energy(gap) - removed

    @override
    def slope_jumps(self) -> bool:
        return False

    def _factor(self, gap: Gap) -> Scalar:
        return blending_factor(gap.depth, self.transition)


def _of_dry_joint(name: str) -> PyTree:
    """Return a method that calls the method `name` of the field `dry`."""

    @wraps(getattr(ClearanceJoint, name))
    def method(self: "LubricatedJoint", *arguments: PyTree, **options: PyTree) -> PyTree:
        return getattr(self.dry, name)(*arguments, **options)

    return method


class LubricatedJoint(AbstractContactJoint):
    """A clearance joint with a lubricant film and wall contact when the film is squeezed out.

    The film extends over the journal's length. It is computed in two halves, one at each base (end
    of the journal), from the eccentricity there, for circular surfaces even if `dry` has profiles.
    Force and reaction act at one point midway between the two axes, so that the film conserves
    angular momentum. The energy ledger lists what it dissipates as "film".

    If `transition` is given, contact begins when the journal touches the wall, and smoothly
    replaces the film as the penetration grows from zero to `transition`. This is the blend of P.
    Flores et al. 2006, but with a continuous derivative. If `transition` is ``None``, film and
    contact act together.

    With a film the journal touches the wall slowly, where laws with an entry speed have very large
    damping: if the wall has to carry load, use a law without an entry speed in `dry`.

    **Arguments:**

    - `dry`: the `ClearanceJoint` without the film, which defines the geometry.
    - `film`: the `AbstractFilm`. A `LawRangeWarning` tells of a bearing outside its range.
    - `transition`: m, a few hundredths of the clearance; ``None``, the default, for mixed
      lubrication. Use ``None`` with a law that carries load before the film is gone, such as
      `clearjoint.laws.RoughCylinders`. The film is then that of smooth surfaces, and the ratio of
      the smallest film thickness to the roughness determines the shares of film and asperities.
    - `largest_ratio`: largest eccentricity ratio used for the film, whose force would be infinite
      at the wall; 0.5 to 0.999, 0.99 by default. The limit sets in smoothly: ratios above
      `largest_ratio` - 0.1 (1 - `largest_ratio`) are reduced.

    >>> scene, state = cj.mechanisms.double_pendulum(clearance=50e-6, law=cj.laws.Hertz(1e10))
    >>> film = cj.films.CaponeFilm(viscosity=0.02)
    >>> joint = cj.LubricatedJoint(scene.joints["shoulder"], film, transition=1e-6)
    >>> joint.pair()
    ('ground', 'arm 2')
    """

    dry: ClearanceJoint
    film: AbstractFilm
    transition: Single | None = optional_quantity(
        "m", positive=True, remedy="give a depth in m, such as 1e-6"
    )
    largest_ratio: Single = quantity(
        "1", default=0.99, within=(0.5, 0.999), remedy="give an eccentricity ratio such as 0.99"
    )

    @override
    def __check_init__(self):
        remedy = "pass the joint without its film, and then a film such as CaponeFilm(0.02)"
        require_instance("dry", self.dry, ClearanceJoint, remedy=remedy)
        require_instance("film", self.film, AbstractFilm, remedy=remedy)

    @override
    def _caution_together(self) -> None:
        for limit in self.film.limits(self.dry.bearing_radius, self.dry.journal_length):
            caution_beyond((limit,), limit.quantity)

    @property
    def clearance(self) -> Single:
        """Radial clearance, m."""
        return self.dry.clearance

    @property
    def friction(self) -> FrictionLaw | None:
        """Friction law of the contact with the wall; ``None`` for no friction."""
        return self.dry.friction

    pair = _of_dry_joint("pair")
    attachments = _of_dry_joint("attachments")
    contacts = _of_dry_joint("contacts")
    rows = _of_dry_joint("rows")
    friction_force = _of_dry_joint("friction_force")
    bristle_laws = _of_dry_joint("bristle_laws")
    deepest = _of_dry_joint("deepest")
    law_limits = _of_dry_joint("law_limits")
    journal_offset = _of_dry_joint("journal_offset")
    relative_angle = _of_dry_joint("relative_angle")
    slid_out = _of_dry_joint("slid_out")
    centred_joint = _of_dry_joint("centred_joint")
    resting_joint = _of_dry_joint("resting_joint")
    anchor = _of_dry_joint("anchor")
    draw = _of_dry_joint("draw")

    @override
    def laws(self) -> dict[str, AbstractContactLaw]:
        laws = self.dry.laws()
        if self.transition is not None:
            for label in self.dry.contact_labels():
                laws[label] = BlendedContactLaw(laws[label], self.transition)
        return laws

    @override
    def film_wrenches(self, motions: Motions) -> dict[str, Wrench]:
        base_at = self.dry.journal_bases(motions)
        lower, upper = (self._half_of_film(motions, base_at(side)) for side in SIDES)
        bearing, journal = self.pair()
        return {bearing: lower[0] + upper[0], journal: lower[1] + upper[1]}

    def _half_of_film(self, motions: Motions, base: JournalBase) -> tuple[Wrench, Wrench]:
        """Return the wrenches, on bearing and journal body, of the half of the film at a base."""
        bearing, journal = (motions[name] for name in self.pair())
        # The vector from the bearing's axis to the journal's centre, plus the component across the
        # axis of the vector from there to the base's centre.
        eccentricity = base.centre + base.arm
        # One point of action for both bodies, midway between the axes, conserves angular momentum.
        to_midpoint = eccentricity * 0.5
        in_journal = base.local - journal.components(to_midpoint)
        on_axis = self.dry.bearing_point + unit(self.dry.bearing_axis) * base.height
        in_bearing = on_axis + bearing.components(to_midpoint)
        # Film laws take the rate of the eccentricity as seen in axes that rotate with half the sum
        # of the two spins. This rate equals the relative velocity of the bodies at the midpoint.
        velocity = journal.velocity_at(in_journal) - bearing.velocity_at(in_bearing)
        # Film laws take a motion across the axis only.
        velocity = velocity - base.axis * velocity.dot(base.axis)
        spin = (journal.direction(journal.spin) - bearing.direction(bearing.spin)).dot(base.axis)
        gap = self._film_gap(base.axis, eccentricity, velocity, spin)
        # The film law is that of a film along the whole journal, of which this is one half. The
        # contact replaces the film over the depth `transition`.
        factor: Scalar = 0.5
        if self.transition is not None:
            size, _ = norm_and_direction(eccentricity)
            faded = blending_factor(size - self.dry.clearance, self.transition)
            factor = 0.5 * (1.0 - faded)
        force, torque = self.film.force(gap) * factor, base.axis * (self.film.drag(gap) * factor)
        return (
            bearing.wrench(-force, in_bearing) + bearing.torque(-torque),
            journal.wrench(force, in_journal) + journal.torque(torque),
        )

    def _film_gap(
        self, axis: Vector, eccentricity: Vector, velocity: Vector, spin: Scalar
    ) -> FilmGap:
        """Return the input of the film law, with a limited eccentricity ratio.

        **Arguments:** components are global. `axis`: of the bearing, a unit vector. `eccentricity`:
        of a base, m. `velocity`: its rate, m/s, in axes that rotate at half the sum of both spins.
        `spin`: of the journal relative to the bearing about `axis`, rad/s.
        """
        dry = self.dry
        offset, rate = eccentricity * (1.0 / dry.clearance), velocity * (1.0 / dry.clearance)
        ratio, _ = norm_and_direction(offset)
        ramp_width = 0.1 * (1.0 - self.largest_ratio)
        # A smooth ramp keeps the force differentiable; the maximum avoids a division by zero in the
        # centre, where the excess is zero.
        excess = ramp(ratio - self.largest_ratio, ramp_width)
        offset = offset * (1.0 - excess / jnp.maximum(ratio, 0.5 * self.largest_ratio))
        sizes = dry.bearing_radius, dry.clearance, dry.journal_length
        return FilmGap(axis, offset, rate, spin, *sizes)


TOLERANCE = 1e-12
"""Relative tolerance of the equilibrium: of force over load, and of offset over clearance."""
NEARLY_CENTRED = 1e-3
"""Eccentricity ratio in each direction at which the search for the equilibrium starts: a film's
force may not be differentiable for a centred journal."""


class CarriedJournal(NamedTuple):
    """Equilibrium of a journal in its film, and the linearised force near the equilibrium.

    The force and the moment on the journal are those of the film and, for a joint without
    `transition`, of the contact and its friction. Components refer to two fixed directions x and y
    across the bearing's axis z, which form a right-handed frame.

    - `offset`: (2,) m, from the bearing's axis to the journal's.
    - `stiffness`: (2, 2) N/m, minus the derivative of the force by the offset.
    - `damping`: (2, 2) N s/m, minus the derivative of the force by the offset's rate.
    - `moment`: N m, on the journal about its own axis, along z. The friction coefficient of the
      bearing is the absolute value of this moment, divided by the load and by the bearing's radius.
      Plotted over the speed, this coefficient gives Stribeck's curve.

    >>> scene, _ = cj.mechanisms.rotor_in_bearing(film=cj.films.CaponeFilm(0.02))
    >>> carried = cj.carried_journal(scene.joints["bearing"], load=(0.0, -196.2), speed=200.0)
    >>> carried.stiffness.shape, bool(carried.damping[0, 0] > 0.0)
    ((2, 2), True)
    """

    offset: Float[jax.Array, "2"]
    stiffness: Float[jax.Array, "2 2"]
    damping: Float[jax.Array, "2 2"]
    moment: Scalar

    def growth(self, mass: Scalar) -> Complex[jax.Array, "4"]:
        """Return the eigenvalues, (4,) complex, 1/s, of small motions of a body of this mass, kg.
        The equilibrium is stable if all of them have negative real parts."""
        # The motion is that of a linear system whose variables are the offset and its rate.
        inverse_mass = jnp.eye(2) / mass
        by_offset, by_rate = -inverse_mass @ self.stiffness, -inverse_mass @ self.damping
        system = jnp.block([[jnp.zeros((2, 2)), jnp.eye(2)], [by_offset, by_rate]])
        return jnp.linalg.eigvals(system)


def carried_journal(joint: LubricatedJoint, load: ArrayLike, speed: Scalar) -> CarriedJournal:
    """Compute the equilibrium of a loaded journal in its film, and the stiffness and damping there.

    The bearing is at rest, and the axes are parallel. The search for the equilibrium is limited to
    eccentricities below the clearance, but not to the joint's `largest_ratio`. Without a
    `transition`, contact adds the normal force of the joint's law between circles (of a law with an
    entry speed, its elastic part) and friction; with a `transition`, contact adds nothing.

    **Arguments:**

    - `joint`: the lubricated joint; without a `transition`, its dry joint may not have profiles.
    - `load`: (2,) N, external force on the journal along the directions x and y that
      `CarriedJournal` defines.
    - `speed`: angular velocity of the journal about z, rad/s, positive.

    **Raises:** `ValueError` for an invalid argument; `RuntimeError` if the search for the
    equilibrium doesn't converge.

    >>> scene, _ = cj.mechanisms.rotor_in_bearing(film=cj.films.CaponeFilm(0.02))
    >>> carried = cj.carried_journal(scene.joints["bearing"], load=(0.0, -196.2), speed=200.0)
    >>> bool(carried.growth(mass=20.0).real.max() < 0.0)  # stable
    True
    """
    require_instance("joint", joint, LubricatedJoint, remedy="pass LubricatedJoint(dry, film)")
    fields = "bearing_profile", "journal_profile"
    profiles = [name for name in fields if getattr(joint.dry, name) is not None]
    # The contact in `_load` is that of circles, whereas a run computes that of the profiles.
    is_round = joint.transition is not None or not profiles
    expected = "without profiles in its dry joint"
    remedy = "leave out the profiles, or give the joint a `transition`"
    require(is_round, "joint", f"with {' and '.join(profiles)}", expected, remedy)
    require_shape("load", load, (2,), "give its components across the axis in N")
    require_positive("speed", speed, "give rad/s, with the axis such that it is positive")
    return _solve_equilibrium(joint, on_device(load), on_device(speed))


@Compiled
def _solve_equilibrium(joint: LubricatedJoint, load: jax.Array, speed: jax.Array) -> CarriedJournal:
    # Joints and films compute with scalars: `unpack` replaces the joint's arrays (3,) by `Vector`s.
    joint, at_rest = unpack(joint), jnp.zeros(2)
    clearance, load_size = joint.dry.clearance, jnp.linalg.norm(load)

    # The search is unbounded, but a film's force exists only inside the clearance: this map keeps
    # each trial offset there.
    def offset_of(point: jax.Array) -> jax.Array:
        return point * (clearance / jnp.sqrt(1.0 + point @ point))

    def residual(point: jax.Array, _: None) -> jax.Array:
        force, _moment = _load(joint, speed, offset_of(point), at_rest)
        # Relative to the size of the load, so that one tolerance suits all loads; absolute for a
        # zero load.
        return (force + load) / jnp.where(load_size > 0.0, load_size, 1.0)

    solver = optimistix.LevenbergMarquardt(rtol=TOLERANCE, atol=TOLERANCE)
    # A film's force may not be differentiable in the centre itself.
    start = jnp.full(2, NEARLY_CENTRED)
    offset = offset_of(optimistix.root_find(residual, solver, start).value)
    derivatives = jax.jacfwd(_load, argnums=(2, 3), has_aux=True)
    # Derivatives of the force. Stiffness and damping have the opposite sign: a positive one resists
    # the displacement or the velocity.
    (by_offset, by_velocity), moment = derivatives(joint, speed, offset, at_rest)
    return CarriedJournal(offset, -by_offset, -by_velocity, moment)


def _load(
    joint: LubricatedJoint, speed: Scalar, offset: jax.Array, velocity: jax.Array
) -> tuple[jax.Array, Scalar]:
    """Return the force on the journal, (2,) N, and the moment about its axis, N m, from the
    position and velocity of its axis relative to the bearing's, (2,) m and m/s, and from the
    journal's speed, rad/s."""
    dry = joint.dry
    position, axis_velocity = (Vector(pair[0], pair[1], 0.0) for pair in (offset, velocity))
    eccentricity = position * (1.0 / dry.clearance)
    # A film law takes the rate as seen in axes that rotate with the mean angular velocity of both
    # surfaces, which is half the journal's, since the bearing is at rest. `_half_of_film` gets the
    # same rate from the relative velocity midway between the two axes.
    rate = axis_velocity * (1.0 / dry.clearance) - UNIT_Z.cross(eccentricity) * (0.5 * speed)
    sizes = dry.bearing_radius, dry.clearance, dry.journal_length
    film_gap = FilmGap(UNIT_Z, eccentricity, rate, speed, *sizes)
    force, moment = joint.film.force(film_gap), joint.film.drag(film_gap)
    # As in `_half_of_film`, the force acts midway between the axes, at -position/2 from the
    # journal's axis.
    moment = moment - 0.5 * UNIT_Z.dot(position.cross(force))
    # With a transition, contact begins at the wall, which `offset` does not reach.
    if joint.transition is None:
        size, normal = norm_and_direction(position)
        approach = axis_velocity.dot(normal)
        gap = dry._gap(size - dry.clearance, approach)
        # The axes are parallel, so that the gap is the same for all contacts along the journal.
        push: Scalar = 0.0
        for label in dry.contact_labels():
            law = dry.laws()[label]
            # An entry speed is that of an impact; a contact in equilibrium has none.
            push = push + (law.elastic_force(gap) if law.uses_entry_speed else law.force(gap, None))
        force = force - normal * push
        if dry.friction is not None:
            sliding = axis_velocity + UNIT_Z.cross(normal) * (speed * dry.journal_radius)
            friction = dry.friction.force(push, sliding - normal * approach)
            force = force + friction
            moment = moment + dry.journal_radius * UNIT_Z.dot(normal.cross(friction))
    return jnp.stack([jnp.asarray(force.x), jnp.asarray(force.y)]), moment

"""The scene: the bodies, joints and forces of a mechanism by name, and gravity."""

from collections.abc import Mapping
from types import MappingProxyType

import jax
import numpy as np
from typing_extensions import override

from .._fields.cautions import LooseBodyWarning, caution
from .._fields.checks import (
    caution_outside,
    caution_unless,
    concrete,
    named,
    nearest,
    require,
    require_type,
)
from .._fields.objects import AbstractReadable, optional_quantity
from .._fields.types import Triple, TripleLike
from .bodies import GROUND, Body
from .contact.friction import AbstractBristleFriction
from .contact.laws import AbstractContactLaw
from .drives.drivers import AbstractDrive
from .forces import TorsionalSpring
from .joints.base import AbstractConstraint, AbstractContactJoint, AbstractElement, AbstractForce
from .joints.joint_friction import JointFriction

FARTHEST = 100.0
"""Distance of a point from the centre of mass, over the body's radius of gyration, above which a
warning is issued: a length in mm may have been given."""
KINDS = {
    "bodies": (Body,),
    "joints": (AbstractConstraint, AbstractContactJoint),
    "forces": (AbstractForce,),
}
"""Classes of the elements in each argument of `Scene`."""


class Scene(AbstractReadable):
    """A mechanism: bodies, joints, forces and gravity.

    A scene is a PyTree. Runs of scenes that differ only in their numbers use the same compiled
    program, provided that the same components of vectors and matrices are exactly 0 or 1: a program
    contains these as constants.

    **Arguments:**

    - `bodies`: `Body` by name, at least one. The name "ground" is reserved for the fixed body.
    - `joints`: ideal joints, clearance joints and drivers by name.
    - `forces`: springs, dampers, loads and drive torques by name.
    - `gravity`: acceleration of gravity, (3,) m/s^2 in global axes; ``None`` (default) for zero.

    **Raises:** `ValueError` if there is no body, a body is named "ground", a name is empty or not a
    string, an element has the wrong class or names an unknown body, a joint and a force have the
    same name, or the gravity is not three finite numbers. **Warns:** `LooseBodyWarning` if no joint
    and no force acts on a body of a scene with joints, or if no chain of joints, apart from
    drivers, connects the two bodies of a driver, drive torque or torsional spring;
    `UnusualValueWarning` if a point is farther than 100 radii of gyration from its body's centre of
    mass, or gravity exceeds 1e3 m/s^2.

    >>> scene = cj.Scene(
    ...     bodies={"arm": cj.Body(mass=1.0, inertia=(1e-3, 0.1, 0.1))},
    ...     joints={"pivot": cj.SphericalJoint("ground", "arm", (0, 0, 0), (-0.5, 0, 0))},
    ...     gravity=(0, 0, -9.81),
    ... )
    >>> list(scene.bodies), list(scene.joints)
    (['arm'], ['pivot'])
    """

    bodies: dict[str, Body]
    joints: dict[str, AbstractConstraint | AbstractContactJoint]
    forces: dict[str, AbstractForce]
    gravity: Triple | None = optional_quantity("m/s^2", shape=(3,))

    def __init__(
        self,
        bodies: Mapping[str, Body],
        joints: Mapping[str, AbstractConstraint | AbstractContactJoint] = MappingProxyType({}),
        forces: Mapping[str, AbstractForce] = MappingProxyType({}),
        gravity: TripleLike | None = None,
    ):
        self.bodies = named("bodies", bodies, "pass {name: Body(...)}")
        self.joints = named("joints", joints, "pass for example {name: RevoluteJoint(...)}")
        self.forces = named("forces", forces, "pass for example {name: SpringDamper(...)}")
        self.gravity = gravity

    @override
    def _check_together(self) -> None:
        remedy = "pass {name: Body(...)}"
        require(len(self.bodies) > 0, "bodies", {}, "a dictionary with at least one body", remedy)
        expected = "without the reserved name of the fixed body"
        require(GROUND not in self.bodies, "bodies", GROUND, expected, "rename the body")
        for family, kinds in KINDS.items():
            expected = "one of " + ", ".join(kind.__name__ for kind in kinds)
            for name, element in getattr(self, family).items():
                # The advice names the argument in which the element belongs, if there is one.
                belongs = [key for key, classes in KINDS.items() if isinstance(element, classes)]
                remedy = "pass an element of that class"
                remedy += "".join(f"; pass this one in `{key}`" for key in belongs)
                argument, kind = f"{family}[{name!r}]", type(element).__name__
                require(isinstance(element, kinds), argument, kind, expected, remedy)
        for family in ("joints", "forces"):
            for name, element in getattr(self, family).items():
                _check_names(f"{family}[{name!r}]", element, self.bodies)
                _check_distances(f"{family}[{name!r}]", element, self.bodies)
        for name, body in self.bodies.items():
            if not body.is_massless:
                continue
            # A body without inertia can't move freely: two joints determine its motion, or one
            # joint has an armature, which provides the inertia.
            ideal = [j for j in self.joints.values() if isinstance(j, AbstractConstraint)]
            joints = [joint for joint in ideal if name in joint.body_names()]
            has_armature = any(getattr(joint, "armature", None) is not None for joint in joints)
            expected = "False unless the body is between two joints, or at one with an armature"
            argument, remedy = f"bodies[{name!r}].is_massless", "give that joint an `armature`"
            require(has_armature or len(joints) > 1, argument, True, expected, remedy)
        # Friction may be pressed by an element with an elastic force: a contact joint or a spring.
        for name, joint in self.joints.items():
            if isinstance(joint, JointFriction) and joint.pressed_by is not None:
                springs = {n: f for n, f in self.forces.items() if isinstance(f, TorsionalSpring)}
                contacts = self.contact_joints().items()
                pressing = {n: j for n, j in contacts if not isinstance(j, JointFriction)} | springs
                expected = f"the name of a contact joint or torsional spring, one of {[*pressing]}"
                argument, remedy = f"joints[{name!r}].pressed_by", "correct the name"
                remedy = nearest(joint.pressed_by, pressing, remedy)
                is_known = joint.pressed_by in pressing
                require(is_known, argument, joint.pressed_by, expected, remedy)
        # Elements are also looked up by name among joints and forces together.
        shared = sorted(set(self.joints) & set(self.forces))
        require(not shared, "forces", shared, "of other names than the joints", "rename them")
        # A gravity that JAX traces is unknown. It may have been given in mm/s^2.
        if self.gravity is not None and concrete(self.gravity) is not None:
            size = np.linalg.norm(self.gravity)
            caution_outside("gravity", size, "m/s^2", 0.0, 1e3, "give it in m/s^2")

    @override
    def _caution_together(self) -> None:
        elements = (*self.joints.values(), *self.forces.values())
        connected = {body for element in elements for body in element.body_names()}
        for name in self.bodies:
            # Without any joint, free bodies are probably intended.
            if self.joints and name not in connected:
                caution(
                    f"No joint and no force acts on body {name!r}, which moves freely: connect it, "
                    "or remove it.",
                    LooseBodyWarning,
                )
        # Sets of bodies that chains of joints connect. A driver is among the joints, but it doesn't
        # hold its axis: its two bodies would move apart if nothing else connected them.
        chains: list[set[str]] = []
        for joint in self.joints.values():
            if not isinstance(joint, AbstractDrive):
                bodies = set(joint.body_names())
                # All chains that contain a body of the joint become one.
                joined = bodies.union(*(chain for chain in chains if chain & bodies))
                chains = [joined, *(chain for chain in chains if not chain & bodies)]
        for name, drive in {**self.joints, **self.forces}.items():
            if not isinstance(drive, AbstractDrive):
                continue
            if not any({drive.first, drive.second} <= chain for chain in chains):
                caution(
                    f"Drive {name!r} rotates a body about an axis that no joint holds: add a "
                    "joint, such as a RevoluteJoint, between the same bodies.",
                    LooseBodyWarning,
                )

    def contact_joints(self) -> dict[str, AbstractContactJoint]:
        """Return the joints that have contacts, by name."""
        joints = self.joints.items()
        return {name: j for name, j in joints if isinstance(j, AbstractContactJoint)}

    def bristle_laws(self) -> dict[str, dict[str, AbstractBristleFriction]]:
        """Return the bristle laws of the joints that have such laws, ``laws[joint][contact]``."""
        laws = {name: joint.bristle_laws() for name, joint in self.contact_joints().items()}
        return {name: family for name, family in laws.items() if family}

    def laws(self) -> dict[str, dict[str, AbstractContactLaw]]:
        """Return the laws of the normal force, ``laws[joint][contact]``."""
        return {name: joint.laws() for name, joint in self.contact_joints().items()}


def _check_names(argument: str, element: AbstractElement, bodies: Mapping[str, Body]) -> None:
    names = {GROUND, *bodies}
    for name in [name for name in element.body_names() if name not in names]:
        remedy = nearest(name, names, "correct the name, or add the body to the scene")
        expected = f"between known bodies {sorted(names)}"
        # The message names the field that holds this very string.
        fields = [f".{key}" for key, value in vars(element).items() if value is name]
        require(False, f"{argument}{''.join(fields[:1])}", name, expected, remedy)


def _check_distances(argument: str, element: AbstractElement, bodies: Mapping[str, Body]) -> None:
    """Warn of an element's points that are far from their body's centre of mass; their unit may be
    wrong. `argument`: the element in warnings, such as "joints['pin']"."""
    for name, body, point in element.attachments():
        # A point of the ground may be anywhere.
        numbers = (bodies[body], point) if body in bodies else ()
        if not numbers or any(concrete(leaf) is None for leaf in jax.tree.leaves(numbers)):
            continue
        distance, radius = float(np.linalg.norm(point)), bodies[body].gyration_radius()
        is_near, unit = distance <= FARTHEST * radius, "m from the centre of mass"
        expected = f"at most {FARTHEST:g} times the radius of gyration {radius:.3g} m of {body!r}"
        remedy = "give points in m, and inertias in kg m^2"
        caution_unless(is_near, f"{argument}.{name}", distance, unit, expected, remedy)


def require_scene(scene: Scene) -> None:
    remedy = "pass one; mechanisms come with a state: scene, state = cj.mechanisms.four_bar()"
    require_type("scene", scene, Scene, "a Scene", remedy)

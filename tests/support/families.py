"""Scenes with every member of a family: ideal joints, forces and drives, clearance joints, links,
films; and all laws and frictions. Each joint has a body of its own, and all move at once. Scenes
that are `lossless` conserve energy.
"""

import warnings
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

import clearjoint as cj
from studies.catalogue import frictions
from tests.support.seen_otherwise import euler

X, Y, Z = np.eye(3)
HERE = np.zeros(3)
BASE = "ground"
SOFT = 1e7
"""Stiffness of contacts, N/m^1.5."""


class Ride:
    """A scene in the making."""

    def __init__(self) -> None:
        self.bodies: dict[str, cj.Body] = {}
        self.states: dict[str, cj.BodyState] = {}
        self.joints: dict[str, Any] = {}
        self.forces: dict[str, Any] = {}

    def body(
        self,
        name: str,
        position: Any = HERE,
        *,
        velocity: Any = HERE,
        spin: Any = HERE,
        turn: Any = HERE,
        size: float = 2e-3,
        mass: float = 0.7,
    ) -> str:
        """Adds a body, which is at a place, turned, and moves; the spin is global."""
        own = Rotation.from_rotvec(turn)
        at = cj.body_state(position, euler(own.as_matrix()), velocity, own.inv().apply(spin))
        self.bodies[name] = cj.Body(mass, (size, 1.3 * size, 1.4 * size))
        self.states[name] = at
        return name

    def finished(self) -> tuple[cj.Scene, cj.State]:
        return (
            cj.Scene(self.bodies, self.joints, self.forces, (1.0, -9.0, 3.0)),
            cj.State(self.states),
        )


def ideal(lossless: bool = False) -> tuple[cj.Scene, cj.State]:
    """Every ideal joint, each on its own body."""
    ride = Ride()
    at, turn = np.array([0.1, 0.2, -0.1]), np.array([0.3, -0.2, 0.4])
    own = Rotation.from_rotvec(turn)
    offset = np.array([0.03, -0.02, 0.05])
    """From the joint's point to the body's centre."""

    def add(kind: Any, *more: Any, velocity: Any = HERE, spin: Any = HERE) -> None:
        name = kind.__name__
        ride.body(
            name, at + offset, velocity=np.cross(spin, offset) + velocity, spin=spin, turn=turn
        )
        ride.joints[f"{name} joint"] = kind(BASE, name, at, -own.inv().apply(offset), *more)

    a, b, c = np.linalg.qr(np.array([[1.0, 2.0, 0.5], [0.3, 1.0, -1.0], [0.2, 0.1, 1.0]]))[0].T
    own_a, own_b = own.inv().apply(a), own.inv().apply(b)
    parallel = own.as_quat(scalar_first=True)
    add(cj.SphericalJoint, spin=a + 2.0 * b)
    add(cj.RevoluteJoint, a, own_a, spin=3.0 * a)
    carried = ride.states["RevoluteJoint"]
    ride.body("FixedJoint", at + offset, velocity=carried.velocity, spin=3.0 * a, turn=turn)
    ride.joints["FixedJoint joint"] = cj.FixedJoint("RevoluteJoint", "FixedJoint", HERE, HERE)
    add(cj.InlineJoint, a, velocity=0.3 * a, spin=a - b)
    add(cj.CylindricalJoint, a, own_a, velocity=0.3 * a, spin=2.0 * a)
    add(cj.PrismaticJoint, a, parallel, velocity=-0.4 * a)
    add(cj.UniversalJoint, a, own_b, spin=2.0 * a - b)
    add(cj.PlanarJoint, a, own_a, velocity=0.2 * b + 0.1 * c, spin=-2.0 * a)
    add(cj.PointInPlaneJoint, a, velocity=0.2 * b, spin=a + b - c)
    add(cj.LineInPlaneJoint, a, own_b, velocity=0.2 * c, spin=2.0 * b + a)
    length = 0.2
    ride.body("DistanceJoint", at + length * a, velocity=0.3 * b, spin=b)
    ride.joints["DistanceJoint joint"] = cj.DistanceJoint(BASE, "DistanceJoint", at, HERE, length)
    # The angle of a screw is zero where the frames differ by the shortest rotation.
    ride.body("ScrewJoint", at, velocity=0.02 / (2.0 * np.pi) * 4.0 * a, spin=4.0 * a)
    ride.joints["ScrewJoint joint"] = cj.ScrewJoint(BASE, "ScrewJoint", at, HERE, a, a, 0.02)
    for name, axis, speed in (("pinion", a, 3.0), ("wheel", b, -1.0)):
        ride.body(name, at, spin=speed * axis)
        ride.joints[f"{name} hinge"] = cj.RevoluteJoint(BASE, name, at, HERE, axis, axis)
    ride.joints["GearJoint joint"] = cj.GearJoint(BASE, "pinion", "wheel", a, b, 17, 51)
    return ride.finished()


def driven(lossless: bool = False) -> tuple[cj.Scene, cj.State]:
    """Every force and drive; without losses those that are conservative."""
    ride = Ride()
    at, axis = np.array([0.1, 0.2, -0.1]), np.array([2.0, 1.0, -2.0]) / 3.0
    damped = 0.0 if lossless else 1.0
    parallel = np.array([1.0, 0.0, 0.0, 0.0])
    hinged = {
        "sprung": (cj.TorsionalSpring, 5.0, 0.01 * damped, 0.2),
        "turned": (cj.DriveTorque, cj.Polynomial([0.3, 20.0])),
        "aimed": (cj.Motor, cj.Polynomial([0.3, 1.0]), 3.0, 0.02, 5.0),
        "spun": (cj.PrescribedRotation, 3.0, 0.0),
        "led": (cj.PrescribedAngle, cj.Polynomial([0.0, 3.0, 50.0])),
    }
    for name, (kind, *more) in hinged.items():
        if lossless and kind is not cj.TorsionalSpring:
            continue
        ride.body(name, at, spin=3.0 * axis)
        ride.joints[f"{name} hinge"] = cj.RevoluteJoint(BASE, name, at, HERE, axis, axis)
        drive = kind(BASE, name, axis, *more)
        family = ride.forces if isinstance(drive, cj.extend.AbstractForce) else ride.joints
        family[f"{name} drive"] = drive
    if not lossless:
        ride.body("pushed", at, velocity=0.3 * axis)
        ride.joints["rail"] = cj.PrismaticJoint(BASE, "pushed", at, HERE, axis, parallel)
        path = cj.Polynomial([0.0, 0.3, 20.0])
        ride.joints["pusher"] = cj.PrescribedTranslation(BASE, "pushed", at, HERE, axis, path)
        kick = cj.PiecewiseLinear([0.0, 4e-3, 0.05], [[9.0, 1.0, 2.0], [5.0, 30.0, 1.0], [0.0] * 3])
        ride.body("kicked", at)
        ride.forces["kick"] = cj.AppliedLoad("kicked", kick, point=(0.02, 0.01, 0.03))
    ride.body("cushioned", at + 0.01 * axis, turn=0.1 * X, spin=2.0 * Y, velocity=0.2 * Z)
    ride.forces["liner"] = cj.Bushing(
        BASE,
        "cushioned",
        at,
        (0.01, 0.02, 0.03),
        stiffness=(800.0, 1e3, 1.5e3),
        damping=damped * np.array([3.0, 1.0, 2.0]),
        rotational_stiffness=(1.0, 2.0, 3.0),
        rotational_damping=damped * np.array([0.01, 0.03, 0.02]),
    )
    ride.body("hanging", at + 0.2 * axis, spin=3.0 * X, velocity=0.5 * Y)
    ride.forces["spring"] = cj.SpringDamper(
        BASE, "hanging", at, (0.03, 0.02, 0.01), 500.0, 2.0 * damped, 0.15
    )
    ride.forces["load"] = cj.AppliedLoad("hanging", (3.0, -4.0, 5.0), point=HERE)
    return ride.finished()


def law(lossless: bool) -> cj.extend.AbstractContactLaw:
    return cj.laws.ExactRestitution(1.0 if lossless else 0.7, SOFT)


def playing(lossless: bool = False) -> tuple[cj.Scene, cj.State]:
    """Every joint with clearance, each thrown against a wall."""
    ride = Ride()
    at, play = np.array([0.1, 0.2, -0.1]), 0.2e-3
    rub = None if lossless else cj.frictions.RegularisedCoulomb(0.1, 1e-2)
    thrown = {"velocity": np.array([0.2, 0.15, 0.05]), "spin": np.array([0.5, 1.0, 2.0])}
    collars = cj.EndPlay(0.1e-3, law(lossless))
    bearing = {
        "bearing_point": at,
        "bearing_radius": 10e-3,
        "clearance": play,
        "journal_length": 20e-3,
        "friction": rub,
        "law": law(lossless),
    }
    ride.body("free", at, **thrown)
    ride.joints["free"] = cj.ClearanceJoint(BASE, "free", **bearing)
    ride.body("stopped", at, **thrown)
    ride.joints["stopped"] = cj.ClearanceJoint(BASE, "stopped", axial=collars, **bearing)
    ride.body("ball", at, **thrown)
    ride.joints["ball"] = cj.BallInSocket(
        BASE,
        "ball",
        socket_point=at,
        socket_radius=10e-3,
        clearance=play,
        law=law(lossless),
        friction=rub,
    )
    ride.body("pin", at, **thrown)
    slot = {"slot_point": at, "play": play, "pin_radius": 5e-3, "travel": 3e-4}
    ride.joints["pin"] = cj.PinInSlot(BASE, "pin", law=law(lossless), friction=rub, **slot)
    ride.body("slider", at, **thrown)
    ride.joints["slider"] = cj.SliderInGuide(
        BASE,
        "slider",
        guide_point=at,
        half_length=0.03,
        half_height=0.02,
        clearance=play,
        law=law(lossless),
        friction=rub,
    )
    for name, place, speed in (("shaft", at, 4.0), ("pinion", at, 3.0), ("wheel", at, -1.5)):
        place = at + 0.105 * X if name == "wheel" else place
        ride.body(name, place, spin=speed * Z)
        ride.joints[f"{name} hinge"] = cj.RevoluteJoint(BASE, name, place, HERE, Z, Z)
    ride.joints["backlash"] = cj.Backlash(
        BASE, "shaft", play=0.03, radius=0.02, middle=0.005, law=law(lossless)
    )
    mesh = HERE, HERE, Z, Z, 20, 50, 3e-3, play, law(lossless)
    ride.joints["mesh"] = cj.GearBacklash("pinion", "wheel", *mesh)
    return ride.finished()


def linked(lossless: bool = False) -> tuple[cj.Scene, cj.State]:
    """A massless link, and a bearing that holds its journal axially."""
    ride = Ride()
    at, play = np.array([0.1, 0.2, -0.1]), 0.2e-3
    ride.body("linked", at + play * X, spin=3.0 * Z)
    ride.joints["link"] = cj.MasslessLink(BASE, "linked", play, 20e-3, at, axial=cj.FixedAxially())
    ride.body("held", at, velocity=(0.2, 0.15, 0.0), spin=(0.5, 1.0, 2.0))
    ride.joints["held"] = cj.ClearanceJoint(
        BASE,
        "held",
        bearing_point=at,
        bearing_radius=10e-3,
        clearance=play,
        journal_length=20e-3,
        friction=None if lossless else cj.frictions.RegularisedCoulomb(0.1, 1e-2),
        law=law(lossless),
        axial=cj.FixedAxially(),
    )
    return ride.finished()


def sockets(kinds: dict[str, tuple[Any, Any]], speed: float = 0.25) -> tuple[cj.Scene, cj.State]:
    """A ball in a socket for each law and friction."""
    ride = Ride()
    at = np.array([0.1, 0.2, -0.1])
    for k, (name, (law, friction)) in enumerate(kinds.items()):
        velocity = speed * Rotation.from_rotvec([0.3 * k, 0.2 * k, 0.1]).apply([0.8, 0.6, 0.0])
        ride.body(name, at, velocity=velocity, spin=(1.0, 2.0, 0.5))
        ride.joints[f"{name} joint"] = cj.BallInSocket(
            BASE,
            name,
            socket_point=at,
            socket_radius=10e-3,
            clearance=0.1e-3,
            law=law,
            friction=friction,
        )
    return ride.finished()


def contact_laws(lossless: bool = False) -> list[cj.extend.AbstractContactLaw]:
    """Every contact law; without losses at a restitution of one."""
    e = 1.0 if lossless else 0.75
    damped = 0.0 if lossless else 1.0
    laws = cj.laws
    with_restitution = [
        laws.HuntCrossley,
        laws.HerbertMcWhannell,
        laws.LeeWang,
        laws.LankaraniNikravesh,
        laws.ZhiyingQishao,
        laws.CarvalhoMartins,
        laws.Flores2011,
        laws.Gonthier,
        laws.GharibHurmuzlu,
        laws.HuGuo,
        laws.SafaeifarFarshidianfar,
        laws.YePounding,
        laws.PantWijeyewickrema,
        laws.ExactRestitution,
    ]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", cj.LawRangeWarning)
        made = [kind(e, SOFT) for kind in with_restitution]
        made += _others(e, damped)
    return made


def _others(e: float, damped: float) -> list[cj.extend.AbstractContactLaw]:
    laws = cj.laws
    return [
        laws.Hertz(SOFT),
        laws.MemorylessHuntCrossley(e, SOFT, 0.2),
        laws.KelvinVoigt(e, 1e5, 0.7),
        laws.Tsuji(e, SOFT, 0.7),
        laws.Jankowski(e, SOFT, 0.7),
        laws.KuwabaraKono(SOFT, 1e4 * damped),
        laws.BordbarHyppanen(SOFT, 1e4 * damped),
        laws.Ristow(SOFT, 20.0 * damped),
        laws.ElastoGap(1e5, 50.0 * damped),
        laws.ImpactFunction(SOFT, 50.0 * damped, 1e-5),
        laws.FloresKelvinVoigt(e, 1e5),
    ]


def throwing(law: cj.extend.AbstractContactLaw) -> tuple[cj.Scene, cj.State]:
    """A ball in a socket whose contact has a law."""
    return sockets({type(law).__name__: (law, None)})


def friction_laws() -> dict[str, Any]:
    """Every friction law by name."""
    return {name: entry[0] for name, entry in {**frictions.LAWS, **frictions.BRISTLES}.items()}


def bearings(kinds: dict[str, tuple[Any, Any]]) -> tuple[cj.Scene, cj.State]:
    """A journal in a bearing for each law of line contact or film."""
    ride = Ride()
    at, clearance = np.array([0.1, 0.2, -0.1]), 0.2e-3
    for k, (name, (law, film)) in enumerate(kinds.items()):
        velocity = Rotation.from_rotvec([0.0, 0.0, 0.4 * k]).apply([0.2, 0.1, 0.0])
        ride.body(name, at, velocity=velocity, spin=(0.3, 0.2, 40.0))
        joint = cj.ClearanceJoint(
            BASE,
            name,
            bearing_point=at,
            bearing_radius=10e-3,
            clearance=clearance,
            journal_length=20e-3,
            law=law,
        )
        ride.joints[f"{name} joint"] = (
            joint if film is None else cj.LubricatedJoint(joint, film, 0.02 * clearance)
        )
    return ride.finished()


def cylinders() -> list[cj.extend.AbstractElasticity]:
    """Every law of line contact whose formula has units, and the stiffness of two spheres."""
    laws, young = cj.laws, 1e8
    kinds = [
        laws.JohnsonCylinder,
        laws.EsduCylinder,
        laws.RadzimovskyCylinder,
        laws.DubowskyFreudensteinCylinder,
        laws.GoldsmithCylinder,
        laws.LiuCylinder,
        laws.PerssonCylinder,
    ]
    return [*(kind(young, 0.3, length=20e-3) for kind in kinds), laws.RavnStiffness(young, 0.3)]


def films(lossless: bool = False) -> tuple[cj.Scene, cj.State]:
    """Every film."""
    del lossless
    kinds = cj.films.CaponeFilm, cj.films.PinkusSternlichtFilm, cj.films.ButenschoenFilm
    return bearings({kind.__name__: (law(False), kind(0.02)) for kind in kinds})


FAMILIES = {"links": (linked, 4e-3), "films": (films, 3e-3)}
"""How each scene is made, and when its run ends, s."""
LARGE = {
    "ideal joints": (ideal, 0.03),
    "forces and drives": (driven, 0.01),
    "clearance joints": (playing, 4e-3),
}
"""Scenes whose programs take minutes to compile; no test runs them yet."""

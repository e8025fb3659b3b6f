"""Scenes of massless links and of films, in which each joint has a body of its own, and all laws
and frictions."""

import warnings
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

import clearjoint as cj
from studies.catalogue import frictions
from tests.support.symmetry_transformations import euler

X, Y, Z = np.eye(3)
HERE = np.zeros(3)
BASE = "ground"
SOFT = 1e7
"""Stiffness of contacts, N/m^1.5."""
LOSSY = cj.laws.ExactRestitution(0.7, SOFT)


class Ride:
    """Builder of a scene: bodies, states, joints and forces by name."""

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
        """Add a body and its initial state; `turn` is a rotation vector, and `spin` is global."""
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


def linked() -> tuple[cj.Scene, cj.State]:
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
        friction=cj.frictions.RegularisedCoulomb(0.1, 1e-2),
        law=LOSSY,
        axial=cj.FixedAxially(),
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


def films() -> tuple[cj.Scene, cj.State]:
    """Every film."""
    kinds = cj.films.CaponeFilm, cj.films.PinkusSternlichtFilm, cj.films.ButenschoenFilm
    return bearings({kind.__name__: (LOSSY, kind(0.02)) for kind in kinds})


FAMILIES = {"links": (linked, 4e-3), "films": (films, 3e-3)}
"""How each scene is made, and when its run ends, s."""

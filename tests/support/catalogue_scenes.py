"""Scenes with every law, friction, film, play, joint, drive and mechanism of the catalogue."""

import warnings
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

import clearjoint as cj
from studies.catalogue import cylinders, films, frictions, laws, plays
from studies.catalogue.machines import machines
from tests.support.one_body import bearing, one_body

REST = (0.0, 0.0, 0.0)
IN_THE_WALL = (0.0, -1.02)
"""Where the wall has just taken over from the film, in clearances."""
TARGETS: dict[str, cj.extend.AbstractFunctionOfTime] = {
    "polynomial": cj.Polynomial([0.01, 0.5, 1.0]),
    "spline": cj.Spline.through(np.linspace(0.0, 0.1, 6), 5e-3 * np.sin(np.arange(6.0))),
    "piecewise linear": cj.PiecewiseLinear([0.0, 0.01, 0.05], [0.0, 0.02, 0.01]),
}
"""Slow enough that the motor does not stay at the limit of its torque."""


class CatalogueScene(NamedTuple):
    """A scene of the catalogue; it is chaotic, if at all, only after `end`, s."""

    make: Callable[[], tuple[cj.Scene, cj.State]]
    end: float
    body: str | None = None
    """Whose mass and inertia derivatives are along; the last one's unless given."""


def with_joint(scene: cj.Scene, name: str, joint: Any) -> cj.Scene:
    return replace(scene, joints={**scene.joints, name: joint})


def alone(
    body: str, mass: float, inertia: float, joint: Any, velocity: Any
) -> tuple[cj.Scene, cj.State]:
    """A sphere that starts at the origin, in a joint to the ground."""
    sphere = {"mass": mass, "inertia": (inertia,) * 3}
    return one_body(body, {"joint": joint}, **sphere, velocity=velocity)


def thrown(law: cj.extend.AbstractContactLaw) -> tuple[cj.Scene, cj.State]:
    """A ball in a wide socket, which meets the wall once."""
    joint = cj.BallInSocket("ground", "ball", socket_radius=10e-3, clearance=0.1e-3, law=law)
    return alone("ball", laws.MASS, 1e-3, joint, (laws.SPEED, 0.3 * laws.SPEED, 0.0))


def pressed(law: cj.extend.AbstractContactLaw) -> tuple[cj.Scene, cj.State]:
    """A rotor that falls into its bearing."""
    return cj.mechanisms.rotor_in_bearing(offset=(0.2, -0.9), law=law)


def rubbing(friction: Any) -> tuple[cj.Scene, cj.State]:
    """A rotor that turns where it lies in its bearing, and whose slip falls from 2.5 mm/s through
    the speeds at which the laws differ."""
    return cj.mechanisms.rotor_in_bearing(friction=friction, speed=0.1)


def with_everything() -> tuple[cj.Scene, cj.State]:
    """A rotor pressed into the wall of a bearing with a film, line contact and bristles."""
    law = _cylinders()["JohnsonCylinder"]
    film, (friction, _) = cj.films.CaponeFilm(films.VISCOSITY), frictions.BRISTLES["LuGre"]
    return cj.mechanisms.rotor_in_bearing(film=film, offset=IN_THE_WALL, law=law, friction=friction)


def with_film_and_friction() -> tuple[cj.Scene, cj.State]:
    """A rotor pressed into the wall of its bearing, from which a film carries it."""
    film = cj.films.PinkusSternlichtFilm(films.VISCOSITY)
    friction = cj.frictions.RegularisedCoulomb(0.1, 1e-3)
    return cj.mechanisms.rotor_in_bearing(film=film, offset=IN_THE_WALL, friction=friction)


def with_profiles() -> tuple[cj.Scene, cj.State]:
    """A rotor with a worn journal, which rolls on the wall of a bearing with two lobes."""
    scene, state, _ = plays.two_lobes()
    worn = cj.profiles.PeriodicSpline.through(-1e-6 * np.exp(np.cos(np.arange(16) * np.pi / 8)))
    pin = replace(scene.joints["bearing"], journal_profile=worn)
    return with_joint(scene, "bearing", pin), state


def tilted() -> tuple[cj.Scene, cj.State]:
    """A rotor that lies tilted in its bearing and touches the wall along a part of its length."""
    law = cj.laws.ElastoGap(stiffness=1e8, damping=1e3, exponent=1.0)
    scene, state = cj.mechanisms.rotor_in_bearing(law=law, speed=20.0)
    pin = replace(scene.joints["bearing"], line_points=5)
    tilt = 5e-4
    turned = cj.body_state(
        state.bodies["rotor"].position,
        orientation=cj.rotation((1.0, 0.0, 0.0), tilt),
        spin=(0.0, 20.0 * np.sin(tilt), 20.0 * np.cos(tilt)),
    )
    return with_joint(scene, "bearing", pin), cj.State({"rotor": turned})


def between_shoulders() -> tuple[cj.Scene, cj.State]:
    """A rotor that strikes the wall of its bearing, and faces with friction at both ends."""
    law = cj.laws.LankaraniNikravesh(restitution=0.6, stiffness=1e9)
    friction = cj.frictions.RegularisedCoulomb(0.1, 1e-2)
    face = cj.EndPlay(2e-4, law, friction, 12e-3)
    pin = bearing(law, "rotor", clearance=1e-4, friction=friction, axial=face)
    thrown = {"velocity": (0.02, 0.0, 0.1), "spin": (0.0, 0.0, 20.0)}
    body = {"inertia": (1e-3,) * 3, "gravity": (0.0, -9.81, 1.0)}
    return one_body("rotor", {"pin": pin}, **body, **thrown)


def with_film_and_asperities() -> tuple[cj.Scene, cj.State]:
    """A rotor that a film and the asperities of its bearing carry together."""
    scene, _ = cj.mechanisms.rotor_in_bearing(speed=10.0)
    # So rough that they touch where the damping of the film is not yet stiff.
    rough = cj.laws.GreenwoodTripp(roughness=3e-6, modulus=1.14e11)
    place = (0.0, -films.CLEARANCE + 8e-6, 0.0)
    state = cj.State({"rotor": cj.body_state(place, spin=(0.0, 0.0, 10.0))})
    return with_joint(scene, "bearing", films.mixed(rough)), state


def in_slot() -> tuple[cj.Scene, cj.State]:
    """A pin that flies from wall to wall."""
    joint = cj.PinInSlot("ground", "b", play=1e-3, pin_radius=5e-3, law=cj.laws.Hertz(1e9))
    return alone("b", 0.5, 1e-4, joint, (0.3, 0.4, 0.0))


def on_plate() -> tuple[cj.Scene, cj.State]:
    """A rod that falls on a plate, which is free, and slips there on its two round ends."""
    law, rub = cj.laws.ExactRestitution(0.6, 1e8), cj.frictions.RegularisedCoulomb(0.2, 1e-2)
    plate = cj.Stop(
        *("plate", "rod"),
        point=(0.0, 0.0, 0.02),
        normal=(0.1, -0.2, 1.0),
        point_second=(-0.1, 0.0, 0.0),
        end_point_second=(0.1, 0.01, 0.0),
        radius=0.01,
        law=law,
        friction=rub,
    )
    bodies = {"plate": cj.Body(3.0, (0.02, 0.03, 0.025)), "rod": cj.Body(0.5, (1e-4, 2e-3, 2e-3))}
    states = {
        "plate": cj.body_state(REST, spin=(0.3, 0.2, -0.1)),
        "rod": cj.body_state((0.0, 0.0, 0.045), velocity=(0.3, -0.2, -1.0), spin=(2.0, -1.0, 3.0)),
    }
    return cj.Scene(bodies, {"plate": plate}, gravity=(0.5, 0.0, -9.81)), cj.State(states)


def billiards() -> tuple[cj.Scene, cj.State]:
    """Three balls of steel, two of which are struck by the third, with bristles."""
    law = cj.laws.LankaraniNikravesh(0.9, cj.laws.RavnStiffness(207e9, 0.3))
    friction, _ = frictions.BRISTLES["LuGre"]
    places = {"cue": (-0.06, 0.004, 0.0), "one": (0.0, 0.03, 0.0), "two": (0.0, -0.03, 0.0)}
    sizes = {"radius_first": 0.025, "radius_second": 0.025}
    joints = {
        f"on {name}": cj.BallOnBall("cue", name, **sizes, law=law, friction=friction)
        for name in ("one", "two")
    }
    bodies = {name: cj.Body(0.5, (1.2e-4,) * 3) for name in places}
    states = {name: cj.body_state(place) for name, place in places.items()}
    states["cue"] = cj.body_state(places["cue"], velocity=(3.0, 0.0, 0.0), spin=(0.0, 20.0, 10.0))
    return cj.Scene(bodies, joints), cj.State(states)


def meshing_gears(law: cj.extend.AbstractContactLaw | None = None) -> tuple[cj.Scene, cj.State]:
    """Gears that rattle under torques, with a contact ratio and a transmission error."""
    law = law or cj.laws.HuntCrossley(0.7, 4e8, exponent=1.0)
    scene, state = cj.mechanisms.gear_pair(law=law, speeds=(60.0, -24.0))
    mesh = replace(
        scene.joints["mesh"],
        stiffness=cj.profiles.TeethInMesh(1.6),
        transmission_error=cj.profiles.Harmonics([4e-6, 1e-6], [0.0, 2e-6]),
    )
    forces = {
        name: cj.DriveTorque("ground", name, (0.0, 0.0, 1.0), torque)
        for name, torque in (("pinion", 20.0), ("wheel", 50.0))
    }
    return cj.Scene(scene.bodies, {**scene.joints, "mesh": mesh}, forces), state


def _laws() -> dict[str, cj.extend.AbstractContactLaw]:
    found = {name: make(0.5) for name, (_, make) in laws.BY_INTEGRATION.items()}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", cj.LawRangeWarning)
        found |= {law.__name__: law(0.9, laws.STIFFNESS) for law in laws.TABLES}
    return {"Hertz": cj.laws.Hertz(laws.STIFFNESS), **found}


def _cylinders() -> dict[str, cj.extend.AbstractContactLaw]:
    size = cylinders.YOUNG, cylinders.POISSON
    kinds = [*cylinders.FORMULAS, *cylinders.AT_EIGHT_MICROMETRES, cj.laws.PerssonCylinder]
    made = {kind.__name__: kind(*size, length=cylinders.LENGTH) for kind in kinds}
    return {name: cj.laws.HuntCrossley(0.5, cylinder) for name, cylinder in made.items()}


def catalogue_scenes() -> dict[str, CatalogueScene]:
    """All scenes by name: the family and the entry."""
    rubbed = {name: friction for name, (friction, *_) in frictions.LAWS.items()}
    rubbed |= {name: friction for name, (friction, *_) in frictions.BRISTLES.items()}
    found = {
        f"{family} {name}": CatalogueScene(partial(make, entry), 3e-3)
        for family, make, entries in (
            ("law", thrown, _laws()),
            ("cylinder", pressed, _cylinders()),
            ("friction", rubbing, rubbed),
        )
        for name, entry in entries.items()
    }
    for kind in (cj.films.CaponeFilm, cj.films.ButenschoenFilm, cj.films.PinkusSternlichtFilm):
        options = {"film": kind(films.VISCOSITY), "offset": (0.3, -0.6)}
        make = partial(cj.mechanisms.rotor_in_bearing, **options)
        found[f"film {kind.__name__}"] = CatalogueScene(make, 0.01)
    found["rotor with film, line contact and bristles"] = CatalogueScene(with_everything, 2e-3)
    found["rotor with film and friction"] = CatalogueScene(with_film_and_friction, 2e-3)
    found["rotor with profiles"] = CatalogueScene(with_profiles, 3e-3)
    found["rotor, tilted, in line contact"] = CatalogueScene(tilted, 2e-3)
    found["rotor between shoulders"] = CatalogueScene(between_shoulders, 0.03)
    found["rotor with film and asperities"] = CatalogueScene(with_film_and_asperities, 2e-3)
    for name, target in TARGETS.items():
        found[f"joints, {name}"] = CatalogueScene(partial(machines, target), 0.03, "driven")
    torque = cj.PiecewiseConstant([0.0, 1e-3, 2e-3], [2.0, -1.0, 0.0])
    motor = cj.DriveTorque("ground", "crank", (0.0, 0.0, 1.0), torque)
    plays_of_four_bar = {"crank pin": 0.1e-3, "rocker foot": 0.2e-3}
    ready = cj.mechanisms
    mechanisms = {
        "slider_crank under a torque that is switched": (
            partial(ready.slider_crank, None, motor=motor),
            3e-3,
        ),
        "Backlash": (partial(plays.shafts, 0.6), 0.02),
        "gear_pair": (ready.gear_pair, 0.02),
        "gear_pair with a mesh that varies": (meshing_gears, 0.01),
        "PinInSlot": (in_slot, 0.01),
        "Stop": (on_plate, 0.03),
        "BallOnBall": (billiards, 0.01),
        "guided_slider_crank": (ready.guided_slider_crank, 4e-3),
        "double_pendulum": (ready.double_pendulum, 0.02),
        "slider_crank": (partial(ready.slider_crank, 0.1e-3), 2e-3),
        "four_bar": (partial(ready.four_bar, speed=5.0), 0.1),
        "four_bar with two plays": (partial(ready.four_bar, plays_of_four_bar, speed=10.0), 0.01),
        "cycloid_stage": (partial(ready.cycloid_stage, torque=2.0), 3e-3),
        "quick_return": (ready.quick_return, 0.04),
        "quick_return without play": (partial(ready.quick_return, None, angle=0.3), 0.1),
        "spatial_four_bar": (partial(ready.spatial_four_bar, speed=40.0), 0.01),
        "spatial_four_bar without play": (partial(ready.spatial_four_bar, None, speed=40.0), 0.05),
        "robot_arm without play": (partial(ready.robot_arm, None, speeds=(2.0, -1.0, 3.0)), 0.05),
        # In contact, what gravity asks of the links turns flanges of 1 g: roundings of so large
        # accelerations make the steps short.
        "robot_arm": (partial(ready.robot_arm, 2e-4), 7e-3, "link 3"),
        "double_four_bar": (ready.double_four_bar, 0.1),
        "bricard": (ready.bricard, 0.1),
        "andrews_squeezer": (ready.andrews_squeezer, 3e-3),
    }
    return found | {
        f"mechanism {name}": CatalogueScene(*scene) for name, scene in mechanisms.items()
    }

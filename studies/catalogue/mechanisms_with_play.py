"""Mechanisms made for play: without it beside closed forms, the rotor beside its film's balance."""

import numpy as np

import clearjoint as cj
from studies.catalogue.check import Check

FINE = cj.Settings(rtol=1e-10, atol=1e-12)
GRAVITY_LOADS = (0.0, 31.6399, 6.0351)
"""Of the arm's three joints in its nominal pose, N m."""


def checks(quick: bool) -> list[Check]:
    """Each mechanism; none is quick."""
    return [] if quick else [_quick_return(), _spatial_four_bar(), _robot_arm(), _rotor(), _wear()]


def turned(body: cj.BodyState, axis: int) -> np.ndarray:
    """Angle of a body about a coordinate axis, rad, at the saved times."""
    orientation = np.asarray(body.orientation)
    return 2.0 * np.arctan2(orientation[:, axis], orientation[:, 0])


def _quick_return() -> Check:
    scene, state = cj.quick_return(None, angle=0.3)
    crank = np.linspace(0.3, 6.3, 25)
    save = cj.Saving((crank - 0.3) / 10.0)
    lever = cj.simulate(scene, state, 0.6, FINE, save, progress=False).states.bodies["lever"]
    expected = np.arctan2(0.05 * np.sin(crank), 0.1 + 0.05 * np.cos(crank))
    off = float(np.abs(turned(lever, 3) - 0.5 * np.pi - expected).max())
    against = "angle of the lever over a turn, rad: closed form"
    return Check("quick_return", "Whitworth's kind", against, off, 1e-8, "")


def _spatial_four_bar() -> Check:
    """d_x cos p + d_y sin p = (d.d + r^2 - l^2)/(2 r), d from the rocker's axis to the crank."""
    scene, state = cj.spatial_four_bar(None, speed=40.0)
    save = cj.Saving(np.linspace(0.01, 0.3, 30))
    bodies = cj.simulate(scene, state, 0.3, FINE, save, progress=False).states.bodies
    crank = turned(bodies["crank"], 1)
    x, y, z = -0.122 + 0.0 * crank, 0.02 * np.cos(crank) + 0.054, 0.02 * np.sin(crank)
    share = (x**2 + y**2 + z**2 + 0.074**2 - 0.122**2) / (2.0 * 0.074 * np.hypot(x, y))
    rocker = np.arctan2(y, x) - np.arccos(share)
    found = turned(bodies["rocker"], 3) + 0.5 * np.pi
    off = float(np.abs(np.sin(found - rocker)).max())
    against = "angle of the rocker, rad: closure of the loop"
    return Check("spatial_four_bar", "RSSR linkages", against, off, 1e-7, "")


def _robot_arm() -> Check:
    scene, state = cj.robot_arm(play=None)
    held = cj.simulate(scene, state, 1e-6, save=cj.Saving([0.0]), progress=False)
    reactions = cj.observe(scene, held).reactions
    found = [np.linalg.norm(reactions[f"motor {k}"][f"link {k}"].moment[0]) for k in (1, 2, 3)]
    off = float(np.abs(np.array(found) - GRAVITY_LOADS).max())
    against = "what gravity asks of the motors, N m: Corke's toolbox, four digits"
    return Check("robot_arm", "PUMA 560; Corke 2017", against, off, 6e-5, "")


def _rotor() -> Check:
    scene, state = cj.rotor_in_bearing(film=cj.CaponeFilm(0.02))
    bearing = scene.joints["bearing"]
    assert isinstance(bearing, cj.LubricatedJoint)
    weight = 9.81 * float(np.asarray(scene.bodies["rotor"].mass))
    found = cj.simulate(scene, state, 0.4, cj.Settings(rtol=1e-8), progress=False).final
    place = np.asarray(found.bodies["rotor"].position)[:2]
    carried = np.asarray(cj.carried_journal(bearing, (0.0, -weight), 200.0).offset)
    off = float(np.abs(place - carried).max() / 50e-6)
    against = "where a rotor floats to from the wall, clearances: the film's balance"
    return Check("LubricatedJoint, rotor_in_bearing", "a rigid rotor", against, off, 1e-5, "")


def _wear() -> Check:
    """A rotor that turns where the wall carries it: V = k F s/H."""
    speed, stiffness, end = 200.0, 1e10, 0.02
    scene, _ = cj.rotor_in_bearing(law=cj.Hertz(stiffness))
    mass = float(np.asarray(scene.bodies["rotor"].mass))
    depth = (0.5 * mass * 9.81 / stiffness) ** (2.0 / 3.0)
    _, state = cj.rotor_in_bearing(
        speed=speed, offset=(0.0, -1.0 - depth / 50e-6), law=cj.Hertz(stiffness)
    )
    wear = cj.ArchardWear("bearing", 1e-5, 2e9)
    axis = cj.Axis(lambda scene: scene.joints["motor"].speed, np.array([speed]))
    swept = cj.sweep(scene, state, end, {"speed": axis}, {"wear": wear}, progress=False)
    expected = 1e-5 * mass * 9.81 * speed * (25e-3 - 50e-6) * end / 2e9
    off = abs(float(swept["wear"][0]) / expected - 1.0)
    against = "volume worn by a rotor that lies on the wall: closed form"
    return Check("ArchardWear", "Archard 1953", against, off, 1e-4, "")

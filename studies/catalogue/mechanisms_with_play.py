"""Mechanisms for joints with clearance: ideal ones against closed forms, the rotor against its
film.
"""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import clearjoint as cj
from clearjoint.plot import style
from studies.catalogue.check import Check
from studies.catalogue.overlay import Compared, legend, overlay

FINE = cj.Settings(rtol=1e-10, atol=1e-12)
GRAVITY_LOADS = (0.0, 31.6399, 6.0351)
"""Static loads of the arm's three joints in its nominal pose, N m."""
CLEARANCE = 50e-6
"""Clearance of the rotor's bearing, m."""
WEAR_COEFFICIENT, HARDNESS = 1e-5, 2e9
"""Archard's wear coefficient, and hardness of the softer side, Pa."""
FIGURE = "[mechanisms with clearance](mechanisms_with_play.png)"


def checks(quick: bool) -> list[Check]:
    """Check each mechanism; none is quick."""
    return [] if quick else [_quick_return(), _spatial_four_bar(), _robot_arm(), _rotor(), _wear()]


def turned(body: cj.BodyState, axis: int) -> np.ndarray:
    """Return the angle of a body about a coordinate axis at the saved times, rad."""
    orientation = np.asarray(body.orientation)
    return 2.0 * np.arctan2(orientation[:, axis], orientation[:, 0])


def quick_return() -> Compared:
    """Return the angle of the lever over that of the crank, rad."""
    scene, state = cj.mechanisms.quick_return(None, angle=0.3)
    crank = np.linspace(0.3, 6.3, 61)
    save = cj.Saving((crank - 0.3) / 10.0)
    lever = cj.simulate(scene, state, 0.6, FINE, save, progress=False).states.bodies["lever"]
    expected = np.arctan2(0.05 * np.sin(crank), 0.1 + 0.05 * np.cos(crank))
    return Compared.along(crank, turned(lever, 3) - 0.5 * np.pi, expected)


def _quick_return() -> Check:
    against = "angle of the lever over a turn, rad: closed form"
    return Check("quick_return", "Whitworth's kind", against, quick_return().off(), 1e-8, FIGURE)


def spatial_four_bar() -> Compared:
    """Return the angle of the rocker over that of the crank, rad.

    The closure of the loop gives d_x cos p + d_y sin p = (d.d + r^2 - l^2)/(2 r), with d from the
    rocker's axis to the crank.
    """
    scene, state = cj.mechanisms.spatial_four_bar(None, speed=40.0)
    save = cj.Saving(np.linspace(0.0, 0.3, 61))
    bodies = cj.simulate(scene, state, 0.3, FINE, save, progress=False).states.bodies
    crank = np.unwrap(turned(bodies["crank"], 1))
    x, y, z = -0.122 + 0.0 * crank, 0.02 * np.cos(crank) + 0.054, 0.02 * np.sin(crank)
    share = (x**2 + y**2 + z**2 + 0.074**2 - 0.122**2) / (2.0 * 0.074 * np.hypot(x, y))
    rocker = np.arctan2(y, x) - np.arccos(share)
    away = turned(bodies["rocker"], 3) + 0.5 * np.pi - rocker
    away = away - 2.0 * np.pi * np.round(away / (2.0 * np.pi))
    return Compared.along(crank, rocker + away, rocker)


def _spatial_four_bar() -> Check:
    against = "angle of the rocker, rad: closure of the loop"
    off = spatial_four_bar().off()
    return Check("spatial_four_bar", "RSSR linkages", against, off, 1e-7, FIGURE)


def gravity_loads() -> np.ndarray:
    """Return the loads of gravity on the arm's motors, (3,) N m."""
    scene, state = cj.mechanisms.robot_arm(play=None)
    held = cj.simulate(scene, state, 1e-6, save=cj.Saving([0.0]), progress=False)
    reactions = cj.observe(scene, held).reactions
    moments = [reactions[f"motor {k}"][f"link {k}"].moment[0] for k in (1, 2, 3)]
    return np.linalg.norm(moments, axis=1)


def _robot_arm() -> Check:
    off = float(np.abs(gravity_loads() - GRAVITY_LOADS).max())
    against = "static loads of the motors, N m: Corke's toolbox, four digits"
    return Check("robot_arm", "PUMA 560; Corke 2017", against, off, 6e-5, FIGURE)


def rotor_path() -> tuple[np.ndarray, np.ndarray]:
    """Return the path of a journal from the wall to its equilibrium, (T, 2), and that equilibrium
    by the film's balance, (2,), both in clearances.
    """
    scene, state = cj.mechanisms.rotor_in_bearing(CLEARANCE, film=cj.films.CaponeFilm(0.02))
    bearing = scene.joints["bearing"]
    assert isinstance(bearing, cj.LubricatedJoint)
    weight = 9.81 * float(np.asarray(scene.bodies["rotor"].mass))
    save = cj.Saving(np.linspace(0.0, 0.4, 801))
    found = cj.simulate(scene, state, 0.4, cj.Settings(rtol=1e-8), save, progress=False).states
    path = np.asarray(found.bodies["rotor"].position)[:, :2]
    carried = np.asarray(cj.carried_journal(bearing, (0.0, -weight), 200.0).offset)
    return path / CLEARANCE, carried / CLEARANCE


def _rotor() -> Check:
    path, carried = rotor_path()
    off = float(np.abs(path[-1] - carried).max())
    against = "equilibrium of a rotor, clearances: the film's balance"
    entry = "LubricatedJoint, rotor_in_bearing"
    return Check(entry, "a rigid rotor", against, off, 1e-5, FIGURE)


def worn() -> Compared:
    """Return the worn volume, 1e3 µm^3, over the sliding distance, m, of a rotor on the wall: V = k
    F s/H.
    """
    stiffness, end = 1e10, 0.02
    speeds = np.array([50.0, 100.0, 150.0, 200.0])
    scene, state = cj.mechanisms.rotor_in_bearing(CLEARANCE, law=cj.laws.Hertz(stiffness))
    load = 9.81 * float(np.asarray(scene.bodies["rotor"].mass))
    depth = (0.5 * load / stiffness) ** (2.0 / 3.0)
    wear = cj.ArchardWear("bearing", WEAR_COEFFICIENT, HARDNESS)
    volumes = []
    for speed in speeds:
        offset = (0.0, -1.0 - depth / CLEARANCE)
        _, state = cj.mechanisms.rotor_in_bearing(
            CLEARANCE, speed=speed, offset=offset, law=cj.laws.Hertz(stiffness)
        )
        axis = cj.Axis(lambda scene: scene.joints["motor"].speed, np.array([speed]))
        swept = cj.sweep(scene, state, end, {"speed": axis}, {"wear": wear}, progress=False)
        volumes.append(float(swept["wear"][0]))
    slid = speeds * (25e-3 - CLEARANCE) * end
    expected = WEAR_COEFFICIENT * load * slid / HARDNESS
    return Compared.along(slid, 1e15 * np.array(volumes), 1e15 * expected)


def _wear() -> Check:
    compared = worn()
    off = float(np.abs(compared.found / compared.expected - 1.0).max())
    against = "worn volume of a rotor on the wall at four speeds: closed form"
    return Check("ArchardWear", "Archard 1953", against, off, 1e-4, FIGURE)


def figure() -> Figure:
    """Draw motions, loads and wear with their expected values."""
    drawn, panels = plt.subplot_mosaic(
        [
            ["lever", "lever", "rocker", "rocker", "loads", "loads"],
            [".", "rotor", "rotor", "wear", "wear", "."],
        ],
        figsize=(11.0, 6.8),
        layout="constrained",
    )
    overlay(panels["lever"], quick_return(), every=3)
    style.dress(panels["lever"], "angle of the crank, rad", "quick return: angle of the lever, rad")
    overlay(panels["rocker"], spatial_four_bar(), every=2)
    style.dress(panels["rocker"], "angle of the crank, rad", "RSSR: angle of the rocker, rad")
    _draw_loads(panels["loads"])
    _draw_rotor(panels["rotor"])
    overlay(panels["wear"], worn())
    style.dress(panels["wear"], "sliding distance, m", "rotor on the wall: worn, 10³ µm³")
    panels["wear"].set(xlim=(0.0, None), ylim=(0.0, None))
    legend(drawn, panels["lever"])
    return drawn


def _draw_loads(axes: Axes) -> None:
    places = np.arange(1, 4)
    axes.bar(places, gravity_loads(), 0.5, color=style.LIGHT, edgecolor=style.BLUE)
    axes.plot(places, GRAVITY_LOADS, "o", color=style.VERMILLION, markersize=5)
    style.dress(axes, "joint of the arm", "PUMA 560: load of gravity, N m")
    axes.set_xticks(places, ["waist", "shoulder", "elbow"])


def _draw_rotor(axes: Axes) -> None:
    path, carried = rotor_path()
    around = np.linspace(0.0, 2.0 * np.pi, 200)
    axes.plot(np.cos(around), np.sin(around), color="0.5", linestyle="--")
    axes.plot(*path.T, color=style.BLUE)
    axes.plot(*carried, "o", color=style.VERMILLION, markersize=5)
    axes.set_aspect("equal")
    style.dress(axes, "x / clearance", "rotor in its film: y / clearance")

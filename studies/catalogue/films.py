"""Films of a journal bearing: published loads, closed forms, and the stability of a rotor."""

import math

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from scipy.integrate import quad
from scipy.optimize import brentq

import clearjoint as cj
from clearjoint.extend import FilmGap, Vector
from clearjoint.plot import style
from studies.catalogue.check import Check

RADIUS, CLEARANCE, VISCOSITY = 25e-3, 50e-6, 0.02
SOMMERFELD_NUMBERS = {1.0: (0.8903, 8.4352), 0.5: (0.3124, 5.0881), 0.25: (0.0888, 2.1595)}
"""Sommerfeld numbers by the ratio of width to diameter, at eccentricity ratios 0.5 and 0.9."""
STABLE_FROM = 0.756
"""Eccentricity ratio from which a rigid rotor in short bearings is stable at all speeds."""
ROUGH = cj.laws.GreenwoodTripp(roughness=0.5e-6, modulus=1.14e11)
FIGURE = "[films](films.png)"


def steady(film: cj.extend.AbstractFilm, ratio: float, length: float) -> np.ndarray:
    """Return radial and tangential force, N, of a fixed journal that spins at 1 rad/s."""
    offset, rate = Vector(ratio, 0.0, 0.0), Vector(0.0, -0.5 * ratio, 0.0)
    axis = Vector(0.0, 0.0, 1.0)
    force = film.force(FilmGap(axis, offset, rate, 0.0, RADIUS, CLEARANCE, length))
    return np.array([float(force.x), float(force.y)])


def sommerfeld_number(film: cj.extend.AbstractFilm, ratio: float, width: float) -> float:
    """Return the load over width, diameter, viscosity and spin, times the squared relative
    clearance.
    """
    length = 2.0 * RADIUS * width
    unit = 2.0 * RADIUS * length * VISCOSITY * (RADIUS / CLEARANCE) ** 2
    return float(np.linalg.norm(steady(film, ratio, length)) / unit)


def checks(quick: bool) -> list[Check]:
    """Check each film, without integrations."""
    del quick
    films = [_of_the_short(), _of_the_finite(), _of_the_endless(), _of_the_threshold()]
    return [*films, _of_the_asperities(), _of_both()]


def mixed(rough: cj.laws.GreenwoodTripp = ROUGH) -> cj.LubricatedJoint:
    """Return a bearing of 20 mm length in which a film and asperities share the load."""
    length = 20e-3
    dry = cj.ClearanceJoint(
        "ground",
        "rotor",
        bearing_radius=RADIUS,
        clearance=CLEARANCE,
        journal_length=length,
        law=cj.laws.RoughCylinders(rough, 0.5 * length, cj.laws.Hertz(1e10)),
        friction=cj.frictions.RegularisedCoulomb(0.1, 1e-6),
        axial=cj.FixedAxially(),
    )
    return cj.LubricatedJoint(dry, cj.films.CaponeFilm(VISCOSITY), transition=None)


def _of_the_asperities() -> Check:
    """Check the force at three distances of the surfaces; its error is of the order of roughness
    over clearance."""
    length = 20e-3

    def integral(distance: float) -> float:
        def along_the_load(angle: float) -> float:
            here = CLEARANCE - (CLEARANCE - distance) * math.cos(angle)
            return float(ROUGH.pressure(here)) * math.cos(angle) * RADIUS * length

        return 2.0 * quad(along_the_load, 0.0, 0.4, points=(0.1, 0.2, 0.3))[0]

    off = max(
        abs(float(ROUGH.force(ROUGH.reach - at, RADIUS, CLEARANCE, length)) / integral(at) - 1.0)
        for at in (0.2e-6, 0.8e-6, 1.5e-6)
    )
    against = "force at three distances: the pressure around the journal by SciPy's quad"
    source = "Greenwood, Tripp 1970"
    return Check("GreenwoodTripp, RoughCylinders", source, against, off, 2.5e-2, FIGURE)


def _of_both() -> Check:
    """Check the friction of a bearing whose film carries the load alone, at a high speed."""
    speed, load, length = 1000.0, 1000.0, 20e-3
    carried = cj.carried_journal(mixed(), (0.0, -load), speed)
    ratio = float(np.linalg.norm(carried.offset)) / CLEARANCE
    shear = VISCOSITY * speed * RADIUS / CLEARANCE
    # The mean of the moments on journal and bearing, which differ by the moment of the load.
    moment = 2.0 * math.pi * RADIUS**2 * length * shear / math.sqrt(1.0 - ratio**2)
    moment += 0.5 * load * abs(float(carried.offset[0]))
    off = abs(abs(float(carried.moment)) / moment - 1.0)
    against = "friction moment of the film at high speed: Sommerfeld's closed form"
    source = "film and asperities"
    return Check("LubricatedJoint(transition=None)", source, against, off, 1e-6, FIGURE)


def _of_the_short() -> Check:
    length = 20e-3
    unit = VISCOSITY * RADIUS * length**3 / (4.0 * CLEARANCE**2)
    found = steady(cj.films.CaponeFilm(VISCOSITY), 0.5, length) / unit
    off = float(np.abs(found / (-16.0 / 9.0, math.pi * 0.5 / 0.75**1.5) - 1.0).max())
    against = "radial and tangential force at half the clearance: closed form"
    return Check("CaponeFilm", "Capone 1986, 1991", against, off, 1e-12, FIGURE)


def _of_the_finite() -> Check:
    film = cj.films.ButenschoenFilm(VISCOSITY)
    off = max(
        abs(sommerfeld_number(film, ratio, width) / expected - 1.0)
        for width, row in SOMMERFELD_NUMBERS.items()
        for ratio, expected in zip((0.5, 0.9), row, strict=True)
    )
    against = "load of three widths at two eccentricities: DIN 31652's table"
    return Check("ButenschoenFilm", "Butenschön 1976", against, off, 0.068, FIGURE)


def _of_the_endless() -> Check:
    length, ratio = 20e-3, 0.6
    found = steady(cj.films.PinkusSternlichtFilm(VISCOSITY), ratio, length)
    found = found / (VISCOSITY * length * RADIUS**3 / CLEARANCE**2)
    square = ratio**2
    radial = -12.0 * square / ((2.0 + square) * (1.0 - square))
    tangential = 6.0 * math.pi * ratio / ((2.0 + square) * math.sqrt(1.0 - square))
    off = float(np.abs(found / (radial, tangential) - 1.0).max())
    against = "force in steady rotation: Sommerfeld's half film"
    return Check("PinkusSternlichtFilm", "Pinkus, Sternlicht 1961", against, off, 1e-12, FIGURE)


def _bearing() -> cj.LubricatedJoint:
    dry = cj.ClearanceJoint(
        "ground",
        "rotor",
        bearing_radius=RADIUS,
        clearance=CLEARANCE,
        journal_length=20e-3,
        law=cj.laws.LankaraniNikravesh(0.7, 1e10),
    )
    return cj.LubricatedJoint(dry, cj.films.CaponeFilm(VISCOSITY), transition=1e-6)


def fastest_growth(ratio: float, speed: float, mass: float) -> float:
    """Return the growth rate of a rotor's whirl about its equilibrium at an eccentricity ratio,
    1/s.
    """
    length = 20e-3
    scale = VISCOSITY * speed * RADIUS * length**3 / (4.0 * CLEARANCE**2)
    square = ratio**2
    root = math.sqrt(math.pi**2 * (1.0 - square) + 16.0 * square)
    load = scale * ratio / (1.0 - square) ** 2 * root
    return float(cj.carried_journal(_bearing(), (load, 0.0), speed).growth(mass).real.max())


def _of_the_threshold() -> Check:
    edge = brentq(lambda ratio: fastest_growth(ratio, 200.0, 1e6), 0.6, 0.85, xtol=1e-4)
    off = abs(float(np.asarray(edge)) - STABLE_FROM)
    against = "least eccentricity ratio of a stable rotor: published"
    source = "linearised `CaponeFilm`"
    return Check("carried_journal", source, against, off, 6e-4, FIGURE)


def critical_mass(ratio: float, speed: float = 200.0) -> float:
    """Return the least mass at which the rotor whirls, kg; NaN if none does."""
    if fastest_growth(ratio, speed, 1e6) < 0.0:
        return math.nan
    found = brentq(lambda log: fastest_growth(ratio, speed, math.exp(log)), -12.0, 13.0, xtol=1e-3)
    return math.exp(float(np.asarray(found)))


def figure() -> Figure:
    """Draw loads of steady rotation, and the mass from which a rotor whirls."""
    drawn, (left, right) = plt.subplots(1, 2, figsize=(10.0, 4.2), layout="constrained")
    ratios = np.linspace(0.02, 0.95, 60)
    colours = (style.BLUE, style.VERMILLION, style.GREEN)
    for (width, row), colour in zip(SOMMERFELD_NUMBERS.items(), colours, strict=True):
        for film, dash in (
            (cj.films.ButenschoenFilm(VISCOSITY), "-"),
            (cj.films.CaponeFilm(VISCOSITY), ":"),
        ):
            numbers = [sommerfeld_number(film, float(ratio), width) for ratio in ratios]
            label = f"B/D = {width:g}" if dash == "-" else None
            left.plot(ratios, numbers, dash, color=colour, label=label)
        left.plot((0.5, 0.9), row, "o", color=colour)
    left.plot([], [], ":", color="0.3", label="short bearing")
    left.plot([], [], "o", color="0.3", label="table")
    left.set_yscale("log")
    left.set_ylim(1e-3, 100.0)
    style.dress(left, "eccentricity / clearance", "Sommerfeld number")
    left.legend(frameon=False)
    places = np.linspace(0.05, 0.75, 15)
    unit = CLEARANCE * 200.0**2
    masses = [critical_mass(float(ratio)) * unit for ratio in places]
    loads = [_load(float(ratio)) for ratio in places]
    right.plot(places, np.array(masses) / loads, "o-", color=style.BLUE, markersize=4)
    right.axvline(STABLE_FROM, color="0.5", linestyle="--")
    right.text(
        STABLE_FROM - 0.02,
        0.9,
        "stable at any\nmass beyond",
        ha="right",
        va="top",
        transform=right.get_xaxis_transform(),
    )
    right.set_ylim(0.0, 30.0)
    style.dress(right, "eccentricity / clearance", "mass · clearance · spin² / load, at the onset")
    return drawn


def _load(ratio: float) -> float:
    length = 20e-3
    return float(np.linalg.norm(steady(cj.films.CaponeFilm(VISCOSITY), ratio, length))) * 200.0

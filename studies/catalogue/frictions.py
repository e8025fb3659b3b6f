"""Friction: ratios against printed formulas, and bristles against the closed form of Dahl and
LuGre.
"""

from collections.abc import Callable

import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from scipy.integrate import solve_ivp

import clearjoint as cj
from clearjoint.plot import style
from studies.catalogue.check import Check

SLOW, FAST = 0.25, 0.15
"""Coefficients of friction at breakaway and in sliding."""
STIFFNESS, STRIBECK_SPEED = 1e5, 0.01
SPEEDS = np.array([1e-4, 5e-4, 2e-3, 0.01, 0.05, 0.3])
"""Slip speeds, m/s."""
FIGURE = "[friction](frictions.png)"
LAWS: dict[str, tuple[cj.extend.AbstractFriction, str, Callable[[np.ndarray], np.ndarray]]] = {
    "RegularisedCoulomb": (
        cj.frictions.RegularisedCoulomb(FAST, 1e-3),
        "Coulomb",
        lambda v: FAST * np.tanh(v / 1e-3),
    ),
    "LinearCoulomb": (
        cj.frictions.LinearCoulomb(FAST, 1e-3),
        "Coulomb",
        lambda v: FAST * np.minimum(v / 1e-3, 1.0),
    ),
    "Threlfall": (
        cj.frictions.Threlfall(FAST, 1e-3),
        "Threlfall 1978",
        lambda v: FAST * (1.0 - np.exp(-3.0 * np.minimum(v / 1e-3, 1.0))),
    ),
    "Ambrosio": (
        cj.frictions.Ambrosio(FAST, 1e-4, 1e-3),
        "Ambrósio 2003",
        lambda v: FAST * np.clip((v - 1e-4) / 9e-4, 0.0, 1.0),
    ),
    "Stribeck": (
        cj.frictions.Stribeck(SLOW, FAST, stribeck_speed=STRIBECK_SPEED, regularisation_speed=1e-6),
        "Stribeck 1902",
        lambda v: _curve(v),
    ),
    "BengisuAkay": (
        cj.frictions.BengisuAkay(SLOW, FAST, breakaway_speed=2e-3, decay=50.0),
        "Bengisu, Akay 1994",
        lambda v: np.where(
            v < 2e-3,
            SLOW * (1.0 - (v / 2e-3 - 1.0) ** 2),
            FAST + (SLOW - FAST) * np.exp(-50.0 * (v - 2e-3)),
        ),
    ),
    "BrownMcPhee": (
        cj.frictions.BrownMcPhee(SLOW, FAST, transition_speed=2e-3),
        "Brown, McPhee 2016",
        lambda v: (
            FAST * np.tanh(4.0 * v / 2e-3)
            + (SLOW - FAST) * (v / 2e-3) / ((v / 4e-3) ** 2 + 0.75) ** 2
        ),
    ),
}
BRISTLES: dict[str, tuple[cj.extend.AbstractBristleFriction, str]] = {
    "Dahl": (cj.frictions.Dahl(FAST, STIFFNESS), "Dahl 1968"),
    "LuGre": (
        cj.frictions.LuGre(
            breakaway=SLOW, kinetic=FAST, stribeck_speed=STRIBECK_SPEED, stiffness=STIFFNESS
        ),
        "Canudas de Wit et al. 1995",
    ),
    "ElastoPlastic": (
        cj.frictions.ElastoPlastic(
            breakaway=SLOW,
            kinetic=FAST,
            stribeck_speed=STRIBECK_SPEED,
            stiffness=STIFFNESS,
            elastic_deflection=0.7e-6,
        ),
        "Dupont et al. 2002",
    ),
}


def _curve(v: np.ndarray) -> np.ndarray:
    """Return Stribeck's curve."""
    return FAST + (SLOW - FAST) * np.exp(-((v / STRIBECK_SPEED) ** 2))


def checks(quick: bool) -> list[Check]:
    """Check each friction law."""
    del quick
    rows: list[Check] = []
    for name, (law, source, formula) in LAWS.items():
        off = np.abs(np.asarray(law.ratio(jnp.asarray(SPEEDS))) - formula(SPEEDS)).max() / FAST
        against = "coefficient at six speeds: the printed formula"
        rows.append(Check(name, source, against, float(off), 1e-12, FIGURE))
    for name in ("Dahl", "LuGre"):
        law, source = BRISTLES[name]
        against = "deflection at constant speed: closed form"
        rows.append(Check(name, source, against, _from_closed_form(name, law), 1e-6, FIGURE))
    return [*rows, _of_elasto_plastic()]


def deflection(
    law: cj.extend.AbstractBristleFriction, times: np.ndarray, speed: Callable[[float], float]
) -> np.ndarray:
    """Return deflections (N,), m, of a bristle at times (N,), s, of a slip at constant speed, by
    SciPy.
    """

    def rate(t: float, z: np.ndarray) -> list[float]:
        slip = cj.extend.Vector(speed(t), 0.0, 0.0)
        return [float(law.rate(cj.extend.Vector(float(z[0]), 0.0, 0.0), slip).x)]

    span = (float(times[0]), float(times[-1]))
    return solve_ivp(rate, span, [0.0], "LSODA", times, rtol=1e-9, atol=1e-15).y[0]


def _from_closed_form(name: str, law: cj.extend.AbstractBristleFriction) -> float:
    """Check a deflection from rest against (g/sigma_0)(1 - exp(-sigma_0 v t/g))."""
    speed = 5e-3
    level = FAST if name == "Dahl" else float(_curve(np.array(speed)))
    times = np.linspace(0.0, 5.0 * level / (STIFFNESS * speed), 20)
    expected = level / STIFFNESS * (1.0 - np.exp(-STIFFNESS * speed * times / level))
    found = deflection(law, times, lambda t: speed)
    return float(np.abs(found - expected).max() * STIFFNESS / level)


def _of_elasto_plastic() -> Check:
    """Check the deflection in long slip, and that small deflections are elastic."""
    law, source = BRISTLES["ElastoPlastic"]
    speed = 5e-3
    level = float(_curve(np.array(speed)))
    slid = deflection(law, np.array([0.0, 40.0 * level / (STIFFNESS * speed)]), lambda t: speed)[-1]
    back = deflection(law, np.array([0.0, 2e-4]), lambda t: 6e-3 if t < 1e-4 else -6e-3)[-1]
    off = max(abs(slid * STIFFNESS / level - 1.0), abs(back) / 0.6e-6)
    against = "deflection in long slip, and none after 0.6 µm and back: closed forms"
    return Check("ElastoPlastic", source, against, float(off), 1e-6, FIGURE)


def figure() -> Figure:
    """Draw ratios against slip speed, and loops of bristles in alternating slip."""
    drawn, (left, right) = plt.subplots(1, 2, figsize=(10.0, 4.2), layout="constrained")
    speeds = np.geomspace(1e-5, 0.3, 400)
    colours = (style.BLUE, style.VERMILLION, style.GREEN, style.PURPLE, style.DARK, "#E69F00")
    for k, (name, (law, _, _)) in enumerate(LAWS.items()):
        look = {"color": colours[k % len(colours)], "linestyle": ("-", "--")[k // len(colours)]}
        left.plot(speeds, np.asarray(law.ratio(jnp.asarray(speeds))), label=name, **look)
    left.set_xscale("log")
    style.dress(left, "slip speed, m/s", "friction / normal force")
    left.legend(frameon=False, fontsize=8)
    times = np.linspace(0.0, 0.05, 2001)
    for (name, (law, _)), colour in zip(BRISTLES.items(), colours, strict=False):
        found = deflection(law, times, lambda t: 5e-4 * np.cos(2.0 * np.pi * 40.0 * t))
        slips = 5e-4 * np.cos(2.0 * np.pi * 40.0 * times)
        ratio = [
            float(law.ratio(z, law.rate(z, slip), slip).x)
            for z, slip in (
                (cj.extend.Vector(float(z), 0.0, 0.0), cj.extend.Vector(float(v), 0.0, 0.0))
                for z, v in zip(found, slips, strict=True)
            )
        ]
        moved = 5e-4 / (2.0 * np.pi * 40.0) * np.sin(2.0 * np.pi * 40.0 * times)
        right.plot(1e6 * moved, ratio, label=name, color=colour)
    style.dress(right, "slip, µm", "friction / normal force")
    right.legend(frameon=False, fontsize=8)
    return drawn

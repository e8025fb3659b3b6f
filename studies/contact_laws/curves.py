"""Elastic forces, loops of free impacts, and delivered restitution of contact laws."""

import warnings
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import clearjoint as cj
from clearjoint.extend import AbstractElasticity

RADIUS, CLEARANCE, LENGTH = 10e-3, 0.5e-3, 20e-3
STEEL = {"young_modulus": 207e9, "poisson_ratio": 0.3}
MASS, SPEED, STIFFNESS = 2.0, 0.1, 6.6e10
ELASTICITIES: dict[str, AbstractElasticity] = {
    "Ravn (spheres)": cj.laws.RavnStiffness(**STEEL),
    "Liu": cj.laws.LiuCylinder(**STEEL, length=LENGTH),
    "Goldsmith; Dubowsky–Freudenstein": cj.laws.GoldsmithCylinder(**STEEL, length=LENGTH),
    "ESDU 78035": cj.laws.EsduCylinder(**STEEL, length=LENGTH),
    "Radzimovsky": cj.laws.RadzimovskyCylinder(**STEEL, length=LENGTH),
    "Johnson": cj.laws.JohnsonCylinder(**STEEL, length=LENGTH),
    "Pereira": cj.laws.PereiraCylinder(**STEEL, length=LENGTH),
    "Persson (overlap)": cj.laws.PerssonCylinder(**STEEL, length=LENGTH),
}
FACTORS: dict[str, type[cj.extend.AbstractDampedLaw]] = {
    "Lee–Wang": cj.laws.LeeWang,
    "Lankarani–Nikravesh": cj.laws.LankaraniNikravesh,
    "Hunt–Crossley": cj.laws.HuntCrossley,
    "Herbert–McWhannell": cj.laws.HerbertMcWhannell,
    "Zhiying–Qishao": cj.laws.ZhiyingQishao,
    "Carvalho–Martins": cj.laws.CarvalhoMartins,
    "Gonthier": cj.laws.Gonthier,
    "Flores 2011": cj.laws.Flores2011,
    "Hu–Guo; Ye": cj.laws.HuGuo,
    "Safaeifar–Farshidianfar": cj.laws.SafaeifarFarshidianfar,
    "Gharib–Hurmuzlu": cj.laws.GharibHurmuzlu,
    "Pant–Wijeyewickrema": cj.laws.PantWijeyewickrema,
}
VISCOUS: dict[str, Callable[[float], cj.laws.KelvinVoigt | cj.laws.FloresKelvinVoigt]] = {
    "Kelvin–Voigt; Tsuji (clamped)": lambda c: cj.laws.KelvinVoigt(c, STIFFNESS, MASS),
    "Kelvin–Voigt of Flores": lambda c: cj.laws.FloresKelvinVoigt(c, STIFFNESS),
}
COLUMNS = (0.1, 0.3, 0.5, 0.7, 0.9)


def elastic_force(elasticity: AbstractElasticity, depths: np.ndarray) -> np.ndarray:
    """Return forces (N,), N, at depths (N,), m."""
    gap = cj.extend.Gap(jnp.asarray(depths), 0.0, RADIUS, CLEARANCE)
    return np.asarray(elasticity.force(gap, 1.5))


def delivered(name: str, requested: np.ndarray) -> np.ndarray:
    """Return the delivered restitutions (N,) of a law in closed form, for requested ones (N,)."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", cj.LawRangeWarning)
        if name in FACTORS:
            law = FACTORS[name]
            factors = [float(law(c, STIFFNESS).damping_factor()) for c in requested]
            return np.asarray(cj.laws.delivered_restitution(np.array(factors)))
        return np.array([float(VISCOUS[name](c).delivered_restitution()) for c in requested])


def jankowski(requested: np.ndarray) -> np.ndarray:
    """Return what Jankowski's law delivers, (N,), by simulated free impacts."""
    laws = [cj.laws.Jankowski(c, STIFFNESS, MASS) for c in requested]
    return np.array([cj.free_impact(law, MASS, SPEED).restitution for law in laws])


def loop(law: Any, steps: int = 4000) -> tuple[np.ndarray, np.ndarray]:
    """Return depths (N,), m, and forces (N,), N, of a free impact.

    Steps of equal length by the classical Runge-Kutta method.
    """
    scale = (MASS * SPEED**2 / float(law.stiffness.stiffness)) ** (1.0 / (law.exponent + 1.0))
    h = 5.0 * scale / SPEED / steps
    entry = SPEED if law.uses_entry_speed else None

    def rates(y):
        return jnp.stack([y[1], -law.force(cj.extend.Gap(y[0], y[1]), entry) / MASS])

    def step(y, _):
        a = rates(y)
        b = rates(y + 0.5 * h * a)
        c = rates(y + 0.5 * h * b)
        d = rates(y + h * c)
        return y + h / 6.0 * (a + 2.0 * b + 2.0 * c + d), y

    start = jnp.array([1e-12 * scale, SPEED])
    path = jax.jit(lambda start: jax.lax.scan(step, start, None, length=steps)[1])(start)
    force = np.asarray(jax.vmap(lambda y: law.force(cj.extend.Gap(y[0], y[1]), entry))(path))
    depth = np.asarray(path[:, 0])
    inside = np.cumsum(depth <= 0.0) == 0
    return depth[inside], force[inside]


def elastic_table() -> list[list[str]]:
    """Return the table of forces at three depths as text."""
    depths = np.array([1e-6, 8e-6, 50e-6])
    head = ["elastic force, N", *(f"at {1e6 * depth:g} µm" for depth in depths)]
    rows = [
        [name, *(f"{force:.4g}" for force in elastic_force(elasticity, depths))]
        for name, elasticity in ELASTICITIES.items()
    ]
    return [head, *rows]


def delivered_table(quick: bool) -> list[list[str]]:
    """Return the table of delivered restitutions as text."""
    requested = np.array(COLUMNS)
    rows = [
        [name, *map("{:.4f}".format, delivered(name, requested))] for name in (*FACTORS, *VISCOUS)
    ]
    if not quick:
        rows.append(["Jankowski", *map("{:.4f}".format, jankowski(requested))])
    return [["requested", *map(str, COLUMNS)], *rows]

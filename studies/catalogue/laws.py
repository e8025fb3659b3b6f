"""Normal laws: delivered restitution against published tables and an integration by SciPy."""

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

import clearjoint as cj
from studies.catalogue.check import Check

STIFFNESS, MASS, SPEED = 6.6e10, 2.0, 0.1
REQUESTED = (0.1, 0.3, 0.5, 0.7, 0.9)
FIGURE = "[restitution](../contact_laws/restitution.png)"
LOOPS = "[loops](../contact_laws/loops.png)"
TABLES: dict[type[cj.extend.AbstractDampedLaw], tuple[str, str, tuple[float, ...]]] = {
    cj.laws.HuntCrossley: (
        "Hunt, Crossley 1975",
        "Exudyn's contactSphereSphereTest.py",
        (0.51586, 0.58132, 0.66298, np.nan, 0.90903),
    ),
    cj.laws.CarvalhoMartins: (
        "Carvalho, Martins 2019",
        "Exudyn's contactSphereSphereTest.py",
        (np.nan, np.nan, 0.50020, np.nan, 0.90002),
    ),
    cj.laws.Gonthier: (
        "Gonthier et al. 2004",
        "Exudyn's contactSphereSphereTest.py",
        (0.10099, 0.30424, np.nan, np.nan, np.nan),
    ),
    cj.laws.YePounding: (
        "Ye et al. 2009",
        "the paper's table",
        (np.nan, 0.271, 0.488, 0.697, 0.900),
    ),
    cj.laws.PantWijeyewickrema: (
        "Pant, Wijeyewickrema 2012",
        "an independent script",
        (np.nan, 0.066, 0.217, 0.477, 0.809),
    ),
}
BY_INTEGRATION: dict[str, tuple[str, Callable[[float], cj.extend.AbstractContactLaw]]] = {
    "LeeWang": ("Lee, Wang 1983", lambda c: cj.laws.LeeWang(c, STIFFNESS)),
    "LankaraniNikravesh": ("paper, eq. 24", lambda c: cj.laws.LankaraniNikravesh(c, STIFFNESS)),
    "HerbertMcWhannell": (
        "Herbert, McWhannell 1977",
        lambda c: cj.laws.HerbertMcWhannell(c, STIFFNESS),
    ),
    "ZhiyingQishao": ("Zhiying, Qishao 2006", lambda c: cj.laws.ZhiyingQishao(c, STIFFNESS)),
    "Flores2011": ("Flores et al. 2011", lambda c: cj.laws.Flores2011(c, STIFFNESS)),
    "HuGuo": ("Hu, Guo 2015", lambda c: cj.laws.HuGuo(c, STIFFNESS)),
    "GharibHurmuzlu": ("Gharib, Hurmuzlu 2012", lambda c: cj.laws.GharibHurmuzlu(c, STIFFNESS)),
    "SafaeifarFarshidianfar": (
        "Safaeifar, Farshidianfar 2020",
        lambda c: cj.laws.SafaeifarFarshidianfar(c, STIFFNESS),
    ),
    "ExactRestitution": ("Zhang, Sharf 2009", lambda c: cj.laws.ExactRestitution(c, STIFFNESS)),
    "KelvinVoigt": ("Kelvin, Voigt", lambda c: cj.laws.KelvinVoigt(c, 1.5e8, MASS)),
    "SpringDashpot": ("Kelvin, Voigt", lambda c: cj.laws.SpringDashpot(1.5e8, 2e4 * (1 - c))),
    "FloresKelvinVoigt": ("Flores", lambda c: cj.laws.FloresKelvinVoigt(c, 1.5e8)),
    "Tsuji": ("Tsuji et al. 1992", lambda c: cj.laws.Tsuji(c, STIFFNESS, MASS)),
    "MemorylessHuntCrossley": (
        "Hunt, Crossley 1975, v0 fixed",
        lambda c: cj.laws.MemorylessHuntCrossley(c, STIFFNESS, SPEED),
    ),
    "KuwabaraKono": (
        "Kuwabara, Kono 1987",
        lambda c: cj.laws.KuwabaraKono(STIFFNESS, 4e6 * (1 - c)),
    ),
    "Ristow": ("Ristow 1992", lambda c: cj.laws.Ristow(STIFFNESS, 1e4 * (1 - c))),
    "BordbarHyppanen": (
        "Bordbar, Hyppänen 2007",
        lambda c: cj.laws.BordbarHyppanen(STIFFNESS, 4e7 * (1 - c)),
    ),
    "ElastoGap": ("Modelica's ElastoGap", lambda c: cj.laws.ElastoGap(1.5e8, 2e4 * (1 - c))),
    "ImpactFunction": (
        "Adams' IMPACT",
        lambda c: cj.laws.ImpactFunction(STIFFNESS, 2e4 * (1 - c), 3e-6),
    ),
    "Jankowski": ("Jankowski 2005", lambda c: cj.laws.Jankowski(c, STIFFNESS, MASS)),
}
BY_RELATION: dict[str, tuple[float, ...]] = {
    "LeeWang": (0.6867, 0.7390, 0.7992, 0.8693, 0.9524),
    "LankaraniNikravesh": (0.6653, 0.6842, 0.7252, 0.7960, 0.9132),
    "HerbertMcWhannell": (0.4907, 0.5200, 0.5936, 0.7227, 0.9009),
    "ZhiyingQishao": (0.2175, 0.3267, 0.4826, 0.6796, 0.8959),
    "Flores2011": (0.0694, 0.2562, 0.4704, 0.6832, 0.8939),
    "HuGuo": (0.0741, 0.2707, 0.4877, 0.6973, 0.8999),
    "GharibHurmuzlu": (0.1000, 0.2819, 0.4107, 0.5008, 0.5668),
    "ExactRestitution": REQUESTED,
}
"""Tables of an independent script, to four digits."""
HERTZ = (1.09336, 1.14326, 3.2181)
"""Depth, force and duration of a Hertzian impact, in its scales."""


def by_scipy(law: cj.extend.AbstractContactLaw) -> float:
    """Return the delivered restitution of a free impact, by SciPy's DOP853 on the law's force."""
    entry = SPEED if law.uses_entry_speed else None

    def rates(t: float, y: np.ndarray) -> list[float]:
        return [y[1], -float(law.force(cj.extend.Gap(y[0], y[1]), entry)) / MASS]

    def out(t: float, y: np.ndarray) -> float:
        return y[0] if t > 0.0 else 1.0

    out.terminal, out.direction = True, -1.0  # type: ignore[attr-defined]
    start = [1e-13, SPEED]
    options: Any = {"rtol": 1e-11, "atol": 1e-15, "max_step": 1e-6}  # over kinks of damping
    found = solve_ivp(rates, (0.0, 0.1), start, "DOP853", events=out, **options)
    return -found.y[1, -1] / SPEED


def checks(quick: bool) -> list[Check]:
    """Check the delivered restitution of each law, and impacts with Hertz's law."""
    rows = [_of_hertz()]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", cj.LawRangeWarning)
        for law, (source, against, expected) in TABLES.items():
            factors = [float(law(c, STIFFNESS).damping_factor()) for c in REQUESTED]
            off = np.abs(np.asarray(cj.laws.delivered_restitution(np.array(factors))) - expected)
            against = f"delivered restitution: {against}"
            rows.append(Check(law.__name__, source, against, float(np.nanmax(off)), 6e-4, FIGURE))
    for name, (source, make) in BY_INTEGRATION.items():
        if name in BY_RELATION:
            rows.append(_by_relation(name, source, make))
        if quick:
            continue
        law = make(0.5)
        off = abs(cj.free_impact(law, MASS, SPEED).restitution - by_scipy(law))
        against = "delivered restitution for 0.5: SciPy's DOP853"
        rows.append(Check(name, source, against, off, 1e-6, FIGURE))
    return rows


def _by_relation(
    name: str, source: str, make: Callable[[float], cj.extend.AbstractContactLaw]
) -> Check:
    """Check the solution of chi (1 + e) = ln[(1 + chi)/(1 - chi e)] against a table."""
    laws = [make(requested) for requested in REQUESTED]
    factors = [
        float(law.damping_factor()) for law in laws if isinstance(law, cj.extend.AbstractDampedLaw)
    ]
    off = np.abs(np.asarray(cj.laws.delivered_restitution(np.array(factors))) - BY_RELATION[name])
    against = "delivered restitution for 0.1 to 0.9: an independent table, four digits"
    return Check(name, source, against, float(off.max()), 6e-5, FIGURE)


def _of_hertz() -> Check:
    """Check penetration, force and duration of an elastic impact, whose scales are known."""
    impact = cj.free_impact(cj.laws.Hertz(STIFFNESS), MASS, SPEED)
    scale = (MASS * SPEED**2 / STIFFNESS) ** 0.4
    found = (
        impact.largest_penetration / scale,
        impact.peak_force * scale / (MASS * SPEED**2),
        impact.duration * SPEED / scale,
    )
    off = max(abs(here / there - 1.0) for here, there in zip(found, HERTZ, strict=True))
    against = "depth, force and duration of an elastic impact: closed forms"
    return Check("Hertz", "Hertz 1882", against, off, 2e-5, LOOPS)

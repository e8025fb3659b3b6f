"""Contact laws of every kind."""

import inspect

import clearjoint as cj

STIFFNESS = 1e7
"""Stiffness of contacts, N/m^1.5."""
CYLINDERS = {name: kind for name, kind in vars(cj.laws).items() if name.endswith("Cylinder")}
"""Every stiffness of a line contact, made of Young's modulus, Poisson's ratio and a length."""


def _needs(kind: type) -> list[str]:
    """The arguments without a default."""
    parameters = inspect.signature(kind).parameters.values()
    return [p.name for p in parameters if p.default is inspect.Parameter.empty]


WITH_RESTITUTION = {
    name: kind
    for name, kind in vars(cj.laws).items()
    if inspect.isclass(kind)
    and issubclass(kind, cj.extend.AbstractDampedLaw)
    and _needs(kind) == ["restitution", "stiffness"]
}
"""Every damped law that is made of a restitution and a stiffness."""


def contact_laws(lossless: bool = False) -> list[cj.extend.AbstractContactLaw]:
    """Every contact law, and Hertz's with every stiffness; without losses at a restitution of one.

    A new law that is made of other arguments than those of `WITH_RESTITUTION` is entered here, with
    a damping of zero if it is to be lossless.
    """
    laws, restitution, damped = cj.laws, 1.0 if lossless else 0.75, 0.0 if lossless else 1.0
    return [
        *(kind(restitution, STIFFNESS) for kind in WITH_RESTITUTION.values()),
        laws.Hertz(STIFFNESS),
        laws.MemorylessHuntCrossley(restitution, STIFFNESS, 0.2),
        laws.KelvinVoigt(restitution, 1e5, 0.7),
        laws.SpringDashpot(1e5, 50.0 * damped),
        laws.Tsuji(restitution, STIFFNESS, 0.7),
        laws.Jankowski(restitution, STIFFNESS, 0.7),
        laws.KuwabaraKono(STIFFNESS, 1e4 * damped),
        laws.BordbarHyppanen(STIFFNESS, 1e4 * damped),
        laws.Ristow(STIFFNESS, 20.0 * damped),
        laws.ElastoGap(1e5, 50.0 * damped),
        laws.ImpactFunction(STIFFNESS, 50.0 * damped, 1.5e-5),
        laws.FloresKelvinVoigt(restitution, 1e5),
        *(laws.Hertz(kind(1e8, 0.3, length=20e-3)) for kind in CYLINDERS.values()),
        laws.Hertz(laws.RavnStiffness(1e8, 0.3)),
        laws.RoughCylinders(laws.GreenwoodTripp(1e-6, 1e8, 0.1, 0.1), 20e-3, laws.Hertz(STIFFNESS)),
    ]

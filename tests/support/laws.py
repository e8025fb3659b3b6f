"""The kinds of contact laws that are made alike."""

import inspect

import clearjoint as cj

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

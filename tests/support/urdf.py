"""Robots in URDF, part by part."""

from collections.abc import Sequence


def robot(*parts: str, name: str = "robot") -> str:
    return f'<robot name="{name}">{"".join(parts)}</robot>'


def tag(kind: str, /, *inside: str, **attributes: object) -> str:
    """An element with those attributes that are not None."""
    given = "".join(f' {key}="{value}"' for key, value in attributes.items() if value is not None)
    return f"<{kind}{given}>{''.join(inside)}</{kind}>" if inside else f"<{kind}{given}/>"


def origin(xyz: str | None, rpy: str | None) -> str:
    return tag("origin", xyz=xyz, rpy=rpy) if xyz or rpy else ""


def link(
    name: str,
    mass: float | None = None,
    moments: Sequence[float] = (),
    *rest: str,
    xyz: str | None = None,
    rpy: str | None = None,
) -> str:
    """A link, with mass, kg, and principal moments of inertia, kg m^2, about a point and axes, or
    without inertia."""
    tensor = dict(zip(("ixx", "iyy", "izz"), moments, strict=False))
    parts = [origin(xyz, rpy), tag("mass", value=mass), tag("inertia", **tensor) if tensor else ""]
    return tag("link", *([] if mass is None else [tag("inertial", *parts)]), *rest, name=name)


def joint(
    name: str,
    kind: str,
    parent: str,
    child: str,
    axis: str | None = None,
    *rest: str,
    xyz: str | None = None,
    rpy: str | None = None,
    limit: Sequence[float] = (),
    **dynamics: float,
) -> str:
    """A joint; `limit`: effort, velocity, lower, upper; `dynamics`: damping, friction."""
    limits = dict(zip(("effort", "velocity", "lower", "upper"), limit, strict=False))
    parts = [tag("parent", link=parent), tag("child", link=child), origin(xyz, rpy)]
    parts += [tag("axis", xyz=axis)] if axis else []
    parts += [tag("limit", **limits)] if limits else []
    parts += [tag("dynamics", **dynamics)] if dynamics else []
    return tag("joint", *parts, *rest, name=name, type=kind)

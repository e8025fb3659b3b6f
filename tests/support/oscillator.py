"""A body on a spring of no length, which moves along X as in the closed form."""

import clearjoint as cj


def on_spring(
    name: str = "ball",
    stiffness: float = 100.0,
    mass: float = 1.0,
    start: float = 0.1,
    damping: float = 0.0,
) -> tuple[cj.Scene, cj.State]:
    """The body and its spring to the origin, N/m, at rest at `start`, m: without damping,
    x = start cos(sqrt(stiffness/mass) t)."""
    spring = cj.SpringDamper("ground", name, (0, 0, 0), (0, 0, 0), stiffness, damping)
    scene = cj.Scene({name: cj.Body(mass, (1e-3, 1e-3, 1e-3))}, forces={"spring": spring})
    return scene, cj.State({name: cj.body_state((start, 0, 0))})

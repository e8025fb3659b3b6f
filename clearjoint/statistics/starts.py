"""Initial states that differ by less than a measurement can resolve, as axes of a zipped sweep.

In a zipped sweep, run i (its lane i) takes the i-th value of every axis.
"""

from collections.abc import Mapping
from functools import partial

import numpy as np
from jaxtyping import Float

from ..dynamics.constraint_report import constraint_report
from ..fields.checks import require
from ..information.error_growth import radii_of_gyration
from ..model.bodies import State
from ..model.scene import Scene
from ..parametrisation.variations import SceneNumber
from ..sweeps.axes import Axis

PARTS = ("velocity", "spin")
"""Fields of a body's initial state that are disturbed; positions are not."""
RANK_TOLERANCE = 1e-8
"""Singular values of the constraints' Jacobian below this share of the largest count as zero, as
those of redundant constraints."""
NEGLIGIBLE = 1e-9
"""Components of a disturbance below this share of its stated size are rounding errors and are set
to zero, so that velocities which the constraints fix get no axis."""


def directions(scene: Scene, members: int, seed: int) -> Float[np.ndarray, "members v"]:
    """Return a random direction in the space of all velocities for each member of an ensemble.

    The v columns are the components of velocity and spin of each body, all standard normal.
    `disturbed_velocities` projects a direction on the velocities that the constraints permit. The
    first rows don't depend on the number of members, so that an ensemble can be extended.
    """
    return np.random.default_rng(seed).standard_normal((members, 6 * len(scene.bodies)))


def disturbed_velocities(
    scene: Scene, state: State, size: float, along: Float[np.ndarray, "n v"], start_time: float
) -> Float[np.ndarray, "n v"]:
    """Return initial velocities (m/s, global) and spins (rad/s, body axes) of n disturbed starts.

    Positions stay as they are. Velocities and spins are those of `state` plus a part of the random
    directions `along`, from `directions`, that the constraints permit.

    **Arguments:** `size`: m/s, expected root mean square of the added speeds over starts and
    bodies, in which a spin counts by the speed at its body's radius of gyration; `start_time`: s,
    of the run, on which constraints by drivers depend.

    **Raises:** `ValueError` if the constraints leave no velocity free.
    """
    radii = radii_of_gyration(scene)
    lengths = np.concatenate([[1.0] * 3 + [radii[name]] * 3 for name in scene.bodies])
    # In speeds at the radius of gyration, spins and velocities of all bodies are comparable. The
    # constraints are linear in the velocities, so that directions in the null space of their
    # Jacobian satisfy them exactly, whatever the size.
    jacobian = constraint_report(scene, state, start_time).jacobian / lengths
    singular, rows = np.zeros(0), np.zeros((0, len(lengths)))
    if jacobian.size:
        _, singular, rows = np.linalg.svd(jacobian)
    rank = int(np.sum(singular > RANK_TOLERANCE * singular.max(initial=0.0)))
    free = rows[rank:] if jacobian.size else np.eye(len(lengths))
    given, remedy = "no free velocity", "remove a joint or driver"
    require(len(free) > 0, "scene", given, "one that can move", remedy)
    # The rows of `free` are orthonormal, so that the expected square of a projected direction is
    # their number. With this factor, the mean over the bodies is the square of `size`.
    added = size * np.sqrt(len(radii) / len(free)) * (along @ free.T) @ free
    added[np.abs(added) < NEGLIGIBLE * size] = 0.0
    return velocities_of(scene, state) + added / lengths


def disturbed_axes(
    scene: Scene,
    state: State,
    axes: Mapping[str, Axis],
    size: float,
    along: Float[np.ndarray, "lanes v"],
    start_time: float,
    members: int = 1,
) -> dict[str, Axis]:
    """Return axes of a zipped sweep that add a disturbance to the initial velocities of each lane.

    **Arguments:**

    - `axes`: further axes of the sweep, of as many values as lanes, which may change the scene and
      the initial state.
    - `size`: m/s, and `along`: random directions, as in `disturbed_velocities`.
    - `start_time`: s, of the runs.
    - `members`: number of successive lanes with equal values of `axes`.

    **Returns:** the given axes, and an axis for each component of a velocity or spin that differs
    from that of the undisturbed state.
    """
    # Axes that change only numbers of the scene leave the initial state as it is. The Jacobian of
    # the given scene then serves all lanes: where a number differs by a small share, the tiny
    # disturbance violates the constraints only by about this share of itself.
    shared = members == 1 and all(isinstance(a.variation, SceneNumber) for a in axes.values())
    block = len(along) if shared else members
    velocities, nominal = np.empty_like(along), np.empty_like(along)
    for first in range(0, len(along), block):
        rows = slice(first, first + block)
        values = {} if shared else {name: axis.values[first] for name, axis in axes.items()}
        at = with_values(scene, state, axes, values)
        velocities[rows] = disturbed_velocities(*at, size, along[rows], start_time)
        nominal[rows] = velocities_of(*at)
    # Components that no disturbance changes, such as all those out of a planar mechanism's plane,
    # need no axis.
    disturbed = dict(axes)
    names = [(b, part, k) for b in scene.bodies for part in PARTS for k in range(3)]
    for column, (body, part, k) in enumerate(names):
        if (velocities[:, column] != nominal[:, column]).any():
            path = partial(_component, body=body, part=part, k=k)
            disturbed[f"{body} {part} {'xyz'[k]}"] = Axis.initial(path, velocities[:, column])
    return disturbed


def _component(state: State, body: str, part: str, k: int) -> float:
    """Return component k of a body's velocity or spin, the `part`; this is the path of an axis."""
    return getattr(state.bodies[body], part)[k]


def velocities_of(scene: Scene, state: State) -> Float[np.ndarray, " v"]:
    """Return velocity (m/s, global) and spin (rad/s, body axes) of each body in a state, (v,), in
    the scene's order of bodies."""
    bodies = [state.bodies[name] for name in scene.bodies]
    return np.concatenate([[*body.velocity, *body.spin] for body in bodies]).astype(float)


def with_values(
    scene: Scene, state: State, axes: Mapping[str, Axis], values: Mapping[str, float]
) -> tuple[Scene, State]:
    """Return scene and initial state with one value of each of several axes.

    **Arguments:** `scene`, `state`: before the change; `axes`: axes of a sweep by name; `values`:
    the value to set for each axis that is to be changed, by the same names.
    """
    for name, value in values.items():
        change = axes[name].setter(scene, state)
        scene, state = change(scene, state, value)
    return scene, state

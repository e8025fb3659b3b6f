"""How large symbols are, how much plays are exaggerated, and from where one looks."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ..fields.checks import require, require_positive
from ..model.scene import Scene
from .motion import BodyPoses
from .survey import SurveyingPen, equivalent_solid, own_points

BAR = 0.014
"""Radius of a bar over the size of the mechanism."""
BORE = 2.4
"""Least radius of a bearing as drawn, over that of a bar."""
DRAWN_GAP = 0.3
"""Largest clearance as drawn, over the radius of its bearing."""
WIDEST_GAP = 0.9
"""Likewise of factors that a user gives."""
PLANAR = 0.95
"""Share of the axes that are parallel from which on a mechanism is planar."""


@dataclass(frozen=True)
class Proportions:
    """Sizes of what is drawn.

    - `size`: of the mechanism, m: the diagonal of the box around it.
    - `bar`: radius of a bar, m.
    - `bearing_scale`: how many times as large as they are bearings, journals and balls are drawn.
    - `clearance_scale`: the same of clearances, and of where journals are in them.
    - `front`, `up`: global unit vectors towards the viewer and upwards, not yet tilted.
    - `planar`: whether one looks at a planar mechanism.
    """

    size: float
    bar: float
    bearing_scale: float
    clearance_scale: float
    front: Float[np.ndarray, "3"]
    up: Float[np.ndarray, "3"]
    planar: bool

    def bore(self, radius: float | None) -> float:
        """Radius of a bearing as drawn, m."""
        return BORE * self.bar if radius is None else radius * self.bearing_scale


def proportions(
    scene: Scene,
    poses: BodyPoses,
    seen: SurveyingPen,
    bearing_scale: float | None,
    clearance_scale: float | None,
) -> Proportions:
    """Those of a scene by what was noted of it; the scales are given, or chosen if ``None``: so
    that bearings, and the widest clearance, can be seen.

    **Raises:** `ValueError` for scales that are not positive, or that leave no journal.
    """
    size = _size(scene, poses, seen)
    bar = BAR * size
    radii = [bore.radius for bore in seen.bores if bore.radius is not None]
    if bearing_scale is None:
        bearing_scale = max(1.0, _rounded(BORE * bar / min(radii))) if radii else 1.0
    require_positive("bearing_scale", bearing_scale, "give how many times as large to draw it")
    drawn = [BORE * bar if b.radius is None else b.radius * bearing_scale for b in seen.bores]
    rooms = [bore / b.clearance for bore, b in zip(drawn, seen.bores, strict=True)]
    if clearance_scale is None:
        clearance_scale = max(1.0, _rounded(DRAWN_GAP * min(rooms))) if rooms else 1.0
    require_positive("clearance_scale", clearance_scale, "give how many times as wide to draw it")
    most = WIDEST_GAP * min(rooms, default=np.inf)
    require(
        clearance_scale <= most,
        "clearance_scale",
        clearance_scale,
        f"at most {most:.3g}, for something of the journal to be left",
        "lower it, or draw bearings larger with `bearing_scale`",
    )
    front, planar = _front(poses, seen)
    up = _up(scene, front, planar)
    return Proportions(size, bar, float(bearing_scale), float(clearance_scale), front, up, planar)


def _size(scene: Scene, poses: BodyPoses, seen: SurveyingPen) -> float:
    """Diagonal of the box around joints and bodies at the first instant, m."""
    points = [poses.point(place.body, place.point)[0] for place in seen.places]
    joined = own_points(seen.places, scene.bodies)
    for name, body in scene.bodies.items():
        solid = equivalent_solid(body)
        if len(np.unique(np.round(joined[name], 9), axis=0)) <= 1:
            ends = solid.axes * (0.5 * solid.sides)
            points += [poses.point(name, sign * end)[0] for end in ends.T for sign in (-1, 1)]
    box = np.ptp(np.array(points), axis=0)
    return float(np.linalg.norm(box)) or 1.0


def _front(poses: BodyPoses, seen: SurveyingPen) -> tuple[np.ndarray, bool]:
    """The axis of a planar mechanism, and whether it is one."""
    axes = [
        poses.direction(place.body, place.axis)[0]
        for place in seen.places
        if place.axis is not None
    ]
    if not axes:
        return np.array([0.0, 0.0, 1.0]), False
    shares, directions = np.linalg.eigh(np.array(axes).T @ np.array(axes))
    main = directions[:, -1]
    main = main * np.sign(main[np.argmax(np.abs(main))])
    return main, bool(shares[-1] > PLANAR * shares.sum())


def _up(scene: Scene, front: np.ndarray, planar: bool) -> np.ndarray:
    """Against gravity, if there is any that one sees act; else along Y, or Z."""
    wishes = [] if scene.gravity is None else [-np.asarray(scene.gravity, dtype=float)]
    for wish in (*wishes, np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])):
        size = np.linalg.norm(wish)
        if size > 0.0 and (not planar or abs(wish @ front) < 0.5 * size):
            return wish / size
    return np.array([1.0, 0.0, 0.0])


def _rounded(number: float) -> float:
    """A number to two digits, rounded down."""
    unit = 10.0 ** (np.floor(np.log10(number)) - 1.0)
    return float(np.round(np.floor(number / unit + 1e-9) * unit, 12))

"""`view`: a mechanism in space, before a run and after it."""

import html
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from types import MappingProxyType

import jax
import numpy as np

from ..fields.checks import require, require_count, require_positive
from ..model.bodies import State
from ..model.scene import Scene
from ..simulation.results.nonsmooth_solution import NonsmoothSolution
from ..simulation.results.observe import MotionMode, Observation, observe
from ..simulation.results.solution import Solution, Trajectory
from .arrows import MODE_NAMES, Arrows, arrows, coloured_by_mode
from .camera import Camera, camera
from .meshes import Mesh, MeshLike, given_mesh
from .motion import (
    BodyPoses,
    at_instants,
    instants_to_show,
    moving,
    require_bodies,
    require_instants,
    standing,
)
from .page import Legend, page
from .parts import FORCE, GROUND_COLOUR, LOAD, MODES, DrawnPart
from .proportions import Proportions, proportions
from .sketching import SketchingPen, colours, sketch
from .survey import survey

Viewable = State | Solution | NonsmoothSolution | Trajectory
"""What says where the bodies are."""
ODD_SIZE = 50.0
"""Size of a given mesh over that of the mechanism, or the inverse, beyond which a unit is wrong."""
PICTURES = (".html", ".gif", ".mp4", ".png", ".pdf", ".svg")
MISSED = 1.1
"""Peak of an impact over the largest force of the frames, from which on it is noted."""
FILMED = 100
"""Frames of an animation."""


class View:
    """A picture of a mechanism in space, which a notebook shows by itself.

    - `parts`: the solids it is made of. `times`: (N,) s of its frames, or ``None``. `legend`: what
      is said beside it: `title`, `entries` of a colour and its meaning, and `notes`.
    - `clearance_scale`, `bearing_scale`: how many times as wide as they are clearances are drawn,
      and as large bearings. `force_scale`: length of the arrow of the largest force over that
      force, m/N.

    >>> four_bar = cj.view(*cj.mechanisms.four_bar(), title="four-bar", clearance_scale=50.0)
    >>> four_bar
    View of four-bar (one state): save it with .save("view.html")
    >>> four_bar.clearance_scale, four_bar.save("four_bar.html").name
    (50.0, 'four_bar.html')
    """

    def __init__(
        self,
        parts: list[DrawnPart],
        where: Camera,
        legend: Legend,
        times: np.ndarray | None,
        scales: tuple[float, float, float],
        height: int,
    ):
        self.parts, self.times = parts, times
        self.clearance_scale, self.bearing_scale, self.force_scale = scales
        self.legend, self._camera, self._height = legend, where, height

    @cached_property
    def html(self) -> str:
        """The whole page: no server, and no network, is needed to look at it."""
        return page(self.parts, self._camera, self.legend, self.times, self._height)

    def save(self, file: str | Path, *, time: float | None = None) -> Path:
        """Write the view, as the file's name ends: ".html" for a page to turn and play, ".gif" or
        ".mp4" for an animation (an MP4 needs ffmpeg), ".png", ".pdf" or ".svg" for a picture.

        **Arguments:** `time`: s, of a picture: of the frame nearest to it, the first by default.

        **Returns:** the file.

        **Raises:** `ValueError` for another ending, for an animation of what stands still, and for
        an MP4 where there is no ffmpeg.

        ```python
        import clearjoint as cj

        cj.view(*cj.mechanisms.four_bar()).save("four_bar.png")
        ```
        """
        file = Path(file)
        ending = file.suffix.lower()
        require(ending in PICTURES, "file", str(file), f"one of {PICTURES}", "name it so")
        if ending == ".html":
            file.write_text(self.html, encoding="utf-8")
            return file
        if ending in (".gif", ".mp4"):
            remedy = "pass a solution to view(), or save a picture"
            require(self.times is not None, "file", str(file), "no animation of one state", remedy)
        from .filming import Film

        Film(self.parts, self._camera, self.legend, self.times).save(
            file, self._frames(ending, time)
        )
        return file

    def _frames(self, ending: str, time: float | None) -> list[int]:
        if self.times is None:
            return [0]
        if ending in (".gif", ".mp4"):
            return instants_to_show(self.times, FILMED).tolist()
        return [0 if time is None else int(np.argmin(np.abs(self.times - time)))]

    def _repr_html_(self) -> str:
        """What notebooks show."""
        inside = html.escape(self.html, quote=True)
        return (
            f'<iframe srcdoc="{inside}" width="100%" height="{self._height}" '
            'style="border:1px solid #ccc" title="view of a mechanism"></iframe>'
        )

    def __repr__(self) -> str:
        frames = "one state" if self.times is None else f"{len(self.times)} frames"
        return f'View of {self.legend.title} ({frames}): save it with .save("view.html")'


def view(
    scene: Scene,
    motion: Viewable | None = None,
    *,
    observation: Observation | None = None,
    forces: bool = True,
    frames: int = 600,
    meshes: Mapping[str, MeshLike] = MappingProxyType({}),
    clearance_scale: float | None = None,
    bearing_scale: float | None = None,
    force_scale: float | None = None,
    centres_of_mass: bool = False,
    inertias: bool = False,
    title: str = "mechanism",
    height: int = 560,
) -> View:
    """A mechanism in space, before a run or moving after it: in a notebook, or saved as a page that
    works without network, an animation or a picture.

    A body is a bar or a plate around its joints' points; one with a single joint, the cylinder or
    box of its mass and inertia. Pins, balls, rails, springs and gears are symbols. Bearings are
    open cylinders, and the journals in them are as far off their middle as they are, times
    `clearance_scale`; after a run their colour is the `MotionMode`, and arrows are the forces on
    the second body of each contact, with their tips where it is touched. The page has a slider for
    the time (opened as `view.html#t=0.25`, it starts at 0.25 s), play and pause, and the speed, and
    says all scales. Flanks of `Backlash`, whose couple
    has no place, are not drawn.

    ```python
    import clearjoint as cj

    scene, state = cj.mechanisms.four_bar({"rocker pin": 0.2e-3})
    cj.view(scene, state).save("four_bar.html")
    ```

    **Arguments:**

    - `motion`: a `State`; a solution with saved states, or steps; or a `Trajectory`. Unless given,
      bodies are where the joints put them, one after the other from the ground on; of loops,
      `assemble` closes what that leaves open, which compiles.
    - `observation`: of the same instants as the motion. By default the solution is observed, which
      compiles once for a structure of scenes; not at all if `forces` is False, and without it there
      are neither arrows nor modes.
    - `frames`: the most that are shown, spread over the time.
    - `meshes`: surfaces of bodies by name, in m in body axes, in place of the bars: a file that
      trimesh reads, an object with `vertices` and `faces`, or a pair of such arrays.
    - `clearance_scale`, `bearing_scale`: how many times as wide as they are to draw clearances, and
      as large bearings; 1.0 for both is the truth. Chosen to be seen unless given.
    - `force_scale`: length of arrows, m/N. Unless given, the largest force has the longest arrow;
      where it is far above the usual ones, such as an impact, lengths grow as the square root of
      forces, which the picture says.
    - `centres_of_mass`, `inertias`: whether to add a black ball at each centre of mass, and the
      solid of each body's mass and inertia.
    - `title`; `height` in a notebook, pixels.

    **Returns:** a `View`.

    **Raises:** `ValueError` for a solution without states, bodies that the scene does not have,
    and meshes or scales that can't be drawn; `ImportError` without the extra `view` (k3d, trimesh).
    """
    require_count("frames", frames, "give the most frames to show")
    if force_scale is not None:
        require_positive("force_scale", force_scale, "give the length of arrows in m/N")
    poses, seen, note = _where(scene, motion, observation, forces, frames)
    noted = survey(scene)
    sizes = proportions(scene, poses, noted, bearing_scale, clearance_scale)
    surfaces = _given(scene, meshes, sizes)
    pen = sketch(scene, poses, sizes, surfaces, centres=centres_of_mass, solids=inertias)
    pushes = arrows(pen, seen, sizes.size, sizes.bar, force_scale)
    parts, modes = pen.parts(), []
    if seen is not None:
        parts, modes = coloured_by_mode(parts, seen)
    parts += pushes.parts
    where = camera(parts, sizes, poses.count)
    notes = [*note, *_notes(bool(noted.bores), sizes, pushes), *_missed(motion, seen)]
    legend = Legend(title, tuple(_entries(scene, pen, modes, pushes)), tuple(notes))
    scales = sizes.clearance_scale, sizes.bearing_scale, pushes.scale
    return View(parts, where, legend, poses.times, scales, height)


def _where(
    scene: Scene,
    motion: Viewable | None,
    observation: Observation | None,
    forces: bool,
    frames: int,
) -> tuple[BodyPoses, Observation | None, list[str]]:
    """Where the bodies are, what is observed at the same instants, and what is to be said of it."""
    if motion is None:
        from .placing import placed

        state, fits = placed(scene)
        told = "as the joints put it" if fits else "joints not closed"
        return standing(state), None, [f"{told}: pass a state for another position"]
    if isinstance(motion, State):
        require_bodies(motion, scene.bodies)
        return standing(motion), None, []
    trajectory = _trajectory(motion)
    if observation is None and trajectory is getattr(motion, "steps", None) and len(trajectory) > 1:
        ends = np.asarray(trajectory.times)
        trajectory = trajectory.between(np.linspace(ends[0], ends[-1], frames))
    require_bodies(trajectory.states, scene.bodies)
    times = np.asarray(trajectory.times)
    require_instants(trajectory)
    chosen = instants_to_show(times, frames)
    shown = at_instants(trajectory, chosen)
    if observation is not None:
        require(
            np.shape(observation.times) == times.shape,
            "observation",
            f"of {np.size(observation.times)} instants",
            f"of the motion's {len(times)}",
            "pass what observe(scene, solution) returns, or nothing",
        )
        observation = _part_of(observation, chosen)
    elif forces and not isinstance(motion, Trajectory) and scene.contact_joints():
        observation = observe(scene, motion, shown)
    return moving(shown), observation if forces else None, []


def _trajectory(motion: Solution | NonsmoothSolution | Trajectory) -> Trajectory:
    """The states that a run has kept."""
    if isinstance(motion, Trajectory):
        return motion
    kinds = isinstance(motion, Solution | NonsmoothSolution)
    remedy = "pass a State, what simulate() returns, or a Trajectory"
    require(kinds, "motion", type(motion).__name__, "a state or a solution", remedy)
    kept = motion.saved if motion.saved is not None else getattr(motion, "steps", None)
    told, expected = "a solution without saved states", "one with states to show"
    remedy = "pass save=Saving(times) or Saving(steps=True) to simulate()"
    require(kept is not None and len(kept) > 0, "motion", told, expected, remedy)
    assert kept is not None
    return kept


def _part_of(observation: Observation, chosen: np.ndarray) -> Observation:
    return jax.tree.map(lambda rows: np.asarray(rows)[chosen], observation)


def _given(scene: Scene, meshes: Mapping[str, MeshLike], sizes: Proportions) -> dict[str, Mesh]:
    """The surfaces that a user gives, checked."""
    found = {}
    for name, value in meshes.items():
        known = sorted(scene.bodies)
        require(name in scene.bodies, "meshes", name, f"by names of bodies {known}", "rename it")
        mesh = given_mesh(f"meshes[{name!r}]", value)
        size = float(np.linalg.norm(np.ptp(mesh.vertices, axis=0)))
        require(
            sizes.size / ODD_SIZE <= size <= sizes.size * ODD_SIZE,
            f"meshes[{name!r}]",
            f"{size:.3g} m large",
            f"about as large as the mechanism, {sizes.size:.3g} m",
            "give it in m; of a file in mm: trimesh.load(file).apply_scale(1e-3)",
        )
        found[name] = mesh
    return found


def _entries(
    scene: Scene, pen: SketchingPen, modes: list[MotionMode], pushes: Arrows
) -> list[tuple[str, str]]:
    entries = [(c, name) for name, c in colours(scene.bodies).items() if c != GROUND_COLOUR]
    entries.append((GROUND_COLOUR, "ground"))
    entries += [(MODES[int(mode)], f"journal: {MODE_NAMES[mode]}") for mode in modes]
    shown = {part.colour for part in pushes.parts}
    entries += [(c, n) for c, n in ((FORCE, "contact force"), (LOAD, "load")) if c in shown]
    return entries


def _notes(has_play: bool, sizes: Proportions, pushes: Arrows) -> list[str]:
    notes = []
    if has_play:
        notes.append(f"clearances drawn {sizes.clearance_scale:g} × as wide")
        if sizes.bearing_scale != 1.0:
            notes.append(f"bearings drawn {sizes.bearing_scale:g} × as large")
    if pushes.parts:
        cut = "" if pushes.cut is None else f", cut at {_newtons(pushes.cut)}"
        length, force = 0.1 * sizes.size, 0.1 * sizes.size / pushes.scale
        if pushes.root:
            length, force = pushes.scale * pushes.largest, pushes.largest
            cut = ", lengths as the square root of forces"
        notes.append(f"arrows: {length:.2g} m for {_newtons(force)}{cut}")
    return notes


def _missed(motion: Viewable | None, seen: Observation | None) -> list[str]:
    """That impacts between the frames have larger forces than the frames show."""
    impacts = motion.impacts if isinstance(motion, Solution) else None
    if seen is None or impacts is None or len(impacts) == 0:
        return []
    bases = [contact for family in seen.contacts.values() for contact in family.values()]
    shown = max((float(np.max(one.normal_force)) for one in bases), default=0.0)
    peak = float(impacts.peak_force.max())
    if peak <= MISSED * shown:
        return []
    return [f"largest contact force of the run, between frames: {_newtons(peak)}"]


def _newtons(force: float) -> str:
    for factor, unit in ((1e6, "MN"), (1e3, "kN"), (1.0, "N"), (1e-3, "mN")):
        if force >= factor:
            return f"{force / factor:.3g} {unit}"
    return f"{force:.3g} N"

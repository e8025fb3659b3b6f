"""Show a mechanism in three dimensions, by the function `view`."""

import html
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import TypeVar

import jax
import numpy as np
from typing_extensions import override

from .._fields.checks import require, require_count, require_finite, require_positive, require_type
from .._model.bodies import State
from .._model.scene import Scene, require_scene
from .._model.survey import survey
from .._simulation.results.nonsmooth_solution import NonsmoothSolution
from .._simulation.results.observe import Observation, observe
from .._simulation.results.solution import Solution, Trajectory
from .arrows import MODE_NAMES, arrows, coloured_by_mode, newtons
from .meshes import FORCE, LOAD, MODES, DrawnPart, Mesh, MeshLike, as_mesh
from .page import Legend, page
from .poses import BodyPoses, body_poses, initial_state, instants_to_show, require_bodies
from .proportions import Camera, Proportions, camera, proportions
from .sketching import colours, sketch

T = TypeVar("T")
Viewable = State | Solution | NonsmoothSolution | Trajectory


@dataclass(eq=False, repr=False)
class View:
    """A three-dimensional view of a mechanism, made by `view`. Notebooks display it.

    - `parts`: the drawn solids.
    - `times`: (N,) s, of the N frames; ``None`` for a single state.
    - `legend`: its `title`; its `entries`, pairs of a colour such as "#0072B2" and its meaning; and
      its `notes`.
    - `clearance_scale`, `bearing_scale`: ratio of drawn to true size of clearances, of bearings.
    - `force_scale`: length of the longest arrow over its force, m/N; by default 1 without forces.

    >>> four_bar = cj.view(*cj.mechanisms.four_bar(), title="four-bar", clearance_scale=50.0)
    >>> four_bar
    View of four-bar (one state): save it with .save("view.html")
    >>> four_bar.clearance_scale, four_bar.save("four_bar.html").name
    (50.0, 'four_bar.html')
    """

    parts: list[DrawnPart]
    times: np.ndarray | None
    legend: Legend
    clearance_scale: float
    bearing_scale: float
    force_scale: float
    _camera: Camera
    _height: int

    @cached_property
    def html(self) -> str:
        """The text of an HTML page with the view, which needs no server and no network.

        **Raises:** `ImportError` without the package k3d.
        """
        return page(self.parts, self._camera, self.legend, self.times, self._height)

    def save(self, file: str | Path, *, time: float | None = None) -> Path:
        """Write the view to a file and return its path: ".html" for an interactive page; ".gif" or,
        with ffmpeg, ".mp4" for up to 100 animated frames; ".png", ".pdf" or ".svg" for a picture.

        **Arguments:** `time`: s; a picture shows the nearest frame, by default the first one.

        **Raises:** `ValueError` for another suffix, for an animation of a single state, and for an
        MP4 without ffmpeg; `ImportError` for a page without the package k3d.
        """
        file = Path(file)
        suffix, suffixes = file.suffix.lower(), (".html", ".gif", ".mp4", ".png", ".pdf", ".svg")
        expected = f"a file with one of the suffixes {suffixes}"
        require(suffix in suffixes, "file", str(file), expected, "rename it")
        if suffix == ".html":
            file.write_text(self.html, encoding="utf-8")
            return file
        from .filming import DPI, SAMPLES, Film

        if time is not None:
            require_finite("time", time)
        is_still = suffix not in (".gif", ".mp4")
        # A picture has twice as many pixels per inch as an animation.
        points_per_inch = SAMPLES if is_still else SAMPLES // 2
        film = Film(self.parts, self._camera, self.legend, self.times, points_per_inch)
        if is_still:
            if self.times is not None and time is not None:
                film.show(int(np.argmin(np.abs(self.times - time))))
            film.figure.savefig(file, dpi=2 * DPI)
            return file
        expected = "a picture, not an animation, of one state"
        remedy = "pass a solution to view(), or save a picture"
        require(self.times is not None, "file", str(file), expected, remedy)
        assert self.times is not None
        film.save(file, instants_to_show(self.times, 100).tolist())  # 4 s at 25 frames per second
        return file

    def _repr_html_(self) -> str:
        content = html.escape(self.html, quote=True)
        return (
            f'<iframe srcdoc="{content}" width="100%" height="{self._height}" '
            'style="border:1px solid #ccc" title="view of a mechanism"></iframe>'
        )

    @override
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
    """Show a mechanism in three dimensions, in one state or along a run.

    A notebook displays the result; `View.save` writes it as a page that works offline, an animation
    or a picture. The page has a slider for the time (`view.html#t=0.25` starts at 0.25 s), a
    playback with variable speed, and a legend with all scales.

    A body is drawn as a bar or a plate around the points of its joints. A body with a single joint
    is drawn as the homogeneous cylinder or box with its mass and moments of inertia. Pins, balls,
    rails, springs and gears are symbols; joints of the class `Backlash` are not drawn. Bearings are
    open cylinders, in which the eccentricities of the journals are enlarged. Along a run, the
    colour of a journal shows its `MotionMode`. Arrows show the contact forces on the second body of
    each joint, with their tips at the contact points, and the loads, which start at the points of
    application.

    ```python
    import clearjoint as cj

    scene, state = cj.mechanisms.four_bar({"rocker pin": 0.2e-3})
    cj.view(scene, state).save("four_bar.html")
    ```

    **Arguments:**

    - `motion`: a `State`; a solution with saved states or steps; or a `Trajectory`, which is shown
      without contact forces. By default, bodies are arranged by following the joints from the
      ground. If loops stay open, `assemble` closes them. Loops that it can't close are shown open,
      and the legend says so.
    - `observation`: from `observe` at the motion's instants; by default computed for a solution.
    - `forces`: whether to draw arrows of contact forces, and colour journals by motion mode. A
      `NonsmoothSolution` has impulses instead of contact forces, so their arrows are left out.
    - `frames`: largest number of frames, at about equal distances in time.
    - `meshes`: meshes of bodies by name, in m in body axes, instead of bars: a file that trimesh
      reads, an object with `vertices` and `faces`, or a tuple of these two arrays.
    - `clearance_scale`, `bearing_scale`: drawn size divided by true size of clearances and of
      bearings. By default both are chosen so that clearances and bearings are visible.
    - `force_scale`: length of an arrow divided by its force, m/N. Arrows longer than 0.3 times the
      diagonal of the box around the mechanism are cut to this length. By default, the arrow of the
      largest force has this length, and lengths are proportional to forces, or to their square
      roots if the largest force exceeds five times the median. The legend says so.
    - `centres_of_mass`: whether to add a black ball at each centre of mass.
    - `inertias`: whether to add the homogeneous solid with each body's mass and moments of inertia.
    - `title`: of the legend. `height`: of the view in a notebook, pixels.

    **Raises:** `ValueError` for a motion without states or with other bodies than the scene; for an
    observation at other instants, or of a single state; and for meshes or scales that can't be
    drawn. `ImportError` without the package trimesh of the extra `view`.
    """
    require_scene(scene)
    require_count("frames", frames, "give a number of frames")
    require_count("height", height, "give a number of pixels")
    if force_scale is not None:
        require_positive("force_scale", force_scale, "give the length of arrows in m/N")
    poses, observed, notes = _poses(scene, motion, observation, forces, frames)
    noted = survey(scene)  # points, axes and clearances of all elements
    sizes = proportions(scene, poses, noted, bearing_scale, clearance_scale)
    shapes = _shapes(scene, meshes, sizes)
    pen = sketch(scene, poses, sizes, shapes, centres=centres_of_mass, solids=inertias)
    # Rigid contacts have impulses, so the contact forces in their observation are meaningless.
    with_forces = None if isinstance(motion, NonsmoothSolution) else observed
    force_arrows = arrows(pen, with_forces, sizes, force_scale)
    parts, modes = pen.parts(), []
    if observed is not None:
        parts, modes = coloured_by_mode(parts, observed)
    parts += force_arrows.parts
    entries = [(colour, name) for name, colour in colours(scene.bodies).items()]
    entries += [(MODES[int(mode)], f"journal: {MODE_NAMES[mode]}") for mode in modes]
    arrow_colours = {part.colour for part in force_arrows.parts}
    entries += [(c, n) for c, n in ((FORCE, "contact force"), (LOAD, "load")) if c in arrow_colours]
    if noted.bores:  # scales of clearances and bearings
        notes.append(f"clearances enlarged {sizes.clearance_scale:g} ×")
        if sizes.bearing_scale != 1.0:
            notes.append(f"bearings enlarged {sizes.bearing_scale:g} ×")
    if force_arrows.parts:
        notes.append(force_arrows.note)
    return View(
        parts,
        poses.times,
        Legend(title, tuple(entries), (*notes, *_missed(motion, observed))),
        clearance_scale=sizes.clearance_scale,
        bearing_scale=sizes.bearing_scale,
        force_scale=force_arrows.scale,
        _camera=camera(parts, sizes),
        _height=height,
    )


def _poses(
    scene: Scene, motion: Viewable | None, observation: Observation | None, forces: bool, most: int
) -> tuple[BodyPoses, Observation | None, list[str]]:
    """Return poses of the bodies in at most `most` frames, the observation there, and notes for the
    legend. Without `motion`, the pose is that of a state found from the joints. Without an
    `observation`, one is computed for a solution with contacts. Without `forces` it is ``None``."""
    if motion is None or isinstance(motion, State):
        remedy = "leave it out, or pass the solution that was observed"
        kind, expected = type(observation).__name__, "None for a single state"
        require(observation is None, "observation", kind, expected, remedy)
    if motion is None:
        state, fits = initial_state(scene)
        text = "state found from the joints" if fits else "joints are not closed"
        return body_poses(state), None, [f"{text}: pass a state for another position"]
    if isinstance(motion, State):
        require_bodies(motion, scene.bodies)
        return body_poses(motion), None, []
    trajectory = _trajectory(motion)
    # Steps are long in free flight. Frames are therefore interpolated at equal distances in time,
    # unless an observation is given: it belongs to the ends of the steps, so these are shown.
    if observation is None and trajectory is getattr(motion, "steps", None) and len(trajectory) > 1:
        ends = np.asarray(trajectory.times)
        trajectory = trajectory.between(np.linspace(ends[0], ends[-1], most))
    times = np.asarray(trajectory.times)
    require_bodies(trajectory.states, scene.bodies, times)
    chosen = instants_to_show(times, most)
    shown = _at(trajectory, chosen)
    if observation is not None:
        observed_times = np.asarray(observation.times)
        is_of_motion = observed_times.shape == times.shape and np.allclose(
            observed_times, times, rtol=1e-9, atol=0.0
        )
        expected = f"of the motion's {len(times)} instants"
        remedy = "pass the result of observe(scene, solution), or nothing"
        given = f"of {observed_times.size} instants"
        require(is_of_motion, "observation", given, expected, remedy)
        observation = _at(observation, chosen)
    elif forces and not isinstance(motion, Trajectory) and scene.contact_joints():
        observation = observe(scene, motion, shown)
    poses = body_poses(shown.states, np.asarray(shown.times, dtype=float))
    return poses, observation if forces else None, []


def _at(recorded: T, chosen: np.ndarray) -> T:
    # The states or observations at the instants with the indices `chosen`.
    return jax.tree.map(lambda rows: np.asarray(rows)[chosen], recorded)


def _trajectory(motion: Solution | NonsmoothSolution | Trajectory) -> Trajectory:
    """Return the saved states of a run or, without any, those at its steps."""
    if isinstance(motion, Trajectory):
        return motion
    remedy = "pass a State, the result of simulate(), or a Trajectory"
    require_type("motion", motion, Solution | NonsmoothSolution, "a state or a solution", remedy)
    # The steps of a run with rigid contacts are a number, not states.
    for saved in (motion.saved, motion.steps):
        if isinstance(saved, Trajectory) and len(saved):
            return saved
    raise ValueError(
        "Argument `motion` must be a solution with saved states, but has none: pass "
        "save=Saving(times) to simulate() or simulate_nonsmooth(), or Saving(steps=True) to "
        "simulate()."
    )


def _shapes(scene: Scene, meshes: Mapping[str, MeshLike], sizes: Proportions) -> dict[str, Mesh]:
    """Check and return the meshes of bodies. The size of each must be that of the mechanism within
    a factor of 50, which a mesh in mm exceeds."""
    checked = {}
    require_type("meshes", meshes, Mapping, "a dictionary by name", "pass {name of body: mesh}")
    for name, value in meshes.items():
        bodies = sorted(scene.bodies)
        require(name in scene.bodies, "meshes", name, f"by names of bodies {bodies}", "rename it")
        mesh = as_mesh(f"meshes[{name!r}]", value)
        size = float(np.linalg.norm(np.ptp(mesh.vertices, axis=0)))  # diagonal of its box, m
        is_usual = sizes.size / 50.0 <= size <= sizes.size * 50.0
        expected = f"about as large as the mechanism, {sizes.size:.3g} m"
        remedy = "give it in m; for a file in mm: trimesh.load(file).apply_scale(1e-3)"
        require(is_usual, f"meshes[{name!r}]", f"{size:.3g} m large", expected, remedy)
        checked[name] = mesh
    return checked


def _missed(motion: Viewable | None, observed: Observation | None) -> list[str]:
    """Return a note, in a list, if the largest force of all impacts acts between frames: if it
    exceeds the forces in all frames by more than a tenth."""
    impacts = motion.impacts if isinstance(motion, Solution) else None
    if observed is None or impacts is None or not len(impacts):
        return []
    contacts = [contact for family in observed.contacts.values() for contact in family.values()]
    shown = max((float(np.max(contact.normal_force)) for contact in contacts), default=0.0)
    peak = float(impacts.peak_force.max())
    is_larger = peak > 1.1 * shown
    return [f"largest contact force, between frames: {newtons(peak)}"] if is_larger else []

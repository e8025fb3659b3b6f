"""What files hold of a class, and the first difference of two objects."""

import dataclasses
import inspect
import json
import math
import re
from collections.abc import Iterator
from typing import Any

import equinox as eqx
import jax
import numpy as np
import pytest
from jaxtyping import Float

import clearjoint as cj
from clearjoint._scene_files.classes import REQUIRED, Expectation, arguments, is_abstract
from clearjoint._scene_files.documents import FileLocation
from clearjoint._scene_files.files import first_difference
from clearjoint.extend import AbstractElasticity
from tests.scene_files.test_round_trips import BODIES, STATE, Polynomial, Push, Way
from tests.support.elements import FIRST, SECOND, THIRD, elements
from tests.support.symmetry_transformations import with_names

FAMILIES = tuple(
    kind
    for name, kind in vars(cj.extend).items()
    if name.startswith("Abstract") and kind.__module__.startswith("clearjoint._model")
)
ELEMENTS = {
    name: kind
    for module in (cj, cj.laws, cj.frictions, cj.films, cj.profiles)
    for name, kind in vars(module).items()
    if isinstance(kind, type) and issubclass(kind, FAMILIES) and not is_abstract(kind)
}
LAW = cj.laws.HuntCrossley(0.7, 1e9 / 3, smoothing=1e-7 / 3)
PIN = {"bearing_radius": 0.01, "clearance": 1e-3 / 3, "journal_length": 0.02, "law": LAW}
DRY = cj.ClearanceJoint("ground", "a", **PIN)
ROUGH = cj.frictions.Ambrosio(0.1)
CASES = {
    "ClearanceJoint": "bearing along its length",
    "GearBacklash": "backlash of gears",
    "GearJoint": "ring gear",
    "JointFriction": "friction of a slider",
    "Servo": "servo",
    "BallInSocket": "ball",
    "SliderInGuide": "slider",
    "PinInSlot": "pin",
    "LubricatedJoint": "CaponeFilm",
}
"""Elements of `tests.support.elements`, by the names of their cases."""
PATCH = cj.laws.GreenwoodTripp(1e-6 / 3, 1e11 / 3)
EXAMPLES = {
    "Backlash": lambda: cj.Backlash("a", "b", play_length=1e-4 / 3, radius=0.1, law=LAW),
    "RoughCylinders": lambda: cj.laws.RoughCylinders(PATCH, 1e-2 / 3, LAW),
    "TeethInMesh": lambda: cj.profiles.TeethInMesh(4 / 3, middle=1 / 3),
    "StiffnessHarmonics": lambda: cj.profiles.StiffnessHarmonics([0.1 / 3], [-0.0]),
    "StiffnessSpline": lambda: cj.profiles.StiffnessSpline.through(1.0 + np.arange(5) / 30),
    "JointCoupling": lambda: cj.JointCoupling(
        cj.RevoluteJoint("ground", "a", (0, 0, 0), (0, 0, 1 / 3), (0, 0, 1), (0, 1, 2)),
        cj.PrismaticJoint("a", "b", (0, 0, 0), (0, 0, 1 / 3), (0, 0, 1)),
        cj.Polynomial([0.1, -1 / 3]),
    ),
    "Polynomial": lambda: cj.Polynomial([1 / 3, 2.0, -1e-17]),
    "Spline": lambda: cj.Spline.through([0.0, 0.1, 0.4, 1 / 3 + 1], [1 / 3, 0.2, -0.0, 7.0]),
    "PiecewiseConstant": lambda: cj.PiecewiseConstant([0.1, 1 / 3], [1 / 3, -0.0]),
    "PiecewiseLinear": lambda: cj.PiecewiseLinear([0.1, 1 / 3], np.eye(2, 3) / 3),
    "EndPlay": lambda: cj.EndPlay(1e-4 / 3, cj.laws.Hertz(1e9), ROUGH, 0.01 / 3),
    "Harmonics": lambda: cj.profiles.Harmonics([0.0, 1e-5 / 3], [1e-6 / 7, -0.0]),
    "PeriodicSpline": lambda: cj.profiles.PeriodicSpline.through(1e-5 * np.sin(np.arange(20) / 3)),
    "Stribeck": lambda: cj.frictions.Stribeck(0.2, 0.1 / 3, stribeck_speed=1e-3 / 3),
    "LuGre": lambda: cj.frictions.LuGre(0.2, 0.1 / 3, stribeck_speed=1e-3 / 3),
    "ElastoPlastic": lambda: cj.frictions.ElastoPlastic(
        0.2, 0.1 / 3, 1e-3 / 3, elastic_deflection=1e-7 / 3
    ),
    "BengisuAkay": lambda: cj.frictions.BengisuAkay(kinetic=0.1 / 3, breakaway=0.2),
    "BrownMcPhee": lambda: cj.frictions.BrownMcPhee(kinetic=0.1 / 3, breakaway=0.2),
}
"""Elements that need other than random arguments."""


ANY_OF = {
    AbstractElasticity: cj.laws.RavnStiffness(207e9, 0.3),
    cj.extend.AbstractStiffness: cj.laws.RavnStiffness(207e9, 0.3),
    cj.extend.AbstractContactLaw: LAW,
    cj.extend.AbstractFriction: cj.frictions.RegularisedCoulomb(0.1),
    cj.extend.AbstractAxialPolicy: cj.FixedAxially(),
    cj.extend.AbstractFunctionOfTime: cj.Polynomial([0.1, 1 / 3]),
}


def exact(path, scene, state, **options) -> tuple[cj.Scene, cj.State]:
    """Scene and state as they are read back, bit for bit the same."""
    cj.save(scene, state, path)
    read = cj.load(path, **options)
    assert first_difference((scene, state), read, FileLocation("round trip")) is None
    return read


def made_at_random(kind: type, draws: Iterator[float]) -> Any:
    """An element with values for all arguments of its constructor."""
    bodies = iter("ab")
    given = {}
    for name, expected in arguments(kind).items():
        if expected.classes:
            given[name] = ANY_OF[expected.classes[0]]
        elif expected.is_text and expected.default is REQUIRED:
            given[name] = next(bodies)
        elif not expected.is_text and (expected.shapes or expected.unit):
            given[name] = numbers(expected, draws)
    return kind(**given)


def rising_numbers() -> Iterator[float]:
    """Numbers with all their digits."""
    return iter(sorted(np.random.default_rng(0).uniform(0.1, 0.5, 100)))


def numbers(expected: Expectation, draws: Iterator[float]) -> Any:
    """Numbers in (0.1, 0.5), which most quantities may be, and Euler parameters."""
    shape = expected.shapes[0] if expected.shapes else ()
    drawn = np.array([next(draws) for _ in range(math.prod(shape))]).reshape(shape)
    if shape == (4,):
        return drawn / np.linalg.norm(drawn)
    return drawn if expected.unit else 1.0 + float(drawn)


def example(name: str) -> Any:
    """One of the exported elements."""
    if name in EXAMPLES:
        return EXAMPLES[name]()
    if name in CASES:
        scene = elements()[CASES[name]].scene
        element = (scene.joints | scene.forces)["element"]
        return with_names(element, {FIRST: "a", SECOND: "b", THIRD: "ground"})
    try:
        return made_at_random(ELEMENTS[name], rising_numbers())
    except (KeyError, ValueError) as error:
        raise AssertionError(f"give an instance of {name} in EXAMPLES") from error


def options_of(element: Any) -> dict[str, Any]:
    """Where an element may stand in a joint with clearance, as an option."""
    if isinstance(element, cj.extend.AbstractContactLaw):
        return {"law": element}
    if isinstance(element, AbstractElasticity):
        return {"law": cj.laws.Hertz(element)}
    if isinstance(element, cj.extend.AbstractFriction | cj.extend.AbstractBristleFriction):
        return {"friction": element}
    if isinstance(element, cj.extend.AbstractProfile):
        return {"bearing_profile": element, "journal_profile": element}
    assert isinstance(element, cj.extend.AbstractAxialPolicy), "say where in a scene it may stand"
    return {"axial": element}


def scene_with(element: Any) -> cj.Scene:
    """A scene that contains an element."""
    if isinstance(element, cj.PiecewiseConstant):
        element = cj.AppliedLoad("a", (0.1, element, 1 / 3))
    if isinstance(element, cj.extend.AbstractForce):
        return cj.Scene(BODIES, forces={"element": element}, gravity=(0.0, -9.81, 1e-17))
    if isinstance(element, cj.extend.AbstractConstraint | cj.extend.AbstractContactJoint):
        joint = element
    elif isinstance(element, cj.extend.AbstractFilm):
        joint = cj.LubricatedJoint(DRY, element, 1e-6 / 3)
    elif isinstance(element, cj.extend.AbstractMeshStiffness):
        error = cj.profiles.Harmonics([1e-6 / 3])
        gears = example("GearBacklash")
        joint = dataclasses.replace(gears, stiffness=element, transmission_error=error)
    elif isinstance(element, cj.extend.AbstractFunctionOfTime):
        joint = cj.PrescribedAngle("a", "b", (0, 0, 1), element)
    else:
        joint = cj.ClearanceJoint("a", "b", **(PIN | options_of(element)))
    return cj.Scene(BODIES, {"element": joint})


def test_all_families_have_elements():
    assert {"ClearanceJoint", "Flores2011", "SpringDamper", "EndPlay"} <= set(ELEMENTS)


@pytest.mark.parametrize("suffix", [".toml", pytest.param(".json", marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", ELEMENTS)
def test_every_element_comes_back_exactly(name, suffix, tmp_path):
    scene, _ = exact(tmp_path / f"scene{suffix}", scene_with(example(name)), STATE)
    assert ELEMENTS[name].__name__ in repr(scene)


def test_entry_speeds_and_jax_arrays_come_back(tmp_path):
    scene, state = cj.mechanisms.double_pendulum()
    entry_speeds = {"shoulder": {"V": np.array(0.1), "W": np.array(0.0)}}
    bodies = jax.tree.map(jax.numpy.asarray, state.bodies)
    late = cj.State(bodies, entry_speeds, {"supplied": np.array(-1 / 3)})
    exact(tmp_path / "late.json", scene, late)


DEEP = ((1.0, 2.0), (3.0,))


@pytest.mark.parametrize("suffix", [".toml", ".json"])
def test_containers_options_and_none_of_a_user_defined_class_come_back(suffix, tmp_path):
    push = Push(
        "a",
        Polynomial((0.1, 2.0)),
        (0.0, 1.0, 0.0),
        parts=(Polynomial((1.0,)), Polynomial((1 / 3,))),
        limits={"first": {"z": 1}, "low = high": (1, 2), "deep": {"x": DEEP}, "mass": 3},
        offset=None,
        is_on=False,
        way=Way.HARD,
    )
    path = tmp_path / f"push{suffix}"
    scene = cj.Scene(BODIES, forces={'gust "x".y': push})
    exact(path, scene, STATE, classes=[Push, Polynomial])


def test_long_tables_of_numbers_come_back(tmp_path):
    table = np.random.default_rng(0).normal(size=(40, 2))
    push = Push("a", Polynomial((1.0,)), (0, 0, 1), limits=table)
    path = tmp_path / "table.toml"
    exact(path, cj.Scene(BODIES, forces={"p": push}), STATE, classes=[Push, Polynomial])
    assert max(map(len, path.read_text().splitlines())) < 100


class Converted(eqx.Module):
    """A class whose annotations declare arrays."""

    rates: np.ndarray
    start: Float[np.ndarray, ""]


def test_arrays_that_are_annotated_come_back(tmp_path):
    arrays = Converted(np.ones((2, 2)) / 3, np.array(0.1))
    push = Push("a", Polynomial((1.0,)), (0, 0, 1), limits=arrays)
    given = [Push, Polynomial, Converted]
    exact(tmp_path / "a.toml", cj.Scene(BODIES, forces={"p": push}), STATE, classes=given)


@pytest.mark.slow
def test_a_user_defined_law_runs_from_a_scene_file(tmp_path):
    """The docstring of `load`: a law in Python, used by a file that names it."""
    blocks = dict(re.findall(r"```(\w+)\n(.*?)```", inspect.getdoc(cj.load) or "", re.DOTALL))
    path = tmp_path / "pendulum.toml"
    path.write_text(blocks["toml"])
    names: dict[str, Any] = {"__name__": "my_laws"}
    exec(blocks["python"].replace("pendulum.toml", str(path)), names)
    scene, state = names["scene"], names["state"]
    assert scene.bodies["arm"].mass == 7.02 and scene.joints["pin"].clearance == 0.5e-3
    assert isinstance(scene.joints["pin"].law, names["Quadratic"])
    solution = cj.simulate(scene, state, 0.02, save=cj.Saving(impacts=True))
    assert len(solution.impacts) > 0
    exact(tmp_path / "after.json", scene, solution.final, classes=[names["Quadratic"]])
    written = json.loads((tmp_path / "after.json").read_text())
    assert written["joints"]["pin"]["law"]["kind"] == "my_laws:Quadratic"

"""Saved scenes are restored bit for bit: every exported element, and user-defined classes."""

import enum
import inspect
import json
import math
import re
import tomllib
import warnings
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

pytestmark = pytest.mark.filterwarnings("ignore::clearjoint.UnusualValueWarning")
BODIES = {"a": cj.Body(1.0, (1.0, 1.1, 1.2)), "b": cj.Body(2.0, np.diag([1.0, 1.1, 1.2]))}
STATE = cj.State({"a": cj.body_state((0.1, 0.2, 0.3)), "b": cj.body_state((1e-300, -0.0, 1 / 3))})
FAMILIES = tuple(
    kind
    for name, kind in vars(cj.extend).items()
    if name.startswith("Abstract") and kind.__module__.startswith("clearjoint._model")
)
PUBLIC = (cj, cj.laws, cj.frictions, cj.films, cj.profiles)
ELEMENTS = {
    name: kind
    for name, kind in {k: v for names in PUBLIC for k, v in vars(names).items()}.items()
    if isinstance(kind, type) and issubclass(kind, FAMILIES) and not is_abstract(kind)
}
LAW = cj.laws.HuntCrossley(0.7, 1e9 / 3, smoothing=1e-7 / 3)
PIN = {"bearing_radius": 0.01, "clearance": 1e-3 / 3, "journal_length": 0.02, "law": LAW}
DRY = cj.ClearanceJoint("ground", "a", **PIN)
BALL = {"socket_radius": 0.01, "clearance": 1e-3 / 3, "law": LAW}
SLIDER = {"half_length": 0.1 / 3, "half_height": 0.01, "clearance": 1e-3 / 3, "law": LAW}
EXAMPLES = {
    "RoughCylinders": lambda: cj.laws.RoughCylinders(
        cj.laws.GreenwoodTripp(1e-6 / 3, 1e11 / 3), 1e-2 / 3, LAW
    ),
    "ClearanceJoint": lambda: cj.ClearanceJoint(
        "ground", "a", **PIN, friction=cj.frictions.Ambrosio(0.1), line_points=5
    ),
    "Backlash": lambda: cj.Backlash("a", "b", play_length=1e-4 / 3, radius=0.1, law=LAW),
    "GearBacklash": lambda: cj.GearBacklash(
        *("a", "b"), (0, 0, 0), (0, 0, 1 / 3), (0, 0, 1), (0, 1, 2), 18, -57, 2e-3, 1e-4 / 3, LAW
    ),
    "GearJoint": lambda: cj.GearJoint("ground", "a", "b", (0, 1, 1 / 3), (1, 0, 0), 17, 51, True),
    "Polynomial": lambda: cj.Polynomial([1 / 3, 2.0, -1e-17]),
    "Spline": lambda: cj.Spline.through([0.0, 0.1, 0.4, 1 / 3 + 1], [1 / 3, 0.2, -0.0, 7.0]),
    "PiecewiseConstant": lambda: cj.PiecewiseConstant([0.1, 1 / 3], [1 / 3, -0.0]),
    "PiecewiseLinear": lambda: cj.PiecewiseLinear([0.1, 1 / 3], np.eye(2, 3) / 3),
    "BallInSocket": lambda: cj.BallInSocket(
        "ground", "a", **BALL, friction=cj.frictions.Ambrosio(0.1)
    ),
    "SliderInGuide": lambda: cj.SliderInGuide(
        "ground", "a", **SLIDER, friction=cj.frictions.Ambrosio(0.1)
    ),
    "PinInSlot": lambda: cj.PinInSlot("ground", "a", play=1e-3 / 3, pin_radius=0.01, law=LAW),
    "LubricatedJoint": lambda: cj.LubricatedJoint(DRY, cj.films.CaponeFilm(0.1 / 3), 1e-6 / 3),
    "EndPlay": lambda: cj.EndPlay(
        1e-4 / 3, cj.laws.Hertz(1e9), cj.frictions.Ambrosio(0.1), 0.01 / 3
    ),
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
    try:
        return made_at_random(ELEMENTS[name], rising_numbers())
    except (KeyError, ValueError) as error:
        raise AssertionError(f"give an instance of {name} in EXAMPLES") from error


def scene_with(element: Any) -> cj.Scene:
    """A scene that contains an element."""
    joints: dict[str, Any] = {}
    if isinstance(element, cj.extend.AbstractForce):
        return cj.Scene(BODIES, forces={"element": element}, gravity=(0.0, -9.81, 1e-17))
    if isinstance(element, cj.extend.AbstractConstraint | cj.extend.AbstractContactJoint):
        joints["element"] = element
    elif isinstance(element, cj.extend.AbstractFilm):
        joints["element"] = cj.LubricatedJoint(DRY, element, 1e-6 / 3)
    elif isinstance(element, cj.extend.AbstractContactLaw):
        joints["pin"] = cj.ClearanceJoint("a", "b", **(PIN | {"law": element}))
    elif isinstance(element, AbstractElasticity):
        joints["pin"] = cj.ClearanceJoint("a", "b", **(PIN | {"law": cj.laws.Hertz(element)}))
    elif isinstance(element, cj.extend.AbstractFriction | cj.extend.AbstractBristleFriction):
        joints["pin"] = cj.ClearanceJoint("a", "b", **PIN, friction=element)
    elif isinstance(element, cj.extend.AbstractProfile):
        joints["pin"] = cj.ClearanceJoint(
            "a", "b", **PIN, bearing_profile=element, journal_profile=element
        )
    elif isinstance(element, cj.PiecewiseConstant):
        return cj.Scene(BODIES, forces={"push": cj.AppliedLoad("a", (0.1, element, 1 / 3))})
    elif isinstance(element, cj.extend.AbstractFunctionOfTime):
        joints["drive"] = cj.PrescribedAngle("a", "b", (0, 0, 1), element)
    else:
        assert isinstance(element, cj.extend.AbstractAxialPolicy), (
            "say where in a scene it may stand"
        )
        joints["pin"] = cj.ClearanceJoint("a", "b", **PIN, axial=element)
    return cj.Scene(BODIES, joints)


def test_all_families_have_elements():
    assert {"ClearanceJoint", "Flores2011", "SpringDamper", "EndPlay"} <= set(ELEMENTS)


@pytest.mark.parametrize("suffix", [".toml", pytest.param(".json", marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", ELEMENTS)
def test_every_element_comes_back_exactly(name, suffix, tmp_path):
    scene, _ = exact(tmp_path / f"scene{suffix}", scene_with(example(name)), STATE)
    assert ELEMENTS[name].__name__ in repr(scene)


@pytest.mark.parametrize(
    "mechanism",
    [
        *(
            cj.mechanisms.double_pendulum,
            cj.mechanisms.slider_crank,
            cj.mechanisms.four_bar,
            cj.mechanisms.double_four_bar,
            cj.mechanisms.bricard,
        ),
        *(cj.mechanisms.andrews_squeezer, cj.mechanisms.gear_pair, cj.mechanisms.robot_arm),
        *(
            cj.mechanisms.guided_slider_crank,
            cj.mechanisms.cycloid_stage,
            cj.mechanisms.quick_return,
            cj.mechanisms.spatial_four_bar,
        ),
    ],
)
def test_mechanisms_come_back_exactly(mechanism, tmp_path):
    exact(tmp_path / "mechanism.toml", *mechanism())


def test_entry_speeds_and_jax_arrays_come_back(tmp_path):
    scene, state = cj.mechanisms.double_pendulum()
    entry_speeds = {"shoulder": {"V": np.array(0.1), "W": np.array(0.0)}}
    bodies = jax.tree.map(lambda leaf: jax.numpy.asarray(leaf), state.bodies)
    exact(
        tmp_path / "late.json",
        scene,
        cj.State(bodies, entry_speeds, {"supplied": np.array(-1 / 3)}),
    )


class Way(enum.Enum):
    SOFT = 1
    HARD = 2


class Polynomial(eqx.Module):
    """A function with numbers, which a file can hold unlike a Python function."""

    coefficients: tuple[float, ...]

    def __call__(self, t):
        return sum(c * t**k for k, c in enumerate(self.coefficients))


class Push(cj.extend.AbstractForce):
    body: str
    over_time: Polynomial
    direction: tuple[float, float, float]
    parts: tuple[Polynomial, ...] = ()
    limits: Any = None
    reach: Any = cj.extend.quantity("m", default=math.inf)
    offset: float | None = 1.0
    label: str | None = "none"
    is_on: bool = True
    way: Way = eqx.field(default=Way.SOFT, static=True)
    orders: tuple[int, ...] = eqx.field(default=(1, 2), static=True)

    def body_names(self):
        return (self.body,)

    def wrenches(self, motions, t):
        force = self.direction * self.over_time(t)
        return {self.body: motions[self.body].wrench(force, cj.extend.Vector(0.0, 0.0, 0.0))}


@pytest.mark.parametrize("suffix", [".toml", ".json"])
def test_containers_options_and_none_of_a_user_defined_class_come_back(suffix, tmp_path):
    push = Push(
        "a",
        Polynomial((0.1, 2.0)),
        (0.0, 1.0, 0.0),
        parts=(Polynomial((1.0,)), Polynomial((1 / 3,))),
        limits={
            "first": {"z": 1},
            "low = high": (1, 2),
            "deep": {"x": ((1.0, 2.0), (3.0,))},
            "mass": 3,
        },
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


def test_the_file_reads_well(tmp_path):
    path = tmp_path / "pendulum.toml"
    cj.save(*cj.mechanisms.double_pendulum(), path)
    text = path.read_text()
    assert '[bodies."arm 2"]\nmass = 7.02 # kg\ninertia = [0.001, 0.5855, 0.5855] # kg m^2' in text
    assert '[joints.shoulder.law]\nkind = "LankaraniNikravesh"\nrestitution = 0.9\n' in text
    assert tomllib.loads(text)["format"] == 1


def test_a_number_instead_of_an_element_is_refused(tmp_path):
    push = Push("a", Polynomial((1.0,)), (0, 0, 1))
    path = tmp_path / "push.json"
    cj.save(cj.Scene(BODIES, forces={"p": push}), STATE, path)
    document = json.loads(path.read_text())
    document["forces"]["p"]["over_time"] = 3
    path.write_text(json.dumps(document))
    with pytest.raises(ValueError, match=r"`forces.p.over_time`: found 3, .* `kind` is a Polynom"):
        cj.load(path, [Push, Polynomial])


def test_saving_does_not_repeat_warnings(tmp_path):
    with pytest.warns(cj.UnusualValueWarning):
        scene = cj.Scene(BODIES, gravity=(0.0, 0.0, -9810.0))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        cj.save(scene, STATE, tmp_path / "heavy.toml")


def saving(element: Any, tmp_path) -> None:
    cj.save(cj.Scene(BODIES, forces={"push": element}), STATE, tmp_path / "scene.toml")


def test_functions_are_refused_by_name(tmp_path):
    push = Push("a", lambda t: t, (0, 0, 1))  # pyright: ignore[reportArgumentType]
    with pytest.raises(ValueError, match=r"`forces.push.over_time`.*a function can't be saved; ma"):
        saving(push, tmp_path)
    assert not list(tmp_path.iterdir())


def test_a_drive_that_follows_a_function_is_refused_by_name(tmp_path):
    scene = cj.Scene(BODIES, {"drive": cj.PrescribedAngle("a", "b", (0, 0, 1), jax.numpy.sin)})
    with pytest.raises(ValueError, match=r"`joints.drive.function.function`.*a function can't be"):
        cj.save(scene, STATE, tmp_path / "scene.toml")


def test_a_number_may_stand_for_a_function_of_time(tmp_path):
    motor = cj.Motor("ground", "a", (0, 0, 1), 0.5, 2.0, 0.1)
    path = tmp_path / "motor.json"
    cj.save(cj.Scene(BODIES, forces={"motor": motor}), STATE, path)
    document = json.loads(path.read_text())
    document["forces"]["motor"]["target"] = "90 deg"
    path.write_text(json.dumps(document))
    (read,) = cj.load(path)[0].forces.values()
    assert isinstance(read, cj.Motor) and isinstance(read.target, cj.Polynomial)
    np.testing.assert_allclose(read.target.coefficients, [math.pi / 2])


def test_nan_is_refused(tmp_path):
    push = Push("a", Polynomial((1.0,)), (0, 0, 1), limits=(1.0, math.nan))
    with pytest.raises(ValueError, match=r"`forces.push.limits\[1\]`: found nan.*NaN is not saved"):
        saving(push, tmp_path)


class Doubling(Push):
    limits: Any = eqx.field(converter=lambda value: 2 * value, default=1)


class Kinds(Push):
    kind: str = "strong"


class Unconverted(eqx.Module):
    """A class whose field keeps a list as it is."""

    rates: Any

    def __call__(self, t):
        return t


class Converted(eqx.Module):
    """A class whose annotations declare arrays."""

    rates: np.ndarray
    start: Float[np.ndarray, ""]


def test_arrays_that_are_annotated_come_back(tmp_path):
    arrays = Converted(np.ones((2, 2)) / 3, np.array(0.1))
    push = Push("a", Polynomial((1.0,)), (0, 0, 1), limits=arrays)
    given = [Push, Polynomial, Converted]
    exact(tmp_path / "a.toml", cj.Scene(BODIES, forces={"p": push}), STATE, classes=given)


class Forgetful(Push):
    def __init__(self, size: float):
        super().__init__("a", Polynomial((size,)), (0, 0, 1))


@pytest.mark.parametrize(
    ("element", "message"),
    [
        (Doubling("a", Polynomial((1.0,)), (0, 0, 1)), r"`forces.push.limits`.*does not restore"),
        (Kinds("a", Polynomial((1.0,)), (0, 0, 1)), r"`forces.push.kind`.*rename"),
        (Doubling("a", Polynomial((1.0,)), (0, 0, 1), limits=[1, [2]]), r"`forces.push.limits`"),
        (
            Push("a", Unconverted(np.ones(2)), (0, 0, 1)),  # pyright: ignore[reportArgumentType]
            r"`forces.push.over_time.kind`.*take a subclass of Polynomial",
        ),
        (
            Push("a", Polynomial((1.0,)), (0, 0, 1), limits=Unconverted(np.ones(2))),
            r"`forces.push.limits.rates`.*declare numbers by `quantity`",
        ),
        (Push("a", Polynomial((1.0,)), (0, 0, 1), label=None), r"`forces.push.label`.*make None"),
        (Forgetful(3.0), r"`forces.push.size`.*store it in a field"),
    ],
)
def test_values_that_would_change_are_refused(element, message, tmp_path):
    with pytest.raises(ValueError, match=message):
        saving(element, tmp_path)


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

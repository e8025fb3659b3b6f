"""Saved scenes are restored bit for bit: every exported element, and user-defined classes."""

import enum
import json
import math
import tomllib
import warnings
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import numpy as np
import pytest

import clearjoint as cj

pytestmark = pytest.mark.filterwarnings("ignore::clearjoint.UnusualValueWarning")
BODIES = {"a": cj.Body(1.0, (1.0, 1.1, 1.2)), "b": cj.Body(2.0, np.diag([1.0, 1.1, 1.2]))}
STATE = cj.State({"a": cj.body_state((0.1, 0.2, 0.3)), "b": cj.body_state((1e-300, -0.0, 1 / 3))})


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


PUSH = "a", Polynomial((1.0,)), (0, 0, 1)


def test_the_file_reads_well(tmp_path):
    path = tmp_path / "pendulum.toml"
    cj.save(*cj.mechanisms.double_pendulum(), path)
    text = path.read_text()
    assert '[bodies."arm 2"]\nmass = 7.02 # kg\ninertia = [0.001, 0.5855, 0.5855] # kg m^2' in text
    assert '[joints.shoulder.law]\nkind = "LankaraniNikravesh"\nrestitution = 0.9\n' in text
    assert tomllib.loads(text)["format"] == 1


def saved_with(folder: Path, force: Any, **changes: Any) -> Path:
    """A file of a scene with a force, in which arguments of the force are others."""
    path = folder / "scene.json"
    cj.save(cj.Scene(BODIES, forces={"p": force}), STATE, path)
    document = json.loads(path.read_text())
    document["forces"]["p"] |= changes
    path.write_text(json.dumps(document))
    return path


def test_a_number_instead_of_an_element_is_refused(tmp_path):
    path = saved_with(tmp_path, Push(*PUSH), over_time=3)
    with pytest.raises(ValueError, match=r"`forces.p.over_time`: found 3, .* `kind` is a Polynom"):
        cj.load(path, [Push, Polynomial])


def test_saving_does_not_repeat_warnings(tmp_path):
    with pytest.warns(cj.UnusualValueWarning):
        scene = cj.Scene(BODIES, gravity=(0.0, 0.0, -9810.0))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        cj.save(scene, STATE, tmp_path / "heavy.toml")


def test_a_drive_that_follows_a_function_is_refused_by_name(tmp_path):
    scene = cj.Scene(BODIES, {"drive": cj.PrescribedAngle("a", "b", (0, 0, 1), jax.numpy.sin)})
    with pytest.raises(ValueError, match=r"`joints.drive.function.function`.*a function can't be"):
        cj.save(scene, STATE, tmp_path / "scene.toml")


def test_a_number_may_stand_for_a_function_of_time(tmp_path):
    motor = cj.Motor("ground", "a", (0, 0, 1), 0.5, 2.0, 0.1)
    read = cj.load(saved_with(tmp_path, motor, target="90 deg"))[0].forces["p"]
    assert isinstance(read, cj.Motor) and isinstance(read.target, cj.Polynomial)
    np.testing.assert_allclose(read.target.coefficients, [math.pi / 2])


class Doubling(Push):
    limits: Any = eqx.field(converter=lambda value: 2 * value, default=1)


class Kinds(Push):
    kind: str = "strong"


class Unconverted(eqx.Module):
    """A class whose field keeps a list as it is."""

    rates: Any

    def __call__(self, t):
        return t


RATES: Any = Unconverted(np.ones(2))


class Forgetful(Push):
    def __init__(self, size: float):
        super().__init__("a", Polynomial((size,)), (0, 0, 1))


@pytest.mark.parametrize(
    ("element", "message"),
    [
        (Push("a", lambda t: t, (0, 0, 1)), r"`forces.push.over_time`.*a function can't be saved"),
        (Push(*PUSH, limits=(1.0, math.nan)), r"limits\[1\]`: found nan.*NaN is not saved"),
        (Doubling(*PUSH), r"`forces.push.limits`.*does not restore"),
        (Kinds(*PUSH), r"`forces.push.kind`.*rename"),
        (Doubling(*PUSH, limits=[1, [2]]), r"`forces.push.limits`"),
        (Push("a", RATES, (0, 0, 1)), r"`forces.push.over_time.kind`.*a subclass of Polynomial"),
        (Push(*PUSH, limits=RATES), r"`forces.push.limits.rates`.*declare numbers by `quantity`"),
        (Push(*PUSH, label=None), r"`forces.push.label`.*make None"),
        (Forgetful(3.0), r"`forces.push.size`.*store it in a field"),
    ],
)
def test_values_that_would_change_are_refused(element, message, tmp_path):
    with pytest.raises(ValueError, match=message):
        cj.save(cj.Scene(BODIES, forces={"push": element}), STATE, tmp_path / "scene.toml")
    assert not list(tmp_path.iterdir())

"""By what a store knows its own: texts that follow from what decides the numbers alone."""

import subprocess
import sys
from functools import partial

import diffrax
import numpy as np
import pytest

import clearjoint as cj
from clearjoint.sweeps.describe import describe, scene_settings, structure_setting


def compiled(code: str):
    """A function whose source cannot be found, as of a session typed in."""
    names = {}
    exec(f"made = {code}", names)
    return names["made"]


def scaled(now, factor=1.0):
    return factor * now.time


def by(factor):
    return lambda now: factor * now.time


class Scaled:
    """A quantity with a setting, which is no module of equinox."""

    def __init__(self, factor):
        self.factor = factor

    def __call__(self, now):
        return self.factor * now.time

    def half(self, now):
        return 0.5 * self(now)


@pytest.mark.parametrize(
    ("one", "same", "other"),
    [
        (by(1.0), by(1.0), by(2.0)),
        (partial(scaled, factor=1.0), partial(scaled, factor=1.0), partial(scaled, factor=2.0)),
        (Scaled(1.0), Scaled(1.0), Scaled(2.0)),
        (Scaled(1.0).half, Scaled(1.0).half, Scaled(2.0).half),
        (
            compiled("lambda now: now.x"),
            compiled("lambda now: now.x"),
            compiled("lambda now: now.y"),
        ),
        (compiled("lambda n: n + 1"), compiled("lambda n: n + 1"), compiled("lambda n: n + 2")),
        (
            compiled("lambda n: [k for k in (lambda: 1,)]"),
            compiled("lambda n: [k for k in (lambda: 1,)]"),
            compiled("lambda n: [k for k in (lambda: 2,)]"),
        ),
        (np.arange(1e3), np.arange(1e3), np.append(np.arange(999.0), 0.0)),
        (diffrax.Tsit5(), diffrax.Tsit5(), diffrax.Dopri5()),
        (cj.Baumgarte(5.0, 5.0), cj.Baumgarte(5.0, 5.0), cj.Baumgarte(5.0, 6.0)),
        ({"a": 1, "b": 2}, {"b": 2, "a": 1}, {"a": 1, "b": 3}),
    ],
)
def test_texts_are_equal_where_the_numbers_will_be(one, same, other):
    assert describe(one) == describe(same) != describe(other)


GAIN = """
import equinox as eqx
class Gain(eqx.Module):
    unit: str = "m"
    def __call__(self, now):
        return {} * now.time
made = Gain()
"""


def test_code_of_a_users_class_counts():
    def gain(factor):
        names = {"__name__": "typed_in"}
        exec(GAIN.format(factor), names)
        return names["made"]

    assert describe(gain(1.0)) == describe(gain(1.0)) != describe(gain(2.0))


IN_ANOTHER = """
import diffrax, clearjoint as cj
from clearjoint.sweeps.describe import describe
print(describe(cj.Peak(cj.quantities.ContactForce("pin"), "N")))
print(describe(diffrax.PIDController(1e-6, 1e-9)))
names = {}
exec("made = lambda n: [k for k in (lambda: 1,)]", names)
print(describe(names["made"]))
"""


def test_texts_are_equal_in_another_process():
    here = [
        describe(cj.Peak(cj.quantities.ContactForce("pin"), "N")),
        describe(diffrax.PIDController(1e-6, 1e-9)),
        describe(compiled("lambda n: [k for k in (lambda: 1,)]")),
    ]
    there = subprocess.run(
        [sys.executable, "-c", IN_ANOTHER], capture_output=True, text=True, check=True
    )
    assert there.stdout.splitlines() == here


def test_numbers_and_structure_of_a_scene_are_told_apart():
    scene, state = cj.double_pendulum()
    other, _ = cj.double_pendulum(clearance=1e-4)
    hertz, _ = cj.double_pendulum(law=cj.Hertz(1e10))
    settings, others = scene_settings(scene, state), scene_settings(other, state)
    differ = [name for name in settings if settings[name] != others[name]]
    assert differ == ["scene.joints['shoulder'].clearance"]
    assert structure_setting(scene) == structure_setting(other) != structure_setting(hertz)

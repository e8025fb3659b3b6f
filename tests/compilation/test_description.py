"""Descriptions of values: what changes them, what doesn't, and what has none."""

import functools
import importlib
import json
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import clearjoint as cj
from clearjoint.compilation.description import Description, described
from clearjoint.compilation.words import UndescribedError

MAIN = """
import functools
import math
import equinox as eqx
import jax.numpy as jnp
import numpy as np
from user_helper import slope
import user_other

RATE = 2.0
TABLE = np.array([1.0, 2.0])

def closure(factor):
    def inner(x):
        return factor * x
    return inner

tripled = closure(3.0)

class Base(eqx.Module):
    def offset(self):
        return 1.0

class Own(Base):
    number: float
    kind: str = eqx.field(default="plain", static=True)

    def value(self, x, shift=0.5):
        '''A value.'''
        y = RATE * x + slope(x) + user_other.far(x) + jnp.sin(TABLE[0]) + shift
        return tripled(y) + self.offset() + (lambda z: z + 4.0)(x)

    @property
    def doubled(self):
        return 2.0 * self.number
"""
HELPER = """
from user_other import deep

def slope(x):
    return deep(x) + 1.0
"""
OTHER = """
LIMIT = 7.0

def deep(x):
    return x * LIMIT

def far(x):
    return x - 1.0

def unused(x):
    return x
"""
EDITS = {
    "a method": ("main", "z + 4.0", "z + 5.0"),
    "a constant": ("main", "RATE = 2.0", "RATE = 2.5"),
    "an array": ("main", "[1.0, 2.0]", "[1.0, 2.5]"),
    "a default": ("main", "shift=0.5", "shift=0.6"),
    "a closure": ("main", "closure(3.0)", "closure(4.0)"),
    "a base": ("main", "return 1.0", "return 2.0"),
    "a property": ("main", "2.0 * self", "3.0 * self"),
    "a default of a field": ("main", '"plain"', '"other"'),
    "a helper": ("helper", "+ 1.0", "+ 2.0"),
    "a helper of the helper": ("other", "LIMIT = 7.0", "LIMIT = 8.0"),
    "a function of a module": ("other", "x - 1.0", "x - 2.0"),
}
NOTHING = {
    "a comment": ("main", "RATE = 2.0", "# now\nRATE = 2.0"),
    "a docstring": ("main", "import math", "import math\n'''Text.'''\n"),
    "what is not used": ("other", "return x\n", "return -x\n"),
}


@pytest.fixture
def own(tmp_path, monkeypatch):
    """The digest of an instance of a class of one's own, after an edit of its files."""
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(sys, "dont_write_bytecode", True)

    def digest(part="", old="", new=""):
        texts = {"main": MAIN, "helper": HELPER, "other": OTHER}
        if part:
            assert old in texts[part]
            texts[part] = texts[part].replace(old, new)
        for name, text in texts.items():
            (tmp_path / f"user_{name}.py").write_text(text)
        for name in ("user_other", "user_helper", "user_main"):
            sys.modules.pop(name, None)
        importlib.invalidate_caches()
        return described(importlib.import_module("user_main").Own(1.0))

    yield digest
    for name in ("user_other", "user_helper", "user_main"):
        sys.modules.pop(name, None)


@pytest.mark.parametrize("edit", EDITS.values(), ids=EDITS)
def test_an_edit_of_anything_that_is_reached_changes_it(own, edit):
    assert own(*edit) != own()


@pytest.mark.parametrize("edit", NOTHING.values(), ids=NOTHING)
def test_an_edit_of_nothing_that_is_reached_does_not(own, edit):
    assert own(*edit) == own()


def test_data_differ_by_type_and_value():
    values = (1, 1.0, True, "1", b"1", (1,), [1], {1: 2}, {1}, np.array(1), np.float32(1), None)
    assert len({described(value) for value in values}) == len(values)
    assert described({"a": [1, (2.0, "b")]}) == described({"a": [1, (2.0, "b")]})
    assert described([("a", "bc")]) != described([("ab", "c")])


def test_a_value_may_hold_itself():
    loop: list[object] = [1.0]
    loop.append(loop)
    other: list[object] = [2.0]
    other.append(other)
    assert described(loop) != described(other)


OUTSIDE = SimpleNamespace(number=1.0)


def _reads_a_file(x):
    return x + float(open("number.txt").read())


def _draws(x):
    return x + np.random.default_rng().normal()


def _imports(x):
    import time

    return x + time.time()


def _remembers(x):
    global OUTSIDE
    OUTSIDE = x
    return x


def _evaluates(x):
    return eval("x + 1")


def _asks_the_system(x):
    return x + len(sys.argv)


def _by_a_name(x):
    return getattr(functools, "".join(["re", "duce"]))(max, x)


def _loads(x):
    return x + np.load("number.npy")


@pytest.mark.parametrize(
    "function",
    [
        _reads_a_file,
        _draws,
        _imports,
        _remembers,
        _evaluates,
        _asks_the_system,
        _by_a_name,
        _loads,
    ],
)
def test_what_may_depend_on_more_than_can_be_seen_has_none(function):
    for reached in (function, functools.partial(function, 1.0), lambda: function(1.0)):
        with pytest.raises(UndescribedError):
            described(reached)


def test_attributes_may_go_by_the_names_of_functions():
    assert described(lambda machine, name: machine.load + machine.input + getattr(machine, name))


def test_a_function_written_in_c_elsewhere_has_none():
    with pytest.raises(UndescribedError):
        described(iter([1]))


PACKAGE = """
import json
from unittest.mock import Mock, patch
import clearjoint as cj
from clearjoint.compilation.description import described
from clearjoint.compilation.words import UndescribedError
from clearjoint.compilation.package_state import held
from clearjoint.simulation import stepping

def state():
    return held([stepping.__name__, cj.RegularisedCoulomb.__module__])

def patched(*place):
    with patch.object(*place):
        try:
            return state() != before
        except UndescribedError:
            return "refused"

before = state()
from clearjoint.simulation import step_length
number = next(n for n, v in vars(step_length).items() if type(v) is float)
print(json.dumps({
    "digests": [described([cj.double_pendulum(), frozenset("abcdef"), cj.presets.default]), before],
    "of a number": patched(step_length, number, 123.0),
    "of a function": patched(stepping, "attempt", lambda *arguments: arguments),
    "of a method": patched(cj.RegularisedCoulomb, "ratio", lambda self, speed: speed),
    "by a mock": patched(stepping, "attempt", Mock()),
    "afterwards": state() != before,
}))
"""


@pytest.fixture(scope="module")
def fresh():
    """What two processes of other hash seeds print. Here shapes are checked by other code."""
    variables = {"PYTHONPATH": str(Path(cj.__file__).parents[1])}
    return [
        json.loads(
            subprocess.run(
                [sys.executable, "-c", PACKAGE],
                env=os.environ | variables | {"PYTHONHASHSEED": seed},
                capture_output=True,
                text=True,
                check=True,
            ).stdout
        )
        for seed in ("1", "2")
    ]


def test_other_processes_say_the_same(fresh):
    assert fresh[0]["digests"] == fresh[1]["digests"]


@pytest.mark.parametrize("replaced", ["of a number", "of a function", "of a method"])
def test_what_was_put_into_the_package_is_seen(fresh, replaced):
    assert fresh[0][replaced] is True and fresh[0]["afterwards"] is False


def test_what_cannot_be_described_in_the_package_is_refused(fresh):
    assert fresh[0]["by a mock"] == "refused"


def test_modules_of_what_is_described_are_known():
    description = Description()
    description.add(cj.double_pendulum())
    assert {"clearjoint.model.plays.clearance", "clearjoint.model.bodies"} <= description.packages

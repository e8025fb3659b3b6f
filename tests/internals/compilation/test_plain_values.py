"""Digests of values: equal and different ones, and values that are refused."""

import collections
import copy
import functools
import math
import types
from typing import Any

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import clearjoint as cj
from clearjoint._compilation.plain_values import NotPlainError, digest_of
from clearjoint.results import MotionMode


def test_data_differ_by_type_and_value():
    array = np.array([1.0, 2.0])
    values = (1, 1.0, True, "1", b"1", (1,), [1], {1: 2}, {"1": 2}, np.array(1), np.float32(1))
    values += (None, array, array[:, None], array.astype(">f8"), 0.0, -0.0, math.nan, (1, (2,)))
    values += (MotionMode(0), MotionMode(1), diffrax.Tsit5)
    values += (("a", "bc"), ("ab", "c"), cj.simulate, cj.Body, cj.Body.rod)
    assert len({digest_of(value) for value in values}) == len(values)
    assert digest_of({"a": [1, (2.0, "b")]}) == digest_of({"a": [1, (2.0, "b")]})


def test_values_of_the_package_have_a_digest():
    settings = (cj.presets.accurate, cj.Settings(solver=diffrax.Dopri8()))
    scene, state = cj.mechanisms.double_pendulum()
    values = (*settings, scene, state, cj.mechanisms.double_pendulum(0.1e-3)[0])
    assert len({digest_of(value) for value in values}) == len(values)
    assert digest_of(cj.mechanisms.double_pendulum()[0]) == digest_of(scene)


def test_data_of_versioned_packages_differ_by_content():
    """Also where the data are neither attributes nor items."""
    values = [np.ma.array([1.0, 2.0], mask=[True, k]) for k in (False, True)]
    values += [np.random.default_rng(k) for k in (0, 1)]
    values += [types.SimpleNamespace(k=np.array([1.0 + k])) for k in (0.0, 1e-10)]
    values += [collections.OrderedDict(a=k) for k in (1, 2)]
    values += [collections.defaultdict(float, a=k) for k in (1, 2)]
    values += [cj.Saving(steps=k).require_none for k in (False, True)]
    values += [jax.ShapeDtypeStruct((k,), float, weak_type=weak) for k, weak in ((1, 0), (2, 0))]
    values += [functools.partial(cj.simulate, k) for k in (1, 2)]
    assert len({digest_of(value) for value in values}) == len(values)
    assert digest_of(jnp.sin) != digest_of(jnp.cos)
    again = [digest_of(copy.deepcopy(value)) for value in values]
    assert again == [digest_of(value) for value in values]


class Own(cj.laws.HuntCrossley):
    pass


class Holder(eqx.Module):
    value: Any


class Number(float):
    pass


class Disguised:
    def __reduce__(self):
        return dict, ()


def function(x):
    return x


def marked():
    body = cj.Body(1.0, (1.0, 1.0, 1.0))
    object.__setattr__(body, "more", function)
    return body


def looped():
    loop: list[object] = []
    loop.append(loop)
    return loop


FOREIGN = {
    "an instance of a subclass": Own(0.8, 1e9),
    "an instance of a module": Holder(1.0),
    "a class": Own,
    "a function": function,
    "a partial function": functools.partial(function, 1.0),
    "a method": Own(0.8, 1e9).force,
    "a jitted function": jax.jit(function),
    "a module": types,
    "a namespace": types.SimpleNamespace(k=function),
    "an instance that claims to be a dictionary": Disguised(),
    "an array of objects": np.array([function], dtype=object),
    "a subclass of a number": Number(1.0),
    "a dictionary with a default of others": collections.defaultdict(function),
    "an iterator": iter([1.0]),
    "a structure": jax.tree.structure(Holder(1.0)),
    "an attribute beyond the fields": marked(),
    "a list in itself": looped(),
}


@pytest.mark.parametrize("value", FOREIGN.values(), ids=FOREIGN)
def test_values_that_contain_other_code_are_refused(value):
    for held in (value, [(value,)], {"a": value}):
        with pytest.raises(NotPlainError):
            digest_of(held)


def test_traced_numbers_are_refused():
    def traced(x):
        with pytest.raises(NotPlainError, match="traces"):
            digest_of({"a": [x]})
        return x

    jax.jit(traced)(1.0)
    jax.grad(traced)(1.0)


def test_classes_with_a_name_of_the_package_are_refused():
    """A class must be the member of the package's module with its name."""
    disguised = type("Saving", (cj.Saving,), {"__module__": cj.Saving.__module__})
    assert digest_of(cj.Saving())
    with pytest.raises(NotPlainError):
        digest_of(disguised())

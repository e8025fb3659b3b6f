"""User-defined classes from the docstrings of their base classes: the examples are complete, accept
plain numbers, and their numbers are not part of a compiled program."""

import inspect
import re
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import clearjoint as cj
from clearjoint._fields.objects import AbstractConverting, with_arrays
from clearjoint._simulation.run.host_run import segment_compiled
from tests.support.programs import made_by

ABSTRACT = {
    name: getattr(owner, name)
    for owner in (cj, cj.quantities)
    for name in vars(owner)
    if name.startswith("Abstract")
}


def example(cls: type) -> dict[str, Any]:
    """The definitions of the Python example in a class's docstring."""
    (block,) = re.findall(r"```python\n(.*?)```", inspect.getdoc(cls) or "", re.DOTALL)
    names: dict[str, Any] = {"__name__": "a_user"}
    exec(block, names)
    return names


@pytest.mark.parametrize("name", ABSTRACT)
def test_each_docstring_has_a_whole_class_whose_numbers_are_arrays(name):
    names = example(ABSTRACT[name])
    owned = [c for c in names.values() if isinstance(c, type) and c.__module__ == "a_user"]
    assert len(owned) == 1 and issubclass(owned[0], ABSTRACT[name])
    values = [value for value in names.values() if isinstance(value, eqx.Module)]
    for leaf in jax.tree.leaves(values):
        assert isinstance(leaf, np.ndarray | jax.Array) and leaf.dtype == np.float64, leaf


def test_changing_a_number_of_a_user_defined_motor_does_not_recompile():
    Motor = example(cj.extend.AbstractDriveTorque)["Motor"]  # noqa: N806

    def speed(torque: float, idle_speed: float) -> float:
        motor = Motor("ground", "crank", (0, 0, 1), torque, idle_speed)
        scene, state = cj.mechanisms.slider_crank(clearance=None, motor=motor, speed=0.0)
        return float(cj.simulate(scene, state, 1e-4).final.bodies["crank"].spin[2])

    slow = speed(2, 600)
    programs = made_by(segment_compiled)
    assert speed(4.0, 500.0) == pytest.approx(2.0 * slow, rel=1e-3)
    assert made_by(segment_compiled) == programs


class Thing(AbstractConverting):
    name: str
    number: float
    row: Any = (1, 2, 3)
    table: Any = ((1, 0), (0, 1))
    ragged: Any = ((1, 2), (3,))
    by_name: Any = None
    with_unit: Any = cj.extend.quantity("kg", default=2)
    is_on: bool = True
    shape: int = eqx.field(default=3, static=True)
    kind: ClassVar[str] = "thing"


def test_values_become_arrays_and_names_static():
    thing = Thing("a", 1, by_name={"x": [1, 2]})
    assert (thing.name, thing.is_on, thing.shape, thing.kind) == ("a", True, 3, "thing")
    assert thing.row.shape == (3,) and thing.table.shape == (2, 2)
    assert [part.tolist() for part in thing.ragged] == [[1.0, 2.0], [3.0]]
    assert thing.by_name["x"].tolist() == [1.0, 2.0] and thing.with_unit == 2.0
    assert {leaf.dtype for leaf in jax.tree.leaves(thing)} == {np.dtype(float)}
    assert jax.tree.structure(thing) == jax.tree.structure(Thing("a", 7.5, by_name={"x": (3, 4)}))


def test_a_bool_of_any_annotation_stays_one():
    """A class may branch on it, which a number that is traced would not allow."""
    changed = eqx.tree_at(lambda thing: thing.number, Thing("a", 1, row=True), 2)
    found = with_arrays(changed)
    assert found.row is True and found.number.dtype == float


def test_the_numbers_of_a_user_defined_class_are_listed_by_their_paths():
    thing = Thing("a", 1, by_name={"x": 4})
    listed = cj.parameters(thing)
    assert len(listed) == len(jax.tree.leaves(thing))
    assert listed["with_unit"] == (2.0, "kg") and listed["by_name['x']"][0] == 4.0
    assert listed["ragged[1]"][0].tolist() == [3.0]


def test_a_row_with_a_traced_component_is_one_array():
    length = jax.jit(lambda x: jnp.linalg.norm(Thing("a", x, row=(3.0, x, 0)).row))
    assert float(length(4.0)) == 5.0


def test_a_subclass_may_declare_a_field_again():
    class Heavier(Thing):
        number: float = 5.0
        row: Any = eqx.field(default=(0.0, 1.0, 0.0))

    assert isinstance(Heavier("a").number, np.ndarray)
    assert Heavier("a").row.tolist() == [0.0, 1.0, 0.0]


def test_a_user_defined_converter_is_kept():
    class Own(AbstractConverting):
        number: Any = eqx.field(converter=lambda value: 2 * value, default=1)

    assert Own(3).number == 6

"""Every contact law and friction law in other units, turned, mirrored, and backwards.

A law knows depths and speeds only; that joints give it the right ones in any scene is in
`tests/dynamics/test_symmetries_of_elements.py`.
"""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import clearjoint as cj
from studies.catalogue import frictions
from tests.simulation.test_symmetries import directions, few, mirror
from tests.support import symmetry_transformations as symmetries
from tests.support.laws import contact_laws
from tests.support.public_names import concrete_classes

pytestmark = pytest.mark.filterwarnings("ignore::UserWarning")
powers = st.floats(-3.0, 3.0).map(lambda x: 10.0 ** round(x, 2))
scales = st.tuples(powers, powers, powers)


def friction_laws() -> dict[str, Any]:
    """Every friction law by name; a new one is entered in `studies/catalogue/frictions.py`."""
    return {name: entry[0] for name, entry in {**frictions.LAWS, **frictions.BRISTLES}.items()}


def test_every_law_is_tested():
    laws = contact_laws()
    tested = {type(part).__name__ for law in laws for part in (law, getattr(law, "stiffness", 0))}
    tested |= {type(law).__name__ for law in friction_laws().values()}
    bases = (
        cj.extend.AbstractContactLaw,
        cj.extend.AbstractElasticity,
        cj.extend.AbstractFriction,
        cj.extend.AbstractBristleFriction,
    )
    missing = concrete_classes(*bases) - tested
    assert not missing, (
        f"no symmetry of {sorted(missing)} is tested: enter them in tests/support/laws.py or, for "
        "friction, in `LAWS` or `BRISTLES` of `studies/catalogue/frictions.py`"
    )


GAPS = st.builds(
    lambda depth, rate: cj.extend.Gap(depth, rate, 10e-3, 0.1e-3),
    st.floats(1e-6, 8e-5),
    st.floats(-0.3, 0.3),
)


def force(law: cj.extend.AbstractContactLaw, gap: cj.extend.Gap, entry: float) -> float:
    law = cj.extend.unpack(law)
    return float(law.force(gap, entry if law.uses_entry_speed else None))


def gap_in_units(gap: cj.extend.Gap, scale: symmetries.Scale) -> cj.extend.Gap:
    metre, _, second = scale
    lengths = (metre * x for x in (gap.bearing_radius, gap.clearance))
    return cj.extend.Gap(metre * gap.depth, metre / second * gap.rate, *lengths)


NO_UNITS = {"PereiraCylinder": "its published formula holds for numbers in mm and N alone"}
"""Laws that are not tested in other units, and the reason."""


@pytest.mark.slow
@few
@given(gap=GAPS, scale=scales)
def test_every_law_in_other_units(gap, scale):
    newton, speed = symmetries.factor("N", scale, {}), scale[0] / scale[2]
    for law in contact_laws():
        if type(getattr(law, "stiffness", None)).__name__ in NO_UNITS:
            continue
        found = force(symmetries.in_other_units(law, scale), gap_in_units(gap, scale), 0.25 * speed)
        assert np.isclose(found, newton * force(law, gap, 0.25), rtol=1e-9), law


@few
@given(gap=GAPS)
def test_every_law_is_prepared_without_a_change(gap):
    for law in contact_laws():
        ready = law.prepared()
        assert force(ready, gap, 0.25) == force(law, gap, 0.25), law
        assert ready.stored_energy(gap) == law.stored_energy(gap), law
        assert ready.uses_entry_speed == law.uses_entry_speed, law


NOT_LOSSLESS_AT_ONE = {"GharibHurmuzlu"}
"""Laws whose published formula damps even at a restitution of one."""


@few
@given(gap=GAPS)
def test_every_law_backwards_at_restitution_one(gap):
    back = cj.extend.Gap(gap.depth, -gap.rate, gap.bearing_radius, gap.clearance)
    for law in contact_laws(lossless=True):
        if type(law).__name__ not in NOT_LOSSLESS_AT_ONE:
            assert np.isclose(force(law, back, 0.25), force(law, gap, 0.25), rtol=1e-12), law


slips = st.builds(
    lambda speed, direction: speed * direction / np.linalg.norm(direction),
    st.floats(1e-5, 0.3),
    directions,
)
deflections = directions.map(lambda direction: 1.5e-6 * direction)


def answers(law: Any, deflection: np.ndarray, slip: np.ndarray) -> dict[str, np.ndarray]:
    """The vectors that a friction law returns, by what they are."""
    z, v = (cj.extend.Vector(*vector) for vector in (deflection, slip))
    found = {"force": law.force(700.0, v)}
    if isinstance(law, cj.extend.AbstractBristleFriction):
        rate = law.rate(z, v)
        found |= {"rate": rate, "ratio": law.ratio(z, rate, v)}
    return {name: np.array([*vector], float) for name, vector in found.items()}


@few
@given(deflection=deflections, slip=slips, turn=directions, normal=st.none() | directions)
def test_every_friction_turned_and_mirrored(deflection, slip, turn, normal):
    flip = np.eye(3) if normal is None else mirror(normal)
    there = Rotation.from_rotvec(2.0 * turn).as_matrix() @ flip
    for name, law in friction_laws().items():
        law, expected = cj.extend.unpack(law), answers(cj.extend.unpack(law), deflection, slip)
        for part, vector in answers(law, there @ deflection, there @ slip).items():
            size = np.abs(expected[part]).max()
            assert np.allclose(vector, there @ expected[part], 0.0, 1e-12 * size), (name, part)


@few
@given(deflection=deflections, slip=slips, scale=scales)
def test_every_friction_in_other_units(deflection, slip, scale):
    speed = scale[0] / scale[2]
    for name, law in friction_laws().items():
        other = cj.extend.unpack(symmetries.in_other_units(law, scale))
        expected = answers(cj.extend.unpack(law), deflection, slip)
        for part, vector in answers(other, scale[0] * deflection, speed * slip).items():
            wanted = (speed if part == "rate" else 1.0) * expected[part]
            assert np.allclose(vector, wanted, 0.0, 1e-9 * np.abs(wanted).max()), (name, part)

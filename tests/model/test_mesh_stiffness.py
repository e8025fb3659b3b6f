"""The stiffness of meshing teeth over the mesh cycle, and the contact of gears with it."""

import math
from dataclasses import replace

import numpy as np
import pytest

import clearjoint as cj
from clearjoint.extend import unpack
from clearjoint.testing import check_contact_joint
from tests.model.test_backlash import gears, meshing

ERROR = cj.profiles.Harmonics([3e-6, 1e-6], [0.0, 2e-6])
TEETH = cj.profiles.TeethInMesh(1.6, middle=0.4)
KINDS = {
    "teeth": TEETH,
    "harmonics": cj.profiles.StiffnessHarmonics([0.2, 0.0], [0.1, -0.05]),
    "spline": cj.profiles.StiffnessSpline.through([1.0, 1.2, 1.1, 0.8, 0.9]),
}
CYCLE = np.arange(4096) * (math.tau / 4096)


@pytest.mark.parametrize(("ratio", "part"), [(1.3, 0.05), (1.6, 0.1), (2.45, 0.03)])
def test_pairs_of_teeth_are_those_of_the_contact_ratio(ratio, part):
    """Their mean is the contact ratio; each change takes the given part of the cycle from 10 % to
    90 %, with its middle at the end of the contact of the larger number."""
    teeth = cj.profiles.TeethInMesh(ratio, part, middle=0.7)
    pairs = ratio * teeth.factor(CYCLE + 0.7)
    least = math.floor(ratio)
    assert pairs.mean() == pytest.approx(ratio, rel=1e-6)
    assert (pairs.max(), pairs.min()) == pytest.approx((least + 1.0, least), abs=1e-3)
    end = math.pi * (ratio - least)
    ends = ratio * teeth.factor(0.7 + end + np.array([-0.5, 0.0, 0.5]) * math.tau * part) - least
    assert ends == pytest.approx([0.9, 0.5, 0.1], abs=5e-3)
    assert teeth.factor(0.7 - CYCLE) == pytest.approx(teeth.factor(0.7 + CYCLE), rel=1e-12)


@pytest.mark.parametrize(
    "kind",
    ["teeth", *(pytest.param(kind, marks=pytest.mark.slow) for kind in ("harmonics", "spline"))],
)
def test_slopes_are_those_of_differences(kind):
    stiffness, step = KINDS[kind], 1e-5
    for angle in (-7.0, 0.3, 2.5, 100.0):
        value, slope = stiffness.factor_and_slope(angle)
        ahead, behind = (float(stiffness.factor(angle + sign * step)) for sign in (1, -1))
        assert float(value) == pytest.approx(float(stiffness.factor(angle)), rel=1e-14)
        assert float(slope) == pytest.approx((ahead - behind) / (2.0 * step), abs=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("teeth_second", [41, -57])
@pytest.mark.parametrize(
    ("stiffness", "error"),
    [(TEETH, None), (None, ERROR), *((kind, ERROR) for kind in KINDS.values())],
)
def test_gears_with_a_mesh_that_varies_conform(stiffness, error, teeth_second):
    varied = {"stiffness": stiffness, "transmission_error": error}
    # So soft that the energies are not rounding errors in the check.
    law = cj.laws.HuntCrossley(0.5, 1e15)
    joint = replace(gears(18, teeth_second, phase=0.3, **varied), law=law)
    check_contact_joint(joint, meshing(joint, 1e-4), together=False)


def test_gears_of_a_constant_mesh_have_the_given_law_and_no_force_beside_the_normal():
    joint = gears()
    assert all(law is joint.law for law in joint.laws().values())
    for contact in unpack(joint).contacts(meshing(joint)).values():
        assert (contact.side, contact.gap.factor) == (None, None)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (lambda: cj.profiles.TeethInMesh(0.9), "`contact_ratio` must be above 1"),
        (lambda: cj.profiles.TeethInMesh(2.0), "`contact_ratio`.*shorter transition"),
        (lambda: cj.profiles.TeethInMesh(1.05, 0.1), "`contact_ratio`.*shorter transition"),
        (lambda: cj.profiles.TeethInMesh(1.6, 0.0), "`transition`"),
        (lambda: cj.profiles.StiffnessHarmonics([0.1], [0.1, 0.2]), "`sines`"),
        (lambda: cj.profiles.StiffnessSpline([1.0, 2.0]), "`coefficients`"),
        (lambda: gears(stiffness=cj.profiles.StiffnessHarmonics([1.2])), "`stiffness`.*positive"),
        (lambda: gears(stiffness=1e8), "`stiffness`.*AbstractMeshStiffness"),
        (lambda: gears(transmission_error=1e-6), "`transmission_error`.*AbstractProfile"),
    ],
)
def test_invalid_meshes_are_refused(wrong, said):
    with pytest.raises(ValueError, match=said):
        wrong()

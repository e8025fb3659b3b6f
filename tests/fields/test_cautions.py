"""Warnings about unusual numbers: their text, line of code and silencing."""

import functools
import warnings

import numpy as np
import pytest

import clearjoint as cj
from tests.support.one_body import ORIGIN

ROD = cj.Body(1.0, (1e-3, 1 / 12, 1 / 12))
pin = functools.partial(cj.ClearanceJoint, "ground", "rod", law=cj.laws.Hertz(1e9))


def scene_with(*, joint=None, force=None, **options):
    joints, forces = ({"it": one} if one is not None else {} for one in (joint, force))
    return cj.Scene({"rod": ROD}, joints, forces, **options)


MISTAKEN = {
    "E in GPa": (lambda: cj.laws.RavnStiffness(207, 0.3), "young_modulus", "207 Pa", "1e9 Pa"),
    "E of the journal in GPa": (
        lambda: cj.laws.RavnStiffness(207e9, 0.3, 207, 0.3),
        "journal_young_modulus",
        "207 Pa",
    ),
    "E in mPa": (lambda: cj.laws.RavnStiffness(207e12, 0.3), "young_modulus", "2.07e+14 Pa"),
    "K in GN": (lambda: cj.laws.Hertz(66.0), "stiffness", "66 N/m^n", "at least 1e+06"),
    "K of a user-defined law": (
        lambda: cj.laws.LankaraniNikravesh(0.9, cj.laws.GivenStiffness(66.0)),
        "stiffness",
        "66 N/m^n",
    ),
    "mass in grams": (
        lambda: cj.Body(7020.0, (0.001, 0.5855, 0.5855)),
        "mass",
        "7020 kg",
        "2.6e+11 kg/m^3",
    ),
    "mass and inertia in grams": (lambda: cj.Body(7020, (1, 585.5, 585.5)), "mass", "kg and kg m"),
    "inertia in kg mm^2": (lambda: cj.Body(7.02, np.diag([1e3, 6e5, 6e5])), "mass", "7.02 kg"),
    "journal's radius for a clearance": (
        lambda: pin(bearing_radius=0.01, clearance=0.0095, journal_length=0.02),
        "clearance",
        "0.0095 m",
        "journal_radius",
    ),
    "bearing in mm": (
        lambda: pin(bearing_radius=10.0, clearance=0.5, journal_length=20.0),
        "bearing_radius",
        "10 m",
        "1 mm is 1e-3 m",
    ),
    "journal in mm": (
        lambda: pin(bearing_radius=0.01, clearance=0.0005, journal_length=20.0),
        "journal_length",
        "20 m",
    ),
    "journal longer than 100 radii": (
        lambda: pin(bearing_radius=0.01, clearance=0.0005, journal_length=1.005),
        "journal_length",
        "at most 1 m",
    ),
    "joint in mm": (
        lambda: scene_with(joint=cj.SphericalJoint("ground", "rod", ORIGIN, (500, 0, 0))),
        "joints['it'].point_second",
        "500 m",
        "'rod'",
    ),
    "clearance joint in mm": (
        lambda: scene_with(
            joint=pin(
                bearing_radius=0.01, clearance=5e-4, journal_length=0.02, journal_point=(500, 0, 0)
            )
        ),
        "joints['it'].journal_point",
        "500 m",
    ),
    "link in mm": (
        lambda: scene_with(
            joint=cj.MasslessLink("rod", "ground", 1e-3, 0.1, bearing_point=(0, 0, 500))
        ),
        "joints['it'].bearing_point",
        "500 m",
    ),
    "spring in mm": (
        lambda: scene_with(force=cj.SpringDamper("rod", "ground", (500, 0, 0), ORIGIN, 1.0)),
        "forces['it'].point_first",
        "500 m",
    ),
    "load in mm": (
        lambda: scene_with(force=cj.AppliedLoad("rod", point=(0, 500, 0))),
        "forces['it'].point",
        "500 m",
    ),
    "gravity in mm/s^2": (lambda: scene_with(gravity=(0, -9810, 0)), "gravity", "9810 m/s^2"),
}


@pytest.mark.parametrize("case", MISTAKEN)
def test_a_wrong_unit_gives_a_warning_at_its_line(case):
    make, *words = MISTAKEN[case]
    with pytest.warns(cj.UnusualValueWarning) as caught:
        make()
    (warning,) = caught
    message = str(warning.message)
    assert [word for word in words if word not in message] == [], message
    assert message.endswith(
        'warnings.filterwarnings("ignore", category=clearjoint.UnusualValueWarning).'
    )
    assert warning.filename == __file__


def test_the_advice_silences_the_warning():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", category=cj.UnusualValueWarning)
        cj.laws.RavnStiffness(207, 0.3)


def test_usual_numbers_give_no_warning():
    """Mechanisms of the package, thin plates, light frames, plastic on diamond, a large bearing."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for name in ("double_pendulum", "slider_crank", "double_four_bar", "bricard"):
            getattr(cj.mechanisms, name)()
        for mass, inertia in ((2.0, (1.0, 1.0, 2.0)), (1.0, (1.0, 1.0, 1.0)), (7e-3, (1e-7,) * 3)):
            cj.Body(mass, inertia)
        cj.laws.RavnStiffness(2e9, 0.4, 1e12, 0.1)
        pin(bearing_radius=0.5, clearance=1e-3, journal_length=1.0)
        pin(bearing_radius=0.01, clearance=1e-3, journal_length=1.0)

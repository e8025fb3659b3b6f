"""Warnings about unusual numbers: their text, line of code and silencing."""

import re
import warnings

import numpy as np
import pytest

import clearjoint as cj
from tests.support.one_body import ORIGIN

ROD = cj.Body(1.0, (1e-3, 1 / 12, 1 / 12))


def pin(**sizes):
    usual = {"bearing_radius": 0.01, "clearance": 5e-4, "journal_length": 0.02}
    return cj.ClearanceJoint("ground", "rod", law=cj.laws.Hertz(1e9), **(usual | sizes))


def scene_with(*, joint=None, force=None, **options):
    joints, forces = ({"it": one} if one is not None else {} for one in (joint, force))
    return cj.Scene({"rod": ROD}, joints, forces, **options)


FAR, JOINT, FORCE = (500, 0, 0), r"`joints\['it'\]", r"`forces\['it'\]"
SPHERICAL = cj.SphericalJoint("ground", "rod", ORIGIN, FAR)
LINK = cj.MasslessLink("rod", "ground", 1e-3, 0.1, bearing_point=FAR)
MISTAKEN = [
    (lambda: cj.laws.RavnStiffness(207, 0.3), "`young_modulus` is 207 Pa.*1e9 Pa"),
    (lambda: cj.laws.RavnStiffness(207e9, 0.3, 207, 0.3), "`journal_young_modulus` is 207 Pa"),
    (lambda: cj.laws.RavnStiffness(207e12, 0.3), r"`young_modulus` is 2.07e\+14 Pa"),
    (lambda: cj.laws.Hertz(66.0), r"`stiffness` is 66 N/m\^n.*at least 1e\+06"),
    (
        lambda: cj.laws.LankaraniNikravesh(0.9, cj.laws.GivenStiffness(66.0)),
        "`stiffness` is 66 N/m",
    ),
    (lambda: cj.Body(7020, (1e-3, 0.58, 0.58)), r"`mass` is 7020 kg.*e\+11 kg/m\^3"),
    (lambda: cj.Body(7020, (1, 585.5, 585.5)), "`mass` is 7020 kg.*kg and kg m"),
    (lambda: cj.Body(7.02, np.diag([1e3, 6e5, 6e5])), "`mass` is 7.02 kg"),
    (lambda: pin(clearance=0.0095), "`clearance` is 0.0095 m.*journal_radius"),
    (lambda: pin(bearing_radius=10, journal_length=20), "`bearing_radius` is 10 m.*1 mm is 1e-3 m"),
    (lambda: pin(journal_length=20.0), "`journal_length` is 20 m"),
    (lambda: pin(journal_length=1.005), "`journal_length` is 1.005 m.*at most 1 m"),
    (lambda: scene_with(joint=SPHERICAL), f"{JOINT}.point_second` is 500 m.*'rod'"),
    (lambda: scene_with(joint=pin(journal_point=FAR)), f"{JOINT}.journal_point` is 500 m"),
    (lambda: scene_with(joint=LINK), f"{JOINT}.bearing_point` is 500 m"),
    (
        lambda: scene_with(force=cj.SpringDamper("rod", "ground", FAR, ORIGIN, 1.0)),
        f"{FORCE}.point_first` is 500 m",
    ),
    (lambda: scene_with(force=cj.AppliedLoad("rod", point=FAR)), f"{FORCE}.point` is 500 m"),
    (lambda: scene_with(gravity=(0, -9810, 0)), r"`gravity` is 9810 m/s\^2"),
]
ADVICE = 'warnings.filterwarnings("ignore", category=clearjoint.UnusualValueWarning).'


@pytest.mark.parametrize(("make", "message"), MISTAKEN, ids=[message for _, message in MISTAKEN])
def test_a_wrong_unit_gives_a_warning_at_its_line(make, message):
    with pytest.warns(cj.UnusualValueWarning, match=f"{message}.*{re.escape(ADVICE)}$") as caught:
        make()
    (warning,) = caught
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
        pin(clearance=1e-3, journal_length=1.0)

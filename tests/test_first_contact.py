"""Typical mistakes of new users: each message names the argument, the value, the expectation and
the remedy. No test compiles a run. Further ones are in tests/model/test_scene_errors.py."""

import re
import subprocess
import sys
import warnings
from dataclasses import FrozenInstanceError

import numpy as np
import pytest

import clearjoint as cj
from clearjoint import quantities as q

BODY = cj.Body(1.0, (0.01, 0.1, 0.1))
LAW = cj.laws.LankaraniNikravesh(0.9, cj.laws.RavnStiffness(207e9, 0.3))
ORIGIN, AXIS = (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)
HINGE = cj.RevoluteJoint("ground", "arm", ORIGIN, (-0.5, 0, 0), AXIS, AXIS)
MOTOR = cj.PrescribedRotation("ground", "arm", AXIS, 10.0)


def pin(first="ground", second="arm", **changed):
    usual = {"journal_point": (-0.5, 0, 0), "bearing_radius": 10e-3, "clearance": 0.5e-3}
    return cj.ClearanceJoint(
        first, second, **(usual | {"journal_length": 0.02, "law": LAW} | changed)
    )


def scene(**changed):
    usual = {"bodies": {"arm": BODY}, "joints": {"pin": pin()}, "gravity": (0, -9.81, 0)}
    return cj.Scene(**(usual | changed))


def state(**changed):
    return cj.State({"arm": cj.body_state(**({"position": (0.5, 0, 0)} | changed))})


def place(scene):
    return scene.joints["pin"].clearance


SCENE, STATE = scene(), state()
HEIGHT = q.Position("arm", "y")
CLEARANCE = {"clearance": cj.Parameter(place)}
DATA = cj.Measurements({"height": cj.Series(HEIGHT, [0.01, 0.02], [0.0, 0.0], 1e-3)})


def run(scene=SCENE, state=STATE, end_time=0.1, **options):
    cj.simulate(scene, state, end_time, **options)


def sweep(place=place, quantity=HEIGHT):
    cj.sweep(SCENE, STATE, 0.01, {"c": cj.Axis(place, [1e-4])}, {"peak": cj.Peak(quantity, "m")})


ERRORS = {
    "a unit in a text": (lambda: cj.Body("7 kg", (1, 1, 1)), "`mass` | '7 kg' | a number | in kg"),
    "a number in a text": (lambda: cj.Body("7", (1, 1, 1)), "`mass` | '7' | a number | a float"),
    "a number left out": (lambda: cj.Body(None, (1, 1, 1)), "`mass` | None | a number | in kg"),
    "an inertia of one number": (lambda: cj.Body(1, 0.1), "`inertia` | 0.1 | (3,) | principal"),
    "bodies in a list": (lambda: cj.Scene([BODY]), "`bodies` | 'list' | a dictionary | Body(...)"),
    "a load among the joints": (
        lambda: scene(joints={"push": cj.AppliedLoad("arm")}),
        "`joints['push']` | 'AppliedLoad' | AbstractConstraint | in `forces`",
    ),
    "a joint among the forces": (
        lambda: scene(joints={}, forces={"pin": HINGE}),
        "`forces['pin']` | 'RevoluteJoint' | AbstractForce | in `joints`",
    ),
    "a body's name in capitals": (
        lambda: scene(joints={"pin": pin(second="Arm")}),
        "`joints['pin'].journal_body` | 'Arm' | known bodies | did you mean 'arm'?",
    ),
    "another body's name": (
        lambda: scene(joints={"pin": pin(second="crank")}),
        "`joints['pin'].journal_body` | 'crank' | ['arm', 'ground'] | add the body",
    ),
    "gravity of one number": (lambda: scene(gravity=-9.81), "`gravity` | -9.81 | (3,) | m/s^2"),
    "a law without its numbers": (
        lambda: pin(law=cj.laws.LankaraniNikravesh),
        "`law` | LankaraniNikravesh | an AbstractContactLaw | "
        "call the class with its numbers, LankaraniNikravesh(...)",
    ),
    "a law by its name": (lambda: pin(law="hertz"), "`law` | 'hertz' | Abstract | pass one of"),
    "a law's arguments swapped": (
        lambda: cj.laws.LankaraniNikravesh(LAW.stiffness, 0.9),
        "`restitution` | RavnStiffness | a number | pass a float",
    ),
    "a stiffness by a material": (
        lambda: cj.laws.LankaraniNikravesh(0.9, "steel"),
        "`stiffness` | 'steel' | a number | N/m^n",
    ),
    "an axis by its letter": (
        lambda: pin(bearing_axis="z"),
        "`bearing_axis` | 'z' | an array of numbers | list of floats",
    ),
    "a point in the plane": (
        lambda: pin(journal_point=(-0.5, 0)),
        "`journal_point` | [-0.5, 0.0] | (3,) | coordinates in m",
    ),
    "an orientation by angles": (
        lambda: state(orientation=(0, 0, 0.5)),
        "`orientation` | 0.5 | (4,) | scalar part first",
    ),
    "a position for a body's state": (
        lambda: cj.State({"arm": (0.5, 0, 0)}),
        "`bodies['arm']` | 'tuple' | a BodyState | body_state(...)",
    ),
    "a number that is set": (
        lambda: setattr(SCENE.joints["pin"], "clearance", 1e-3),
        "'clearance' | a ClearanceJoint | cannot be changed | cj.set_value(",
    ),
    "a mechanism with its state": (
        lambda: run(scene=cj.mechanisms.double_pendulum()),
        "`scene` | 'tuple' | a Scene | scene, state =",
    ),
    "scene and state swapped": (
        lambda: run(STATE, SCENE),
        "`scene` | 'State' | a Scene | pass one",
    ),
    "an end with its unit": (lambda: run(end_time="1 s"), "`end_time` | '1 s' | number | in s"),
    "times for an end": (
        lambda: run(end_time=np.linspace(0, 1, 3)),
        "`end_time` | [0.0, 0.5, 1.0] | a single number | one time",
    ),
    "times to save that are no Saving": (
        lambda: run(save=np.linspace(0, 0.1, 3)),
        "`save` | 'ndarray' | a Saving | cj.Saving(times)",
    ),
    "a number of times": (lambda: cj.Saving(100), "`times` | 100.0 | rising | linspace"),
    "settings in a dictionary": (
        lambda: run(settings={"rtol": 1e-6}),
        "`settings` | 'dict' | Settings or None | cj.Settings(rtol=",
    ),
    "a solver's class": (
        lambda: cj.Settings(coordinates=cj.AbsoluteCoordinates),
        "`coordinates` | AbsoluteCoordinates | an object such as JointCoordinates() | pass one",
    ),
    "a journal outside its bearing": (
        lambda: run(state=state(position=(0.6, 0, 0))),
        "`state` | 0.0995 | contact 'V' of joint 'pin' | assemble(scene, state)",
    ),
    "a journal that shall rest by a text": (
        lambda: cj.assemble(SCENE, STATE, resting="pin"),
        "`resting` | 'pin' | a list | [\"pin\"]",
    ),
    "a journal that shall rest that is none": (
        lambda: cj.assemble(SCENE, STATE, resting=["Pin"]),
        "`resting` | 'Pin' | ['pin'] | did you mean 'pin'?",
    ),
    "a joint misspelt in a place": (
        lambda: sweep(lambda scene: scene.joints["pn"].clearance),
        "`path` | 'pn' | leads to numbers | did you mean 'pin'?",
    ),
    "an attribute that is none": (
        lambda: cj.set_value(SCENE, lambda scene: scene.joints["pin"].play, 1.0),
        "`path` | 'play' | leads to numbers | cj.parameters(scene)",
    ),
    "a place by its name": (
        lambda: cj.Axis("joints.pin.clearance", [1.0]),
        "`path` | 'joints.pin.clearance' | a function | lambda scene",
    ),
    "an axis of one number": (lambda: cj.Axis(place, 1e-4), "`values` | 0.0001 | a row | pass"),
    "a body misspelt in a quantity": (
        lambda: sweep(quantity=q.Position("arn", "y")),
        "`body` | 'arn' | ['arm', 'ground'] | did you mean 'arm'?",
    ),
    "a contact misspelt in a quantity": (
        lambda: sweep(quantity=q.ContactForce("pin", "A")),
        "`contact` | 'A' | ['V', 'W'] | correct the name",
    ),
    "a component in capitals": (
        lambda: q.Position("arm", "Y"),
        "`component` | 'Y' | 'y' | pass one of these",
    ),
    "a quantity by its name": (
        lambda: sweep(quantity="arm.y"),
        "`quantity` | 'arm.y' | function of an Instant | cj.quantities.Position",
    ),
    "a quantity of no body": (
        lambda: sweep(quantity=q.Position),
        "`quantity` | Position | function of an Instant | cj.quantities.Position",
    ),
    "a state for a solution": (
        lambda: cj.observe(SCENE, STATE),
        "`solution` | 'State' | a Solution | simulate(scene",
    ),
    "arrays for measurements": (
        lambda: cj.identify(SCENE, STATE, {"height": np.zeros(3)}, CLEARANCE),
        "`measurements` | 'dict' | Measurements | cj.Series(...)",
    ),
    "a place for a parameter": (
        lambda: cj.identify(SCENE, STATE, DATA, {"clearance": place}),
        "`parameters['clearance']` | 'function' | a Parameter | cj.Parameter(",
    ),
    "a guess that no scene can have": (
        lambda: cj.identify(SCENE, STATE, DATA, CLEARANCE, guess={"clearance": -1e-4}),
        "Parameter 'clearance' | -0.0001 | positive | in m",
    ),
    "a guess in a text": (
        lambda: cj.identify(SCENE, STATE, DATA, CLEARANCE, guess={"clearance": "1e-4"}),
        "`guess['clearance']` | '1e-4' | a number | a float",
    ),
    "a scale's class": (
        lambda: cj.Parameter(place, cj.Log),
        "`scale` | 'Log' | Linear() | cj.Log()",
    ),
    "samples that are not sorted": (
        lambda: cj.Series(HEIGHT, [0.2, 0.1], [0.0, 0.0], 1e-3),
        "`times[1]` | 0.1 | later than | sort the samples",
    ),
    "a file and a scene swapped": (
        lambda: cj.save("pin.toml", SCENE, STATE),
        "`scene` | 'str' | a Scene | pass one",
    ),
}
"""Mistakes, and what the message names: argument, value, expectation and remedy."""


@pytest.mark.parametrize("case", ERRORS)
def test_an_error_says_what_to_do(case):
    mistake, words = ERRORS[case]
    with (
        warnings.catch_warnings(action="ignore"),
        pytest.raises((ValueError, FrozenInstanceError)) as caught,
    ):
        mistake()
    message = str(caught.value)
    assert [word for word in words.split(" | ") if word not in message] == [], message
    assert re.search(r"[^.]\.$", message), message


WARNINGS = {
    "a drive without a joint": (
        lambda: scene(joints={"motor": MOTOR}),
        cj.LooseBodyWarning,
        "'motor' | no joint holds | RevoluteJoint",
    ),
    "a body without a joint": (
        lambda: scene(bodies={"arm": BODY, "leg": BODY}),
        cj.LooseBodyWarning,
        "'leg' | moves freely | connect it",
    ),
    "millimetres": (
        lambda: pin(bearing_radius=10.0, clearance=0.5),
        cj.UnusualValueWarning,
        "`bearing_radius` | 10 m | 1 mm is 1e-3 m",
    ),
    "gigapascals": (
        lambda: cj.laws.RavnStiffness(207, 0.3),
        cj.UnusualValueWarning,
        "`young_modulus` | 207 Pa | 1 GPa is 1e9 Pa",
    ),
}


@pytest.mark.parametrize("case", WARNINGS)
def test_a_warning_says_what_to_do(case):
    mistake, category, words = WARNINGS[case]
    with pytest.warns(category) as caught:
        mistake()
    message = str(caught[0].message)
    assert [word for word in words.split(" | ") if word not in message] == [], message
    assert caught[0].filename == __file__ and f"category=clearjoint.{category.__name__}" in message


def test_supported_bodies_cause_no_warning():
    """A drive with its joint, or supported through a body; a projectile; a body on a spring."""
    crank = cj.RevoluteJoint("ground", "crank", ORIGIN, ORIGIN, AXIS, AXIS)
    rod = cj.SphericalJoint("crank", "arm", ORIGIN, ORIGIN)
    spring = cj.SpringDamper("ground", "leg", ORIGIN, ORIGIN, 1.0)
    with warnings.catch_warnings(action="error"):
        scene(joints={"pin": HINGE, "motor": MOTOR})
        scene(bodies={"arm": BODY, "crank": BODY}, joints={"a": crank, "b": rod, "motor": MOTOR})
        scene(joints={})
        scene(bodies={"arm": BODY, "leg": BODY}, forces={"spring": spring})
        for make in (
            cj.mechanisms.slider_crank,
            cj.mechanisms.four_bar,
            cj.mechanisms.gear_pair,
            cj.mechanisms.robot_arm,
            cj.mechanisms.rotor_in_bearing,
        ):
            make()


def test_a_drive_needs_joints_from_one_of_its_bodies_to_the_other():
    """Beside other joints too: those of two mechanisms do not hold a drive between them."""
    ankle = cj.SphericalJoint("leg", "foot", ORIGIN, ORIGIN)
    bodies, joints = dict.fromkeys(("arm", "leg", "foot"), BODY), {"pin": HINGE, "ankle": ankle}
    with warnings.catch_warnings(action="error"):
        scene(bodies=bodies, joints=joints | {"motor": MOTOR})
    between = cj.PrescribedRotation("arm", "leg", AXIS, 10.0)
    with pytest.warns(cj.LooseBodyWarning, match="'motor'.*no joint holds"):
        scene(bodies=bodies, joints=joints | {"motor": between})


@pytest.mark.slow
def test_plot_and_testing_are_attributes_of_the_package():
    program = "import clearjoint as cj; cj.testing.check_law; cj.plot.report; cj.nothing"
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert "no attribute 'nothing'" in run.stderr, run.stderr

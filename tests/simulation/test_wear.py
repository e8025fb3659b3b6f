"""Wear of a bearing's wall: by hand for a journal at rest on the wall, and in sweeps."""

import numpy as np
import pytest

import clearjoint as cj
from clearjoint import AbsoluteCoordinates
from clearjoint.extend import Formulation, Instant, System, unpack

SPEED, MASS, CLEARANCE, RADIUS = 200.0, 20.0, 50e-6, 25e-3
COEFFICIENT, HARDNESS = 1e-5, 2e9
STIFFNESS = 1e10
WEAR = cj.ArchardWear("bearing", COEFFICIENT, HARDNESS, sectors=6)
DEPTH = (0.5 * MASS * 9.81 / STIFFNESS) ** (2 / 3)
"""m: penetration at which the wall carries the rotor."""
RATE = COEFFICIENT * MASS * 9.81 * SPEED * (RADIUS - CLEARANCE) / HARDNESS
"""m^3/s: rate of wear with the whole weight sliding at the speed of the journal's surface."""


def resting(angle=-np.pi / 2):
    """A rotor that rotates while the wall carries it, at an angle about the bearing's axis."""
    place = (1.0 + DEPTH / CLEARANCE) * np.array([np.cos(angle), np.sin(angle)])
    pull = 9.81 * np.array([np.cos(angle), np.sin(angle), 0.0])
    return cj.mechanisms.rotor_in_bearing(
        CLEARANCE, speed=SPEED, offset=tuple(place), law=cj.laws.Hertz(STIFFNESS), gravity=pull
    )


def instant(time, angle):
    scene, state = resting(angle)
    system = System(unpack(scene), Formulation(AbsoluteCoordinates()))
    variables = system.encode(unpack(state.bodies))
    return Instant(system, time, variables, {}, {}, inside=lambda _: instant(time, angle))


@pytest.mark.parametrize(
    ("angle", "sector"), [(-1.0, 6), (0.1, 1), (1.2, 2), (-np.pi / 2, 5), (-1e-18, 6)]
)
def test_a_journal_on_the_wall_wears_its_sector(angle, sector):
    tally = WEAR.update(WEAR.start(instant(1.0, angle)), instant(4.0, angle))
    volumes = {name: float(worn) for name, worn in WEAR.results(tally, instant(4.0, angle)).items()}
    assert volumes[""] == pytest.approx(3.0 * RATE, rel=1e-6, abs=0.0)
    for base in "VW":
        assert volumes[base] == pytest.approx(1.5 * RATE, rel=1e-6, abs=0.0)
        assert volumes[f"{base} {sector}"] == volumes[base]
    assert volumes.keys() == WEAR.units().keys()


@pytest.mark.parametrize("slower", [0.0, 40.0])
def test_surfaces_slide_by_their_relative_motion(slower):
    """Housing and shaft orbit the origin as one body at 300 rad/s, but the shaft spins slower. The
    points of both surfaces that touch are apart by the depth."""
    sizes = {"bearing_radius": RADIUS, "clearance": CLEARANCE, "journal_length": 0.02}
    bearing = cj.ClearanceJoint("housing", "shaft", **sizes, law=cj.laws.Hertz(STIFFNESS))
    body = cj.Body(1.0, (1e-3, 1e-3, 1e-3))
    scene = cj.Scene({"housing": body, "shaft": body}, {"bearing": bearing})

    def turning(x, rate):
        return cj.body_state((x, 0.0, 0.0), velocity=(0.0, 300.0 * x, 0.0), spin=(0.0, 0.0, rate))

    state = cj.State(
        {"housing": turning(0.1, 300.0), "shaft": turning(0.1 + CLEARANCE + DEPTH, 300.0 - slower)}
    )
    system = System(unpack(scene), Formulation(AbsoluteCoordinates()))
    now = Instant(system, 0.0, system.encode(unpack(state.bodies)), {}, {})
    wear = cj.ArchardWear("bearing", COEFFICIENT, HARDNESS, 1)
    _, rates, _ = wear.start(now)
    force = now.contacts["bearing"]["V"].normal_force
    speed = float(rates["V"][0] * HARDNESS / COEFFICIENT / force)
    expected = abs(300.0 * DEPTH - slower * (RADIUS - CLEARANCE))
    assert speed == pytest.approx(expected, rel=1e-6)


def test_the_part_of_a_step_in_a_window_wears_by_simpsons_rule():
    """The speed grows as the square of time, for which the rule is exact."""

    def at(time):
        scene, state = resting()
        faster = cj.set_value(state, lambda s: s.bodies["rotor"].spin[2], SPEED * time**2)
        system = System(unpack(scene), Formulation(AbsoluteCoordinates()))
        variables = system.encode(unpack(faster.bodies))
        return Instant(system, time, variables, {}, {}, inside=lambda x: at(1.0 + 3.0 * x))

    wear = cj.ArchardWear("bearing", COEFFICIENT, HARDNESS, after=2.0, until=3.5)
    worn = wear.results(wear.update(wear.start(at(1.0)), at(4.0)), at(4.0))[""]
    expected = RATE * (3.5**3 - 2.0**3) / 3.0
    assert float(worn) == pytest.approx(expected, rel=1e-6, abs=0.0)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("bearing", 1e-5, 0.0), "`hardness` must be positive"),
        (("bearing", 1e-5, 2e9, 0), "`sectors` must be a whole number"),
        (("motor", 1e-5, 2e9), "`joint` must be one of the scene's"),
    ],
)
def test_wrong_arguments_are_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        cj.ArchardWear(*arguments).check(resting()[0])

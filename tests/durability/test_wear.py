"""Wear over many cycles: closed forms, worn volumes, convergence, continuation and refusals."""

import dataclasses
from functools import partial

import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import clearjoint as cj
from clearjoint.laws import ElastoGap

RADIUS, CLEARANCE, LENGTH, STIFFNESS = 10e-3, 0.1e-3, 20e-3, 1e8
MASS, SPEED, LOAD = 0.5, 200.0, 1e3
CYCLE = 2.0 * np.pi / SPEED
DRAG = 400.0
OTHER_CLEARANCE, OTHER_LOAD = 0.15e-3, 1e3
ROTATING_LOAD = (lambda t: LOAD * jnp.cos(SPEED * t), lambda t: LOAD * jnp.sin(SPEED * t), 0.0)
"""The same functions in every scene, so that equal scenes are traced and compiled once."""
HERE = (0.0, 0.0, 0.0)
RATE = 1e-12
"""Specific wear rate, m^2/N."""


def penetration(depth, clearance=CLEARANCE, mass=MASS, load=LOAD, drag=0.0):
    """Penetration, m, of a journal that a rotating load presses on a wall worn by a depth, m.

    Both bases carry the load and the centrifugal force. A drag, N s/m, makes the journal lag behind
    the load, whose component along the normal remains.
    """
    lag = np.arcsin(drag * SPEED * (clearance + depth) / load)
    force = load * np.cos(lag) + mass * SPEED**2 * (clearance + depth)
    return force / (2.0 * STIFFNESS - mass * SPEED**2)


def rate(depth, wear_rate=RATE, **changed):
    """Depth worn per cycle, m, by Archard's law, evenly around the wall."""
    d = penetration(depth, **changed)
    speed = SPEED * (RADIUS + depth + 0.5 * d)
    return wear_rate * 2.0 * STIFFNESS * d * speed * CYCLE / (2.0 * np.pi * RADIUS * LENGTH)


def whirling(drag=0.0):
    """A journal that rotates together with its load, so that its contact runs around the wall.

    A drag, N s/m, damps oscillations along the wall.
    """
    bodies, joints, states = rotor("", CLEARANCE + penetration(0.0), SPEED)
    forces = {"load": cj.AppliedLoad("rotor", force=ROTATING_LOAD)}
    if drag > 0.0:
        # Dampers along x and along y that are so long that their directions don't change.
        for name, end in {"x": (1e3, 0.0, 0.0), "y": (0.0, 1e3, 0.0)}.items():
            damper = cj.SpringDamper("ground", "rotor", end, HERE, stiffness=0.0, damping=drag)
            forces[f"drag along {name}"] = damper
    return cj.Scene(bodies, joints, forces), cj.State(states)


def rotor(prefix, distance, whirl, clearance=CLEARANCE):
    """Body, joints and state of a rotor whose centre is a distance, m, along x from that of its
    bearing, and moves around it with an angular velocity, rad/s."""
    pin = cj.ClearanceJoint(
        "ground",
        f"{prefix}rotor",
        bearing_radius=RADIUS,
        clearance=clearance,
        journal_length=LENGTH,
        law=ElastoGap(stiffness=STIFFNESS, damping=1e4, exponent=1.0),
    )
    axis = (0.0, 0.0, 1.0)
    joints = {
        "pin": pin,
        "plane": cj.PlanarJoint("ground", f"{prefix}rotor", HERE, HERE, axis, axis),
        "motor": cj.PrescribedRotation("ground", f"{prefix}rotor", axis, SPEED),
    }
    state = cj.body_state(
        (distance, 0.0, 0.0), velocity=(0.0, whirl * distance, 0.0), spin=(0.0, 0.0, SPEED)
    )
    return (
        {f"{prefix}rotor": cj.Body(MASS, (1e-4, 1e-4, 1e-4))},
        {prefix + name: joint for name, joint in joints.items()},
        {f"{prefix}rotor": state},
    )


def whirling_and_rotating(drag=0.0):
    """Two mechanisms in one scene: the whirling journal, which wears its bearing evenly, and one
    that rotates under a constant load, "other pin", which is itself worn evenly."""
    scene, state = whirling(drag)
    distance = OTHER_CLEARANCE + 0.5 * OTHER_LOAD / STIFFNESS
    bodies, joints, states = rotor("other ", distance, 0.0, OTHER_CLEARANCE)
    load = cj.AppliedLoad("other rotor", force=(OTHER_LOAD, 0.0, 0.0))
    both = cj.Scene(
        scene.bodies | bodies, scene.joints | joints, scene.forces | {"other load": load}
    )
    return both, cj.State(state.bodies | states)


def other_rate(depth, other_load=OTHER_LOAD, other_wear_rate=RATE):
    """Depth worn per cycle off the journal that rotates under a load, N, by Archard's law, m.

    Both bases carry the load, with half of the penetration on each side of their contact points.
    """
    speed = SPEED * (RADIUS - OTHER_CLEARANCE - depth - 0.25 * other_load / STIFFNESS)
    area = 2.0 * np.pi * (RADIUS - OTHER_CLEARANCE) * LENGTH
    return other_wear_rate * other_load * speed * CYCLE / area


def life(depth, of=rate, **changed):
    """Number of cycles to a depth, m, by the differential equation of Archard's law."""
    span, tight = (0.0, depth), {"rtol": 1e-12, "atol": 1e-9}
    return solve_ivp(lambda h, _: [1.0 / of(h, **changed)], span, [0.0], **tight).y[0, -1]


OPTIONS = {"settle": 1, "measured": 2, "tolerance": 0.05, "samples": 16, "progress": False}
RATES = {"pin": cj.WearRates(bearing=RATE), "other pin": cj.WearRates(journal=RATE)}
OF_PIN = {"pin": RATES["pin"]}
SLOW = 1e-13
"""Specific wear rate, m^2/N, of a bearing that takes 100 000 cycles to a hundred penetrations."""
SLOWLY = {"pin": cj.WearRates(bearing=SLOW)}
DEEP = 500e-6
"""A hundred penetrations, m."""


@pytest.fixture(scope="module")
def found_of_two():
    start = whirling_and_rotating()
    return cj.wear(*start, CYCLE, RATES, 300.0, largest_change=2e-6, **OPTIONS)


@pytest.fixture(scope="module")
def found():
    return cj.wear(*whirling(DRAG), CYCLE, SLOWLY, 1e6, depth=DEEP, **OPTIONS)


def test_a_bearing_wears_by_archards_law_to_a_hundred_penetrations(found):
    """The depth is the same at all angles. Few runs are needed for 97 000 cycles."""
    assert found.attrs["ending"] == "reached the depth"
    depths, cycles = found["bearing_depth"].sel(joint="pin").values, found["cycles"].values
    assert 90e3 < cycles[-1] < 100e3 and len(cycles) < 15
    assert DEEP <= depths[-1].max() < 1.01 * DEEP
    assert (np.ptp(depths, axis=1) <= 1e-4 * depths.max(axis=1)).all()
    exact = [life(depth, wear_rate=SLOW, drag=DRAG) for depth in depths.mean(axis=1)[1:]]
    np.testing.assert_allclose(cycles[1:], exact, rtol=2e-4)
    assert not found["journal_depth"].any()


def pressed(load=LOAD):
    """A journal that rotates under a constant load, N, in a bearing that stands still."""
    bodies, joints, states = rotor("", CLEARANCE + 0.5 * load / STIFFNESS, 0.0)
    forces = {"load": cj.AppliedLoad("rotor", force=(load, 0.0, 0.0))}
    return cj.Scene(bodies, joints, forces), cj.State(states)


def groove(volume):
    """Depth, m, of the groove that a rigid journal wears into its bearing along one direction, by
    its volume, m^3.

    The journal has moved by the depth d from the wall, so that the groove's depth is
    (c + d) cos(u) - c at the angle u from the direction, with the clearance c.
    """

    def excess(depth):
        eccentricity = CLEARANCE + depth
        half = np.arccos(CLEARANCE / eccentricity)
        area = 2.0 * (eccentricity * np.sin(half) - CLEARANCE * half)
        return RADIUS * LENGTH * area - volume

    return brentq(excess, 1e-12, 1.0)


@pytest.mark.slow
@pytest.mark.parametrize("load", [LOAD, 0.1 * LOAD])
def test_a_constant_load_wears_a_groove_as_a_rigid_journal_does(load):
    """The penetration, by which the journal is less deep in the groove than a rigid one, is a
    hundredth of the depth, and the load's share of it at the ends of the groove is smaller."""
    depth = 50.0 * load / STIFFNESS
    options = OPTIONS | {"samples": 96}
    found = cj.wear(*pressed(load), CYCLE, SLOWLY, np.inf, depth=depth, **options)
    assert found.attrs["ending"] == "reached the depth" and found.sizes["stage"] < 20
    cycles, at_end = found["cycles"].values, found["bearing_depth"][0, -1].values
    # By Archard's law: the rate times the load and the distance by which the journal's surface
    # slides. The point of contact is inside of it by a quarter of the two bases' penetration.
    volume = float(found["bearing_volume"][0, -1])
    distance = 2.0 * np.pi * (RADIUS - CLEARANCE - 0.25 * load / STIFFNESS) * cycles[-1]
    assert volume == pytest.approx(SLOW * load * distance, rel=1e-5)
    exact = groove(volume)
    assert at_end[0] == at_end.max() == pytest.approx(exact, rel=1e-3)
    angles = found["angle"].values
    rigid = np.maximum((CLEARANCE + exact) * np.cos(angles) - CLEARANCE, 0.0)
    np.testing.assert_allclose(at_end, rigid, rtol=0.0, atol=load / STIFFNESS)
    np.testing.assert_allclose(at_end[1:], at_end[:0:-1], rtol=0.0, atol=1e-4 * exact)


@pytest.mark.slow
def test_smaller_errors_of_stages_have_smaller_errors_at_the_end():
    """With a centrifugal force that more than doubles as the bearing wears."""
    scene, state = whirling(DRAG)
    mass, load = 4.0, 0.3 * LOAD
    x, y, z = ROTATING_LOAD
    light = cj.AppliedLoad("rotor", force=(lambda t: 0.3 * x(t), lambda t: 0.3 * y(t), z))
    scene = cj.set_value(scene, lambda s: s.bodies["rotor"].mass, mass)
    scene = dataclasses.replace(scene, forces={**scene.forces, "load": light})
    errors = []
    for stage_error in (0.3, 0.003):
        options = OPTIONS | {"stage_error": stage_error, "settle": 2}
        found = cj.wear(scene, state, CYCLE, SLOWLY, np.inf, depth=DEEP, **options)
        mean = float(found["bearing_depth"][0, -1].mean())
        exact = life(mean, wear_rate=SLOW, mass=mass, load=load, drag=DRAG)
        errors.append(abs(float(found["cycles"][-1]) / exact - 1.0))
    assert errors[0] < 0.1 and errors[1] < min(5e-4, 0.2 * errors[0])


@pytest.mark.slow
def test_the_joint_that_wears_fastest_limits_the_stages(found_of_two):
    """The change of each joint is at most the largest one, and that of one joint equals it."""
    found = found_of_two
    depths = np.stack([found["bearing_depth"][0], found["journal_depth"][1]])
    changes = np.diff(depths, axis=1).max(axis=2).max(axis=0)[1:-1]
    np.testing.assert_allclose(changes, 2e-6, rtol=0.02)


def test_forces_and_volumes_are_in_the_result(found):
    of_pin = found.sel(joint="pin")
    depths = of_pin["bearing_depth"].mean("angle").values
    forces = [2.0 * STIFFNESS * penetration(depth) for depth in depths]
    np.testing.assert_allclose(of_pin["force"], forces, rtol=5e-3)
    area = 2.0 * np.pi * RADIUS * LENGTH
    np.testing.assert_allclose(of_pin["bearing_volume"], depths * area, rtol=1e-12)


def test_life_is_interpolated(found):
    for depth in np.array([0.01, 0.1, 0.3, 0.7, 0.95]) * DEEP:
        cycles = cj.cycles_to_depth(found, depth, "pin")
        assert cycles == pytest.approx(life(depth, wear_rate=SLOW, drag=DRAG), rel=1e-3)
    assert cj.cycles_to_depth(found, 1.0, "pin") == np.inf


def test_a_depth_may_end_the_computation_without_a_number_of_cycles(found):
    start = whirling(DRAG)
    short = cj.wear(*start, CYCLE, SLOWLY, np.inf, depth=5e-6, **OPTIONS)
    assert short.attrs["ending"] == "reached the depth"
    count = short.sizes["stage"]
    # The stages are those of the computation to a larger depth, up to the depth.
    np.testing.assert_array_equal(short["cycles"][:-1], found["cycles"][: count - 1])
    deepest = np.maximum(short["bearing_depth"], short["journal_depth"]).max(["joint", "angle"])
    assert deepest[count - 2] < 5e-6 <= deepest[count - 1] < 5.1e-6
    with pytest.raises(ValueError, match="`cycles` must be finite.*`depth`"):
        cj.wear(*start, CYCLE, SLOWLY, np.inf, **OPTIONS)


def test_contacts_that_stay_open_reach_no_depth():
    scene, _ = whirling()
    scene = dataclasses.replace(scene, forces={})
    state = cj.State(rotor("", 0.0, 0.0)[2])
    with pytest.raises(ValueError, match=r"`cycles` must be finite \(no part wears"):
        cj.wear(scene, state, CYCLE, OF_PIN, np.inf, depth=1e-6, **OPTIONS)
    found = cj.wear(scene, state, CYCLE, OF_PIN, 1e6, **OPTIONS)
    assert found["cycles"].values.tolist() == [0.0, 1e6] and not found["bearing_depth"].any()


def rough():
    """A rotor like the whirling one, whose bearing carries a small load by asperities alone."""
    scene, _ = whirling(0.1 * DRAG)
    asperities = cj.laws.GreenwoodTripp(roughness=2e-6, modulus=1.14e11)
    law = cj.laws.RoughCylinders(asperities, length=0.5 * LENGTH, law=cj.laws.Hertz(1e10))
    pin = dataclasses.replace(scene.joints["pin"], law=law)
    x, y, z = ROTATING_LOAD
    load = cj.AppliedLoad("rotor", force=(lambda t: 0.1 * x(t), lambda t: 0.1 * y(t), z))
    scene = dataclasses.replace(
        scene, joints={**scene.joints, "pin": pin}, forces={**scene.forces, "load": load}
    )
    return scene, cj.State(rotor("", CLEARANCE - 2e-6, SPEED)[2])


@pytest.mark.slow
def test_stages_are_limited_where_the_force_begins_before_the_surfaces_touch():
    scene, state = rough()
    found = cj.wear(scene, state, CYCLE, OF_PIN, 1e5, stages=3, **OPTIONS | {"tolerance": 0.5})
    deepest = found["penetration"].values[0, :-1]
    assert np.all(deepest < 0.0)
    changes = np.diff(found["bearing_depth"][0].max("angle"))
    limit = 0.2 * (deepest[0] + float(scene.joints["pin"].law.onset_offset()))
    np.testing.assert_allclose(changes, limit * np.array([1.0, 2.0]), rtol=0.1)


def require_closed_form(found, depth, joint="pin"):
    """Compare a life, and its derivatives by logarithms of parameters, with the differential
    equation of Archard's law. Those of the other joint have no effect on it."""
    part, of, known = "bearing", partial(life, of=rate, drag=DRAG), {"clearance": CLEARANCE}
    if joint == "other pin":
        part, of, known = "journal", partial(life, of=other_rate), {"other_load": OTHER_LOAD}
    mean = found.mean("angle", keepdims=True)
    cycles = cj.cycles_to_depth(mean, depth, joint, part)
    assert cycles == pytest.approx(of(depth), rel=2e-3)
    own = "wear_rate" if joint == "pin" else "other_wear_rate"
    names = {name: name for name in known} | {f"{joint} {part} rate": own}
    for name, derivative in cj.life_derivatives(mean, depth, joint, part).items():
        expected = 0.0
        if name in names:
            value = known.get(name, RATE)
            up, down = (of(depth, **{names[name]: value * (1 + x)}) for x in (1e-4, -1e-4))
            expected = (up - down) / 2e-4
        assert derivative == pytest.approx(expected, abs=3e-4 * cycles), name


@pytest.mark.slow
def test_derivatives_of_two_lives_are_those_of_the_closed_forms():
    """By a clearance of one joint, the load on the other, and the wear rates of both."""
    load = cj.Parameter(lambda scene: scene.forces["other load"].force[0], cj.Log())
    clearance = cj.Parameter(lambda scene: scene.joints["pin"].clearance, cj.Log())
    parameters = {"clearance": clearance, "other_load": load}
    start, options = whirling_and_rotating(DRAG), {**OPTIONS, "samples": 8}
    found = cj.wear(*start, CYCLE, RATES, [10.0, 100.0], parameters=parameters, **options)
    require_closed_form(found, 3e-6)
    require_closed_form(found, 3e-6, "other pin")


def test_a_store_is_continued(tmp_path):
    start, path = whirling(), tmp_path / "wear"
    staged = partial(cj.wear, *start, CYCLE, OF_PIN, 3000.0, largest_change=2e-6, **OPTIONS)
    whole = staged(stages=3)
    assert staged(stages=2, path=path).attrs["ending"] == "2 stages"
    assert cj.open_wear(path).attrs["ending"] == "2 stages"
    assert staged(stages=3, path=path).drop_attrs().identical(whole.drop_attrs())
    # As between the two renamings with which a stage replaces the store.
    path.rename(tmp_path / "wear.old")
    assert cj.open_wear(path).drop_attrs().identical(whole.drop_attrs())
    other = {"pin": cj.WearRates(bearing=2.0 * RATE)}
    with pytest.raises(ValueError, match="path"):
        cj.wear(*start, CYCLE, other, 3000.0, path=path, **OPTIONS)


@pytest.mark.slow
def test_worn_profiles_are_put_into_the_scene(found_of_two):
    found = found_of_two
    worn = cj.worn(whirling_and_rotating()[0], found).joints
    angles, last = found["angle"].values, found.isel(stage=-1)
    wall = worn["pin"].bearing_profile.at(angles).value
    np.testing.assert_allclose(wall, last["bearing_depth"][0], rtol=1e-9)
    journal = worn["other pin"].journal_profile.at(angles).value
    np.testing.assert_allclose(journal, -last["journal_depth"][1], rtol=1e-9)
    assert worn["pin"].journal_profile is None and worn["other pin"].bearing_profile is None


PIN_CLEARANCE = cj.Parameter(lambda scene: scene.joints["pin"].clearance)


def test_a_cycle_that_is_not_periodic_is_refused():
    scene, state = whirling()
    _, _, slower = rotor("", CLEARANCE + penetration(0.0), 0.5 * SPEED)
    slower = cj.State(state.bodies | slower)
    with pytest.raises(ValueError, match="cycle.*periodic.*differ"):
        cj.wear(scene, slower, CYCLE, OF_PIN, 100.0, **OPTIONS | {"settle": 0, "tolerance": 1e-6})
    with pytest.raises(ValueError, match="cycle.*period of the scene's drives"):
        cj.wear(scene, state, 0.1 * CYCLE, OF_PIN, 100.0, **OPTIONS)


@pytest.mark.parametrize(
    "change, name",
    [
        ({"rates": {}}, "rates"),
        ({"rates": {"pins": cj.WearRates(bearing=RATE)}}, "rates"),
        ({"cycle": -1.0}, "cycle"),
        ({"cycles": 0.0}, "cycles"),
        ({"cycles": []}, r"`cycles` must be positive and rising, but is \[\]"),
        ({"depth": 0.0}, "depth"),
        ({"settle": -1}, "`settle` must be a whole number, zero or positive"),
        ({"settle": True}, "settle"),
        ({"settle": np.int64(0), "measured": 3}, "measured"),
        ({"measured": 3}, "measured"),
        ({"samples": 4}, "samples"),
        ({"tolerance": np.nan}, "tolerance"),
        ({"largest_change": 0.0}, "largest_change"),
        ({"parameters": {"pin bearing rate": PIN_CLEARANCE}}, "otherwise than .* of a wear rate"),
    ],
)
def test_unsuitable_arguments_are_refused(change, name):
    usual = {"cycle": CYCLE, "rates": OF_PIN, "cycles": 10.0, "progress": False}
    with pytest.raises(ValueError, match=name):
        cj.wear(*whirling(), **usual | change)


@pytest.mark.parametrize("part", ["bearing", "journal"])
@pytest.mark.parametrize("lobes", [11, 16, 24])
def test_samples_that_lose_a_profile_are_refused(part, lobes):
    """At 16 angles, 16 or 24 lobes are a circle, and 11 lobes are five."""
    scene, state = whirling()
    waves = cj.profiles.Harmonics([0.0] * (lobes - 1) + [1e-7])
    pin = dataclasses.replace(scene.joints["pin"], **{f"{part}_profile": waves})
    scene = dataclasses.replace(scene, joints={**scene.joints, "pin": pin})
    message = f"`samples` must be enough to resolve the {part}_profile of 'pin', but is 16"
    with pytest.raises(ValueError, match=message):
        cj.wear(scene, state, CYCLE, {"pin": cj.WearRates(**{part: RATE})}, 10.0, **OPTIONS)


def test_points_between_the_bases_are_refused():
    scene, state = whirling()
    pin = dataclasses.replace(scene.joints["pin"], line_points=3)
    scene = dataclasses.replace(scene, joints={**scene.joints, "pin": pin})
    refused = (
        r"at its bases, not at \['point 2'\] too \(wear along the axis is not resolved\), "
        r"but is 'pin': give the joint no `line_points`"
    )
    with pytest.raises(ValueError, match=f"`rates` must be a joint .* {refused}"):
        cj.wear(scene, state, CYCLE, OF_PIN, 10.0)
    with pytest.raises(ValueError, match=f"`joint` must be a joint .* {refused}"):
        cj.ArchardWear("pin", coefficient=RATE, hardness=1.0).check(scene)


def test_wear_rates_are_positive():
    with pytest.raises(ValueError, match="bearing.*1e-9 m"):
        cj.WearRates(bearing=-1e-15)
    with pytest.raises(ValueError, match="bearing"):
        cj.WearRates()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda found: cj.cycles_to_depth(found, 1e-6, "pin"),
            "`joint` must be one of shoulder, b",
        ),
        (lambda found: cj.cycles_to_depth(found, 1e-6, "shoulder", "pin"), "`part` must be one of"),
        (lambda found: cj.life_derivatives(found, 1e-6, "pin"), "`joint` must be one of shoulder"),
        (
            lambda found: cj.worn(cj.mechanisms.slider_crank()[0], found),
            "`scene` must be one of .*",
        ),
        (
            lambda found: cj.worn(cj.mechanisms.double_pendulum()[0], found, 2),
            "`stage` must be a s",
        ),
    ],
)
def test_names_that_a_result_lacks_are_refused(call, message):
    depths = dict.fromkeys(("bearing_depth", "journal_depth"), np.zeros((1, 2, 8)))
    rows = {name: (("joint", "stage", "angle"), depth) for name, depth in depths.items()}
    with pytest.raises(ValueError, match=message):
        call(xr.Dataset(rows, {"joint": ["shoulder"]}))


@pytest.mark.slow
@pytest.mark.parametrize(
    "joint, part, per_cycle", [("pin", "bearing", rate), ("other pin", "journal", other_rate)]
)
def test_each_of_two_joints_wears_as_it_would_alone(found_of_two, joint, part, per_cycle):
    """The depth at all angles follows the joint's own differential equation of Archard's law."""
    found = found_of_two
    assert found.attrs["ending"] == "reached the cycles"
    cycles = found["cycles"].values
    span, tight = (0.0, cycles[-1]), {"rtol": 1e-10, "atol": 1e-16}
    exact = solve_ivp(lambda n, h: [per_cycle(h[0])], span, [0.0], t_eval=cycles, **tight).y[0]
    depths = found[f"{part}_depth"].sel(joint=joint).values
    assert exact[-1] > 10e-6 and len(cycles) > 5
    np.testing.assert_allclose(depths[-1], exact[-1], rtol=2e-2)
    np.testing.assert_allclose(depths.mean(axis=1), exact, rtol=1e-3, atol=1e-10)
    unworn = "journal" if part == "bearing" else "bearing"
    assert not found[f"{unworn}_depth"].sel(joint=joint).any()

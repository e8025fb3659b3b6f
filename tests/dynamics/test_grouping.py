"""Grouped elements: the same numbers as single elements, under the same names."""

import copy
import dataclasses
import pickle
import sys
from functools import partial

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import clearjoint as cj
from clearjoint.dynamics.formulation import Formulation
from clearjoint.dynamics.grouping import condensing as grouping
from clearjoint.dynamics.grouping.condensing import (
    GroupedMotions,
    condensed,
    groups,
    summed_wrenches,
    whole,
)
from clearjoint.dynamics.system import System
from clearjoint.math.groups import GroupName, by_group, by_name, each
from clearjoint.math.vectors import Vector, fold_constants, unpack
from clearjoint.simulation.run import host_run as running
from clearjoint.simulation.run.host_run import begin, segment
from clearjoint.simulation.step.method import Scheme
from clearjoint.simulation.step.step_state import Variables
from clearjoint.simulation.step.stepping import attempt, start
from studies.benchmark.chain import chain

SIMULATE = sys.modules["clearjoint.simulation.run.simulate"]
"""The module; its name is also that of its function."""
ROUGH = cj.frictions.RegularisedCoulomb(0.1)
STOPS = cj.EndPlay(1e-3, cj.laws.Hertz(1e9))
SPRING = {"spring": cj.SpringDamper("ground", "rod 4", (0.7, 0.2, 0), (0.01, 0.0, 0), 50.0, 2.0)}


def uneven(rods, unlike=(), forces=None, **options):
    """A chain whose rods and clearances all differ, those of `unlike` in structure too."""
    scene, state = chain(rods)
    bodies, joints = {}, {}
    for k, (name, body) in enumerate(scene.bodies.items(), 1):
        inertia = (1 + 0.1 * k) * body.inertia
        bodies[name] = cj.Body(1 + 0.1 * k, np.diag(inertia) if k in unlike else inertia)
    for k, (name, joint) in enumerate(scene.joints.items(), 1):
        joints[name] = eqx.tree_at(lambda j: j.clearance, joint, np.asarray((4 + 0.1 * k) * 1e-4))
        for option, value in options.items():
            object.__setattr__(joints[name], option, value)
    return cj.Scene(bodies, joints, forces or {}, gravity=scene.gravity), state


def shaken(state, seed=1):
    """Bodies displaced by about the clearance, tilted and moving; and entry speeds."""
    random = np.random.default_rng(seed)
    bodies = {
        name: cj.body_state(
            body.position + random.normal(0, 6e-4, 3),
            Rotation.from_rotvec(random.normal(0, 5e-3, 3)).as_quat(scalar_first=True),
            random.normal(0, 0.3, 3),
            random.normal(0, 2.0, 3),
        )
        for name, body in state.bodies.items()
    }
    entry_speeds = {
        name.replace("rod", "joint"): {"V": random.uniform(0.1, 1), "W": random.uniform(0.1, 1)}
        for name in bodies
    }
    return cj.State(bodies, jax.tree.map(np.asarray, entry_speeds))


class OiledBall(cj.extend.AbstractContactJoint):
    """A user-defined ball in an oiled socket, with its own film."""

    first: str
    second: str
    end_first: tuple[float, float, float]
    end_second: tuple[float, float, float]
    clearance: float
    damping: float
    law: cj.extend.AbstractContactLaw

    def pair(self):
        return self.first, self.second

    def laws(self):
        return {"V": self.law}

    def _moving(self, motions):
        first, second = (motions[name] for name in self.pair())
        apart = second.point(self.end_second) - first.point(self.end_first)
        return apart, second.velocity_at(self.end_second) - first.velocity_at(self.end_first)

    def contacts(self, motions):
        apart, velocity = self._moving(motions)
        distance, normal = cj.extend.norm_and_direction(apart)
        gap = cj.extend.Gap(distance - self.clearance, velocity.dot(normal))
        return {"V": cj.extend.Contact(gap, normal, self.end_first, self.end_second, None)}

    def friction_force(self, name, contact, normal_force):
        return None

    def film_wrenches(self, motions):
        force = self._moving(motions)[1] * -self.damping
        first, second = (motions[name] for name in self.pair())
        on_first, on_second = (
            first.wrench(-force, self.end_first),
            second.wrench(force, self.end_second),
        )
        return dict(zip(self.pair(), (on_first, on_second), strict=True))


def oiled():
    """The chain with these balls instead of journals."""
    scene, state = uneven(8)
    joints = {}
    for k, (name, dry) in enumerate(scene.joints.items()):
        ends = dry.bearing_point, dry.journal_point
        joints[name] = OiledBall(
            *dry.pair(), *ends, 2.5 * dry.clearance, 5.0 + k, cj.laws.Hertz(1e8)
        )
    return dataclasses.replace(scene, joints=joints), state


SCENES = {
    "chain": uneven(8),
    "oiled balls": oiled(),
    "friction and end play": uneven(8, friction=ROUGH, axial=STOPS),
    "unlike rods in the middle, spring": uneven(8, (3, 6), SPRING),
}


def told(coordinates, scene, state, together):
    """Return the results of the equations of motion by the names of single elements."""

    formulation, scene = Formulation(coordinates, ledger=True), unpack(fold_constants(scene))
    system = System.of(scene, formulation) if together else System(scene, formulation)
    assert together == bool(groups(system.scene))
    variables = jax.tree.map(jnp.asarray, system.encode(unpack(state.bodies)))
    entry_speeds, t = by_group(state.entry_speeds, system.scene.joints), jnp.zeros(())
    dynamics = system.dynamics(variables, entry_speeds, t)
    rates = jax.tree.map(jnp.asarray, dynamics.variable_rates)
    return {
        "bodies": by_name(system.decode(variables)),
        "accelerations": dynamics.accelerations,
        "forces": by_name(dynamics.contact_forces),
        "reaches": by_name(system.contact_gaps(variables)),
        "second rates": by_name(system.second_rates(variables, rates)),
        "energy": system.energies(variables, t),
        "powers": system.powers(dynamics, t),
    }


CASES = [(case, cj.JointCoordinates()) for case in SCENES]
CASES += [("unlike rods in the middle, spring", cj.AbsoluteCoordinates())]


@pytest.mark.parametrize("case, coordinates", CASES)
def test_equations_of_motion_are_the_same(case, coordinates):
    scene, state = SCENES[case]
    state = shaken(state)
    alone, together = (told(coordinates, scene, state, both) for both in (False, True))
    touching = [
        reach.depth > 0 for family in together["reaches"].values() for reach in family.values()
    ]
    assert 3 < sum(touching) < len(touching)
    assert jax.tree.structure(alone) == jax.tree.structure(together)
    for one, other in zip(jax.tree.leaves(alone), jax.tree.leaves(together), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-10, atol=1e-10)


def test_each_rod_obeys_newton():
    """Mass times acceleration is the sum of weight and of the joints' forces at both ends."""
    scene, state = SCENES["chain"]
    found = told(cj.AbsoluteCoordinates(), scene, shaken(state), True)

    def on_journal(joint):
        return -sum(
            force.normal_force * np.array(list(force.contact.normal))
            for force in found["forces"][joint].values()
        )

    for k, (name, body) in enumerate(scene.bodies.items(), 1):
        force = body.mass * scene.gravity + on_journal(f"joint {k}")
        if k < len(scene.bodies):
            force = force - on_journal(f"joint {k + 1}")
        linear = np.array(list(found["accelerations"][name].linear))
        np.testing.assert_allclose(linear, force / body.mass, rtol=1e-12)
        assert np.abs(linear).max() > 1.0


def attempts(smallest, growth):
    """Return a step from the start of a chain with open and closed contacts, and whether it was
    accepted; clearances are increased by a relative amount."""
    scene, state = uneven(4)
    wider = [joint.clearance * (1.0 + growth) for joint in scene.joints.values()]
    scene = eqx.tree_at(lambda s: [joint.clearance for joint in s.joints.values()], scene, wider)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(grouping, "SMALLEST", smallest)
        scheme = Scheme.of(cj.Settings(solver=diffrax.Heun(), rtol=1e-2, ledger=True))
        method, system = scheme.method, scheme.system_of_packed(fold_constants(scene))
        state = shaken(state)
        bodies = system.encode(unpack(state.bodies))
        entry_speeds = by_group(state.entry_speeds, system.scene.joints)
        t0, t_end, first = (jnp.asarray(t) for t in (0.0, 1.0, 1e-10))
        steps = [start(method, system, t0, t_end, first, Variables(bodies, {}), entry_speeds)]
        steps.append(attempt(method, system, steps[-1], t_end).step)
    found = [
        (
            (step.t, step.proposal.t_next, step.proposal.full_length, step.y.work),
            [by_name(part) for part in (step.entry_speeds, step.contact_gaps, step.second_rates)],
            by_name(system.decode(step.y.motion)),
        )
        for step in steps
    ]
    return found, steps[-1].accepted > 0


@pytest.mark.slow
def test_steps_and_their_derivatives_are_the_same_in_lanes():
    def lanes(smallest):
        def lane(growth):
            return jax.jvp(partial(attempts, smallest), (growth,), (1.0,), has_aux=True)

        return jax.vmap(lane)(jnp.asarray([0.0, 0.1]))

    together, alone = lanes(2), lanes(10)
    assert jax.tree.structure(together) == jax.tree.structure(alone)
    for one, other in zip(jax.tree.leaves(together), jax.tree.leaves(alone), strict=True):
        scale = np.abs(other).max()
        np.testing.assert_allclose(one, other, rtol=1e-8, atol=1e-12 * max(scale, 1.0))
    values, derivatives, accepted = together
    assert accepted.all()
    assert not np.array_equal(*jax.tree.leaves(values[-1][1][1]["joint 3"])[0])
    assert all(np.abs(leaf).max() > 0 for leaf in jax.tree.leaves(derivatives[-1][2]["rod 3"]))


END, TIMES = 0.005, np.linspace(0.0, 0.005, 6)
"""s: past the first impacts, at 2 to 4 ms."""
SETTINGS = cj.Settings(solver=diffrax.Heun(), rtol=1e-6, ledger=True)


@pytest.fixture(scope="module")
def runs():
    """Four rods without groups; with three bodies and two joints grouped; and as a sweep."""
    scene, state = uneven(4)
    speeds = {name: (0.0, 0.1 * (-1) ** k, 0.0) for k, name in enumerate(state.bodies)}
    state = cj.State({
        name: cj.body_state(body.position, velocity=speeds[name])
        for name, body in state.bodies.items()
    })  # fmt: skip

    def run(smallest):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(grouping, "SMALLEST", smallest)
            patch.setattr(SIMULATE, "begin_compiled", eqx.filter_jit(lambda *a: begin(*a)))
            patch.setattr(running, "segment_compiled", eqx.filter_jit(lambda *a: segment(*a)))
            return cj.simulate(
                scene,
                state,
                END,
                SETTINGS,
                cj.Saving(TIMES, impacts=True, steps=True),
                progress=False,
            )

    def swept():
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(grouping, "SMALLEST", 2)
            return cj.sweep(
                scene,
                state,
                END,
                settings=SETTINGS,
                axes={"gravity": cj.Axis(lambda s: s.gravity[1], [-9.81, -9.0])},
                outputs=OUTPUTS,
                progress=False,
                threads=1,
            )

    return run(2), run(10), swept()


SPEED = {"speed": (cj.quantities.PenetrationRate("joint 4", "V"), "m/s")}
OUTPUTS = {
    "peak": cj.Peak(cj.quantities.ContactForce("joint 3"), "N"),
    "impacts": cj.ImpactCount("joint 4"),
    "path": cj.Saved(TIMES, {"y": (cj.quantities.Position("rod 3", "y"), "m")}),
    "lost": cj.DissipatedEnergy(),
    "touch": cj.Section(cj.quantities.Penetration("joint 4", "V"), SPEED, 1),
}


@pytest.mark.slow
def test_runs_are_the_same(runs):
    together, alone, _ = runs
    assert len(together.impacts) == len(alone.impacts)
    assert {"joint 3", "joint 4"} <= set(together.impacts.joint)
    for field in dataclasses.fields(together.impacts):
        one, other = (getattr(run.impacts, field.name) for run in (together, alone))
        if one.dtype == object:
            assert list(one) == list(other)
        else:
            np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-9)
    parts = [(run.final, run.saved, run.steps) for run in (together, alone)]
    assert jax.tree.structure(parts[0]) == jax.tree.structure(parts[1])
    for one, other in zip(*map(jax.tree.leaves, parts), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-9)


@pytest.mark.slow
def test_lanes_of_a_sweep_are_the_same(runs):
    together, _, sweep = runs
    lane = sweep.isel(gravity=0)
    first = together.impacts.of("joint 4", "V")
    np.testing.assert_allclose(
        lane.path_y, together.states.bodies["rod 3"].position[:, 1], rtol=1e-9
    )
    np.testing.assert_allclose(lane.touch_time[0], first.onset[0], rtol=1e-9)
    np.testing.assert_allclose(lane.touch_speed[0], first.entry_speed[0], rtol=1e-5)
    np.testing.assert_allclose(lane.lost, together.final.work["normal damping"], rtol=1e-6)
    for k, (_, body) in enumerate(together.final.bodies.items()):
        np.testing.assert_allclose(lane.final_position[k], body.position, rtol=1e-9, atol=1e-12)
    largest = max(together.impacts.of("joint 3", base).peak_force.max() for base in "VW")
    np.testing.assert_allclose(lane.peak, largest, rtol=0.05)
    finished = (together.impacts.joint == "joint 4").sum()
    assert 0 < finished <= lane.impacts <= finished + 2


def test_group_names_differ_for_different_members():
    assert GroupName(("a", "b")) == GroupName(["a", "b"]) != GroupName(("a, b",))
    family = {GroupName(("a", "b")): np.array([1.0, 2.0]), "c": 3.0}
    assert by_name(family) == {"a": 1.0, "b": 2.0, "c": 3.0}
    back = by_group({"a": 1.0, "b": 2.0, "c": 3.0, "d": 4.0}, family)
    np.testing.assert_array_equal(back[GroupName(("a", "b"))], [1.0, 2.0])
    assert back["c"] == 3.0 and set(back) == set(family)


def test_copies_of_group_names_are_equal():
    name = GroupName(("a", "b"))
    for again in (pickle.loads(pickle.dumps(name)), copy.deepcopy(name)):
        assert again == name and again.members == name.members


def test_each_applies_any_function_and_keeps_structural_numbers():
    """A conditional and a stack, which the arithmetic of arrays would get wrong."""

    def function(x, shared):
        largest = jnp.max(jnp.stack([x, shared]))
        return jax.lax.cond(x > 1.0, lambda: largest, lambda: -largest), 0.0

    values, zero = each(function, np.array([0.5, 1.5, 3.0]), jnp.asarray(2.0))
    np.testing.assert_array_equal(values, [-2.0, 2.0, 3.0])
    assert type(zero) is float


def test_wrenches_are_summed_for_the_bodies_on_which_they_act():
    """On one body of a group, on a slice, on indices out of order and repeated, and repeatedly on a
    single body."""
    group = GroupName("abcd")
    bodies = {group: None, "hub": None}
    wrenches = {
        "c": 1.0,
        GroupName("bcd"): np.array([10.0, 20.0, 30.0]),
        GroupName("dad"): np.array([100.0, 200.0, 300.0]),
        group: np.array([1e3, 2e3, 3e3, 4e3]),
        GroupName(("hub",) * 3): np.array([1.0, 2.0, 3.0]),
        "hub": 10.0,
        "ground": 5.0,
    }
    zero = Vector(0.0, 0.0, 0.0)
    found = summed_wrenches(
        {
            name: cj.extend.Wrench(Vector(jnp.asarray(x), 0.0, 0.0), zero)
            for name, x in wrenches.items()
        },
        bodies,
    )
    np.testing.assert_array_equal(found[group].force.x, [1200.0, 2010.0, 3021.0, 4430.0])
    assert found["hub"].force.x == 16.0 and found["hub"].force.y == 0.0
    assert found.keys() == bodies.keys()


def test_grouped_motions_by_names_of_one_and_of_several_bodies():
    group = GroupName("abcd")
    motions = GroupedMotions({group: jnp.arange(4.0), "hub": jnp.asarray(9.0)})
    assert motions["c"] == 2.0 and motions[GroupName(("hub", "hub"))] == 9.0
    np.testing.assert_array_equal(motions[GroupName("bcd")], [1, 2, 3])
    np.testing.assert_array_equal(motions[GroupName("dab")], [3, 0, 1])
    with pytest.raises(KeyError):
        motions["e"]


def grouped_names(scene):
    return {name.members for name in groups(condensed(unpack(fold_constants(scene))))}


def test_elements_that_are_grouped():
    """Free rods and joints between them; not elements with an ideal joint, an anchor or another
    structure, nor too few."""
    rods, joints = ([f"{what} {k}" for k in range(1, 9)] for what in ("rod", "joint"))
    assert grouped_names(uneven(8)[0]) == {tuple(rods[1:]), tuple(joints[2:])}
    assert grouped_names(uneven(8, (8,))[0]) == {tuple(rods[1:7]), tuple(joints[2:7])}
    assert grouped_names(uneven(4)[0]) == set()
    held = uneven(8, axial=cj.FixedAxially())[0]
    assert grouped_names(held) == set()
    scene = uneven(8)[0]
    ball = cj.SphericalJoint("rod 1", "rod 8", (0, 0, 0), (0, 0, 0))
    assert (tuple(rods[1:7])) in grouped_names(
        cj.Scene(scene.bodies, {**scene.joints, "ball": ball})
    )


def test_joints_of_one_hub_are_grouped():
    scene, _ = uneven(6)
    spokes = {
        f"pin {k}": eqx.tree_at(
            lambda j: j.clearance, scene.joints["joint 3"], np.asarray(k * 1e-4)
        )
        for k in range(1, 6)
    }
    for k, joint in enumerate(spokes.values(), 2):
        object.__setattr__(joint, "bearing_body", "rod 1")
        object.__setattr__(joint, "journal_body", f"rod {k}")
    ball = cj.SphericalJoint("ground", "rod 1", (0, 0, 0), (-0.1, 0, 0))
    names = grouped_names(cj.Scene(scene.bodies, {**spokes, "ball": ball}))
    assert names == {tuple(f"rod {k}" for k in range(2, 7)), tuple(spokes)}


def test_joints_with_rows_are_not_grouped_even_between_the_same_bodies():
    def pinned(axial):
        pins = {
            f"pin {k}": cj.ClearanceJoint(
                "rod 1", "rod 2", bearing_radius=1e-2, clearance=(4 + 0.1 * k) * 1e-4,
                journal_length=2e-2, law=cj.laws.Hertz(1e9), axial=axial,
            )
            for k in range(4)
        }  # fmt: skip
        rods = {name: cj.Body(1.0, (0.1, 0.1, 0.1)) for name in ("rod 1", "rod 2")}
        return cj.Scene(rods, pins)

    assert grouped_names(pinned(cj.FreeAxially())) == {tuple(f"pin {k}" for k in range(4))}
    assert grouped_names(pinned(cj.FixedAxially())) == set()


def test_bristles_of_a_group_store_the_energy_of_each():
    friction = cj.frictions.LuGre(0.15, 0.1, stribeck_speed=1e-2)
    scene = condensed(unpack(fold_constants(uneven(8, friction=friction)[0])))
    ((name, laws),) = [one for one in scene.bristle_laws().items() if isinstance(one[0], GroupName)]
    single = friction.stored_energy(Vector(2e-5, 1e-5, 0.0))
    assert single > 0.0
    deflections = Vector(*np.outer([2e-5, 1e-5, 0.0], np.ones(len(name.members))))
    np.testing.assert_allclose(laws["V"].stored_energy(deflections), single, rtol=1e-15)


def test_the_original_scene_is_restored_from_a_condensed_one():
    scene = unpack(fold_constants(uneven(8, friction=ROUGH)[0]))
    again = whole(condensed(scene))
    assert jax.tree.structure(again) == jax.tree.structure(scene)
    for one, other in zip(jax.tree.leaves(again), jax.tree.leaves(scene), strict=True):
        np.testing.assert_array_equal(one, other)

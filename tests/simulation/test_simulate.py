"""The integrator: compilation, saving, recording, result codes, transformations, methods."""

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import clearjoint as cj
from tests.support.oscillator import on_spring

END = 0.05
FEW_STAGES = cj.Settings(solver=diffrax.Bosh3())
"""For programs that XLA compiles: in half the time."""


def hung(**options):
    """Arm 2 of the paper's pendulum without arm 3: half as much to compile."""
    scene, state = cj.mechanisms.double_pendulum(**options)
    arm, shoulder = scene.bodies["arm 2"], scene.joints["shoulder"]
    alone = cj.Scene({"arm 2": arm}, {"shoulder": shoulder}, gravity=scene.gravity)
    return alone, cj.State({"arm 2": state.bodies["arm 2"]})


@pytest.fixture(scope="module")
def pendulum():
    return hung()


@pytest.fixture(scope="module")
def plain(pendulum):
    return cj.simulate(*pendulum, END)


def _height(solution):
    return float(solution.final.bodies["arm 2"].position[1])


def test_saving_does_not_change_the_steps(pendulum, plain):
    saved = cj.simulate(*pendulum, END, save=cj.Saving([0.0, 0.01, 0.0287, END]))
    assert saved.attempts == plain.attempts
    np.testing.assert_array_equal(saved.times, [0.0, 0.01, 0.0287, END])
    final, last = saved.final.bodies["arm 2"], saved.states.bodies["arm 2"]
    np.testing.assert_array_equal(last.position[-1], final.position)
    np.testing.assert_allclose(final.position, plain.final.bodies["arm 2"].position, rtol=1e-14)
    start = saved.states.bodies["arm 2"].position[0]
    np.testing.assert_array_equal(start, pendulum[1].bodies["arm 2"].position)


def test_saved_states_lie_on_the_trajectory(pendulum):
    """Dense output in flight: free fall to rounding; at recorded steps: the step itself."""
    solution = cj.simulate(*pendulum, 0.03, save=cj.Saving(np.linspace(0, 0.01, 300), steps=True))
    fall = 0.5 * 9.81 * solution.times**2
    np.testing.assert_allclose(solution.states.bodies["arm 2"].position[:, 1], fall, atol=1e-13)
    steps = solution.steps
    assert len(steps) == solution.accepted + 1
    again = cj.simulate(*pendulum, 0.03, save=cj.Saving(steps.times, steps=True))
    found = again.states.bodies["arm 2"].position
    np.testing.assert_allclose(found, steps.states.bodies["arm 2"].position, atol=1e-13)


def test_a_run_can_be_continued(pendulum, plain):
    """The final state with its memory goes on, in the middle of a contact too."""
    scene, state = pendulum
    half = cj.simulate(scene, state, 0.0102, cj.Settings(rtol=1e-9))
    assert half.final.entry_speeds["shoulder"]["V"] > 0.0
    rest = cj.simulate(scene, half.final, END, cj.Settings(rtol=1e-9), start_time=0.0102)
    whole = cj.simulate(scene, state, END, cj.Settings(rtol=1e-9))
    assert _height(rest) == pytest.approx(_height(whole), abs=1e-9)


def test_step_limit_returns_what_was_reached():
    pendulum = hung(clearance=1e-4)
    settings, save = cj.Settings(max_steps=100), cj.Saving([0.005, END])
    solution = cj.simulate(*pendulum, END, settings, save=save, throw=False)
    assert solution.result == cj.RESULTS.max_steps_reached
    assert solution.attempts == 100
    assert 0.0 < solution.time < END
    np.testing.assert_array_equal(solution.times, [0.005])
    with pytest.raises(cj.SimulationError, match="max_steps") as failure:
        cj.simulate(*pendulum, END, cj.Settings(max_steps=100))
    assert failure.value.solution.time == solution.time


@pytest.mark.parametrize("modulus, code", [(1e25, "left_bearing"), (1e300, "non_finite")])
def test_fixed_steps_that_explode_say_so(pendulum, modulus, code):
    """A step of 1 ms jumps deep into the wall: the next ones go through it, or the state overflows,
    and the code says so."""
    scene, state = pendulum
    stiff = eqx.tree_at(lambda s: s.joints["shoulder"].law.stiffness.young_modulus, scene, modulus)
    solution = cj.simulate(
        stiff,
        state,
        1.0,
        cj.Settings(controller=diffrax.ConstantStepSize(), first_step=1e-3, landing_tolerance=None),
        throw=False,
    )
    assert solution.result == getattr(cj.RESULTS, code)
    assert np.isfinite(solution.final.bodies["arm 2"].position).all()


def test_adaptive_steps_survive_overshoot(pendulum):
    """A first step of half a second overflows on trial, is rejected, and shrinks."""
    solution = cj.simulate(*pendulum, END, cj.Settings(first_step=0.5))
    assert solution.result == cj.RESULTS.successful
    assert _height(solution) == pytest.approx(_height(cj.simulate(*pendulum, END)), abs=1e-6)


@pytest.mark.parametrize(
    "method",
    [
        pytest.param(cj.Settings(solver=diffrax.Dopri5()), marks=pytest.mark.slow),
        pytest.param(cj.Settings(solver=diffrax.Kvaerno3(), atol=1e-9), marks=pytest.mark.slow),
        cj.Settings(
            solver=diffrax.Midpoint(), controller=diffrax.ConstantStepSize(), first_step=1e-5
        ),
    ],
    ids=["Dopri5", "Kvaerno3", "Midpoint with constant steps"],
)
def test_other_solvers_and_controllers(pendulum, method):
    solution = cj.simulate(*pendulum, 0.02, method)
    assert _height(solution) == pytest.approx(
        _height(cj.simulate(*pendulum, 0.02, cj.Settings(rtol=1e-9))), abs=2e-6
    )


def test_split_solvers_are_refused(pendulum):
    with pytest.raises(ValueError, match="KenCarp4"):
        cj.simulate(*pendulum, 0.02, cj.Settings(solver=diffrax.KenCarp4()))


@pytest.mark.slow
def test_vmapped_lanes_equal_single_runs(pendulum):
    """Batched clearances, each with its own steps and impacts, equal the runs one by one within the
    tolerance: rounding differs, and the choice of steps amplifies it."""
    scene, state = pendulum
    clearances = jnp.asarray([2e-4, 5e-4, 1e-3])

    def run(clearance):
        swept = eqx.tree_at(lambda s: s.joints["shoulder"].clearance, scene, clearance)
        saving = cj.Saving(jnp.asarray([0.02, END]))
        solution = cj.simulate(swept, state, END, FEW_STAGES, saving)
        return solution.states.bodies["arm 2"].position, solution.result == cj.RESULTS.successful

    positions, fine = jax.jit(jax.vmap(run))(clearances)
    assert fine.all()
    for lane, clearance in enumerate(clearances):
        swept, _ = hung(clearance=float(clearance))
        single = cj.simulate(swept, state, END, FEW_STAGES, cj.Saving([0.02, END]))
        np.testing.assert_allclose(
            positions[lane], single.states.bodies["arm 2"].position, rtol=0, atol=1e-9
        )


@pytest.mark.slow
def test_a_failing_lane_leaves_the_others_alone(pendulum):
    scene, state = pendulum

    def run(clearance):
        swept = eqx.tree_at(lambda s: s.joints["shoulder"].clearance, scene, clearance)
        solution = cj.simulate(swept, state, END, save=cj.Saving(jnp.asarray([0.02, END])))
        return solution.final.bodies["arm 2"].position, solution.result == cj.RESULTS.successful

    good, fine = jax.jit(jax.vmap(run))(jnp.asarray([2e-4, 5e-4, 1e-3]))
    mixed, ok = jax.jit(jax.vmap(run))(jnp.asarray([2e-4, jnp.nan, 1e-3]))
    np.testing.assert_array_equal(ok, [True, False, True])
    np.testing.assert_allclose(good[jnp.asarray([0, 2])], mixed[jnp.asarray([0, 2])], atol=1e-9)


@pytest.mark.slow
def test_forward_derivative_through_impacts():
    """Three impacts: the derivative by the clearance, against the extended-precision table."""
    scene, state = cj.mechanisms.double_pendulum()

    def height(log_clearance):
        swept = eqx.tree_at(lambda s: s.joints["shoulder"].clearance, scene, jnp.exp(log_clearance))
        solution = cj.simulate(
            swept, state, 0.06, cj.Settings(rtol=1e-9), save=cj.Saving(jnp.asarray([0.012, 0.06]))
        )
        return solution.states.bodies["arm 2"].position[:, 1]

    slope = jax.jit(lambda x: jax.jvp(height, (x,), (1.0,))[1])(jnp.log(5e-4))
    expected = [2.861031385e-4, -5.195528888e-4]
    np.testing.assert_allclose(slope, expected, rtol=2e-2)


@pytest.mark.slow
def test_memoryless_and_free_scenes_run():
    body = cj.Body(2.0, (0.1, 0.2, 0.25))
    scene = cj.Scene({"rock": body})
    state = cj.State({"rock": cj.body_state((0, 0, 0), velocity=(1, 2, 3), spin=(0.1, 2.0, 0.3))})
    solution = cj.simulate(scene, state, 1.0, cj.Settings(ledger=True), save=cj.Saving([0.0, 1.0]))
    np.testing.assert_allclose(solution.final.bodies["rock"].position, (1, 2, 3), rtol=1e-12)
    observed = cj.observe(scene, solution)
    assert np.abs(np.diff(observed.energies["kinetic"])) < 1e-6
    hertz, state = hung(law=cj.laws.Hertz(6.6e10))
    assert cj.simulate(hertz, state, 0.02).final.entry_speeds == {}


OTHER_CONTACTS = [{"shoulder": {"V": 0.0}}, {"shoulder": {"X": 1.0}, "hip": {}}]
"""Entry speeds of a state of another law, or of a nonsmooth run: some are lacking, or too many."""


@pytest.mark.parametrize("given", OTHER_CONTACTS)
def test_entry_speeds_of_the_state_need_not_be_those_of_the_scene(pendulum, given):
    scene, state = pendulum
    other = cj.State(state.bodies, given)
    finals = [cj.simulate(scene, one, 0.012).final for one in (other, state)]
    assert all(jax.tree.leaves(jax.tree.map(np.array_equal, *finals)))
    hertz, _ = hung(law=cj.laws.Hertz(6.6e10))
    assert cj.simulate(hertz, other, 1e-3).final.entry_speeds == {}


@pytest.mark.slow
@pytest.mark.parametrize("given", OTHER_CONTACTS)
def test_sweeps_and_derivatives_need_no_entry_speeds_of_the_state(pendulum, given):
    scene, state = pendulum
    other = cj.State(state.bodies, given)
    axes = {"c": cj.Axis(lambda scene: scene.joints["shoulder"].clearance, [3e-4, 5e-4])}
    peak = {"F": cj.Peak(cj.quantities.ContactForce("shoulder"), "N")}
    mass = {"m": cj.Parameter(lambda scene: scene.bodies["arm 2"].mass)}
    height = {"y": cj.quantities.Position("arm 2", "y")}

    def results(state):
        lanes = cj.sweep(scene, state, 0.012, axes, peak)["F"].values
        slopes = cj.sensitivities(scene, state, 0.012, mass, height, [0.012]).derivatives
        return lanes, slopes

    same = jax.tree.map(np.array_equal, results(other), results(state))
    assert all(jax.tree.leaves(same))


def test_contact_at_the_start_counts_as_elastic(pendulum):
    """A journal released 5 um deep leaves with the elastic energy, whatever the restitution."""
    scene, _ = hung(restitution=0.5)
    scene = eqx.tree_at(lambda s: s.gravity, scene, np.zeros(3))
    state = cj.State({"arm 2": cj.body_state((0.5, 5.05e-4, 0.0))})
    settings = cj.Settings(rtol=1e-9, ledger=True)
    solution = cj.simulate(scene, state, 1e-3, settings, save=cj.Saving([0.0, 1e-3]))
    observed = cj.observe(scene, solution)
    assert observed.energies["contacts"][0] > 1e-4
    assert observed.energies["contacts"][1] == 0.0
    assert observed.energies["kinetic"][1] == pytest.approx(
        observed.energies["contacts"][0], rel=1e-6
    )


def test_a_scene_closed_over_by_jit_runs_in_one_piece():
    scene = cj.Scene({"ball": cj.Body(1.0, (1.0, 1.0, 1.0))}, gravity=(0.0, 0.0, -9.81))
    state = cj.State({"ball": cj.body_state((0.0, 0.0, 0.0))})
    fallen = jax.jit(lambda: cj.simulate(scene, state, 2.0).final.bodies["ball"].position[2])()
    assert float(fallen) == pytest.approx(-0.5 * 9.81 * 4.0, rel=1e-9)


@pytest.mark.slow
def test_reductions_of_a_run_see_what_is_between_saved_states():
    scene, state = on_spring()  # 0.1 cos(10 t)
    speed = cj.quantities.Velocity("ball", "x")
    outputs = {"speed": cj.Peak(speed, "m/s"), "mean": cj.Statistics(speed, "m/s", until=0.3)}
    save, end, exact = cj.Saving([0.0, 0.5]), 0.5, cj.Settings(rtol=1e-9)
    found = cj.simulate(scene, state, end, exact, save, outputs=outputs).outputs
    assert found["speed"] == pytest.approx(1.0, rel=1e-6)
    assert found["speed_time"] == pytest.approx(0.15 * np.pi, rel=1e-4)
    assert found["mean_mean"] == pytest.approx(0.1 * (np.cos(3.0) - 1.0) / 0.3, rel=1e-6)
    assert cj.simulate(scene, state, end, exact).outputs == {}
    with pytest.raises(ValueError, match=r"outputs\['speed'\].*a quantity under a transformation"):
        jax.jit(lambda t: cj.simulate(scene, state, t, outputs=outputs).time)(end)
    joint = cj.ImpactCount("pin")
    with pytest.raises(ValueError, match="Output 'hits'.*pin"):
        cj.simulate(scene, state, end, outputs={"hits": joint})
    with pytest.raises(ValueError, match=r"outputs\['lost'\]"):
        cj.simulate(scene, state, end, outputs={"lost": cj.MeanPowerLost()})


def test_times_that_stand_twice_are_refused():
    with pytest.raises(ValueError, match="`times` must be without repetition.*numpy.unique"):
        cj.Saving([0.0, 1.0, 1.0])

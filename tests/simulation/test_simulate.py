"""The integrator: compilation, saving, recording, result codes, transformations, methods."""

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import clearjoint as cj
from tests.support.dropped_rod import STEEL, dropped_rod
from tests.support.one_body import one_body

END = 0.05
FEW_STAGES = cj.Settings(solver=diffrax.Bosh3())
"""For programs that XLA compiles: in half the time."""


@pytest.fixture(scope="module")
def rod():
    return dropped_rod()


@pytest.fixture(scope="module")
def plain(rod):
    return cj.simulate(*rod, END)


def _height(solution):
    return float(solution.final.bodies["rod"].position[1])


def test_saving_does_not_change_the_steps(rod, plain):
    saved = cj.simulate(*rod, END, save=cj.Saving([0.0, 0.01, 0.0287, END]))
    assert saved.attempts == plain.attempts
    np.testing.assert_array_equal(saved.times, [0.0, 0.01, 0.0287, END])
    final, last = saved.final.bodies["rod"], saved.states.bodies["rod"]
    np.testing.assert_array_equal(last.position[-1], final.position)
    np.testing.assert_allclose(final.position, plain.final.bodies["rod"].position, rtol=1e-14)
    start = saved.states.bodies["rod"].position[0]
    np.testing.assert_array_equal(start, rod[1].bodies["rod"].position)


def test_saved_states_lie_on_the_trajectory(rod):
    """Dense output in flight: free fall to rounding; at recorded steps: the step itself."""
    solution = cj.simulate(*rod, 0.03, save=cj.Saving(np.linspace(0, 0.01, 300), steps=True))
    fall = 0.5 * 9.81 * solution.times**2
    np.testing.assert_allclose(
        solution.states.bodies["rod"].position[:, 1], fall, rtol=0.0, atol=1e-13
    )
    steps = solution.steps
    assert len(steps) == solution.accepted + 1
    again = cj.simulate(*rod, 0.03, save=cj.Saving(steps.times, steps=True))
    found = again.states.bodies["rod"].position
    np.testing.assert_allclose(found, steps.states.bodies["rod"].position, rtol=0.0, atol=1e-13)


def test_step_limit_returns_what_was_reached():
    rod = dropped_rod(clearance=1e-4)
    settings, save = cj.Settings(max_steps=100), cj.Saving([0.005, END])
    solution = cj.simulate(*rod, END, settings, save=save, throw=False)
    assert solution.result == cj.RESULTS.max_steps_reached
    assert solution.attempts == 100
    assert 0.0 < solution.time < END
    np.testing.assert_array_equal(solution.times, [0.005])
    with pytest.raises(cj.SimulationError, match="max_steps") as failure:
        cj.simulate(*rod, END, cj.Settings(max_steps=100))
    assert failure.value.solution.time == solution.time


@pytest.mark.parametrize("modulus, code", [(1e25, "left_bearing"), (1e300, "non_finite")])
def test_fixed_steps_that_explode_say_so(rod, modulus, code):
    """A step of 1 ms jumps deep into the wall: the next ones go through it, or the state overflows,
    and the code says so."""
    scene, state = rod
    stiff = eqx.tree_at(lambda s: s.joints["pin"].law.stiffness.young_modulus, scene, modulus)
    constant = {"controller": diffrax.ConstantStepSize(), "first_step": 1e-3}
    settings = cj.Settings(**constant, landing_tolerance=None)
    solution = cj.simulate(stiff, state, 1.0, settings, throw=False)
    assert solution.result == getattr(cj.RESULTS, code)
    assert np.isfinite(solution.final.bodies["rod"].position).all()


def test_adaptive_steps_survive_overshoot(rod):
    """A first step of half a second overflows on trial, is rejected, and shrinks."""
    solution = cj.simulate(*rod, END, cj.Settings(first_step=0.5))
    assert solution.result == cj.RESULTS.successful
    assert _height(solution) == pytest.approx(_height(cj.simulate(*rod, END)), abs=1e-6)


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
def test_other_solvers_and_controllers(rod, method):
    solution = cj.simulate(*rod, 0.02, method)
    expected = cj.simulate(*rod, 0.02, cj.Settings(rtol=1e-9))
    assert _height(solution) == pytest.approx(_height(expected), abs=2e-6)


@pytest.mark.slow
def test_vmapped_lanes_equal_single_runs(rod):
    """Batched clearances, each with its own steps and impacts, equal the runs one by one within the
    tolerance, also beside a lane that fails: rounding differs, and the choice of steps amplifies
    it."""
    scene, state = rod
    clearances = jnp.asarray([2e-4, 5e-4, jnp.nan, 1e-3])

    def run(clearance):
        swept = eqx.tree_at(lambda s: s.joints["pin"].clearance, scene, clearance)
        saving = cj.Saving(jnp.asarray([0.02, END]))
        solution = cj.simulate(swept, state, END, FEW_STAGES, saving)
        return solution.states.bodies["rod"].position, solution.result == cj.RESULTS.successful

    positions, fine = jax.jit(jax.vmap(run))(clearances)
    np.testing.assert_array_equal(fine, np.isfinite(clearances))
    for lane in np.flatnonzero(fine):
        swept, _ = dropped_rod(clearance=float(clearances[lane]))
        single = cj.simulate(swept, state, END, FEW_STAGES, cj.Saving([0.02, END]))
        expected = single.states.bodies["rod"].position
        np.testing.assert_allclose(positions[lane], expected, rtol=0, atol=1e-9)


OTHER_CONTACTS = [{"pin": {"V": 0.0}}, {"pin": {"X": 1.0}, "hip": {}}]
"""Entry speeds of a state of another law, or of a nonsmooth run: some are lacking, or too many."""


@pytest.mark.parametrize("given", OTHER_CONTACTS)
def test_entry_speeds_of_the_state_need_not_be_those_of_the_scene(rod, given):
    scene, state = rod
    other = cj.State(state.bodies, given)
    finals = [cj.simulate(scene, one, 0.012).final for one in (other, state)]
    assert all(jax.tree.leaves(jax.tree.map(np.array_equal, *finals)))
    hertz, _ = dropped_rod(cj.laws.Hertz(6.6e10))
    assert cj.simulate(hertz, other, 1e-3).final.entry_speeds == {}


@pytest.mark.slow
@pytest.mark.parametrize("given", OTHER_CONTACTS)
def test_sweeps_and_derivatives_need_no_entry_speeds_of_the_state(rod, given):
    scene, state = rod
    other = cj.State(state.bodies, given)
    axes = {"c": cj.Axis(lambda scene: scene.joints["pin"].clearance, [3e-4, 5e-4])}
    peak = {"F": cj.Peak(cj.quantities.ContactForce("pin"), "N")}
    mass = {"m": cj.Parameter(lambda scene: scene.bodies["rod"].mass)}
    height = {"y": cj.quantities.Position("rod", "y")}

    def results(state):
        lanes = cj.sweep(scene, state, 0.012, axes, peak)["F"].values
        slopes = cj.sensitivities(scene, state, 0.012, mass, height, [0.012]).derivatives
        return lanes, slopes

    same = jax.tree.map(np.array_equal, results(other), results(state))
    assert all(jax.tree.leaves(same))


def test_contact_at_the_start_counts_as_elastic(rod):
    """A journal released 5 um deep leaves with the elastic energy, whatever the restitution."""
    scene, _ = dropped_rod(cj.laws.LankaraniNikravesh(0.5, STEEL))
    scene = eqx.tree_at(lambda s: s.gravity, scene, np.zeros(3))
    state = cj.State({"rod": cj.body_state((0.5, 5.05e-4, 0.0))})
    settings = cj.Settings(rtol=1e-9, ledger=True)
    solution = cj.simulate(scene, state, 1e-3, settings, save=cj.Saving([0.0, 1e-3]))
    energies = cj.observe(scene, solution).energies
    assert energies["contacts"][0] > 1e-4
    assert energies["contacts"][1] == 0.0
    assert energies["kinetic"][1] == pytest.approx(energies["contacts"][0], rel=1e-6)


def test_a_scene_closed_over_by_jit_runs_in_one_piece():
    scene, state = one_body("ball", gravity=(0.0, 0.0, -9.81))
    fallen = jax.jit(lambda: cj.simulate(scene, state, 2.0).final.bodies["ball"].position[2])()
    assert float(fallen) == pytest.approx(-0.5 * 9.81 * 4.0, rel=1e-9)

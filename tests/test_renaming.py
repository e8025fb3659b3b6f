"""Names of bodies, joints, forces, outputs, parameters, axes, sensors and series don't change
results, in any public call.

Each call is made with names in alphabetical order and with random ones, and the numbers are
compared by the roles of the names. What a user writes down keeps its order, so random numbers,
columns of parameters and rows of constraints are the same ones. Within a run, names decide the
order of sums, so that numbers may differ by rounding errors, which impacts and searches amplify.
"""

import inspect
import json
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest
import xarray as xr
from matplotlib import pyplot as plt

import clearjoint as cj
from clearjoint import plot
from tests.durability import test_wear as wearing
from tests.support import urdf
from tests.support.renaming import Names, by_role, differences, renamed
from tests.support.slow import slow, slow_but

ROUNDING = 1e-9
"""Largest difference of two numbers, relative to the largest one of their array."""
SEARCHED = 1e-5
"""The same for results of a search, which ends within its tolerance, and for motions whose
integration error differs."""
QUIET = {"progress": False}
TIMES = np.linspace(0.002, 0.04, 20)
Case = Callable[[Names], Any]


def balls() -> tuple[cj.Scene, cj.State]:
    """Balls of 1 and 4 kg on springs of 100 and 400 N/m, 0.1 m out; the first one moves at 1 m/s.
    Both have a period of 0.2 pi s."""
    bodies = {"heavy": cj.Body(4.0, (1e-3,) * 3), "light": cj.Body(1.0, (2e-3,) * 3)}
    springs = {
        f"{name} spring": cj.SpringDamper("ground", name, (0, 0, 0), (0, 0, 0), stiffness=stiffness)
        for name, stiffness in (("heavy", 400.0), ("light", 100.0))
    }
    velocities = {"heavy": (1.0, 0, 0.2), "light": (0, 0.3, 0)}
    states = {name: cj.body_state((0.1, 0, 0), velocity=v) for name, v in velocities.items()}
    return cj.Scene(bodies, forces=springs), cj.State(states)


def rig() -> tuple[cj.Scene, cj.State]:
    """The double pendulum, a ball on a spring, and a load on an arm."""
    scene, state = cj.mechanisms.double_pendulum(clearance=0.2e-3, restitution=0.6)
    alone, start = balls()
    forces = {"light spring": alone.forces["light spring"]}
    forces["push"] = cj.AppliedLoad("arm 3", force=(0.0, 3.0, 1.0))
    bodies = {"light": alone.bodies["light"], **scene.bodies}
    state = cj.State({"light": start.bodies["light"], **state.bodies})
    return cj.Scene(bodies, scene.joints, forces, scene.gravity), state


def quantities(n: Names) -> dict[str, Any]:
    """Four outputs of the rig, by name."""
    return {
        n["swing"]: cj.quantities.Velocity(n["arm 3"], "y"),
        n["speed"]: cj.quantities.Velocity(n["light"]),
        n["offset"]: cj.quantities.JournalOffset(n["shoulder"], "y"),
        n["angle"]: cj.quantities.JointAngle(n["elbow"]),
    }


def velocity(n: Names) -> Callable[[cj.State], Any]:
    return lambda state: state.bodies[n["light"]].velocity[1]


def stiffness(n: Names, ball: str = "light") -> Callable[[cj.Scene], Any]:
    return lambda scene: scene.forces[n[f"{ball} spring"]].stiffness


def mass(n: Names) -> Callable[[cj.Scene], Any]:
    return lambda scene: scene.bodies[n["arm 2"]].mass


def parameters(n: Names) -> dict[str, cj.Parameter]:
    """Three parameters of the rig, one of them of the initial state, by name."""
    return {
        n["start"]: cj.Parameter.initial(velocity(n)),
        n["stiffness"]: cj.Parameter(stiffness(n), cj.Log()),
        n["mass"]: cj.Parameter(mass(n), cj.Log()),
    }


def ball_parameters(n: Names) -> dict[str, cj.Parameter]:
    return {
        n["start"]: cj.Parameter.initial(velocity(n)),
        n["light stiffness"]: cj.Parameter(stiffness(n), cj.Log()),
        n["heavy stiffness"]: cj.Parameter(stiffness(n, "heavy"), cj.Log()),
    }


def probes(n: Names) -> dict[str, Any]:
    return {
        n["of heavy"]: cj.quantities.Position(n["heavy"], "x"),
        n["of light"]: cj.quantities.Position(n["light"], "y"),
        n["of light, x"]: cj.quantities.Position(n["light"], "x"),
    }


def speeds(n: Names) -> dict[str, Any]:
    return {
        n["speed of heavy"]: cj.Peak(cj.quantities.Velocity(n["heavy"]), "m/s"),
        n["speed of light"]: cj.Peak(cj.quantities.Velocity(n["light"]), "m/s"),
    }


def outputs(n: Names) -> dict[str, Any]:
    """Outputs of a sweep of the rig, of each kind."""
    looks = quantities(n)
    channels = {name: (quantity, "1") for name, quantity in looks.items()}
    return {
        n["peak"]: cj.Peak(looks[n["swing"]], "m/s"),
        n["impacts"]: cj.ImpactCount(n["shoulder"]),
        n["mean"]: cj.Statistics(looks[n["speed"]], "m/s"),
        n["lost"]: cj.DissipatedEnergy(),
        n["hits"]: cj.ImpactTable(5),
        n["crossings"]: cj.Section(looks[n["offset"]], channels, count=4),
        **looks,
    }


@cache
def solved(n: Names) -> tuple[cj.Scene, Any]:
    """The rig and a run of it."""
    scene, state = renamed(rig(), n)
    save, settings = cj.Saving(TIMES, steps=True, impacts=True), cj.Settings(ledger=True)
    return scene, cj.simulate(scene, state, 0.04, settings, save, outputs=outputs(n), **QUIET)


def simulate(n: Names) -> Any:
    _, solution = solved(n)
    return solution, solution.to_xarray()


def observe(n: Names) -> Any:
    found = cj.observe(*solved(n))
    return found, found.to_xarray()


def sensitivities(n: Names) -> Any:
    scene, state = renamed(rig(), n)
    settings = cj.Settings(coordinates=cj.AbsoluteCoordinates())
    recorded = {n[name]: outputs(n)[n[name]] for name in ("crossings", "hits")}
    wanted, save = {**quantities(n), **recorded}, cj.Saving(TIMES, impacts=True)
    asked = parameters(n), wanted, TIMES, settings, save
    found = cj.sensitivities(scene, state, 0.04, *asked, **QUIET)
    return found, found.to_xarray()


def predictor(n: Names) -> Any:
    scene, state = renamed(rig(), n)
    predict = cj.predictor(scene, state, 0.04, parameters(n), quantities(n), TIMES)
    values, pull = jax.vjp(predict, predict.values)
    (gradient,) = pull({name: np.ones(len(TIMES)) for name in values})
    return values, gradient


def measured(n: Names) -> cj.Measurements:
    """Series of the balls' motion, which is known, with noise."""
    w, v = 10.0, 0.3
    values = {
        n["of heavy"]: 0.1 * np.cos(w * TIMES) + np.sin(w * TIMES) / w,
        n["of light"]: v * np.sin(w * TIMES) / w,
        n["of light, x"]: 0.1 * np.cos(w * TIMES),
    }
    series = {
        name: cj.Series(probe, TIMES, values[name], noise=1e-4 * (k + 1))
        for k, (name, probe) in enumerate(probes(n).items())
    }
    return cj.Measurements(series).with_noise(np.random.default_rng(1))


def guess(n: Names) -> dict[str, float]:
    return {n["heavy stiffness"]: 380.0, n["start"]: 0.31, n["light stiffness"]: 110.0}


def problem(n: Names, data: Any = None) -> tuple[Any, ...]:
    """Scene, state, measurements and parameters of a fit of the balls."""
    return *renamed(balls(), n), data or measured(n), ball_parameters(n)


@cache
def fitted(n: Names) -> Any:
    return cj.identify(*problem(n), guess=guess(n), check_runs=0, **QUIET)


def identify(n: Names) -> Any:
    fit = fitted(n)
    parts = "estimates standard_errors correlation chi_squared intervals coordinates predictions "
    parts += "residuals value_covariance whiteness"
    return [getattr(fit, part) for part in parts.split()], fit.to_xarray()


def identify_many(n: Names) -> Any:
    data = measured(n)
    draws = [data.with_noise(np.random.default_rng(seed)) for seed in range(2)]
    fits = cj.identify_many(*problem(n, draws), guess=guess(n), check_runs=0, **QUIET)
    return [(fit.estimates, fit.standard_errors) for fit in fits]


def minimise(n: Names) -> Any:
    def objective(found: dict[str, Any]) -> Any:
        return jnp.sum((found[n["of heavy"]] - 2.0 * found[n["of light"]]) ** 2)

    found = cj.minimise(*problem(n, objective), probes(n), TIMES, iterations=3)
    return found.estimates, found.history


def posterior(n: Names) -> Any:
    spread = {n["heavy stiffness"]: 0.01, n["start"]: 0.01, n["light stiffness"]: 0.02}
    found = cj.posterior(*problem(n), draws=64, spread=spread, **QUIET)
    return found.means, found.standard_deviations, found.coordinates, found.log_evidence


def sensors(n: Names) -> dict[str, cj.Sensor]:
    return {
        name: cj.Sensor(probe, TIMES[k:], 1e-4 * (k + 1))
        for k, (name, probe) in enumerate(probes(n).items())
    }


@cache
def identified(n: Names) -> Any:
    return cj.identifiability(*renamed(balls(), n), ball_parameters(n), sensors(n))


def identifiability(n: Names) -> Any:
    report = identified(n)
    one = report.of(n["of light"])
    parts = [report.matrix, report.deviations, report.identifiable, report.names, report.sensors]
    return parts, [one.matrix, one.deviations_alone]


@cache
def fit_horizon(n: Names) -> Any:
    uncertainty = {n["light stiffness"]: 0.3, n["heavy stiffness"]: 0.2, n["start"]: 0.1}
    start = renamed(balls(), n)
    return cj.fit_horizon(*start, ball_parameters(n), sensors(n), uncertainty=uncertainty)


def largest_feasible(n: Names) -> Any:
    limits = {n["speed of light"]: 5.0, n["speed of heavy"]: 2.0}
    start = renamed(balls(), n)
    parameter = ball_parameters(n)[n["heavy stiffness"]]
    options = {"between": (100.0, 1e4), "lanes": 5, "tolerance": 0.1, "limit": limits, **QUIET}
    return cj.largest_feasible(*start, 1.0, parameter, speeds(n), **options)


def axes(n: Names) -> dict[str, cj.Axis]:
    return {
        n["start"]: cj.Axis.initial(velocity(n), [0.1, 0.4]),
        n["stiffness"]: cj.Axis(stiffness(n), [90.0, 120.0]),
        n["both"]: cj.Axis.change(lambda s, t, v: (cj.set_value(s, mass(n), v), t), [6.0, 8.0]),
    }


def sweep(n: Names) -> Any:
    save = cj.Saving(TIMES[:3])
    start = renamed(rig(), n)
    wanted = {name: o for name, o in outputs(n).items() if name not in quantities(n)}
    run = partial(cj.sweep, *start, 0.04, axes(n), settings=cj.Settings(ledger=True), **QUIET)
    found = run(wanted, save=save, path="sweep.zarr")
    again = run(outputs(n), save=save)
    return found, cj.open_sweep("sweep.zarr"), again


def ensemble(n: Names) -> Any:
    axis = cj.Axis(stiffness(n), [100.0, 400.0])
    start = renamed(balls(), n)
    options = {"disturbance": 0.3, "draws": 3, **QUIET}
    return cj.ensemble(*start, 1.0, {n["stiffness"]: axis}, speeds(n), **options)


def ensemble_of_a_linkage(n: Names) -> Any:
    start = renamed(rig(), n)
    axis = cj.Axis(mass(n), [7.0])
    options = {"disturbance": 1e-3, "draws": 3, "exponents": 2, **QUIET}
    peak = {n["peak"]: outputs(n)[n["peak"]]}
    return cj.ensemble(*start, 0.02, {n["mass"]: axis}, peak, **options)


def uncertain(n: Names) -> dict[str, cj.Uncertain]:
    start, light, heavy = ball_parameters(n).values()
    return {
        n["start"]: cj.Uncertain(start, deviation=0.01),
        n["light stiffness"]: cj.Uncertain(light, half_width=0.1),
        n["heavy stiffness"]: cj.Uncertain(heavy, deviation=0.02),
    }


def statistics_derivatives(n: Names) -> Any:
    start = renamed(balls(), n)
    options = {"draws": 140, "disturbance": 0.05, **QUIET}
    return cj.statistics_derivatives(*start, 0.3, uncertain(n), speeds(n), **options)


def sobol_indices(n: Names) -> Any:
    return cj.sobol_indices(*renamed(balls(), n), 0.3, uncertain(n), speeds(n), draws=16, **QUIET)


def design(n: Names) -> Any:
    drawn = cj.design(*renamed(balls(), n), uncertain(n), 8)
    return {name: axis.values for name, axis in drawn.items()}


def wear(n: Names) -> Any:
    mechanism = wearing.whirling_and_rotating()
    scene, state = renamed(mechanism, n)
    load = cj.Parameter(lambda s: s.forces[n["other load"]].force[0], cj.Log())
    mass = cj.Parameter(lambda s: s.bodies[n["rotor"]].mass, cj.Log())
    rates = {n[name]: rate for name, rate in wearing.RATES.items()}
    found = cj.wear(
        scene,
        state,
        wearing.CYCLE,
        rates,
        [100.0, 200.0],
        parameters={n["worn by"]: load, n["by mass"]: mass},
        path="wear.zarr",
        **wearing.OPTIONS,
    )
    pin = n["pin"]
    return [
        found,
        cj.open_wear("wear.zarr"),
        list(cj.worn(scene, found).bodies),
        cj.parameters(cj.worn(scene, found)),
        cj.cycles_to_depth(found, 1e-8, pin),
        cj.life_derivatives(found, 1e-8, pin),
    ]


def settle(n: Names) -> Any:
    channels = {
        n["across"]: (cj.quantities.Velocity(n["heavy"], "z"), "m/s"),
        n["along"]: (cj.quantities.Position(n["light"], "x"), "m"),
    }
    section = cj.Section(cj.quantities.Position(n["heavy"], "x"), channels, count=10)
    found = cj.settle(*renamed(balls(), n), section=section, span=0.2 * np.pi, periods=20, **QUIET)
    # The changes are differences of nearly equal numbers.
    return found.kind, found.multiple, found.state, found.time, found.period


def simulate_nonsmooth(n: Names) -> Any:
    scene, state = renamed(rig(), n)
    solution = cj.simulate_nonsmooth(scene, state, 0.02, cj.Saving(TIMES[TIMES <= 0.02]), step=1e-3)
    return solution, solution.to_xarray()


def assemble(n: Names) -> Any:
    scene, state = renamed(cj.mechanisms.four_bar(), n)
    bodies = {
        name: cj.body_state(np.asarray(body.position) + 1e-3 * (k + 1), body.orientation)
        for k, (name, body) in enumerate(state.bodies.items())
    }
    return cj.assemble(scene, cj.State(bodies))


def loops(n: Names) -> Any:
    """Joint coordinates cut a loop of ideal joints at a joint that is chosen by names, so that the
    integration error differs."""
    scene, state = renamed(cj.mechanisms.bricard(), n)
    return cj.simulate(scene, state, 0.04, save=cj.Saving(TIMES), progress=False).saved


def accelerometer(n: Names) -> Any:
    scene, state = renamed(balls(), n)
    on_light = {"axis": (0, 1, 0), "frequency": 50.0, "name": n["sensor"]}
    added = cj.accelerometer(scene, state, n["light"], **on_light)
    return added.scene, added.state


def constraint_report(n: Names) -> Any:
    report = cj.constraint_report(*renamed(cj.mechanisms.bricard(), n))
    assert len(report.redundant) == 1
    return report


def numbers_of_scenes(n: Names) -> Any:
    scene, state = renamed(rig(), n)
    changed = cj.set_value(scene, mass(n), 8.0)
    started = cj.set_value(state, lambda s: s.bodies[n["light"]].velocity[2], 0.7)
    orders = [list(part) for part in (changed.bodies, changed.joints, changed.forces)]
    return cj.parameters(scene), cj.parameters(changed), cj.parameters(started), orders


def files(n: Names) -> Any:
    scene, state = renamed(rig(), n)
    cj.save(scene, state, "scene.json")
    read, start = cj.load("scene.json")
    orders = [list(part) for part in (read.bodies, read.joints, read.forces)]
    document = json.loads(Path("scene.json").read_text())
    return document, cj.parameters(read), cj.parameters(start), orders


def two_links(n: Names) -> Any:
    """A robot of two hinges, from a file."""

    def hinge(name: str, parent: str, child: str, top: float) -> str:
        limit, place = (top, 2, -1, top + 1), f"0.2 0 {top}"
        ends = n[parent], n[child]
        return urdf.joint(n[name], "revolute", *ends, "0 0 1", xyz=place, limit=limit)

    masses = {"base": 5.0, "upper": 2.0, "lower": 1.0}
    links = [urdf.link(n[name], mass, (0.1, 0.2, 0.2)) for name, mass in masses.items()]
    hinges = hinge("first", "base", "upper", 0.1), hinge("second", "upper", "lower", 0.3)
    Path("robot.urdf").write_text(urdf.robot(*links, *hinges))
    return cj.load_robot("robot.urdf")


def driven_robot(n: Names) -> Any:
    robot = two_links(n)
    robot = robot.with_drive(n["second"], cj.Drive(1e-3, 5.0, "1 deg", 20.0, loss=0.1))
    robot = robot.with_elements({n["torque"]: cj.DriveTorque(*robot.motor_side(n["second"]), 1.0)})
    positions = {n["first"]: 0.3, n["second"]: -0.2}
    state = robot.state(positions, positions)
    return (
        cj.parameters(robot.scene),
        cj.parameters(state),
        robot.limits,
        robot.links,
        robot.angles(state),
        robot.torques(positions, positions),
    )


def mjcf(n: Names) -> Any:
    pytest.importorskip("mujoco")
    axis, body = (0.0, 0.0, 1.0), cj.Body(1.0, (0.01, 0.01, 0.01))
    joints = {
        name: cj.RevoluteJoint("ground", of, (0, 0, 0), (0, 0, 0), axis, axis)
        for name, of in (("first", "upper"), ("second", "lower"))
    }
    joints["play"] = cj.Backlash("upper", "lower", play=0.01, torsional_stiffness=200.0)
    states = {
        "upper": cj.body_state((0, 0, 0), spin=(0, 0, 1.0)),
        "lower": cj.body_state((0, 0, 0)),
    }
    scene = cj.Scene({"upper": body, "lower": body}, joints)
    scene, state = renamed((scene, cj.State(states)), n)
    cj.save_mjcf(scene, "scene.xml", state)
    read = cj.load_robot("scene.xml").scene
    orders = [list(part) for part in (read.bodies, read.joints)]
    found = cj.compare_with_mujoco(scene, state, 0.02)
    return cj.parameters(read), orders, found.positions, found.in_mujoco, found.largest_difference


def fit_robot(n: Names) -> Any:
    robot, times = two_links(n), np.linspace(0.0, 0.2, 60)
    size = {n["first"]: 0.3, n["second"]: -0.2}
    q, qd, qdd = (
        {name: wave * s for name, s in size.items()}
        for wave in (np.sin(9.0 * times), 9.0 * np.cos(9.0 * times), -81.0 * np.sin(9.0 * times))
    )
    torques = robot.torques(q, qd, qdd)
    table = pd.DataFrame({"t": times})
    for name in size:
        table[f"q {name}"], table[f"tau {name}"] = q[name], torques[name] + 0.4 * qd[name]
    log = cj.RobotLog.read(
        table,
        angles={name: f"q {name} [rad]" for name in size},
        torques={name: cj.LogColumn(f"tau {name} [N m]", noise=0.1) for name in size},
    )
    find = {name: {"damping": 0.3, "inertia": None} for name in size}
    found = cj.fit_robot(robot, log, find, dict.fromkeys(size, "angle"), **QUIET)
    results = found.fit.estimates, found.fit.intervals, found.to_xarray(), found.hysteresis()
    return [*results, found.undetermined, found.held]


def beyond_law_ranges(n: Names) -> Any:
    scene, solution = solved(n)
    return cj.beyond_law_ranges(scene, solution.impacts)


def readers(n: Names) -> Any:
    channels = {
        name: cj.Channel(probe, noise=0.1 * (k + 1))
        for k, (name, probe) in enumerate(probes(n).items())
    }
    columns = {name: ("t", TIMES + k, {"units": "m"}) for k, name in enumerate(channels)}
    table = xr.Dataset(columns, coords={"t": TIMES})
    table.to_dataframe().rename(columns=lambda name: f"{name} [m]").rename_axis("t [s]").to_csv(
        "rig.csv"
    )
    read = cj.read_csv("rig.csv", channels), cj.from_xarray(table, channels)
    return [
        {name: (one.values, one.noise) for name, one in data.series.items()} for data in read
    ], cj.function_from_csv("rig.csv", n["of light"], "m").values


def view(n: Names) -> Any:
    drawn = cj.view(*solved(n))
    return drawn.parts, drawn.legend


def figures_of_runs(n: Names) -> Any:
    scene, solution = solved(n)
    seen = cj.observe(scene, solution)
    drawn = [
        plot.joint_forces(seen),
        plot.motion_timeline(seen),
        plot.contact_forces(seen, n["shoulder"]),
        plot.acceleration({n["run"]: seen}, n["light"]),
        plot.position({n["run"]: solution.steps}, n["light"]),
        plot.energy_ledger(seen).ravel()[0],
    ]
    return [*(axes.figure for axes in drawn), plot.report(scene, solution)]


def figures_of_fits(n: Names) -> Any:
    fit, found = fitted(n), fit_horizon(n)
    drawn = plot.correlations(fit), plot.fitted(fit).ravel()[0], plot.growth(found)
    return [axes.figure for axes in (*drawn, plot.record_length(identified(n)))]


EXACT = (
    *(accelerometer, assemble, beyond_law_ranges, constraint_report, design, ensemble),
    *(largest_feasible, minimise, observe, sensitivities, simulate, simulate_nonsmooth),
    *(sobol_indices, statistics_derivatives, view),
)
CLOSE = fit_horizon, fit_robot, identify, identify_many, loops, posterior
CASES: dict[str, tuple[Case, float]] = {
    **{case.__name__: (case, ROUNDING) for case in EXACT},
    **{case.__name__: (case, SEARCHED) for case in CLOSE},
    "ensemble of a linkage": (ensemble_of_a_linkage, SEARCHED),
    "figures of fits": (figures_of_fits, SEARCHED),
    "figures of runs": (figures_of_runs, 1e-6),
    "identifiability": (identifiability, 1e-7),
    "load, save": (files, ROUNDING),
    "load_robot": (driven_robot, ROUNDING),
    "save_mjcf, compare_with_mujoco": (mjcf, 1e-7),
    "parameters, set_value": (numbers_of_scenes, ROUNDING),
    "predictor": (predictor, 1e-6),
    "read_csv, from_xarray, function_from_csv": (readers, ROUNDING),
    "settle": (settle, 1e-7),
    "sweep, open_sweep": (sweep, ROUNDING),
    "wear, open_wear, worn, cycles_to_depth, life_derivatives": (wear, 1e-7),
}
"""The calls that are made, by the names of the public functions, and how far numbers may be apart
relative to the largest one of their array."""
WITHOUT_NAMES = {
    *("body_state", "carried_journal", "configure", "free_impact", "rotation", "scene_schema"),
}
"""Public functions whose arguments and results have no names that a user chooses."""
FEW = "constraint_report", "design", "load, save", "parameters, set_value"
"""Calls made in fast tests: at most one program of two balls each."""


def test_every_public_function_is_renamed_or_has_no_names():
    functions = {name for name in dir(cj) if inspect.isfunction(getattr(cj, name))}
    called = {name for names in CASES for name in names.split(", ")}
    functions = {name for name in functions if not name.startswith("_")}
    assert functions <= called | WITHOUT_NAMES
    assert not WITHOUT_NAMES & called and functions >= WITHOUT_NAMES


@pytest.mark.parametrize("call", slow_but(FEW, CASES))
@pytest.mark.parametrize("seed", [1, slow(2)])
def test_names_change_nothing(call, seed, tmp_path, monkeypatch):
    case, rtol = CASES[call]
    found = []
    for names in (Names(), Names(seed)):
        folder = tmp_path / str(len(found))
        folder.mkdir()
        monkeypatch.chdir(folder)
        # The roles are complete only after the call.
        result = case(names)
        found.append(by_role(result, names))
        plt.close("all")
    assert names.sort_otherwise()
    assert list(differences(*found, rtol)) == []


def test_exchanged_names_are_noticed():
    """A comparison that could not fail would prove nothing."""
    names = Names()
    scene, state = renamed(balls(), names)
    one = by_role(cj.parameters(scene), names)
    names["heavy"], names["light"] = names["light"], names["heavy"]
    assert list(differences(one, by_role(cj.parameters(scene), names), ROUNDING))

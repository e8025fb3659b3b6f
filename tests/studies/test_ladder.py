"""The ladder of sizes: its scenes, and the table and figure of its measurements."""

import json
import math
import re
import xml.etree.ElementTree as ElementTree
from importlib.util import find_spec

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import clearjoint as cj
from studies.benchmark import ladder, ladder_scenes, ladder_yardsticks
from studies.benchmark.__main__ import HERE
from studies.benchmark.chain import ideal_chain
from studies.benchmark.ladder import SIMULATE, Cost, exponent, figure, main, parse
from studies.benchmark.ladder_scenes import FEW, MANY, SCENES, humanoid, humanoid_urdf

DEGREES = {"backlash": 2, "ideal": 1, "humanoid": 1, "four-bars": 1}
"""Degrees of freedom for a unit of size."""


@pytest.mark.parametrize(("name", "size"), [("ideal", 3), ("humanoid", FEW), ("four-bars", 2)])
def test_scenes_start_closed_with_their_degrees_of_freedom(name, size):
    report = cj.constraint_report(*SCENES[name](size))
    assert max(abs(report.values)) < 1e-12
    assert max(abs(report.rates)) < 1e-12
    assert report.degrees_of_freedom() == DEGREES[name] * size
    assert not report.uncertain


@pytest.mark.parametrize("stages", [1, 3])
def test_scissor_lift_has_a_motion_and_two_more_for_each_pin_with_clearance(stages):
    scene, state = SCENES["scissor"](stages)
    report = cj.constraint_report(scene, state)
    plays = [joint for joint in scene.joints.values() if isinstance(joint, cj.ClearanceJoint)]
    assert len(plays) == stages - 1
    assert report.degrees_of_freedom() == 1 + 2 * len(plays)
    assert max(abs(report.values)) < 1e-12


def test_segments_are_a_whole_body_and_joints_as_many_as_asked_for():
    pelvis, single = 0.142, ("torso", "head")
    segments = ladder_scenes.SEGMENTS.items()
    masses = [one.mass if name in single else 2 * one.mass for name, one in segments]
    assert pelvis + sum(masses) == pytest.approx(1.0, abs=1e-12)
    for joints in (FEW, MANY):
        masses = ElementTree.fromstring(humanoid_urdf(joints)).iterfind(".//mass")
        total = sum(float(mass.get("value", "nan")) for mass in masses)
        assert total == pytest.approx((1.0 - pelvis) * ladder_scenes.MASS, rel=1e-12)
        assert len(humanoid(joints)[0].joints) == joints
    with pytest.raises(ValueError, match="joints must be 23 or 29, but is 24"):
        humanoid_urdf(24)


@pytest.mark.slow
def test_a_parallel_crank_swings_like_a_pendulum():
    """One four-bar is a pendulum with the inertia of two rods about their ends and of a point."""
    scene, state = ladder_scenes.four_bars(1)
    length, span = 0.2, 0.2
    inertia, moment = 2.0 * length**2 / 3.0 + length**2, 9.81 * 2.0 * length

    def rates(t, y):
        return y[1], -moment / inertia * math.cos(y[0])

    angle, _ = solve_ivp(rates, (0.0, span), (0.5, 0.0), rtol=1e-10, atol=1e-10).y[:, -1]
    final = cj.simulate(scene, state, span, progress=False).final
    expected = 0.5 * length * np.array([math.cos(angle), math.sin(angle), 0.0])
    np.testing.assert_allclose(final.bodies["crank 1"].position, expected, atol=2e-6)


def test_exponents_are_those_of_power_laws():
    sizes = [1, 3, 10, 30]
    assert exponent(sizes, [2.0 * n**1.5 for n in sizes]) == pytest.approx(1.5, rel=1e-12)
    assert math.isnan(exponent([1], [1.0]))


def test_figure_shows_each_scene_with_its_exponent():
    costs = [
        Cost(scene, n, call, 1.0 * n, 0.1 * n, 1e-3 * n, 1e-6 * n, 300.0)
        for scene in ("ideal", "backlash")
        for n in (1, 3, 10)
        for call in (SIMULATE, "sweep")
    ]
    costs.append(Cost("backlash", 30, SIMULATE, stopped=True))
    canvas = figure(costs)
    assert len(canvas.axes) == 8
    legend = canvas.axes[0].get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.texts] == ["ideal: 1.00", "backlash: 1.00"]
    assert costs[-1].cells() == ("backlash, 30", "simulate (stopped)", "", "", "", "", "")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["rope"], "NAME must be of backlash, .*, but is rope"),
        (["--write", "--quick"], "needs a full run"),
        (["--limit", "0"], "at least 1 s"),
    ],
)
def test_command_line_refuses(words, message, capsys):
    with pytest.raises(SystemExit):
        parse(words)
    assert re.search(message, capsys.readouterr().err)


def test_readme_has_a_place_for_the_table():
    text = (HERE / "README.md").read_text(encoding="utf-8")
    assert text.index("<!-- begin of the ladder -->") < text.index("<!-- end of the ladder -->")


def test_a_process_beyond_its_limit_keeps_what_it_has_printed():
    code = """
import os, signal, sys
print("{}", flush=True)
sys.stdout.write("{"); sys.stdout.flush()
os.kill(os.getpid(), signal.SIGXCPU)
"""
    assert ladder.lines_of_process(code) == (["{}\n"], True)
    with pytest.raises(RuntimeError, match="NameError"):
        ladder.lines_of_process("unknown")


@pytest.mark.slow
def test_quick_ladder(tmp_path):
    main(["--quick", "--output", str(tmp_path)])
    rows = json.loads((tmp_path / "ladder.json").read_text())["rows"]
    measured = [row for row in rows if "call" in row]
    assert [(row["scene"], row["size"]) for row in measured] == [("ideal", 1), ("ideal", 2)]
    for row in measured:
        assert all(row[part] > 0.0 for part in ("first", "kept", "again", "step", "memory"))
    assert (tmp_path / "ladder.png").stat().st_size > 5_000


@pytest.mark.slow
@pytest.mark.skipif(find_spec("mujoco") is None, reason="needs the extra mujoco")
@pytest.mark.parametrize("joints", [3, FEW])
def test_mujoco_moves_as_clearjoint(joints):
    """Both programs converge to the same positions, for the chain and for the humanoid."""
    is_chain = joints < FEW
    mechanism = ideal_chain(joints) if is_chain else humanoid(joints)
    model = ladder_yardsticks.chain_model(joints) if is_chain else humanoid_urdf(joints)
    here = ladder_yardsticks.Here(*mechanism)
    gravity = None if is_chain else ladder_yardsticks.GRAVITY
    there = ladder_yardsticks.MujocoTree(model, list(here.scene.bodies), gravity)
    np.testing.assert_allclose(there.run("RK4", 4096), here.run(1e-10), rtol=0.0, atol=1e-8)

"""The ladder of sizes: its scenes, and the table and figure of its measurements."""

import json
import xml.etree.ElementTree as ElementTree
from importlib.util import find_spec

import numpy as np
import pytest

import clearjoint as cj
from studies.benchmark import ladder, ladder_scenes, ladder_yardsticks
from studies.benchmark.chain import ideal_chain
from studies.benchmark.ladder import main
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

"""The study of robots: files of a folder, and a quick fit of a servo's log."""

import importlib.util

import pytest

from studies.robots import files, servo_joint
from studies.robots.__main__ import main
from studies.robots.geared_joint import URDF

ARM = URDF.format(inertia=0.01)
TIP = '<link name="tip"/><joint name="wrist" type="continuous"><parent link="arm"/>'
TIP += '<child link="tip"/></joint></robot>'
TWO = """<mujoco><worldbody><body name="a"><joint name="j"/><joint name="k" axis="1 0 0"/>
<geom size="0.1" pos="0.3 0.2 0"/></body></worldbody></mujoco>"""
TEXTS = {
    "arm.urdf": ARM,
    "light.urdf": ARM.replace("</robot>", TIP),
    "loop.urdf": ARM.replace('<parent link="base"/>', '<parent link="nowhere"/>'),
    "two.xml": TWO,
    "other.xml": "<note/>",
}


def test_files_are_loaded_as_messages_say_and_compared(tmp_path):
    (tmp_path / "deep").mkdir()
    for name, text in TEXTS.items():
        (tmp_path / "deep" / name).write_text(text)
    rows = {row.name: row for row in files.survey(tmp_path)}
    has_mujoco = importlib.util.find_spec("mujoco") is not None
    has_pinocchio = importlib.util.find_spec("pinocchio") is not None
    # Without the other program, a file is not compared and left out.
    absent = set() if has_mujoco else {"two.xml"}
    absent |= set() if has_pinocchio else {"arm.urdf"}
    assert rows.keys() == TEXTS.keys() - {"other.xml"} - absent
    for name in {"arm.urdf", "two.xml"} - absent:
        assert rows[name].difference is not None and rows[name].difference < 1e-12
    assert rows["light.urdf"].options == {"bound_mass": 1e-3, "bound_inertia": 1e-6}
    assert "nowhere" in rows["loop.urdf"].refused
    assert (
        "| refused, with element and remedy | 1 |" in main(["files", "--files", str(tmp_path)])[0]
    )


@pytest.mark.slow
def test_a_short_log_of_a_servo_is_fitted():
    rows, first = servo_joint.measure(quick=True)
    assert [row[0] for row in rows[1:5]] == list(servo_joint.TRUTH)
    assert first.mean_square < 1.3
    assert all(first.holds(name) for name in servo_joint.TRUTH)
    assert len(servo_joint.figure(first).axes) == 2

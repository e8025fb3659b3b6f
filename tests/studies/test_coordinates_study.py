"""The comparison of coordinates runs in its quick setting."""

from studies.coordinates.__main__ import main


def test_joint_coordinates_take_fewer_operations_and_do_not_drift(capsys):
    main(["--quick"])
    lines = capsys.readouterr().out.splitlines()
    absolute, joint = ([cell.strip() for cell in line.split("|")] for line in lines[2:])
    assert (absolute[2], joint[2]) == ("absolute", "joint")
    assert 0.0 < float(joint[4]) < 0.5 * float(absolute[4])
    assert float(joint[8]) < 1e-14

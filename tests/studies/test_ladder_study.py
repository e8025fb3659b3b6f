"""The ladder of models runs in its quick setting."""

from studies.ladder.__main__ import main


def test_rigid_contact_is_near_the_reference_and_has_no_derivative(capsys):
    main(["--quick"])
    lines = capsys.readouterr().out.splitlines()
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in lines if line]
    cost, slope = rows[2], rows[5]
    assert cost[0] == slope[0] == "rigid, h = 1e-4 s"
    assert int(cost[1]) == 40_000 and 0.0 < float(cost[4]) < 15.0
    forward, near, far, reference = (float(cell) for cell in slope[1:])
    assert forward == near == 0.0
    assert abs(far / reference - 1.0) < 0.5

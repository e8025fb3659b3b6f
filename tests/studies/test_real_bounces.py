"""The study of bouncing balls, on small files of the same form with known truth."""

import numpy as np
import pytest

import clearjoint as cj
from studies.real_bounces import ball as balls
from studies.real_bounces.__main__ import main
from studies.real_bounces.ball import flight_time, landing_speed
from studies.real_bounces.bounce_files import read_balls
from studies.real_bounces.bounce_fit import fit, from_drops, from_intervals
from studies.real_bounces.throws import BALLS

TENNIS_TABLE, GOLF = 1, 4
LOSS, POWER = 0.1, 0.3


def restitution(speed):
    return 1.0 - LOSS * speed**POWER


def throw(launch, count, terminal, scatter, generator):
    """Return the intervals of a ball that follows the law, in closed form."""
    intervals = []
    for _ in range(count):
        intervals.append(flight_time(launch, terminal))
        landing = landing_speed(launch, terminal)
        launch = landing * (restitution(landing) + scatter * generator.standard_normal())
    return intervals


def written(name, rows):
    return f"{name} = np.array([\n" + ",\n".join(f"    {[*map(float, r)]}" for r in rows) + "\n])\n"


def drops(number, terminal, generator):
    """Return heights and rebounds in cm, by integration of fall and rise in small steps."""
    heights, rebounds = np.linspace(0.2, 1.1, 5), []
    for height in heights:
        e = restitution(fallen(height, terminal)) + 2e-3 * generator.standard_normal(8)
        rebounds.append([100 * risen(x * fallen(height, terminal), terminal) for x in e])
    columns = written(f"pallina{number}_H0", 100 * heights[:, None])
    return columns + written(f"pallina{number}_H1", rebounds)


def fallen(height, terminal, steps=4000):
    """Return the speed after a fall: d(v^2/2) = g (1 - v^2/terminal^2) dh, by Euler."""
    square = 0.0
    for _ in range(steps):
        square += 2 * 9.81 * (1 - square / terminal**2) * height / steps
    return np.sqrt(square)


def risen(speed, terminal, step=5e-5):
    """Return the height by dh = v dt, dv = -g (1 + v^2/terminal^2) dt."""
    height = 0.0
    while speed > 0.0:
        height += (speed - 0.5 * 9.81 * step) * step
        speed -= 9.81 * (1 + (speed / terminal) ** 2) * step
    return height


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Files of two balls with drag in the repository's format; a throw has a copied interval."""
    generator = np.random.default_rng(1)
    path = tmp_path_factory.mktemp("bounces")
    intervals, heights = "import numpy as np\nfrom missing_module import *\n", ""
    for number in (TENNIS_TABLE, GOLF):
        terminal = BALLS[number].terminal
        for series, launch in enumerate((1.2, 1.8, 2.6), 1):
            columns = [throw(launch, 6, terminal, 2e-3, generator) for _ in range(8)]
            if number == GOLF and series == 1:
                columns[2][4] = columns[2][3]
            rows = np.transpose(columns)
            intervals += written(f"pallina{number}_intervalli_h{series}", rows)
        intervals += f"print(pallina{number}_intervalli_h1)\n"
        heights += drops(number, terminal, generator)
    for name, text in (("Method1", heights), ("Method2", intervals)):
        (path / name).mkdir()
        (path / name / "data.py").write_text(text)
    return path


def test_true_restitution_is_recovered_within_its_errors(folder):
    """From intervals and from heights with drag; without drag the fit is far off."""
    ball = read_balls([folder])[TENNIS_TABLE]
    points = from_intervals(ball.series, BALLS[TENNIS_TABLE].terminal)
    assert len(points.speed) == 3 * 8 * 5 and points.left_out == ()
    assert points.scatter == pytest.approx(2e-3, rel=0.2)
    dropped = from_drops(ball.drops, BALLS[TENNIS_TABLE].terminal)
    for found in (fit(points, constant=False), fit(dropped, constant=False)):
        errors = (np.array(found.values) - (LOSS, POWER)) / found.errors
        assert np.abs(errors).max() < 3.0
        assert max(found.errors) < 0.02
        assert found.error_at(np.array([1.5]))[0] < 1e-3
    in_vacuum = fit(from_intervals(ball.series, np.inf), constant=False)
    assert abs(in_vacuum.values[1] - POWER) > 5.0 * in_vacuum.errors[1]


def test_copied_interval_ends_its_throw(folder):
    points = from_intervals(read_balls([folder])[GOLF].series, np.inf)
    (line,) = points.left_out
    assert "series 1, throw 3: from interval 5" in line
    assert len(points.speed) == 3 * 8 * 5 - 2


def test_impossible_readings_are_left_out_and_named():
    generator = np.random.default_rng(2)
    rows = np.transpose([throw(2.0, 4, np.inf, 1e-3, generator) for _ in range(9)])
    rows[2, 4] *= 1.2
    points = from_intervals((rows,), np.inf)
    assert len(points.left_out) == 2 and all("scatters from" in line for line in points.left_out)
    assert len(points.speed) == 9 * 3 - 2


@pytest.mark.slow
def test_simulated_ball_keeps_to_the_closed_form():
    """The duration of contacts is the remaining difference."""
    terminal = BALLS[TENNIS_TABLE].terminal
    expected = throw(2.5, 6, terminal, 0.0, np.random.default_rng())
    law = balls.RestitutionOverSpeed(LOSS, POWER, cj.laws.Hertz(1e8))
    ball = BALLS[TENNIS_TABLE]
    made = balls.scene(law, ball.mass, ball.diameter, terminal)
    found = balls.simulated_intervals(made, expected[0], terminal, 6)
    np.testing.assert_allclose(found, expected, rtol=5e-4)


@pytest.mark.slow
def test_quick_study_writes_its_figures(folder, tmp_path, capsys):
    main([str(folder), "--quick", "--output", str(tmp_path)])
    assert {file.name for file in tmp_path.iterdir()} == {"restitution.png", "intervals.png"}
    printed = capsys.readouterr().out
    assert "table tennis" in printed and "golf" in printed


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("x = 1\n", "No arrays named like pallina1_intervalli_h1"),
        ("pallina1_intervalli_h1 = np.array([[1, 2], [3]])\n", "rows of equal length"),
        ("pallina1_intervalli_h1 = np.array([[0.4, 0.3], [-0.1, 0.2]])\n", r"\[\[1, 0\]\]"),
    ],
)
def test_files_without_measurements_are_refused(tmp_path, text, said):
    (tmp_path / "data.py").write_text(text)
    with pytest.raises(ValueError, match=said):
        read_balls([tmp_path / "data.py"])


def test_computed_arrays_of_scripts_are_no_data(folder, tmp_path):
    """A script beside the data reduces a table: the table of the data file is read."""
    (tmp_path / "data.py").write_text((folder / "Method1" / "data.py").read_text())
    script = "pallina1_H0 = np.delete(data.pallina1_H0, [0], axis=0)\npallina1_H1 = rebounds\n"
    (tmp_path / "script.py").write_text(script)
    assert len(read_balls([tmp_path])[TENNIS_TABLE].drops.heights) == 5
